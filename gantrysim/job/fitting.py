"""Checks against the machine: the program's frame and geometry, and the number of values in a servo file."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gantrysim.base.errors import InputError
from gantrysim.controllers.controller import Controller
from gantrysim.engine.positions import axis_positions
from gantrysim.job.settings import ServoSettings
from gantrysim.machine.machine import Machine
from gantrysim.record.setpoints import Setpoints

_PROBES = 64  # places along the path
_OFF = 1.0  # distance of the commanded tip from the path beyond which the geometry is another [mm]


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
        return
    on = np.flatnonzero(setpoints.dispense)
    if not on.size:
        return
    ticks = on[np.linspace(0, on.size - 1, min(_PROBES, on.size)).astype(int)]
    tip = machine.tip(axis_positions(machine, setpoints)[ticks])
    off = float(controller.requested.project(tip).distance.max())
    if off > _OFF:
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


def check_servo_file(file: Path, servo: ServoSettings, machine: Machine) -> None:
    """Raise InputError where a list of a servo file has another number of values than the machine has axes."""
    axes = machine.axis_names
    for name, value in servo:
        if name != "law" and isinstance(value, list) and len(value) != len(axes):
            raise InputError(
                f"servo {file}: {name} has {len(value)} values: must be one or {len(axes)}, of the axes "
                f"{', '.join(axes)} of machine {machine.name}"
            )
