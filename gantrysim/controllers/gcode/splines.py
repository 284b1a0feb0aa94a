"""Bézier curves as chords."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise

from gantrysim.base.errors import InputError

_CHORD = 1e-3  # largest distance of a chord from its curve [mm]
_MOST = 20_000  # chords of a curve


def chords(points: list[complex]) -> Iterator[tuple[complex, float]]:
    """Yield the ends of chords of a quadratic or cubic Bézier curve, and the completed share of its parameter.

    With n chords of equal parameter a chord's distance is at most max |c''| / (8 n^2), and |c''| at most
    d (d - 1) times the largest second difference of the d + 1 control points.
    """
    degree = len(points) - 1
    second = max(abs(a - 2 * b + c) for a, b, c in zip(points, points[1:], points[2:], strict=False))
    n = max(math.ceil(math.sqrt(degree * (degree - 1) * second / (8 * _CHORD))), 1)
    if n > _MOST:
        raise InputError(f"spline of {n} chords: must be at most {_MOST}")
    for k in range(1, n + 1):
        level = points
        t = k / n
        while len(level) > 1:
            level = [(1 - t) * a + t * b for a, b in pairwise(level)]
        yield (points[-1] if k == n else level[0]), t
