"""What a job commands, before it is simulated."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from gantrysim.base.arrays import Floats, dot, extremes
from gantrysim.base.columns import blocks
from gantrysim.base.errors import InputError
from gantrysim.base.memory import needed_files, needed_memory
from gantrysim.controllers.controller import Controller
from gantrysim.engine.positions import axis_positions
from gantrysim.job.settings import ServoSettings
from gantrysim.machine.machine import Machine
from gantrysim.record.setpoints import Setpoints

# Checks against the machine: the program's frame and geometry, and the number of values in a servo file.

_PROBES = 64  # places along the path
_SAME_HEIGHT = 1e-6  # difference of heights that is rounding [mm]
_OFF_PATH = 1.0  # distance of the commanded tip from the path beyond which the geometry is another [mm]


def check_fit(machine: Machine, controller: Controller, setpoints: Setpoints, name: str) -> None:
    """Raise InputError for a program in another frame, or for another geometry, than its machine's.

    On a machine that turns its work, programs give positions of the axes: they must put the nozzle on the requested
    path.

    Args:
        machine: the machine.
        controller: the motion controller with its program.
        setpoints: its own.
        name: of the controller, for the message.
    """
    if controller.commands_axes and not machine.turns_work:
        raise InputError(
            f"{name} gives positions of the axes of a machine that turns its work, but machine {machine.name} does "
            "not: use machine stage"
        )
    if not machine.turns_work:
        _check_height(machine, controller, setpoints, name)
        return
    on = np.flatnonzero(setpoints.dispense)
    if not on.size:
        return
    ticks = on[np.linspace(0, on.size - 1, min(_PROBES, on.size)).astype(int)]
    tip = machine.tip(axis_positions(machine, setpoints)[ticks])
    off = float(controller.requested.project(tip).distance.max())
    if off > _OFF_PATH:
        reason = (
            "its sigma, needle, centre, work_centre or normal are not those of the machine"
            if controller.commands_axes
            else f"it gives positions in the work frame, but machine {machine.name} turns its work and takes positions "
            "of its axes; use a machine such as xy, or a program such as stage.OutlineTrace"
        )
        raise InputError(
            f"{name}: on machine {machine.name} its positions put the nozzle up to {off:.4g} mm off the requested "
            f"path: {reason}"
        )


def _check_height(machine: Machine, controller: Controller, setpoints: Setpoints, name: str) -> None:
    """Raise InputError for a program that lies at another height than the nozzle, and commands none."""
    if "z" in setpoints.axes:
        return
    held = float(machine.tip(axis_positions(machine, setpoints)[:1])[0, 2])
    height = float(controller.requested.position(0.0)[0, 2])
    if abs(height - held) > _SAME_HEIGHT:
        raise InputError(
            f"{name}: its path lies at z = {height:.4g} mm, but it commands no z, and machine {machine.name} holds its "
            f"nozzle at z = {held:.4g} mm: add {held - height:.4g} to program.placement.z, or move z in the program"
        )


def check_servo_file(file: Path, servo: ServoSettings, machine: Machine) -> None:
    """Raise InputError where a list of a servo file has another number of values than the machine has axes."""
    axes = machine.axis_names
    for name, value in servo:
        if name != "law" and isinstance(value, list) and len(value) != len(axes):
            raise InputError(
                f"servo {file}: {name} has {len(value)} values: must be one or {len(axes)}, of the axes "
                f"{', '.join(axes)} of machine {machine.name}"
            )


_REACHED_SPEED = 0.98  # share of a speed that counts as reached: setpoints are samples


@dataclass(frozen=True)
class Extent:
    """Least and largest value of a quantity of an axis, and its bounds on the machine."""

    least: float
    largest: float
    bounds: tuple[float, float]


@dataclass(frozen=True)
class Plan:
    """What a job commands.

    Attributes:
        machine: name of the machine.
        controller: name of the motion controller.
        length: of the requested path [mm].
        way: of the commanded tip, with all dry moves [mm].
        glue: way with the dispenser on [mm].
        standing_time: at rest with the dispenser on, in which dots are laid [s].
        duration: of the program's motion [s].
        ticks: servo ticks of a run, see `Setpoints.run_ticks`.
        period: servo period [s].
        memory: that a run with all its figures needs, estimated [B].
        files: room in temporary files that it needs, estimated; 0 for none [B].
        speed: largest speed of the tip [mm/s].
        glue_speed: the same with the dispenser on; 0 where it never is [mm/s].
        box: least and largest x, y and z of the tip in the work frame, (2, 3) [mm].
        travel: positions of each axis, by its name [mm or deg].
        speeds: largest speed of each axis, by its name [mm/s or deg/s].
        units: unit of each axis, by its name.
        dryness: why no glue is laid, in words, if none is.
    """

    machine: str
    controller: str
    length: float
    way: float
    glue: float
    standing_time: float
    duration: float
    ticks: int
    period: float
    memory: float
    files: float
    speed: float
    glue_speed: float
    box: Floats
    travel: dict[str, Extent]
    speeds: dict[str, Extent]
    units: dict[str, str]
    dryness: str


def plan_of(
    machine: Machine, name: str, setpoints: Setpoints, controller: Controller, *, is_checked: bool = True
) -> Plan:
    """Return what setpoints command.

    Args:
        machine: that runs them.
        name: of the motion controller.
        setpoints: of the run.
        controller: with its program.
        is_checked: whether positions and speeds are checked against the machine's.

    Raises:
        InputError: an unknown axis; if checked, also a position outside the travel, or a speed above the limit.
    """
    sums = _checked_sums(machine, setpoints) if is_checked else _sums(machine, setpoints, is_checked=False)
    low, high = sums.positions
    axes = list(enumerate(machine.axes))
    return Plan(
        machine=machine.name,
        controller=name,
        length=controller.requested.length,
        way=sums.way,
        glue=sums.glue,
        standing_time=sums.resting * setpoints.period,
        duration=controller.duration,
        ticks=setpoints.run_ticks,
        period=setpoints.period,
        memory=needed_memory(setpoints.run_ticks),
        files=needed_files(setpoints.run_ticks),
        speed=sums.longest / setpoints.period,
        glue_speed=sums.longest_glue / setpoints.period,
        box=sums.box,
        travel={axis.name: Extent(float(low[a]), float(high[a]), axis.travel) for a, axis in axes},
        speeds={
            axis.name: Extent(0.0, float(sums.steps[a]) / setpoints.period, (0.0, axis.speed_limit)) for a, axis in axes
        },
        units={axis.name: axis.unit for axis in machine.axes},
        dryness=controller.dryness,
    )


_STANDSTILL_WAY = 1e-9  # way in a tick; more is motion [mm]


class _Sums(NamedTuple):
    """What consecutive setpoints command.

    Attributes:
        way, glue: of the tip, in all and with the dispenser on [mm].
        resting: ticks with the dispenser on in which it stands.
        longest, longest_glue: way of the tip between two setpoints, in all and with the dispenser on [mm].
        box: least and largest x, y and z of the tip, (2, 3) [mm].
        positions: least and largest position of the axes, (2, axes) [mm or deg].
        steps: largest step of the axes between two setpoints, (axes,) [mm or deg].
    """

    way: float
    glue: float
    resting: int
    longest: float
    longest_glue: float
    box: Floats
    positions: Floats
    steps: Floats

    @classmethod
    def of(cls, machine: Machine, setpoints: Setpoints, *, is_checked: bool) -> _Sums:
        """Return what a block of setpoints commands."""
        position = axis_positions(machine, setpoints, is_checked=is_checked)
        tip = machine.tip(position)
        steps = np.diff(tip, axis=0)
        ways = np.sqrt(dot(steps, steps))
        glue_ways = ways[setpoints.dispense[:-1]]
        return cls(
            float(ways.sum()),
            float(glue_ways.sum()),
            int(np.count_nonzero(glue_ways <= _STANDSTILL_WAY)),
            float(ways.max(initial=0)),
            float(glue_ways.max(initial=0)),
            extremes(tip),
            extremes(position),
            extremes(np.abs(np.diff(position, axis=0, prepend=position[:1])))[1],
        )

    def combined_with(self, other: _Sums) -> _Sums:
        """Return what these and other setpoints command."""
        return _Sums(
            self.way + other.way,
            self.glue + other.glue,
            self.resting + other.resting,
            max(self.longest, other.longest),
            max(self.longest_glue, other.longest_glue),
            _widest(self.box, other.box),
            _widest(self.positions, other.positions),
            np.maximum(self.steps, other.steps),
        )


def _widest(first: Floats, second: Floats) -> Floats:
    """Return the least and largest values of two pairs of rows."""
    return np.array([np.minimum(first[0], second[0]), np.maximum(first[1], second[1])])


def _sums(machine: Machine, setpoints: Setpoints, *, is_checked: bool) -> _Sums:
    """Return what setpoints command, block by block: a long program's arrays would fill the memory."""
    sums: _Sums | None = None
    for block in blocks(len(setpoints.position) - 1):
        rows = slice(block.start, block.stop + 1)
        part = _Sums.of(machine, setpoints.part(rows), is_checked=is_checked)
        sums = part if sums is None else sums.combined_with(part)
    # there are two setpoints at least
    assert sums is not None
    return sums


def _checked_sums(machine: Machine, setpoints: Setpoints) -> _Sums:
    try:
        return _sums(machine, setpoints, is_checked=True)
    except InputError:
        # names the worst place of the whole program
        axis_positions(machine, setpoints)
        raise


def glue_note(plan: Plan) -> str | None:
    """Return a note where a program lays no glue at all; None where it lays some."""
    if plan.glue > 0 or plan.standing_time > 0:
        return None
    return f"no glue is laid: {plan.dryness}"


def speed_note(plan: Plan, speed: float) -> str | None:
    """Return a note where glue is not laid at the speed that a program is run at; None where it is.

    Args:
        plan: of the program at that speed.
        speed: of its fastest motion [mm/s].
    """
    if not plan.glue_speed or plan.glue_speed >= _REACHED_SPEED * speed:
        return None
    return (
        f"--speed {speed:g} does not act in full: glue is laid at {plan.glue_speed:.4g} mm/s at most, as acceleration, "
        "corners or the machine's speeds limit it."
    )
