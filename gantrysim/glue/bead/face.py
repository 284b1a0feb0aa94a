"""Where the needle's face passes over a grid, and the room that it leaves the glue there.

Heights are volumes per cell, places are in cells.
"""

from __future__ import annotations

import math

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.jit import jit
from gantrysim.glue.bead.laying import Layer

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
