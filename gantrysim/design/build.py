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
# largest angle by which the fastest mode turns in a physics step [rad]; smaller with a stepper in open loop, whose
# field only friction damps: half the error of its torque
_PER_STEP = 1.0
_PER_STEP_UNDAMPED = 0.5


def mjcf_of(table: MachineTable) -> str:
    """Return the MJCF of a machine, complete in one text, with a physics step that its fastest mode allows."""
    mjcf = ARRANGEMENTS[table.arrangement](table)
    frequencies, _ = modes(mujoco.MjModel.from_xml_string(mjcf.text()))
    drives = [slide.drive for slide in (table.x, table.y, table.z) if slide is not None]
    field_rates = [drive.field_rate for drive in (*drives, table.belts) if drive is not None]
    fastest = max(2 * math.pi * float(frequencies.max(initial=0.0)), *field_rates)
    step = _STEP
    largest_angle = _PER_STEP_UNDAMPED if any(field_rates) else _PER_STEP
    while fastest * step > largest_angle:  # halved, so that it stays a fraction of usual servo periods
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
