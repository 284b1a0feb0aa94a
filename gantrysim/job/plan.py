"""What a job commands, before it is simulated."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gantrysim.base.arrays import Floats, dot
from gantrysim.base.memory import needed_files, needed_memory
from gantrysim.controllers.controller import Controller
from gantrysim.engine.positions import axis_positions
from gantrysim.machine.machine import Machine
from gantrysim.record.setpoints import Setpoints


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
        duration: of the program's motion [s].
        ticks: servo ticks of a run, see `Setpoints.run_ticks`.
        period: servo period [s].
        memory: that a run with all its figures needs, estimated [B].
        files: room in temporary files that it needs, estimated; 0 for none [B].
        speed: largest speed of the tip [mm/s].
        box: least and largest x, y and z of the tip in the work frame, (2, 3) [mm].
        travel: positions of each axis, by its name [mm or deg].
        speeds: largest speed of each axis, by its name [mm/s or deg/s].
        units: unit of each axis, by its name.
    """

    machine: str
    controller: str
    length: float
    way: float
    glue: float
    duration: float
    ticks: int
    period: float
    memory: float
    files: float
    speed: float
    box: Floats
    travel: dict[str, Extent]
    speeds: dict[str, Extent]
    units: dict[str, str]


def plan_of(machine: Machine, name: str, setpoints: Setpoints, controller: Controller) -> Plan:
    """Return what setpoints command.

    Args:
        machine: that runs them.
        name: of the motion controller.
        setpoints: of the run.
        controller: with its program.

    Raises:
        InputError: an unknown axis, a position outside the travel, or a speed above the limit.
    """
    position = axis_positions(machine, setpoints)
    tip = machine.tip(position)
    steps = np.diff(tip, axis=0)
    ways = np.sqrt(dot(steps, steps))
    speeds = np.abs(np.diff(position, axis=0)).max(axis=0, initial=0) / setpoints.period
    axes = list(enumerate(machine.axes))
    return Plan(
        machine=machine.name,
        controller=name,
        length=controller.requested.length,
        way=float(ways.sum()),
        glue=float(ways[setpoints.dispense[:-1]].sum()),
        duration=controller.duration,
        ticks=setpoints.run_ticks,
        period=setpoints.period,
        memory=needed_memory(setpoints.run_ticks),
        files=needed_files(setpoints.run_ticks),
        speed=float(ways.max(initial=0)) / setpoints.period,
        box=np.array([tip.min(axis=0), tip.max(axis=0)]),
        travel={
            axis.name: Extent(float(position[:, a].min()), float(position[:, a].max()), axis.travel) for a, axis in axes
        },
        speeds={axis.name: Extent(0.0, float(speeds[a]), (0.0, axis.speed_limit)) for a, axis in axes},
        units={axis.name: axis.unit for axis in machine.axes},
    )
