"""Cross-coupled contour control: the error across the path counts more than the one along it."""

from __future__ import annotations

import math

from gantrysim.base.arrays import Floats


def tangents(velocity: Floats, linear: Floats, tangent: Floats, axes: int) -> None:
    """Set the unit tangent of the demanded path, v / |v|, in the linear axes; where it rests, keep the last one.

    Args:
        velocity: dDPOS/T, (axes,) or more [mm/s].
        linear: 1 for a linear axis, 0 for another.
        tangent: t, set.
        axes: number of axes.
    """
    square = 0.0
    for a in range(axes):
        square += linear[a] * velocity[a] ** 2
    if square > 0.0:
        for a in range(axes):
            tangent[a] = linear[a] * velocity[a] / math.sqrt(square)


def error_across(error: Floats, tangent: Floats, linear: Floats, axis: int, axes: int) -> float:
    """Return an axis' part of the following error across the path [mm].

        E_n = E - t (t . E)

    of the linear axes. With contour_gain g the law takes E + g E_n for E (Koren, Journal of Dynamic Systems,
    Measurement, and Control 102, 1980).

    Args:
        error: E, (axes,) or more [mm].
        tangent: t.
        linear: 1 for a linear axis, 0 for another.
        axis: whose part.
        axes: number of axes.
    """
    along = size = 0.0
    for a in range(axes):
        along += linear[a] * tangent[a] * error[a]
        size += tangent[a] ** 2
    return error[axis] - tangent[axis] * along if size > 0.0 else 0.0
