"""Limits of the stage's axes."""

from __future__ import annotations

import math

from gantrysim.base.errors import InputError, positive

Three = tuple[float, float, float]
Place = tuple[float, float]

AXES = ("th", "x", "y")
FREE = (math.inf, math.inf, math.inf)
_UNITS = ("deg", "mm", "mm")


def axis_limits(name: str, values: Three, unit: str) -> Three:
    """Return positive limits of th, x and y, inf for none, as floats, or raise InputError."""
    if len(values) != 3:
        raise InputError(f"{name} of {len(values)} values: must be three, of th, x and y")
    for axis, length, value in zip(AXES, _UNITS, values, strict=True):
        if value != math.inf:
            positive(f"{name} of {axis}", value, f"{length}/{unit}")
    th, x, y = (float(value) for value in values)
    return th, x, y


def travel(name: str, values: Place) -> Place:
    """Return a lower and an upper limit as floats [mm], or raise InputError."""
    if len(values) != 2 or not values[0] < values[1]:
        raise InputError(f"{name} = {tuple(values)} mm: must be a lower and an upper limit")
    return float(values[0]), float(values[1])
