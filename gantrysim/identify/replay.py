"""A recorded command sent again to the simulated machine: its motion and torque beside those of the log.

No program, path or glue is needed, and nothing is fitted: the simulated axes begin in the log's first position and
velocity, under the given servo, and both following errors are taken at the same rows.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError
from gantrysim.base.progress import Progress
from gantrysim.base.quantity import number_text
from gantrysim.engine.simulate import simulate
from gantrysim.engine.simulation import Start
from gantrysim.identify.log import Log, Rows, read_log
from gantrysim.machine.ideal import frictionless_machine
from gantrysim.machine.machine import Machine
from gantrysim.metrics.analysis import ErrorSize
from gantrysim.paths.chain import Chain
from gantrysim.paths.pieces import Line
from gantrysim.record.run import Run
from gantrysim.record.setpoints import Setpoints
from gantrysim.servo.laws.user import PlainLaw
from gantrysim.servo.servo import Servo
from gantrysim.tables.reading import read_table
from gantrysim.tables.units import spaced_name

# The log, with the command that was sent.

COMMAND = "command"
DISTURBANCE = "disturbance"
_FURTHER_COLUMNS = (COMMAND, DISTURBANCE)


@dataclass(frozen=True, eq=False)
class CommandedLog:
    """A log of a machine's axes, with the command that they followed.

    Attributes:
        log: of position and torque.
        command: positions sent to the servo, (n, axes) [mm or deg].
        disturbance: known torque that was added to the motors', (n, axes) [N·m]; None for none.
        first: number of its first row in its file, from 1; None where rows are missing before or in it.
    """

    log: Log
    command: Floats
    disturbance: Floats | None = None
    first: int | None = 1

    @classmethod
    def of(cls, run: Run) -> CommandedLog:
        """Return the log of a run."""
        return cls(Log.of(run), np.array(run.commanded))


def read_commanded_log(
    file: str | Path,
    machine: Machine,
    columns: Mapping[str, str] | None = None,
    period: float | None = None,
    rows: Rows | None = None,
) -> CommandedLog:
    """Read a log as `read_log` does, with the columns of the command, such as `x command [mm]` or `commanded_x_mm`.

    An axis without a command is left out. A column such as `x disturbance [N·m]` holds a known torque that was added
    to the motor's.

    Args:
        file: of the log.
        machine: whose axes are logged.
        columns: sources by names, as in {"x command": "DPOS AXIS(0) [mm]", "x position": "MPOS AXIS(0) [mm]"}.
        period: of the samples, for a log without time or with rounded stamps [s].
        rows: that are read.

    Raises:
        InputError: as `read_log`, or no axis has a command.
    """
    given = dict(columns or {})
    further = {name: given.pop(name) for name in list(given) if name.rpartition(" ")[2] in _FURTHER_COLUMNS}
    log = read_log(file, machine, given, period, rows)
    table = read_table(file)
    heads = _further_columns(table.order, machine) | further
    commands = {axis: heads[f"{axis} {COMMAND}"] for axis in log.axes if f"{axis} {COMMAND}" in heads}
    if not commands:
        axis = log.axes[0]
        raise InputError(
            f"log {file}: has the command of no axis with position and torque: must have a column such as {axis} "
            f"{COMMAND} [{_unit(machine, axis)}], or be told it by --column '{axis} {COMMAND}=COLUMN'"
        )
    of_axes = [log.axes.index(axis) for axis in commands]
    kind = "demand" if log.held else "torque"

    def read_as(quantity: str, sources: Mapping[str, str]) -> Log:
        named = {f"{axis} {quantity}": source for axis, source in sources.items()}
        other = read_log(file, machine, given | named, period, rows)
        if other.position.shape != log.position.shape or other.starts != log.starts:
            raise InputError(
                f"log {file}: its columns of {', '.join(sources.values())} have gaps where others have none"
            )
        return other

    command = read_as("position", commands).position[:, of_axes]
    torques = {axis: heads[f"{axis} {DISTURBANCE}"] for axis in commands if f"{axis} {DISTURBANCE}" in heads}
    disturbance = None
    if torques:
        read = read_as(kind, torques).torque
        disturbance = np.stack(
            [read[:, k] if axis in torques else np.zeros(len(read)) for k, axis in zip(of_axes, commands, strict=True)],
            axis=1,
        )
    commanded = replace(log, axes=tuple(commands), position=log.position[:, of_axes], torque=log.torque[:, of_axes])
    piece = max(log.pieces, key=lambda piece: piece.stop - piece.start)
    disturbance = None if disturbance is None else disturbance[piece]
    chosen = (rows or Rows()).of(len(next(iter(table.columns.values()))), f"log {file}")
    is_whole = len(log.starts) == 1 and len(log.position) == chosen.stop - chosen.start
    return CommandedLog(commanded.longest, command[piece], disturbance, chosen.start + 1 if is_whole else None)


def _further_columns(names: tuple[str, ...], machine: Machine) -> dict[str, str]:
    """Return the columns of commands and disturbances that are named so, by "x command" and "x disturbance"."""
    words = {}
    for axis in machine.plain_axes:
        for text in (f"{axis.name} command", f"{axis.name} commanded", f"commanded {axis.name}"):
            words[text] = words[f"{text} {axis.unit}"] = f"{axis.name} {COMMAND}"
        words[f"{axis.name} {DISTURBANCE}"] = words[f"{axis.name} {DISTURBANCE} Nm"] = f"{axis.name} {DISTURBANCE}"
    columns: dict[str, str] = {}
    for column in names:
        name = words.get(spaced_name(column))
        if name is not None:
            columns.setdefault(name, column)
    return columns


def _unit(machine: Machine, axis: str) -> str:
    return machine.axes[machine.axis_names.index(axis)].unit


# The simulated machine under the recorded command.

_NO_PATH = Chain([Line((0.0, 0.0, 0.0), (1.0, 0.0, 0.0))])  # nothing is laid, so no path is compared
_START_TIME = 0.01  # time over which the first position and velocity are fitted [s]
_START_SAMPLES = 5  # samples of that
_RESTING_COUNTS = 1.5  # counts of the encoder by which an axis at rest moves
_SURE_DEVIATIONS = 4.0  # deviations by which a velocity must differ from zero
_STEADY_DEVIATION = 0.005  # of the way in that time, from a parabola, up to which an axis is in steady motion


@dataclass(frozen=True, eq=False)
class Replay:
    """A log, and the simulated machine under its command.

    Attributes:
        recorded: the log; moved where it was outside of the travel, see `notes`.
        machine: that was simulated.
        run: its record, row by row beside the log.
        frictionless: the same of the machine without friction, under the same servo; None where a fault ended it.
        fitted: rows to which the machine was fitted, all others are held out; None where that is not known.
        notes: what was changed, or is missing.
    """

    recorded: CommandedLog
    machine: Machine
    run: Run
    frictionless: Run | None
    fitted: slice | None
    notes: tuple[str, ...]

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of the axes."""
        return self.recorded.log.axes

    @property
    def fitted_count(self) -> int:
        """Number of the rows to which the machine was fitted."""
        return 0 if self.fitted is None else len(range(*self.fitted.indices(len(self.recorded.command))))

    @property
    def is_partly_held_out(self) -> bool:
        """Whether some rows are held out, and others not."""
        return 0 < self.fitted_count < len(self.recorded.command)

    def following(self, axis: str, run: Run | None = None) -> Floats:
        """Return the following error of an axis, of the log or of a run, (n,) [mm or deg]."""
        k = self.axes.index(axis)
        command = self.recorded.command[:, k]
        position = self.recorded.log.position[:, k] if run is None else run.encoder[:, run.axes.index(axis)]
        return command - position

    def torque(self, axis: str, run: Run | None = None) -> Floats:
        """Return the torque of an axis at the motor shaft, of the log or of a run, (n,) [N·m].

        It is the demand where the log has that, else the motor's.
        """
        if run is None:
            return self.recorded.log.torque[:, self.axes.index(axis)]
        torque = run.demand if self.recorded.log.held else run.torque
        return torque[:, run.axes.index(axis)]

    def parts(self, axis: str) -> dict[str, NDArray[np.bool_]]:
        """Return the rows of each part, (n,) each: all, held out and fitted, around reversals and elsewhere."""
        rows = np.ones(len(self.recorded.command), bool)
        near = near_reversals(self.recorded.command[:, self.axes.index(axis)], self.run.period, self._least(axis))
        parts = {"all": rows}
        if self.is_partly_held_out:
            of_fit = np.zeros(len(rows), bool)
            of_fit[self.fitted] = True
            parts |= {"held out": ~of_fit, "fitted": of_fit}
        named = {}
        for name, mask in parts.items():
            before = "" if name == "all" else f"{name}, "
            named[name] = mask
            if (mask & near).any() and (mask & ~near).any():
                named |= {f"{before}reversals": mask & near, f"{before}elsewhere": mask & ~near}
        return named

    def _least(self, axis: str) -> float:
        """Return by how much a command must turn back for a reversal [mm or deg]."""
        command = self.recorded.command[:, self.axes.index(axis)]
        return max(_TURN * float(np.ptp(command)), 2 * self._axis_resolution(axis))

    def _axis_resolution(self, axis: str) -> float:
        return self.machine.axes[self.machine.axis_names.index(axis)].resolution

    def compared(self, axis: str, quantity: str) -> dict[str, Compared]:
        """Return the sizes of a quantity of an axis in the parts of the log.

        Args:
            axis: its name.
            quantity: "following" error or "torque".
        """
        values = self.following if quantity == "following" else self.torque
        measured = values(axis)
        simulated = values(axis, self.run)
        wrong = None if self.frictionless is None else values(axis, self.frictionless)
        return {
            name: Compared(
                rows=int(np.count_nonzero(mask)),
                measured=ErrorSize.of(measured[mask]),
                simulated=ErrorSize.of(simulated[mask]),
                difference=ErrorSize.of((measured - simulated)[mask]),
                frictionless=None if wrong is None else ErrorSize.of((measured - wrong)[mask]),
            )
            for name, mask in self.parts(axis).items()
        }


