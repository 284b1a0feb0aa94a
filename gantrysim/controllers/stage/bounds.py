"""Limits of the stage's axes, and the speed along the outline that keeps to them."""

from __future__ import annotations

import math

import numpy as np

from gantrysim.arrays import Floats
from gantrysim.errors import InputError, finite, positive

Three = tuple[float, float, float]
Place = tuple[float, float]

AXES = ("th", "x", "y")
FREE = (math.inf, math.inf, math.inf)
_UNITS = ("deg", "mm", "mm")


def velocity_bound(s: Floats, first: Floats, velocity: Three) -> Floats:
    """Return the speed that keeps the axes to their velocity limits, at and between nodes, (m,) [mm/s].

    It allows for the derivatives at a node's neighbours too.

    Args:
        s: nodes, (m,), the same value twice where two pieces meet [mm].
        first: derivatives of th, x and y by the arc length, (m, 3).
        velocity: limits of th, x and y.
    """
    largest = np.abs(first)
    inside = np.diff(s) > 0
    for here, there in ((slice(None, -1), slice(1, None)), (slice(1, None), slice(None, -1))):
        neighbour = np.abs(first)[there][inside]
        largest[here][inside] = np.maximum(largest[here][inside], neighbour)
    with np.errstate(divide="ignore"):
        return (np.array(velocity) / largest).min(axis=1)


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
    for value in values:
        if math.isnan(value):
            finite(name, value, "mm")
    return float(values[0]), float(values[1])
