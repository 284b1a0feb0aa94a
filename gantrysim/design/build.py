"""From the table of a machine to its MJCF."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import mujoco

from gantrysim.base.errors import InputError
from gantrysim.design.arrangements.cartesian import bridge, cantilever, moving_table
from gantrysim.design.arrangements.coupled import corexy, tandem
from gantrysim.design.mjcf import Mjcf
from gantrysim.design.modes import modes
from gantrysim.design.table import MachineTable, read_table

ARRANGEMENTS: dict[str, Callable[[MachineTable], Mjcf]] = {
    "bridge": bridge,
    "table": moving_table,
    "cantilever": cantilever,
    "tandem": tandem,
    "corexy": corexy,
}
_STEP = 2.5e-4  # longest physics step [s]
_PER_STEP = 1.0  # largest angle by which the fastest mode turns in a physics step [rad]
# the same with a stepper in open loop, which nothing damps but friction: half the error of its torque
_PER_STEP_UNDAMPED = 0.5


def mjcf_of(table: MachineTable) -> str:
    """Return the MJCF of a machine, complete in one text, with a physics step that its fastest mode allows."""
    mjcf = ARRANGEMENTS[table.arrangement](table)
    frequencies, _ = modes(mujoco.MjModel.from_xml_string(mjcf.text()))
    slides = (slide.drive for slide in (table.x, table.y, table.z) if slide is not None)
    fields = [drive.field_rate for drive in (*slides, table.belts) if drive is not None]
    fastest = max(2 * math.pi * float(frequencies.max(initial=0.0)), *fields)
    step = _STEP
    largest = _PER_STEP_UNDAMPED if any(fields) else _PER_STEP
    while fastest * step > largest:
        step /= 2
    return mjcf.text(step)


def mjcf_in(file: Path) -> str:
    """Return the MJCF of the machine whose table a TOML file holds.

    Raises:
        InputError: a file that cannot be read, or a key that is unknown, missing or out of its bounds.
    """
    table = read_table(file)
    try:
        return mjcf_of(table)
    except (ArithmeticError, ValueError, mujoco.FatalError) as error:  # of values far from any machine
        text = " ".join(str(error).split())
        raise InputError(
            f"machine {file}: its values make no machine, one is far too large or too small: {text}"
        ) from None
