"""The nearest entries of a table of points along a path, for a trace in the order of the motion."""

# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators

from __future__ import annotations

import numba
import numpy as np

# Points of the trace this far apart are searched one after the other [mm], the foot moving at most _REACH times as far
# as the point; those in between are searched within AROUND entries of the table.
_ANCHOR = 1.0
_REACH = 4.0
AROUND = 12


@numba.njit(error_model="numpy")
def _square(a, b):
    """Squared distance of two points."""
    x, y, z = a[0] - b[0], a[1] - b[1], a[2] - b[2]
    return x * x + y * y + z * z


@numba.njit(error_model="numpy")
def _nearest(table, point, low, high):
    """Index of the first entry nearest to a point, from low to high inclusive."""
    best, least = low, np.inf
    for i in range(max(low, 0), min(high, len(table) - 1) + 1):
        square = _square(table[i], point)
        if square < least:
            best, least = i, square
    return best


@numba.njit(error_model="numpy")
def _first(table, point, spacing):
    """Index of the first entry as near to a point as the nearest, within the table's spacing."""
    nearest = table[_nearest(table, point, 0, len(table) - 1)]
    bound = np.sqrt(_square(nearest, point)) + spacing
    for i in range(len(table)):
        if _square(table[i], point) <= bound * bound:
            return i
    return 0


@numba.njit(cache=True, error_model="numpy")
def along(table, trace, spacing, begin):
    """Return the index of the entry nearest to every point of a trace, close to that of the point before, (n,).

    Args:
        table: points along the path, (m, 3) [mm].
        trace: points, (n, 3) [mm].
        spacing: of the table [mm].
        begin: index at which the trace begins; -1 to search the whole table.
    """
    n, last_entry = len(trace), len(table) - 1
    travelled = np.zeros(n)
    for k in range(1, n):
        travelled[k] = travelled[k - 1] + np.sqrt(_square(trace[k], trace[k - 1]))
    if begin < 0:
        last, reach = _first(table, trace[0], spacing), 2
    else:
        last = min(begin, last_entry)
        reach = int((2 * np.sqrt(_square(trace[0], table[last])) + _ANCHOR) / spacing)
    found = np.empty(n, np.int64)
    last = _nearest(table, trace[0], last - reach, last + reach)
    found[0] = _nearest(table, trace[0], last - AROUND, last + AROUND)
    before = 0
    for k in range(1, n):
        if k < n - 1 and np.floor(travelled[k] / _ANCHOR) == np.floor(travelled[k - 1] / _ANCHOR):
            continue
        distance = travelled[k] - travelled[before]
        reach = int(_REACH * (distance + _ANCHOR) / spacing) + 1
        foot = _nearest(table, trace[k], last - reach, last + reach)
        for j in range(before + 1, k + 1):
            share = (travelled[j] - travelled[before]) / distance if distance > 0 else 1.0
            guess = int(np.round(last + share * (foot - last)))
            found[j] = _nearest(table, trace[j], guess - AROUND, guess + AROUND)
        last, before = foot, k
    return found


@numba.njit(cache=True, error_model="numpy")
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
        second = square[0] - 2 * square[1] + square[2]
        shift = 0.5 * (square[0] - square[2]) / second if second > 0 else 0.0
        found[k] = middle + min(max(shift, -1.0), 1.0)
    return found
