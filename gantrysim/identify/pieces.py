"""A log in pieces and parts: filters within its pieces, and masks of the samples that differ in one quantity.

Between the pieces of a log rows are missing, and no filter reaches from one into another. Its parts differ in time,
direction, speed, place or torque.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from gantrysim.base.arrays import Floats

Starts = tuple[int, ...]  # rows at which a piece begins, rising from 0
WHOLE_LOG: Starts = (0,)
_SORTING_FILTER = 0.004  # standard deviation of the filter of speed and torque that sort samples [s]


def by_piece(function: Callable[[Floats], Floats], values: Floats, starts: Starts) -> Floats:
    """Return what a function makes of each piece of values, one after the other."""
    return np.concatenate([function(piece) for piece in np.split(values, starts[1:])])


def smoothed(values: Floats, width: float, starts: Starts) -> Floats:
    """Return values after a zero-phase low-pass, a Gaussian of a width in samples, (n,)."""
    return by_piece(lambda piece: gaussian_filter1d(piece, width), values, starts)


def gradient(values: Floats, period: float, starts: Starts) -> Floats:
    """Return the derivative by central differences, (n,)."""
    return by_piece(lambda piece: np.gradient(piece, period), values, starts)


def around(after: Floats, starts: Starts) -> Floats:
    """Return means over the steps before and behind each sample, (n,), of means over those behind."""
    before = by_piece(lambda piece: np.concatenate([piece[:1], piece[:-1]]), after, starts)
    return 0.5 * (before + after)


def inside(size: int, starts: Starts, margin: int) -> NDArray[np.bool_]:
    """Return whether a sample is so many samples from both ends of its piece, (size,) bool."""
    mask = np.zeros(size, bool)
    for piece in bounds(size, starts):
        mask[piece.start + margin : max(piece.stop - margin, 0)] = True
    return mask


def bounds(size: int, starts: Starts) -> list[slice]:
    """Return the rows of each piece."""
    return [slice(start, end) for start, end in zip(starts, (*starts[1:], size), strict=True)]


def longest_piece(size: int, starts: Starts) -> slice:
    """Return the rows of the longest piece."""
    return max(bounds(size, starts), key=lambda piece: piece.stop - piece.start)


def partitions(
    position: Floats, torque: Floats, used: NDArray[np.bool_], period: float, starts: Starts = WHOLE_LOG
) -> dict[str, list[NDArray[np.bool_]]]:
    """Return masks over all samples, (n,) each, by the quantity in which parts differ; samples at rest are in none.

    Args:
        position: (n,) [u].
        torque: (n,) [N·m].
        used: whether a sample is in motion, (n,) bool.
        period: of the samples [s].
        starts: of the pieces.
    """
    width = max(_SORTING_FILTER / period, 1.0)
    speed = smoothed(gradient(position, period, starts), width, starts)
    size = np.abs(smoothed(torque, width, starts))
    time = np.arange(used.size, dtype=np.float64)
    return {
        "time": _as_many(time, used, 3),
        "direction": [used & (speed < 0), used & (speed >= 0)],
        "speed": _as_many(np.abs(speed), used, 3),
        "position": as_wide(position, used, 4),
        "torque": _as_many(size, used, 3),
    }


def _as_many(values: Floats, used: NDArray[np.bool_], count: int) -> list[NDArray[np.bool_]]:
    """Return masks of parts with as many samples each."""
    edges = np.quantile(values[used], np.linspace(0, 1, count + 1)[1:-1])
    number = np.searchsorted(edges, values)
    return [used & (number == k) for k in range(count)]


def as_wide(values: Floats, used: NDArray[np.bool_], count: int) -> list[NDArray[np.bool_]]:
    """Return masks of parts that span as much of the values' range each."""
    edges = np.linspace(values[used].min(), values[used].max(), count + 1)[1:-1]
    number = np.searchsorted(edges, values)
    return [used & (number == k) for k in range(count)]
