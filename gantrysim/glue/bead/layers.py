"""Layers of a bead: glue merges over one place of the plan only where it lies on one surface.

A height map is a single-valued surface. On a cone, a helix or a print in layers the trace comes back over the same
place at another height; the glue there neither adds to that below nor is pushed into it. Each such pass is a layer.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.jit import jit
from gantrysim.glue.bead.trace import BeadTrace

# Layers of a print lie a bead's height apart, but for the machine's error; turns on a gentle slope lie closer.
_MERGING = 0.75
_RESOLUTION = 0.25  # cell of the search for passes at another height, of the bead's mean width
_MOST_CELLS = 2e7  # of that search
_HELD_PATH = 4.0  # path after a conflict on which a pass stays in the other layer, of the bead's width
_STEEPEST_SLOPE = 1.001  # slope of a surface; a steeper path leaves it for another
_CROSSING = 4.0  # path on which a straight pass leaves a cell behind for certain, of the bead's width


def merging_height(bead: BeadTrace) -> float:
    """Return the difference of the surface's heights below which two passes of a bead merge [mm].

    It is three quarters of the bead's height, which is the nozzle's gap or that of a lower drop.
    """
    height = float(bead.nominal_section.height[0])
    return _MERGING * (min(bead.gap, height) if height > 0 else bead.gap)


def layers_of(bead: BeadTrace, wet: NDArray[np.bool_], most: int) -> NDArray[np.int64]:
    """Return the number of the layer of every interval between two stations, (r - 1,); the first layer is 0.

    A layer takes the passes in their order. A pass is refused from where the surface below it differs by
    `merging_height` or more from that below the layer's first pass over the same place, and on a few widths of
    path beyond; the next layer takes what is refused.

    Args:
        bead: the trace of the bead.
        wet: whether there is glue in each interval, (r - 1,).
        most: number of layers after which the search ends; a further one then holds what is left.
    """
    number = np.zeros(wet.size, np.int64)
    surface = bead.along(bead.surface())
    limit = merging_height(bead)
    touched = np.concatenate([wet, [False]]) | np.concatenate([[False], wet])
    if not wet.any() or np.ptp(surface[touched]) < limit:
        return number
    plan = bead.point[touched, :2]
    width = float(bead.width[touched].mean())
    extent = np.ptp(plan, axis=0) + 2 * float(bead.width[touched].max())
    cell = max(_RESOLUTION * width, float(np.sqrt(np.prod(extent) / _MOST_CELLS)))
    half = 0.5 * bead.width / cell
    margin = int(np.ceil(half[touched].max())) + 2
    place = (bead.point[:, :2] - plan.min(axis=0)) / cell + margin
    nx, ny = (np.ceil(place[touched].max(axis=0)) + margin + 1).astype(int).tolist()
    steps = np.hypot(*np.diff(bead.point[:, :2], axis=0).T)
    slope = np.abs(np.diff(surface)) / np.maximum(steps, 1e-9)
    slope[slope > _STEEPEST_SLOPE] = np.inf
    # two paths of one slope that cross at right angles lie on a plane so much steeper
    slope *= np.sqrt(2)
    stations = (place[:, 0].copy(), place[:, 1].copy(), half, surface / cell)
    hold = int(np.ceil(_HELD_PATH * width / bead.ds))
    crossing = int(np.ceil(_CROSSING * width / bead.ds))
    waiting = wet.copy()
    while waiting.any() and number.max() < most:
        refused = _refused_intervals(stations, slope, waiting, (ny, nx), limit / cell, (hold, crossing))
        number[refused] += 1
        waiting = refused
    return number


class _Passes(NamedTuple):
    """Passes over the cells of a layer, (ny, nx) each.

    Attributes:
        low, high: bounds of the surface's height that the first pass gives [cells].
        begin: height at which the last pass came to the cell [cells].
        came: interval in which it did.
        last: interval in which it was last over the cell, below 0 before the first one.
        passed: whether it was not the first one.
    """

    low: Floats
    high: Floats
    begin: Floats
    came: NDArray[np.int32]
    last: NDArray[np.int32]
    passed: NDArray[np.bool_]


class _Piece(NamedTuple):
    """A piece of the trace between two stations, in cells.

    Attributes:
        x, y: its begin.
        dx, dy: from there to its end.
        reach: half the width of the bead.
        surface: height of the surface below its begin.
        rise: of the surface along it.
        slope: doubt of the surface's height per distance from it.
        rows, columns: that it may touch, from the first to before the last.
    """

    x: float
    y: float
    dx: float
    dy: float
    reach: float
    surface: float
    rise: float
    slope: float
    rows: tuple[int, int]
    columns: tuple[int, int]


@jit
def _refused_intervals(
    stations: tuple[Floats, Floats, Floats, Floats],
    slope: Floats,
    waiting: NDArray[np.bool_],
    shape: tuple[int, int],
    limit: float,
    intervals: tuple[int, int],
) -> NDArray[np.bool_]:
    """Return the intervals between stations that a layer refuses, (r - 1,).

    Below a pass that climbs, the height of the surface in a cell is known up to the slope times the distance of the
    cell. A cell holds the bounds that the first pass over it gives. A pass that stays over a cell longer than it takes
    to cross it, as in a small circle, is compared with its own begin.

    Args:
        stations: x and y, half the width, and the height of the surface, (r,) each [cells].
        slope: doubt of the surface's height per distance from the path, inf where that leaves the surface, (r - 1,).
        waiting: intervals with glue that no layer has taken yet, (r - 1,).
        shape: of the grid, (ny, nx).
        limit: of the heights' difference [cells].
        intervals: on which a pass is refused after a conflict, and in which it crosses a cell.
    """
    x, y, half, surface = stations
    hold, crossing = intervals
    passes = _Passes(
        low=np.empty(shape),
        high=np.empty(shape),
        begin=np.empty(shape),
        came=np.zeros(shape, np.int32),
        last=np.full(shape, -2, np.int32),
        passed=np.zeros(shape, np.bool_),
    )
    refused = np.zeros(waiting.size, np.bool_)
    conflict = -hold - 1
    for k in range(waiting.size):
        if not waiting[k]:
            continue
        if k - conflict <= hold:
            refused[k] = True
            continue
        if math.isinf(slope[k]):  # between two surfaces
            continue
        reach = max(half[k], half[k + 1])
        piece = _Piece(
            x=x[k],
            y=y[k],
            dx=x[k + 1] - x[k],
            dy=y[k + 1] - y[k],
            reach=reach,
            surface=surface[k],
            rise=surface[k + 1] - surface[k],
            slope=slope[k],
            rows=(
                max(math.ceil(min(y[k], y[k + 1]) - reach), 0),
                min(math.floor(max(y[k], y[k + 1]) + reach) + 1, shape[0]),
            ),
            columns=(
                max(math.ceil(min(x[k], x[k + 1]) - reach), 0),
                min(math.floor(max(x[k], x[k + 1]) + reach) + 1, shape[1]),
            ),
        )
        refused[k] = _conflicts(passes, piece, k, limit, crossing)
        if refused[k]:
            conflict = k
        else:  # a layer takes an interval whole or not at all
            _take(passes, piece, k)
    return refused


@jit
def _below(piece: _Piece, i: int, j: int) -> tuple[bool, float, float, float]:
    """Return whether a piece passes over a cell, and the lowest, likely and highest surface below it there [cells]."""
    px = i - piece.x
    py = j - piece.y
    square = piece.dx * piece.dx + piece.dy * piece.dy
    along = min(max((px * piece.dx + py * piece.dy) / square, 0.0), 1.0) if square > 0.0 else 0.5
    distance = math.hypot(px - along * piece.dx, py - along * piece.dy)
    here = piece.surface + along * piece.rise
    doubt = piece.slope * distance
    return distance <= piece.reach, here - doubt, here, here + doubt


@jit
def _conflicts(passes: _Passes, piece: _Piece, k: int, limit: float, crossing: int) -> bool:
    """Return whether any cell refuses a piece.

    Args:
        passes: over the cells before.
        piece: of the trace.
        k: its interval.
        limit: of the heights' difference [cells].
        crossing: intervals in which a pass crosses a cell.
    """
    low, high, begin, came, last, passed = passes
    conflict = False
    for j in range(piece.rows[0], piece.rows[1]):
        for i in range(piece.columns[0], piece.columns[1]):
            over, lowest, here, highest = _below(piece, i, j)
            if not over:
                continue
            stays = last[j, i] >= k - 1
            if stays and k - came[j, i] > crossing:
                conflict |= abs(begin[j, i] - here) >= limit
            if last[j, i] >= 0 and (passed[j, i] or not stays):
                conflict |= max(low[j, i] - highest, lowest - high[j, i]) >= limit
    return conflict


@jit
def _take(passes: _Passes, piece: _Piece, k: int) -> None:
    """Note a piece in the cells that it passes over; arguments as of `_conflicts`."""
    low, high, begin, came, last, passed = passes
    for j in range(piece.rows[0], piece.rows[1]):
        for i in range(piece.columns[0], piece.columns[1]):
            over, lowest, here, highest = _below(piece, i, j)
            if not over:
                continue
            stays = last[j, i] >= k - 1
            if not stays:
                passed[j, i] = last[j, i] >= 0
                came[j, i] = k
                begin[j, i] = here
            if not passed[j, i]:
                if not stays or max(low[j, i] - highest, lowest - high[j, i]) > 0.0:
                    low[j, i] = lowest
                    high[j, i] = highest
                else:  # both hold: the surface lies where they overlap
                    low[j, i] = max(low[j, i], lowest)
                    high[j, i] = min(high[j, i], highest)
            last[j, i] = k
