"""Limits of the stage's axes: as they are given, and as the speed along the outline has to keep them."""

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


def held(s: Floats, rate: Floats, velocity: Three) -> Floats:
    """Return the speed at which no axis passes its velocity, at the nodes and between them, (m,) [mm/s].

    A node's speed is held to the largest rate of its neighbours as well, as the speed changes evenly from node to node.

    Args:
        s: nodes, (m,), twice the same where two pieces meet [mm].
        rate: derivatives of th, x and y over the way, (m, 3).
        velocity: limits of th, x and y.
    """
    largest = np.abs(rate)
    inside = np.diff(s) > 0
    for here, there in ((slice(None, -1), slice(1, None)), (slice(1, None), slice(None, -1))):
        neighbour = np.abs(rate)[there][inside]
        largest[here][inside] = np.maximum(largest[here][inside], neighbour)
    with np.errstate(divide="ignore"):
        speed: Floats = (np.array(velocity) / largest).min(axis=1)
    return speed


def axis_limits(name: str, values: Three, unit: str) -> Three:
    """Return limits of th, x and y as floats, or raise InputError where one is not above zero; inf is none."""
    if len(values) != 3:
        raise InputError(f"{name} of {len(values)} values: must be three, of th, x and y")
    for axis, length, value in zip(AXES, _UNITS, values, strict=True):
        if value != math.inf:
            positive(f"{name} of {axis}", value, f"{length}/{unit}")
    th, x, y = (float(value) for value in values)
    return th, x, y


def travel(name: str, values: Place) -> Place:
    """Return a lower and a higher limit as floats [mm], or raise InputError."""
    if len(values) != 2 or not values[0] < values[1]:
        raise InputError(f"{name} = {tuple(values)} mm: must be a lower and a higher limit")
    for value in values:
        if math.isnan(value):
            finite(name, value, "mm")
    return float(values[0]), float(values[1])