@dataclass(frozen=True)
class Compared:
    """Sizes of a quantity in a part of a log; following errors in mm or deg, torques in N·m.

    Attributes:
        rows: of the part.
        measured: of the log.
        simulated: of the machine.
        difference: of the two, row by row.
        frictionless: of the log and the machine without friction; None where that was not simulated.
    """

    rows: int
    measured: ErrorSize
    simulated: ErrorSize
    difference: ErrorSize
    frictionless: ErrorSize | None

    @property
    def share(self) -> float | None:
        """Share of the measured mean square that the simulation explains, None where nothing is measured."""
        return _explained_share(self.measured, self.difference)

    @property
    def frictionless_share(self) -> float | None:
        """The same of the machine without friction."""
        return None if self.frictionless is None else _explained_share(self.measured, self.frictionless)


def _explained_share(measured: ErrorSize, difference: ErrorSize) -> float | None:
    return 1 - (difference.rms / measured.rms) ** 2 if measured.rms > 0 else None


def replay(
    machine: Machine,
    recorded: CommandedLog,
    servo: Servo | None = None,
    *,
    law: PlainLaw | None = None,
    fitted: slice | None = None,
    progress: Progress = None,
) -> Replay:
    """Send the command of a log to a simulated machine, and to the same without friction.

    Args:
        machine: that is simulated.
        recorded: the log with its command.
        servo: of the machine's axes, at the log's period; by default `Servo.derive`.
        law: law in plain Python in place of the servo's own.
        fitted: rows of the log to which the machine was fitted; all others are held out.
        progress: as of `simulate`.

    Raises:
        InputError: a servo of another period, a command beyond the travel or the speed of an axis, or a fault that
            ends the run.
    """
    log = recorded.log
    for name in log.axes:
        if machine.axes[machine.axis_names.index(name)].mode == "stepper":
            raise InputError(f"axis {name} is a stepper in open loop: only drives in a closed loop can be replayed")
    if servo is None:
        servo = Servo.derive(machine.axes, log.period)
    if not math.isclose(servo.period, log.period, rel_tol=1e-6):
        raise InputError(f"servo period = {servo.period:g} s: must be the period of the log, {log.period:g} s")
    placed, notes = _log_within_travel(machine, recorded)
    run = _simulated_run(machine, servo, placed, law, progress)
    if run.fault is not None:
        raise InputError(f"the simulated machine {machine.name} does not follow the log to its end: {run.fault}")
    wrong: Run | None = _simulated_run(frictionless_machine(machine), servo, placed, law, progress)
    if wrong is not None and wrong.fault is not None:
        notes.append(f"without friction the simulated machine does not follow the log to its end: {wrong.fault}")
        wrong = None
    return Replay(placed, machine, run, wrong, fitted, (*log.notes, *notes))


