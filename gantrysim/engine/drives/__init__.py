"""The drives of a run that are no plain ones: each part of a drive is a file with its record and its part of the tick.

A new part is a file here, and its line in `PARTS` below. What it needs to know of the machine it reads from the MJCF,
as a rule from a custom numeric with a value per actuator; a table states that with an entry in `facts` of
`gantrysim.machine.design.table`.
"""

# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators

from __future__ import annotations

from functools import cache
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from gantrysim.engine.drives.closed_loop import LOOP
from gantrysim.engine.drives.current_loop import CURRENT
from gantrysim.engine.drives.drag import DRAG
from gantrysim.engine.drives.encoder import ENCODER, FEEDBACK
from gantrysim.engine.drives.field import FIELD
from gantrysim.engine.drives.part import MODE_NUMBERS, DrivenAxis, DrivePart
from gantrysim.engine.drives.stepper import STEPPING
from gantrysim.engine.drives.transmission import TRANSMISSION
from gantrysim.engine.native.functions import with_parts
from gantrysim.engine.native.pointers import pointer, row_at, tape_of
from gantrysim.engine.native.stages import Body, Stage, compiled_stage
from gantrysim.machine.machine import Machine
from gantrysim.servo.servo import Servo

# those that act at one point of the tick do so in this order
PARTS: tuple[DrivePart, ...] = (ENCODER, FEEDBACK, FIELD, TRANSMISSION, DRAG, LOOP, STEPPING, CURRENT)

DRIVE = np.dtype(
    [
        ("mode", np.int64),
        ("logged", np.int64),  # ticks of which the drive has written its part of the log
        *((part.name, np.dtype(part.record)) for part in PARTS),
    ]
)
_DRIVE = numba.from_dtype(DRIVE)


def drive_entries(machine: Machine, servo: Servo, step: float) -> NDArray[np.void] | None:
    """Return the drives of a servo at their start, (axes,) of `DRIVE`; None where all are plain ones.

    Args:
        machine: the machine.
        servo: its servo.
        step: physics step [s].

    Raises:
        InputError: feedback from the load of an axis that has none, a current loop of a motor without inductance, or
            mode "stepper" of a motor that is none.
    """
    entries = np.zeros(servo.axes, DRIVE)
    for a, entry in enumerate(entries):
        entry["mode"] = MODE_NUMBERS[servo.modes[a]]
        for part in PARTS:
            for name, value in part.entry(DrivenAxis(machine, servo, a, step)).items():
                entry[part.name][name] = value
    return entries if any(part.needed(servo, entries[part.name]) for part in PARTS) else None


def drive_stages(servo: Servo, entries: NDArray[np.void] | None) -> list[Stage]:
    """Return the stages of drives that are no plain ones; they hold the address of the entries."""
    if entries is None:
        return []
    return [
        Stage(point, _stage(act), entries.ctypes.data, Body("drives", act))
        for part in PARTS
        if part.needed(servo, entries[part.name])
        for point, act in part.acts
    ]


@cache
def _stage(act: Any) -> int:
    """Return the address of a part's function as a stage; its argument is the address of the drives."""
    return compiled_stage(with_parts(_act_on_drives, act=act))


def act(row, tape, axis, drive):
    """Stand for the function of a part."""
    raise NotImplementedError


def _act_on_drives(address, argument):
    row = row_at(address)
    tape = tape_of(row)
    drives = numba.carray(pointer(argument, _DRIVE), (row.axes,))
    for axis in range(row.axes):
        act(row, tape, axis, drives[axis])
