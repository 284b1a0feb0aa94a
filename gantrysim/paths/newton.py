"""One step of Newton's method towards the feet of points on a path; compiled."""

# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.jit import plain_inner_jit, plain_jit

INSIDE = 1e-11  # of the ends of an interval [mm]
LAST_STEP = 1e-7  # after which the error is of the order of its square [mm]
_TOLERANCE = 1e-11  # of a bisection [mm]


class Search(NamedTuple):
    """Points and the intervals of the path in which their feet are searched, (n,) each.

    Attributes:
        point: (n, 3) [mm].
        first, last: ends of the interval at the begin of the search [mm].
        low, high: its ends now [mm].
        s: of the foot [mm].
        end_tried: whether an end of the interval was tried.
    """

    point: Floats
    first: Floats
    last: Floats
    low: Floats
    high: Floats
    s: Floats
    end_tried: NDArray[np.bool_]


class Feet(NamedTuple):
    """Feet, as of `Projection`, to be written."""

    s: Floats
    offset: Floats
    lateral: Floats
    vertical: Floats
    beyond: Floats
    distance: Floats


class Places(NamedTuple):
    """The path at present feet of the points that are still searched, as of `Local`."""

    position: Floats
    cosine: Floats
    sine: Floats
    climb: Floats
    turning: Floats
    frames: Floats
    plane: NDArray[np.intp]


@plain_inner_jit
def _dot(a, b):
    return (a[0] * b[0] + a[2] * b[2]) + a[1] * b[1]


@plain_inner_jit
def _frame_at(places, k):
    """Return tangent, left normal, and curvature vector."""
    u = places.frames[places.plane[k], 0]
    v = places.frames[places.plane[k], 1]
    w = places.frames[places.plane[k], 2]
    cosine = places.cosine[k]
    sine = places.sine[k]
    climb = places.climb[k]
    level = np.sqrt(max(1.0 - climb * climb, 0.0))
    along = (cosine * u[0] + sine * v[0], cosine * u[1] + sine * v[1], cosine * u[2] + sine * v[2])
    normal = (cosine * v[0] - sine * u[0], cosine * v[1] - sine * u[1], cosine * v[2] - sine * u[2])
    tangent = (level * along[0] + climb * w[0], level * along[1] + climb * w[1], level * along[2] + climb * w[2])
    turning = places.turning[k] * level
    return tangent, normal, (turning * normal[0], turning * normal[1], turning * normal[2])


@plain_jit
def step(search, places, active, feet, is_last):
    """Make a step towards the feet, see `gantrysim.paths.feet.foot_between`, and write those that it reaches.

    Args:
        search: of the feet, updated.
        places: the path at the present feet of the active points.
        active: indices of the points whose feet are not reached, (k,), of which those still so are moved to the front.
        feet: of the points, those reached are written.
        is_last: whether this ends the search: the feet are those at the places, and no step is made.

    Returns:
        The number of points whose feet are not reached.
    """
    remaining = 0
    for k in range(active.size):
        i = active[k]
        point = search.point[i]
        tangent, normal, curvature = _frame_at(places, k)
        position = places.position[k]
        back = (position[0] - point[0], position[1] - point[1], position[2] - point[2])
        s = search.s[i]
        moved = s
        reached = True
        if not is_last:
            moved, reached = _moved(search, i, _dot(back, tangent), 1.0 + _dot(back, curvature))
            search.s[i] = moved
        if not reached:
            active[remaining] = i
            remaining += 1
            continue
        # the last step is so short that the path is straight along it
        ahead = moved - s
        offset = (-back[0] - ahead * tangent[0], -back[1] - ahead * tangent[1], -back[2] - ahead * tangent[2])
        binormal = (
            tangent[1] * normal[2] - tangent[2] * normal[1],
            tangent[2] * normal[0] - tangent[0] * normal[2],
            tangent[0] * normal[1] - tangent[1] * normal[0],
        )
        _write(feet, i, _snapped(moved, search.first[i], search.last[i]), offset)
        feet.lateral[i] = _dot(offset, normal)
        feet.vertical[i] = _dot(offset, binormal)
        feet.beyond[i] = _dot(offset, tangent)
    return remaining


@plain_inner_jit
def _moved(search, i, ahead, slope):
    """Return where a foot goes, and whether it is reached.

    Args:
        search: of the feet, updated.
        i: index of the point.
        ahead: the function that vanishes at the foot, (c - p).t [mm].
        slope: its derivative.
    """
    s = search.s[i]
    if ahead > 0.0:
        search.high[i] = s
    else:
        search.low[i] = s
    low = search.low[i]
    high = search.high[i]
    moved = s - (ahead / slope if slope > 0.0 else np.inf)
    outside = moved < low or moved > high
    if outside:
        # just inside, as a corner has another tangent on its other side
        end = search.first[i] + INSIDE if ahead > 0.0 else search.last[i] - INSIDE
        moved = end if not search.end_tried[i] and low < end < high else 0.5 * (low + high)
        search.end_tried[i] = True
    return moved, not abs(moved - s) > (_TOLERANCE if outside else LAST_STEP)


@plain_inner_jit
def _snapped(s, first, last):
    """Return an arc length, or the end of its interval where that is as near as rounding."""
    if s - first <= 2.0 * INSIDE:
        return first
    if last - s <= 2.0 * INSIDE:
        return last
    return s


@plain_inner_jit
def _write(feet, i, s, offset):
    feet.s[i] = s
    feet.offset[i, 0] = offset[0]
    feet.offset[i, 1] = offset[1]
    feet.offset[i, 2] = offset[2]
    feet.distance[i] = np.sqrt(_dot(offset, offset))
