"""Units of length of a drawing."""

from __future__ import annotations

from gantrysim.base.errors import unknown

UNITS = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "um": 1e-3, "in": 25.4, "ft": 304.8, "pt": 25.4 / 72, "px": 25.4 / 96}


def millimetres(unit: str) -> float | None:
    """Return the length of a unit [mm], None of "auto".

    Raises:
        InputError: an unknown unit.
    """
    if unit != "auto" and unit not in UNITS:
        raise unknown("unit", unit, ("auto", *UNITS))
    return UNITS.get(unit)