def _log_within_travel(machine: Machine, recorded: CommandedLog) -> tuple[CommandedLog, list[str]]:
    """Return the log within the travel, and notes on axes that had to be moved there.

    An encoder that counts from another zero puts the whole log outside; the motion is the same wherever it lies.
    """
    notes = []
    moves = np.zeros(len(recorded.log.axes))
    for k, name in enumerate(recorded.log.axes):
        axis = machine.axes[machine.axis_names.index(name)]
        low, high = axis.travel
        least, most = (float(limit(recorded.command[:, k])) for limit in (np.min, np.max))
        if (low <= least and most <= high) or most - least > high - low or not machine.kinematics.axes_are_coordinates:
            continue
        moves[k] = 0.5 * (low + high) - 0.5 * (least + most)
        move = number_text(moves[k], "+.4g")
        notes.append(
            f"{name}: the log's command, {least:.4g} to {most:.4g} {axis.unit}, lies outside of the travel, {low:g} to "
            f"{high:g} {axis.unit}: moved by {move} {axis.unit}, as from another zero of its encoder"
        )
    if not notes:
        return recorded, notes
    log = replace(recorded.log, position=recorded.log.position + moves)
    return replace(recorded, log=log, command=recorded.command + moves), notes


def _simulated_run(
    machine: Machine, servo: Servo, recorded: CommandedLog, law: PlainLaw | None, progress: Progress
) -> Run:
    log = recorded.log
    setpoints = Setpoints(
        servo.period,
        log.axes,
        recorded.command,
        np.zeros(len(recorded.command), bool),
        _NO_PATH,
        torque=recorded.disturbance,
    )
    return simulate(machine, servo, setpoints, law=law, progress=progress, start=_start(machine, recorded))


