"""The fastest speed along a path that limits of the feed and of the axes allow.

Where axes q move along a path s with q' = dq/ds and q'' = d2q/ds2, their velocities are q' v and their
accelerations q' u + q'' v^2, with the path's speed v and acceleration u. Over the square of the speed x = v^2,
which u = (dx/ds) / 2 changes evenly where u is constant, all limits are linear. So one pass backward finds from
how fast the path's end, and every halt, can still be reached, and one forward pass takes the most of it.
(Bobrow, Dubowsky and Gibson 1985; Pham and Pham 2018 for the two passes.)
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from gantrysim.arrays import Floats
from gantrysim.errors import InputError

# What is kept in hand of an acceleration limit for what lies between two nodes, where it is not looked at.
_IN_HAND = 1e-3
_FEWEST = 8  # intervals of a piece
_MOST = 2_000_000  # nodes of a path


class Limited:
    """A law whose acceleration is constant between nodes.

    Args:
        s: way at the nodes, (m,) [mm].
        speed: there, (m,) [mm/s].
    """

    def __init__(self, s: Floats, speed: Floats) -> None:
        self._s, self._v = s, speed
        endless = ~np.isfinite(speed)
        if endless.any():
            raise InputError(f"speed = {speed[endless][0]:g} mm/s at {s[endless][0]:g} mm of the path: must be finite")
        total, step = speed[1:] + speed[:-1], np.diff(s)
        stuck = (total <= 0) & (step > 0)
        if stuck.any():
            raise InputError(f"speed = 0 mm/s at {s[:-1][stuck][0]:g} mm of the path: the limits leave no way on")
        self._dt = np.divide(2 * step, total, out=np.zeros_like(step), where=step > 0)
        self._t = np.concatenate([[0.0], np.cumsum(self._dt)])

    @property
    def length(self) -> float:
        return float(self._s[-1])

    @property
    def duration(self) -> float:
        return float(self._t[-1])

    @cached_property
    def slowest(self) -> tuple[float, float]:
        """Smallest speed after the first rise and before the last fall, and the way at which it is [mm/s, mm]."""
        change, peak = np.diff(self._v), int(self._v.argmax())
        falling, rising = np.flatnonzero(change < 0), np.flatnonzero(change > 0)
        first = int(falling[0]) if falling.size else peak
        last = int(rising[-1]) + 1 if rising.size else peak
        if first > last:  # a single rise and fall
            first = last = peak
        k = first + int(self._v[first : last + 1].argmin())
        return float(self._v[k]), float(self._s[k])

    def _locate(self, t: ArrayLike) -> tuple[NDArray[np.intp], Floats, Floats]:
        at = np.clip(np.asarray(t, float), 0.0, self.duration)
        k = np.clip(np.searchsorted(self._t, at, side="right") - 1, 0, self._dt.size - 1)
        rate = np.divide(self._v[k + 1] - self._v[k], self._dt[k], out=np.zeros(k.shape), where=self._dt[k] > 0)
        return k, at - self._t[k], rate

    def position(self, t: ArrayLike) -> Floats:
        k, rest, rate = self._locate(t)
        return np.clip(self._s[k] + rest * (self._v[k] + 0.5 * rate * rest), 0.0, self.length)

    def velocity(self, t: ArrayLike) -> Floats:
        k, rest, rate = self._locate(t)
        at = np.asarray(t, float)
        return np.where((at >= 0) & (at <= self.duration), self._v[k] + rate * rest, 0.0)

    def reached(self, s: float) -> float:
        """Return the time at which the way s is reached [s]."""
        k = int(np.clip(np.searchsorted(self._s, s, side="left") - 1, 0, self._dt.size - 1))
        low, high = self._v[k], self._v[k + 1]
        rest = max(s - self._s[k], 0.0)
        step = self._s[k + 1] - self._s[k]
        share = min(rest / step, 1.0) if step > 0 else 1.0
        at = np.sqrt((1 - share) * low**2 + share * high**2)
        return float(self._t[k] + (2 * rest / (low + at) if rest > 0 else 0.0))


def nodes(ends: ArrayLike, step: ArrayLike) -> tuple[Floats, NDArray[np.intp]]:
    """Return nodes along a path of pieces, with both ends of every piece, and the piece of each node.

    Args:
        ends: arc length at the end of every piece, (p,) [mm].
        step: longest distance of two nodes, one for all or (p,) [mm].

    Returns:
        s: (m,), twice the same where two pieces meet [mm].
        piece: (m,).

    Raises:
        InputError: a path so long that these would not fit into memory.
    """
    edges = np.concatenate([[0.0], np.atleast_1d(np.asarray(ends, float))])
    intervals = np.maximum(np.ceil(np.diff(edges) / np.asarray(step, float)), _FEWEST)
    if not intervals.sum() <= _MOST:
        raise InputError(
            f"path of {edges[-1]:g} mm in {edges.size - 1} pieces: needs {intervals.sum():.3g} places at which "
            f"its limits are looked at, must be at most {_MOST:g}"
        )
    count = intervals.astype(np.intp) + 1
    piece = np.repeat(np.arange(count.size), count)
    first = np.concatenate([[0], np.cumsum(count)[:-1]])
    share = (np.arange(piece.size) - first[piece]) / (count[piece] - 1)
    return np.where(share < 1, edges[piece] + share * np.diff(edges)[piece], edges[piece + 1]), piece


def fastest(
    s: Floats,
    speed: ArrayLike,
    rate: Floats,
    bend: Floats,
    velocity: ArrayLike,
    acceleration: ArrayLike,
    begin: float = 0.0,
    end: float = 0.0,
) -> Limited:
    """Return the fastest law along the nodes of a path within limits.

    No node is passed faster than its own bend allows at constant speed. Between the nodes the accelerations may
    pass their limits by what the bend changes over half a step; a thousandth is kept in hand for it.

    Args:
        s: nodes, (m,), not descending; two at one place where the bend jumps [mm].
        speed: largest path speed at each node, one for all or (m,); 0 is a halt [mm/s].
        rate: q', (m, axes) [mm/mm].
        bend: q'', (m, axes) [mm/mm²].
        velocity: limits of the axes, (axes,); inf where there is none [mm/s].
        acceleration: limits of the axes, (axes,); inf where there is none [mm/s²].
        begin: path speed at the start, where any acceleration is limited [mm/s].
        end: the same at the end [mm/s].

    Raises:
        InputError: the path cannot be left with the speed `begin`.
    """
    top = np.broadcast_to(np.asarray(speed, float), s.shape) ** 2
    limit = np.asarray(acceleration, float) * (1 - _IN_HAND)
    with np.errstate(divide="ignore", invalid="ignore"):
        for bound in ((np.asarray(velocity, float) / np.abs(rate)) ** 2, limit / np.abs(bend)):
            top = np.minimum(top, np.nanmin(np.where(np.isnan(bound), np.inf, bound), axis=1, initial=np.inf))
    if not np.isfinite(limit).any():
        return Limited(s, np.sqrt(top))
    finite = np.isfinite(limit)
    top[-1] = min(top[-1], end**2)
    square = _backward(s, top, rate[:, finite], bend[:, finite], limit[finite])
    if begin**2 > square[0] * (1 + 1e-9) + 1e-12:
        raise InputError(f"speed at the start = {begin:g} mm/s: must be at most {np.sqrt(square[0]):g} mm/s")
    square[0] = min(square[0], begin**2)
    return Limited(s, np.sqrt(_forward(s, square, rate[:, finite], bend[:, finite], limit[finite])))


_jit: Any = numba.njit(cache=True, error_model="numpy")


@_jit
def _backward(s: Floats, top: Floats, rate: Floats, bend: Floats, limit: Floats) -> Floats:
    """Squares of the speeds from which everything ahead can be met, (m,)."""
    x = top.copy()
    for k in range(s.size - 2, -1, -1):
        after, step = x[k + 1], 2 * (s[k + 1] - s[k])
        if x[k] <= after:
            continue
        if step <= 0.0:
            x[k] = after
            continue
        for i in range(limit.size):
            for g, h in (
                (bend[k, i] - rate[k, i] / step, rate[k, i] * after / step),
                (-rate[k + 1, i] / step, (rate[k + 1, i] / step + bend[k + 1, i]) * after),
            ):
                if g > 0.0:
                    x[k] = min(x[k], (limit[i] - h) / g)
                elif g < 0.0:
                    x[k] = min(x[k], (limit[i] + h) / -g)
        x[k] = max(x[k], after)
    return x


@_jit
def _forward(s: Floats, top: Floats, rate: Floats, bend: Floats, limit: Floats) -> Floats:
    """Squares of the speeds that are reached, (m,)."""
    x = top.copy()
    for k in range(s.size - 1):
        before, step = x[k], 2 * (s[k + 1] - s[k])
        if x[k + 1] <= before:
            continue
        if step <= 0.0:
            x[k + 1] = before
            continue
        for i in range(limit.size):
            for g, h in (
                (rate[k, i] / step, (bend[k, i] - rate[k, i] / step) * before),
                (rate[k + 1, i] / step + bend[k + 1, i], -rate[k + 1, i] * before / step),
            ):
                if g > 0.0:
                    x[k + 1] = min(x[k + 1], (limit[i] - h) / g)
                elif g < 0.0:
                    x[k + 1] = min(x[k + 1], (limit[i] + h) / -g)
        x[k + 1] = max(x[k + 1], before)
    return x
