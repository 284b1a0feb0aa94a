"""Distances of a trace from a path by brute force: the oracle of feet, and of the contour error.

What is true. Where the legs of a path are far apart, the distance of a point from the path is that of the nearest
point of the whole path: `Polyline.nearest`. Where the path comes near itself, at teeth, hatches and retraces, the
nearest point may be of a leg that the motion passed long before, or will pass, and an error is measured in the order of
the motion: the trace stands at a progress g along the path that never falls, and the contour error is the distance from
the stretch of the path about g. Of all progresses the true one is that with the least sum of squares,

    sum over points of D(point, [g - reach, g + reach])^2  +  SKIPPED x sum over skipped cells of D(point, cell)^2,

found by an exact dynamic program over all points of the trace and all cells of the path, without a beam, a window or a
guess. Jumps forward are free but for the second sum, as a command that rounds a corner passes from leg to leg without
its tip; that sum, small, keeps a trace from skipping a turn of a spiral that lies as near. The reach allows for a
nozzle that swings back: it can be no further from the command than that, and so hardly further from its progress. A
reach of 0 (progress is the foot) gives an upper value and one of twice the distance of nozzle and command a lower one,
and a right contour error lies between. They differ by less than a micrometre but on paths that come as near to
themselves as the nozzle to the command.

Known right values: a program of one corner of 35 degrees, rounded by half of its legs, 553 / 2,884 µm (rms / largest);
twenty teeth of 0.4 x 0.075 mm before two long legs, rounded within 0.1 mm, 7.3 / 69.7 µm.

How exact. The path is a polyline of points of `Path.position` alone: a curve of length l between ends at the
distance c stays within sqrt(l^2 - c^2) / 2 of its chord, and chords are halved until that is below `FLAT`; nothing is
taken from the package's own table, search, corners or progress.
"""

import math
from dataclasses import dataclass

import numba
import numpy as np

FLAT = 2e-5  # largest distance of the path from its chords, and so of any error of a distance [mm]
CELL = 0.05  # shortest cell, within which progress is not told apart [mm]
MOST_CELLS = 2000
SKIPPED = 1e-4  # weight of the cells of the path that a trace skips


@dataclass(frozen=True)
class Coupling:
    """Distances of the points of a trace from the path, in the order of the motion.

    Attributes:
        progress: arc length of the middle of the cell that each point belongs to, never falling, (n,) [mm].
        distance: from the path near there, (n,) [mm].
    """

    progress: np.ndarray
    distance: np.ndarray


class Polyline:
    """A path as chords, each within one cell of even arc length."""

    def __init__(self, path):
        self.length = path.length
        self.cells = int(np.clip(np.ceil(path.length / CELL), 1, MOST_CELLS))
        self.cell = path.length / self.cells
        s = np.linspace(0, path.length, self.cells + 1)
        points = path.position(s)
        while True:
            chord = np.linalg.norm(np.diff(points, axis=0), axis=1)
            between = np.diff(s)
            bulge = 0.5 * np.sqrt(np.maximum(between**2 - chord**2, 0))
            rows = np.flatnonzero((bulge > FLAT) & (between > FLAT))
            if not rows.size:
                break
            middle = 0.5 * (s[rows] + s[rows + 1])
            s = np.insert(s, rows + 1, middle)
            points = np.insert(points, rows + 1, path.position(middle), axis=0)
        self.s = s
        self.points = points
        middle = 0.5 * (s[:-1] + s[1:])
        cell = np.minimum((middle / self.cell).astype(int), self.cells - 1)
        self.begins = np.searchsorted(cell, np.arange(self.cells))

    def distances(self, trace):
        """Distance of each point of a trace from each cell of the path, (n, cells) [mm]."""
        return _distances(np.ascontiguousarray(trace), np.ascontiguousarray(self.points), self.begins, self.cells)


