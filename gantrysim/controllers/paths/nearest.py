"""The feet of a trace on a path, as entries of a table of points along it, in the order of the motion."""

# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators

from __future__ import annotations

import numpy as np

from gantrysim.arrays import Floats
from gantrysim.jit import inner_jit, jit

# A foot advances by at most _REACH more than four times the point's step, and goes back by at most _BACK more than it
# [mm]; of all feet that a point may have, the best _KEPT are followed.
_REACH = 10.0
_BACK = 1.0
_KEPT = 8
_AROUND = 12  # entries about the first foot that are searched for a nearer one
_WEIGHT = 0.02  # of the distance from the path, per mm of the trace, against the difference in progress [1/mm]


@inner_jit
def _square(a, b):
    """Squared distance of two points."""
    x, y, z = a[0] - b[0], a[1] - b[1], a[2] - b[2]
    return x * x + y * y + z * z


@inner_jit
def _nearest(table, point, low, high):
    """Index of the first entry nearest to a point, from low to high inclusive."""
    best, least = low, np.inf
    for i in range(max(low, 0), min(high, len(table) - 1) + 1):
        square = _square(table[i], point)
        if square < least:
            best, least = i, square
    return best


@inner_jit
def _first(table, point, spacing):
    """Index of the first entry as near to a point as the nearest, within the table's spacing."""
    nearest = table[_nearest(table, point, 0, len(table) - 1)]
    bound = np.sqrt(_square(nearest, point)) + spacing
    for i in range(len(table)):
        if _square(table[i], point) <= bound * bound:
            return i
    return 0


@inner_jit
def _vertex(before, square, after):
    """Place of the vertex of a parabola through three squared distances, in entries from the middle one, -1 to 1."""
    second = before - 2 * square + after
    return min(max(0.5 * (before - after) / second, -1.0), 1.0) if second > 0 else 0.0


@inner_jit
def _minima(table, point, low, high, found, place, distance):
    """Find the entries from low to high that are nearer to a point than their neighbours; return their number.

    Without any, it is the nearest; an end of the table needs one neighbour only.

    Args:
        table: points along the path, (m, 3) [mm].
        point: (3,) [mm].
        low: first entry.
        high: last entry.
        found: into whose first elements their indices are written, (c,).
        place: likewise where the distance is least about each, in entries, (c,).
        distance: likewise the distances, (c,) [mm].
    """
    count, best, least = 0, low, np.inf
    before = np.inf if low == 0 else _square(table[low - 1], point)
    square = _square(table[low], point)
    for i in range(low, high + 1):
        after = np.inf if i == len(table) - 1 else _square(table[i + 1], point)
        if square <= before and square < after and count < len(found):
            found[count], distance[count] = i, np.sqrt(square)
            place[count] = i + (_vertex(before, square, after) if 0 < i < len(table) - 1 else 0.0)
            count += 1
        if square < least:
            best, least = i, square
        before, square = square, after
    if count == 0:
        found[0], place[0], distance[0] = best, best, np.sqrt(least)
        return 1
    return count


@jit
def along(table, trace, spacing, begin):
    """Return the index of the entry at the foot of every point of a trace, in the order of the motion, (n,).

    Candidates are the points of the path that are nearer than their neighbours. Among all sequences of candidates s_k
    within reach of one another the one with the least

        sum of |s_k - s_(k-1) - l_k| + w d_k l_k,    l_k = |p_k - p_(k-1)|,

    is chosen (Viterbi's algorithm), d being the distance from the path. So the foot advances along the path as the
    trace does, where the path retraces itself or nearly does, and is the nearest where it may be either of two.

    Args:
        table: points along the path, (m, 3) [mm].
        trace: points, (n, 3) [mm].
        spacing: of the table [mm].
        begin: index at which the trace begins; -1 to search the whole table.
    """
    n, last_entry = len(trace), len(table) - 1
    index, origin = np.zeros((n, _KEPT), np.int32), np.zeros((n, _KEPT), np.int8)
    kept = np.ones(n, np.int64)
    cost, extended = np.zeros(_KEPT), np.zeros(_KEPT)
    at, reached = np.zeros(_KEPT), np.zeros(_KEPT)  # where the feet are, in entries
    candidate, place, distance = np.zeros(4 * _KEPT, np.int64), np.zeros(4 * _KEPT), np.zeros(4 * _KEPT)
    if begin < 0:
        first, reach = _first(table, trace[0], spacing), 2
    else:
        first = min(begin, last_entry)
        reach = int((2 * np.sqrt(_square(trace[0], table[first])) + _BACK) / spacing)
    first = _nearest(table, trace[0], first - reach, first + reach)
    index[0, 0] = _nearest(table, trace[0], first - _AROUND, first + _AROUND)
    at[0] = index[0, 0]
    for k in range(1, n):
        step = np.sqrt(_square(trace[k], trace[k - 1]))
        previous = index[k - 1, : kept[k - 1]]
        low = max(previous.min() - int((_BACK + step) / spacing), 0)
        for ahead in (_BACK, _REACH):  # far ahead only where no foot nearby advances as the trace does
            high = min(previous.max() + int((ahead + 4 * step) / spacing) + 1, last_entry)
            count = 0
            for c in range(_minima(table, trace[k], low, high, candidate, place, distance)):
                best, least = 0, np.inf
                for j in range(len(previous)):
                    total = cost[j] + abs((place[c] - at[j]) * spacing - step)
                    if total < least:
                        best, least = j, total
                least += _WEIGHT * distance[c] * step
                slot = count if count < _KEPT else int(np.argmax(extended))
                if count < _KEPT:
                    count += 1
                elif extended[slot] <= least:
                    continue
                extended[slot], reached[slot] = least, place[c]
                index[k, slot], origin[k, slot] = candidate[c], best
            if extended[:count].min() <= 0.5 * step:
                break
        least, alive = extended[:count].min(), 0
        for c in range(count):  # those far behind the best do not come back
            if extended[c] <= least + 2 * _REACH:
                cost[alive], at[alive] = extended[c] - least, reached[c]
                index[k, alive], origin[k, alive] = index[k, c], origin[k, c]
                alive += 1
        kept[k] = alive
    found = np.empty(n, np.int64)
    slot = int(np.argmin(cost[: kept[n - 1]]))
    for k in range(n - 1, -1, -1):
        found[k] = index[k, slot]
        slot = origin[k, slot]
    return found


def last_moved(steps: Floats) -> Floats:
    """Return steps in which those of a trace at rest are the last one before it."""
    return steps[np.maximum.accumulate(np.where(steps > 0, np.arange(len(steps)), 0))]


@jit
def vertices(table, points, nearest):
    """Return the vertex of a parabola through the squared distances to three entries, in entries, (n,).

    Args:
        table: points along the path, (m, 3) [mm].
        points: (n, 3) [mm].
        nearest: index of the entry nearest to each point, (n,).
    """
    found = np.empty(len(points))
    square = np.empty(3)
    for k in range(len(points)):
        middle = min(max(nearest[k], 1), len(table) - 2)
        for i in range(3):
            square[i] = _square(table[middle - 1 + i], points[k])
        found[k] = middle + _vertex(square[0], square[1], square[2])
    return found