def _start(machine: Machine, recorded: CommandedLog) -> Start:
    """Return the first position, velocity and torque of the log; axes that it has not are at zero."""
    log = recorded.log
    position, velocity, commanded, torque = np.zeros((4, len(machine.plain_axes)))
    for k, name in enumerate(log.axes):
        a = machine.axis_names.index(name)
        position[a], velocity[a] = _first_motion(log.position[:, k], log.period, machine.axes[a].resolution)
        torque[a] = log.torque[0, k]
        if velocity[a]:
            before, here, after = recorded.command[:3, k]
            # the velocity over the period before the first row, at the acceleration of those behind it
            commanded[a] = ((here - before) - (after - 2 * here + before)) / log.period
    return Start(position, velocity, commanded, torque)


def _first_motion(position: Floats, period: float, count: float) -> tuple[float, float]:
    """Return position and velocity of an axis at the first row of its positions, (n,) [mm or deg] and per s.

    They are those of a parabola through the first rows, where these lie on one; an axis that starts within them does
    not, and has the velocity of its first step alone. A velocity within the encoder's counts is none.
    """
    first = position[: max(_START_SAMPLES, round(_START_TIME / period))]
    time = period * np.arange(first.size)
    terms = np.stack([np.ones(first.size), time, time**2], axis=1)
    parabola = np.linalg.lstsq(terms, first, rcond=None)[0]
    place, velocity, _ = parabola.tolist()
    off = float(np.std(first - terms @ parabola))
    if off <= max(count, _STEADY_DEVIATION * float(np.ptp(first))):
        deviation = max(off, count / math.sqrt(12)) * math.sqrt(np.linalg.inv(terms.T @ terms)[1, 1])
        if abs(velocity) > _SURE_DEVIATIONS * deviation:
            return place, velocity
        return float(first[0]), 0.0
    step = float(first[1] - first[0])
    return float(first[0]), step / period if abs(step) > _RESTING_COUNTS * count else 0.0


# Where the command turns back.

_TURN = 1e-3  # of its span, by which a command must turn back for a reversal
_BEFORE_REVERSAL = 0.02  # time before a reversal that counts as around it [s]
_AFTER_REVERSAL = 0.1  # and after it [s]


def near_reversals(command: Floats, period: float, least: float) -> NDArray[np.bool_]:
    """Return whether rows lie around a reversal of the command, from 20 ms before to 100 ms after it, (n,).

    Args:
        command: of an axis, (n,) [mm or deg].
        period: of the rows [s].
        least: by how much the command must turn back [mm or deg].
    """
    near = np.zeros(command.size, bool)
    for row in _turns(command, least):
        near[max(row - round(_BEFORE_REVERSAL / period), 0) : row + round(_AFTER_REVERSAL / period) + 1] = True
    return near


def _turns(command: Floats, least: float) -> list[int]:
    """Return the last rows at which the command is at an extreme from which it then turns back."""
    turns = []
    highest = lowest = 0
    rising: bool | None = None
    for row, place in enumerate(command.tolist()):
        if place >= command[highest]:
            highest = row
        if place <= command[lowest]:
            lowest = row
        if rising is not False and command[highest] - place > least:
            if rising is not None:
                turns.append(highest)
            rising = False
            lowest = row
        elif rising is not True and place - command[lowest] > least:
            if rising is not None:
                turns.append(lowest)
            rising = True
            highest = row
    return turns
