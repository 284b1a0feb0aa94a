"""From the table of a machine, or the table beside a URDF, to its MJCF."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from pathlib import Path

import mujoco

from gantrysim.base.errors import InputError
from gantrysim.base.toml_files import read_toml
from gantrysim.machine.design.arrangements.cartesian import bridge, cantilever, moving_table
from gantrysim.machine.design.arrangements.coupled import corexy, tandem
from gantrysim.machine.design.mjcf import Mjcf, TableMjcf
from gantrysim.machine.design.modes import modes
from gantrysim.machine.design.table import Drive, MachineTable, read_table
from gantrysim.machine.design.urdf import urdf_mjcf
from gantrysim.machine.design.urdf_table import SUFFIX, is_urdf_table, read_urdf_table, table_of_urdf

ARRANGEMENTS: dict[str, Callable[[MachineTable], TableMjcf]] = {
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
    slides = [slide for slide in (table.x, table.y, table.z) if slide is not None]
    return _text(ARRANGEMENTS[table.arrangement](table), [*(slide.drive for slide in slides), table.belts])


def _text(mjcf: Mjcf, drives: Iterable[Drive | None]) -> str:
    frequencies, _ = modes(mujoco.MjModel.from_xml_string(mjcf.text()))
    field_rates = [drive.field_rate for drive in drives if drive is not None]
    fastest = max(2 * math.pi * float(frequencies.max(initial=0.0)), *field_rates)
    step = _STEP
    largest_angle = _PER_STEP_UNDAMPED if any(field_rates) else _PER_STEP
    while fastest * step > largest_angle:  # halved, so that it stays a fraction of usual servo periods
        step /= 2
    return mjcf.text(step)


def mjcf_in(file: Path) -> str:
    """Return the MJCF of the machine whose table a TOML file holds, or of a URDF with its table beside it.

    Raises:
        InputError: a file that cannot be read, a key that is unknown, missing or out of its bounds, or a URDF without
            a table.
    """
    source = table_of_urdf(file) if file.suffix.lower() == SUFFIX else file
    content = read_toml(source, f"machine {source}")
    try:
        if file.suffix.lower() == SUFFIX or is_urdf_table(content):
            table, urdf, root = read_urdf_table(source, content)
            return _text(urdf_mjcf(table, urdf, root), [axis.drive for axis in table.axes.values()])
        return mjcf_of(read_table(source))
    except InputError:
        raise
    except (ArithmeticError, ValueError, mujoco.FatalError) as error:  # of values far from any machine
        text = " ".join(str(error).split())
        raise InputError(
            f"machine {source}: its values do not make a machine: one is far too large or too small: {text}"
        ) from None
