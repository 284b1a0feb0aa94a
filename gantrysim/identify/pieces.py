"""Filters over a log of several pieces, between which rows are missing: none reaches from one piece into another."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from gantrysim.base.arrays import Floats

Starts = tuple[int, ...]  # rows at which a piece begins, rising from 0
WHOLE: Starts = (0,)


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
