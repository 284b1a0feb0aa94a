"""Entries of a table of points that are nearer to a point than their neighbours; compiled."""

# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.jit import plain_inner_jit, plain_jit


class Table(NamedTuple):
    """Points along a path, evenly spaced.

    Attributes:
        points: (m, 3) [mm].
        spacing: arc length from one to the next [mm].
    """

    points: Floats
    spacing: float


class Minima(NamedTuple):
    """Buffers for the minima about a point.

    Attributes:
        entry: their indices, (c,).
        place: where the distance is least about each, in entries, (c,).
        distance: the distances, (c,) [mm].
        squares: squared distances of entries in a row, (b,) [mm²].
    """

    entry: NDArray[np.int64]
    place: Floats
    distance: Floats
    squares: Floats


ZERO: Any = np.int64(0)  # of NumPy's type, as numba compiles a function anew for a literal of Python's


@plain_inner_jit
def square_distance(a, b):
    """Squared distance of two points."""
    x = a[0] - b[0]
    y = a[1] - b[1]
    z = a[2] - b[2]
    return x * x + y * y + z * z


@plain_inner_jit
def nearest_entry(points, point, low, high):
    """Index of the first entry nearest to a point, from low to high inclusive."""
    best = low
    least = np.inf
    for i in range(max(low, 0), min(high, len(points) - 1) + 1):
        square = square_distance(points[i], point)
        if square < least:
            best = i
            least = square
    return best


@plain_inner_jit
def first_near_entry(table, point):
    """Index of the first entry as near to a point as the nearest, within the table's spacing."""
    points = table.points
    nearest = points[nearest_entry(points, point, ZERO, len(points) - 1)]
    bound = np.sqrt(square_distance(nearest, point)) + table.spacing
    for i in range(len(points)):
        if square_distance(points[i], point) <= bound * bound:
            return i
    return 0


@plain_inner_jit
def _vertex(before, square, after):
    """Place of the vertex of a parabola through three squared distances, in entries from the middle one, -1 to 1."""
    second = before - 2 * square + after
    return min(max(0.5 * (before - after) / second, -1.0), 1.0) if second > 0 else 0.0


@plain_inner_jit
def find_minima(points, point, low, high, minima):
    """Find the entries from low to high that are nearer to a point than their neighbours; return their number.

    Without any, it is the nearest; an end of the table needs one neighbour only.

    Args:
        points: along the path, (m, 3) [mm].
        point: (3,) [mm].
        low: first entry.
        high: last entry.
        minima: into whose first elements they are written; those that have no room are left out.
    """
    last_entry = len(points) - 1
    squares = minima.squares
    room = len(minima.entry)
    count = 0
    for begin in range(low, high + 1, len(squares) - 2):
        end = min(begin + len(squares) - 3, high)
        _find_squares(points, point, begin - 1, end + 2, squares)
        before = squares[0]
        square = squares[1]
        for k in range(2, end - begin + 3):
            after = squares[k]
            if square <= before and square < after and count < room:
                i = begin + k - 2
                minima.entry[count] = i
                minima.distance[count] = np.sqrt(square)
                minima.place[count] = i + (_vertex(before, square, after) if 0 < i < last_entry else 0.0)
                count += 1
            before = square
            square = after
    if count == 0:
        best = nearest_entry(points, point, low, high)
        minima.entry[0] = best
        minima.place[0] = best
        minima.distance[0] = np.sqrt(square_distance(points[best], point))
        return 1
    return count


@plain_inner_jit
def _find_squares(points, point, begin, end, squares):
    """Write the squared distances of a point from the entries from `begin` to before `end`, inf beyond the table."""
    if begin < 0:
        squares[0] = np.inf
    if end > len(points):
        squares[len(points) - begin] = np.inf
    first = max(begin, 0)
    x = points[first:end, 0]
    y = points[first:end, 1]
    z = points[first:end, 2]
    at_x = point[0]
    at_y = point[1]
    at_z = point[2]
    written = squares[first - begin :]
    # from the first element of each array on, and without a sum: several at once
    for k in range(len(x)):
        dx = x[k] - at_x
        dy = y[k] - at_y
        dz = z[k] - at_z
        written[k] = dx * dx + dy * dy + dz * dz


def vertices(points, p, nearest):
    """Return the vertex of a parabola through the squared distances to three entries, in entries, (n,).

    Args:
        points: along the path, (m, 3) [mm].
        p: points beside it, (n, 3) [mm].
        nearest: index of the entry nearest to each point, (n,).
    """
    places = np.empty(len(p))
    _find_vertices(points, p, nearest, places)
    return places


@plain_jit
def _find_vertices(points, p, nearest, places):
    for k in range(len(p)):
        middle = min(max(nearest[k], 1), len(points) - 2)
        before = square_distance(points[middle - 1], p[k])
        square = square_distance(points[middle], p[k])
        after = square_distance(points[middle + 1], p[k])
        places[k] = middle + _vertex(before, square, after)