@numba.njit(cache=True, error_model="numpy")
def _distances(trace, points, begins, cells):
    found = np.empty((len(trace), cells), np.float32)
    for k in range(len(trace)):
        for cell in range(cells):
            least = np.inf
            end = begins[cell + 1] if cell + 1 < cells else len(points) - 1
            for j in range(begins[cell], end):
                square = 0.0
                along = 0.0
                for a in range(3):
                    way = points[j + 1, a] - points[j, a]
                    square += way * way
                    along += way * (trace[k, a] - points[j, a])
                share = min(max(along / square, 0.0), 1.0) if square > 0 else 0.0
                apart = 0.0
                for a in range(3):
                    foot = points[j, a] + share * (points[j + 1, a] - points[j, a])
                    apart += (trace[k, a] - foot) ** 2
                least = min(least, apart)
            found[k, cell] = math.sqrt(least)
    return found


def dense(trace, spacing):
    """Points of a trace no further apart than a spacing, and the rows of the trace's own among them, (n,).

    Between ticks a fast trace passes many cells, and none of them is skipped.
    """
    steps = np.linalg.norm(np.diff(trace, axis=0), axis=1)
    parts = np.maximum(np.ceil(steps / spacing), 1).astype(int)
    rows = np.append(0, np.cumsum(parts))
    every = np.arange(rows[-1] + 1)
    return np.column_stack([np.interp(every, rows, trace[:, a]) for a in range(3)]), rows


def reached(distances, cells):
    """The least distance from each cell and so many on either side of it, (n, m)."""
    found = distances.copy()
    for step in range(1, min(cells, distances.shape[1] - 1) + 1):
        np.minimum(found[:, step:], distances[:, :-step], out=found[:, step:])
        np.minimum(found[:, :-step], distances[:, step:], out=found[:, :-step])
    return found


def coupled(distances, cell, reach, weight=SKIPPED):
    """The coupling of a trace and a path with the least sum of squares, by dynamic programming over all of both.

    Args:
        distances: of each point from each cell of the path, (n, m) [mm].
        cell: length of a cell [mm].
        reach: how far from its progress a point's foot may be [mm].
        weight: of cells that are skipped.
    """
    near = reached(distances, int(np.ceil(reach / cell)))
    at = _cheapest_way(near, weight)
    return Coupling((at + 0.5) * cell, near[np.arange(len(at)), at].astype(float))


@numba.njit(cache=True, error_model="numpy")
def _cheapest_way(near, weight):
    """Cell of each point, never falling, of the least sum."""
    n, m = near.shape
    came = np.empty((n, m), np.int16)  # the cell of the point before, on the cheapest way to each
    cost = np.zeros(m)
    for k in range(n):
        skipped = 0.0  # of all cells before
        least = np.inf  # cost of leaving the cheapest cell before, less what is skipped up to there
        left = 0
        for j in range(m):
            square = float(near[k, j]) ** 2
            before = cost[j]
            jump = skipped + least
            came[k, j] = j
            if k == 0:
                cost[j] = square + skipped
            elif before <= jump:
                cost[j] = square + before
            else:
                came[k, j] = left
                cost[j] = square + jump
            skipped += weight * square
            if before - skipped <= least:
                least = before - skipped
                left = j
    skipped = 0.0  # of all cells behind
    best = np.inf
    at = np.empty(n, np.int64)
    for j in range(m - 1, -1, -1):
        if cost[j] + skipped < best:
            best = cost[j] + skipped
            at[n - 1] = j
        skipped += weight * float(near[n - 1, j]) ** 2
    for k in range(n - 1, 0, -1):
        at[k - 1] = came[k, at[k]]
    return at


def near_progress(distances, cell, progress, reach):
    """Least distance of points from the path near a progress of each, (n,) [mm].

    Args:
        distances: of each point from each cell of the path, (n, m) [mm].
        cell: length of a cell [mm].
        progress: (n,) [mm].
        reach: how far from its progress each point's foot may be, (n,) [mm].
    """
    m = distances.shape[1]
    first = np.clip((progress - reach) / cell, 0, m - 1).astype(int)
    last = np.clip((progress + reach) / cell, 0, m - 1).astype(int)
    rows = zip(distances, first, last, strict=True)
    return np.array([row[begin : end + 1].min() for row, begin, end in rows], float)
