"""The share of each cell that glue wets, which resolves gaps narrower than a cell.

The footprint of a pass is the strip as wide as the bead about the trace. Its edge is blurred by a hat two cells wide,
as glue is shared among cells: the footprints of two strips side by side then add up to 1 at every cell between them.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.jit import jit
from gantrysim.glue.bead.laying import Layer

# Where the needle's face passes over a grid, and the room that it leaves the glue there.
#
# Heights are volumes per cell, places are in cells.

_BAND = 32  # rows that are computed at a time, so that what lies between stays near the processor


@jit
def cover(under: Floats, x: Floats, y: Floats, volume: Floats, radius: float) -> None:
    """Raise the share of each cell that the needle's face passes over while it lays the volumes between stations.

    The edge is blurred by a hat two cells wide, as glue is shared among cells.

    Args:
        under: the share, (ny, nx).
        x: of the stations, (r,) [cells].
        y: likewise.
        volume: between the stations, (r - 1,) [mm³].
        radius: of the face [cells].
    """
    ny, nx = under.shape
    reach = radius + 1.0
    for k in range(volume.size):
        if volume[k] <= 0.0:
            continue
        dx = x[k + 1] - x[k]
        dy = y[k + 1] - y[k]
        square = dx * dx + dy * dy
        per_square = 1.0 / square if square > 0.0 else 0.0
        leftmost = max(math.ceil(min(x[k], x[k + 1]) - reach), 0)
        rightmost = min(math.floor(max(x[k], x[k + 1]) + reach), nx - 1)
        low = max(math.ceil(min(y[k], y[k + 1]) - reach), 0)
        high = min(math.floor(max(y[k], y[k + 1]) + reach), ny - 1)
        count = max(min((rightmost - leftmost + 8) // 8 * 8, nx - leftmost), 0)  # see `footprint`
        for j in range(low, high + 1):
            row = under[j, leftmost : leftmost + count]
            py = j - y[k]
            for i in range(count):
                px = leftmost + i - x[k]
                along = min(max((px * dx + py * dy) * per_square, 0.0), 1.0)
                across = px - along * dx
                upward = py - along * dy
                distance = across * across + upward * upward
                share = share_within(radius, math.sqrt(distance))
                row[i] = max(row[i], share if distance < reach * reach else 0.0)


@jit
def share_within(half: float, distance: float) -> float:
    """Share of a hat two cells wide about a point that lies within a strip, given half its width [cells].

    Args:
        half: of the strip.
        distance: of the point from the strip's middle.
    """
    return hat_below(half - distance) - hat_below(-half - distance)


@jit
def hat_below(t: float) -> float:
    """Share of a hat from -1 to 1 that lies below t."""
    short = max(1.0 - abs(t), 0.0)
    beyond = 0.5 * short * short
    return beyond if t <= 0.0 else 1.0 - beyond


def headroom(under: Floats, layer: Layer, gap: float, free: float) -> tuple[Floats, Floats]:
    """Return the height that glue may have in each cell, and how far its surface there rises with excess.

    Args:
        under: share of each cell that the needle's face passes over, (ny, nx).
        layer: with the moment, the nozzle's mean height over the glue laid in a cell counts; without, `gap`.
        gap: the nozzle's height over cells without glue [mm].
        free: rise of a free surface, see `pushing.push_aside`.
    """
    ceiling = np.empty(under.shape)
    rise = np.empty(under.shape)
    for first in range(0, len(under), _BAND):
        rows = slice(first, first + _BAND)
        face: Floats | float = gap
        if layer.moment.size:
            face = np.full(under[rows].shape, gap)
            np.divide(layer.moment[rows], layer.glue[rows], out=face, where=layer.glue[rows] > 0.0)
        beside = 1.0 - under[rows]
        np.multiply(beside, np.maximum(layer.crest[rows], face), out=ceiling[rows])
        ceiling[rows] += under[rows] * face
        np.multiply(beside, free, out=rise[rows])
    return ceiling, rise


_ROUNDING = 1e-9  # of distances [cells]


def footprint(shape: tuple[int, int], x: Floats, y: Floats, half: Floats, wet: Floats, ends: Floats) -> Floats:
    """Return the sum of the passes' footprints, clipped to 1, (ny, nx).

    Consecutive intervals of the trace are one pass over a cell, of which the largest share counts; the shares of
    different passes add up. They are clipped after the sum, so that beads that just touch leave no gap.

    Args:
        shape: of the grid, (ny, nx).
        x: of the stations [cells], (r,).
        y: likewise.
        half: half the width of the bead [cells], (r,).
        wet: volume between the stations, 0 where there is no glue [mm³], (r - 1,).
        ends: x, y and radius of round drops [cells], (k, 3).
    """
    share = np.zeros(shape)
    # share of the pass that is over the cell
    present = np.zeros(shape)
    # interval of the trace in which it was last over it
    last = np.full(shape, -2, np.int32)
    _pass_along(share, present, last, (x, y, half), wet, ends)
    share += present
    return np.minimum(share, 1.0, out=share)


@jit
def _pass_along(
    share: Floats,
    present: Floats,
    last: NDArray[np.int32],
    stations: tuple[Floats, Floats, Floats],
    wet: Floats,
    ends: Floats,
) -> None:
    """Add all passes; arguments as of `footprint`."""
    x, y, half = stations
    for k in range(wet.size):
        if wet[k] > 0.0:
            start = (x[k], y[k], half[k])
            stop = (x[k + 1], y[k + 1], half[k + 1])
            _pass_over(share, present, last, start, stop, k)
    for k in range(len(ends)):
        # numbers two apart: each drop is a pass of its own
        point = (ends[k, 0], ends[k, 1], ends[k, 2])
        _pass_over(share, present, last, point, point, wet.size + 2 * k + 1)


@jit
def _pass_over(
    share: Floats,
    present: Floats,
    last: NDArray[np.int32],
    start: tuple[float, float, float],
    stop: tuple[float, float, float],
    number: int,
) -> None:
    """Add a piece of a pass, between two points given with half the width there [cells]."""
    dx = stop[0] - start[0]
    dy = stop[1] - start[1]
    square = dx * dx + dy * dy
    per_square = 1.0 / square if square > 0.0 else 0.0
    growth = stop[2] - start[2]
    reach = max(start[2], stop[2]) + 1.0
    # a point beside the line is no further than half its length from the foot of one of its ends
    radius = math.sqrt(reach * reach + 0.25 * square) + _ROUNDING
    low = max(math.ceil(min(start[1], stop[1]) - reach), 0)
    high = min(math.floor(max(start[1], stop[1]) + reach) + 1, share.shape[0])
    for j in range(low, high):
        first, count = _cells_within(start, stop, radius, j, share.shape[1])
        row_share = share[j, first : first + count]
        row_present = present[j, first : first + count]
        row_last = last[j, first : first + count]
        py = j - start[1]
        # without a branch, and from the first element of each array on: several cells are computed at once
        for i in range(count):
            px = first + i - start[0]
            along = min(max((px * dx + py * dy) * per_square, 0.0), 1.0)
            half = start[2] + along * growth
            across = px - along * dx
            upward = py - along * dy
            distance = across * across + upward * upward
            touched = distance < (half + 1.0) * (half + 1.0)
            wetted = share_within(half, math.sqrt(distance))
            before = row_present[i]
            previous = row_last[i]
            stays = previous >= number - 1
            row_share[i] += 0.0 if stays or not touched else before
            now = wetted if wetted > before or not stays else before
            row_present[i] = now if touched else before
            row_last[i] = number if touched else previous


@jit
def _cells_within(
    start: tuple[float, float, float], stop: tuple[float, float, float], radius: float, j: int, nx: int
) -> tuple[int, int]:
    """Return the first cell of a row within a radius of one of two points, and the number of cells up to the last.

    They are those between the chords of the circles about both points. There are up to seven more: a multiple of eight
    leaves none to be computed alone.
    """
    leftmost = math.inf
    rightmost = -math.inf
    for x, y in ((start[0], start[1]), (stop[0], stop[1])):
        square = radius * radius - (j - y) * (j - y)
        if square >= 0.0:
            half = math.sqrt(square)
            leftmost = min(leftmost, x - half)
            rightmost = max(rightmost, x + half)
    if leftmost > rightmost:
        return 0, 0
    first = max(math.ceil(leftmost), 0)
    count = math.floor(rightmost) + 1 - first
    return first, max(min((count + 7) // 8 * 8, nx - first), 0)


def wet_where_pushed(share: Floats, laid: Floats, pushed: Floats, ceiling: Floats) -> None:
    """Raise the shares of cells into which glue was pushed by how far it fills their room, see `pushing`.

    Args:
        share: wet share, (ny, nx), changed.
        laid: height of the glue before it was pushed aside, (ny, nx) [mm].
        pushed: height afterwards [mm].
        ceiling: height that the glue may have [mm].
    """
    risen = np.flatnonzero(pushed > laid)  # few cells
    before = laid.take(risen)
    gain = pushed.take(risen) - before
    room = ceiling.take(risen) - before
    filled = np.where(room > 0.0, np.minimum(gain / np.where(room > 0.0, room, 1.0), 1.0), 0.0)
    dry = 1.0 - share.take(risen)
    share.put(risen, share.take(risen) + dry * filled)
