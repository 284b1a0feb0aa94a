"""The fastest speed profile along a path within limits of the feed and of the axes.

With q' = dq/ds and q'' = d2q/ds2 of the axes' positions q(s), their velocities are q' v and their accelerations
q' u + q'' v^2, at the path's speed v and acceleration u = (dx/ds) / 2. In x = v^2, which is linear in s where u is
constant, all limits are linear. One backward pass finds the highest speeds from which the path's end, and every halt,
can still be reached; one forward pass takes the highest reachable speeds below.
(Bobrow, Dubowsky and Gibson 1985; Pham and Pham 2018 for the two passes.)
"""

from __future__ import annotations

from functools import cached_property, reduce
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError
from gantrysim.base.jit import jit

LIMIT_MARGIN = 1e-3  # share of an acceleration limit reserved for excesses between nodes
_PIECE_INTERVALS = 8  # intervals of a piece
_MOST_NODES = 2_000_000  # nodes of a path


class Limited:
    """A speed profile of constant acceleration between nodes.

    Args:
        s: arc length at the nodes, (m,) [mm].
        speed: there, (m,) [mm/s].
    """

    def __init__(self, s: Floats, speed: Floats) -> None:
        self._s = s
        self._v = speed
        unlimited = ~np.isfinite(speed)
        if unlimited.any():
            place = s[unlimited][0]
            raise InputError(f"speed = {speed[unlimited][0]:g} mm/s at {place:g} mm of the path: must be finite")
        total = speed[1:] + speed[:-1]
        step = np.diff(s)
        stuck = (total <= 0) & (step > 0)
        if stuck.any():
            raise InputError(f"speed = 0 mm/s at {s[:-1][stuck][0]:g} mm of the path: the limits allow no motion")
        # in place: of a program of a million lines these are the largest arrays
        step *= 2
        self._dt = np.divide(step, total, out=step, where=step > 0)
        self._t = np.zeros_like(s)
        np.cumsum(self._dt, out=self._t[1:])

    @property
    def length(self) -> float:
        return float(self._s[-1])

    @property
    def duration(self) -> float:
        return float(self._t[-1])

    @property
    def knots(self) -> tuple[Floats, Floats, Floats]:
        """Arc lengths, speeds and times of the nodes, (m,) each [mm, mm/s, s]."""
        return self._s, self._v, self._t

    @cached_property
    def slowest(self) -> tuple[float, float]:
        """Lowest speed between the first rise and the last fall, and its arc length [mm/s, mm]."""
        change = np.diff(self._v)
        peak = int(self._v.argmax())
        falling = np.flatnonzero(change < 0)
        rising = np.flatnonzero(change > 0)
        first = int(falling[0]) if falling.size else peak
        last = int(rising[-1]) + 1 if rising.size else peak
        if first > last:  # a single rise and fall
            first = last = peak
        k = first + int(self._v[first : last + 1].argmin())
        return float(self._v[k]), float(self._s[k])

    def _locate(self, t: ArrayLike) -> tuple[NDArray[np.intp], Floats, Floats]:
        """Return the intervals at times, the times since their beginnings, and their accelerations, (n,) each."""
        time = np.clip(np.asarray(t, float), 0.0, self.duration)
        k = np.clip(np.searchsorted(self._t, time, side="right") - 1, 0, self._dt.size - 1)
        rate = np.divide(self._v[k + 1] - self._v[k], self._dt[k], out=np.zeros(k.shape), where=self._dt[k] > 0)
        return k, time - self._t[k], rate

    def position(self, t: ArrayLike) -> Floats:
        k, elapsed, rate = self._locate(t)
        return np.clip(self._s[k] + elapsed * (self._v[k] + 0.5 * rate * elapsed), 0.0, self.length)

    def velocity(self, t: ArrayLike) -> Floats:
        k, elapsed, rate = self._locate(t)
        time = np.asarray(t, float)
        return np.where((time >= 0) & (time <= self.duration), self._v[k] + rate * elapsed, 0.0)

    def time_at(self, s: float) -> float:
        """Return the time at which the arc length s is reached [s]."""
        k = int(np.clip(np.searchsorted(self._s, s, side="left") - 1, 0, self._dt.size - 1))
        low = self._v[k]
        high = self._v[k + 1]
        distance = max(s - self._s[k], 0.0)
        if not distance > 0:
            return float(self._t[k])
        step = self._s[k + 1] - self._s[k]
        share = min(distance / step, 1.0) if step > 0 else 1.0
        # v² is linear in s
        speed = np.sqrt((1 - share) * low**2 + share * high**2)
        return float(self._t[k] + 2 * distance / (low + speed))


def nodes(ends: ArrayLike, step: ArrayLike) -> tuple[Floats, NDArray[np.intp]]:
    """Return nodes along a path of pieces, including both ends of every piece, and the piece of each node.

    Args:
        ends: arc length at the end of every piece, (p,) [mm].
        step: largest distance of two nodes, one for all or (p,) [mm].

    Returns:
        s: (m,), the same value twice where two pieces meet [mm].
        piece: (m,).

    Raises:
        InputError: too many nodes for the memory.
    """
    edges = np.concatenate([[0.0], np.atleast_1d(np.asarray(ends, float))])
    intervals = np.maximum(np.ceil(np.diff(edges) / np.asarray(step, float)), _PIECE_INTERVALS)
    if not intervals.sum() <= _MOST_NODES:
        raise InputError(
            f"path of {edges[-1]:g} mm in {edges.size - 1} pieces: needs {intervals.sum():.3g} nodes "
            f"for its limits, must be at most {_MOST_NODES:g}"
        )
    count = intervals.astype(np.intp) + 1
    piece = np.repeat(np.arange(count.size), count)
    first = np.concatenate([[0], np.cumsum(count)[:-1]])
    share = (np.arange(piece.size) - first[piece]) / (count[piece] - 1)
    return np.where(share < 1, edges[piece] + share * np.diff(edges)[piece], edges[piece + 1]), piece


def velocity_bound(s: Floats, first: Floats, velocity: ArrayLike) -> Floats:
    """Return the speed that keeps the axes to their velocity limits, at and between nodes, (m,) [mm/s].

    It allows for the derivatives at a node's neighbours too.

    Args:
        s: nodes, (m,), the same value twice where two pieces meet [mm].
        first: derivatives of the axes by the arc length, (m, axes).
        velocity: limits of the axes, (axes,); inf for none.
    """
    derivative = np.abs(first)
    largest = derivative.copy()
    inside = (np.diff(s) > 0)[:, None]
    np.maximum(largest[:-1], derivative[1:], out=largest[:-1], where=inside)
    np.maximum(largest[1:], derivative[:-1], out=largest[1:], where=inside)
    with np.errstate(divide="ignore"):
        bounds = np.asarray(velocity, float) / largest
    return reduce(np.minimum, bounds.T)


class Derivatives(NamedTuple):
    """Derivatives of the axes' positions by the arc length, at nodes of a path.

    Attributes:
        s: nodes, (m,), not descending; two at the same place where q'' jumps [mm].
        first: q', (m, axes) [mm/mm].
        second: q'', (m, axes) [mm/mm²].
    """

    s: Floats
    first: Floats
    second: Floats


def fastest(
    derivatives: Derivatives,
    speed: ArrayLike,
    velocity: ArrayLike,
    acceleration: ArrayLike,
    begin: float = 0.0,
    end: float = 0.0,
) -> Limited:
    """Return the fastest profile along the nodes of a path within limits.

    No node is passed faster than q'' allows at constant speed. Between nodes the accelerations may exceed their
    limits by the change of q'' over half a step, for which a thousandth of the limits is reserved.

    Args:
        derivatives: of the axes' positions at the nodes.
        speed: largest path speed at each node, one for all or (m,); 0 is a halt [mm/s].
        velocity: limits of the axes, (axes,); inf for none [mm/s].
        acceleration: limits of the axes, (axes,); inf for none [mm/s²].
        begin: path speed at the start, if any acceleration is limited [mm/s].
        end: path speed at the end, if any acceleration is limited [mm/s].

    Raises:
        InputError: the limits do not allow the speed `begin`.
    """
    s, first, second = derivatives
    top = np.broadcast_to(np.asarray(speed, float), s.shape) ** 2
    limit = np.asarray(acceleration, float) * (1 - LIMIT_MARGIN)
    with np.errstate(divide="ignore", invalid="ignore"):
        for bound in ((np.asarray(velocity, float) / np.abs(first)) ** 2, limit / np.abs(second)):
            # one after the other, as NumPy takes short rows slowly
            for of_axis in bound.T:
                # nan is no limit: such as of an infinite one where the axis rests
                top = np.fmin(top, of_axis)
    if not np.isfinite(limit).any():
        return Limited(s, np.sqrt(top))
    finite = np.isfinite(limit)
    top[-1] = min(top[-1], end**2)
    forward = s, first[:, finite], second[:, finite], top, limit[finite]
    square = _backward(*map(np.ascontiguousarray, forward))
    if begin**2 > square[0] * (1 + 1e-9) + 1e-12:
        raise InputError(f"speed at the start = {begin:g} mm/s: must be at most {np.sqrt(square[0]):g} mm/s")
    square[0] = min(square[0], begin**2)
    # the forward pass is the backward one of the reversed path, along which s and q' change their signs
    reverse = -s[::-1], -first[::-1, finite], second[::-1, finite], square[::-1], limit[finite]
    square = _backward(*map(np.ascontiguousarray, reverse))
    return Limited(s, np.sqrt(square[::-1]))


@jit
def _backward(s: Floats, first: Floats, second: Floats, top: Floats, limit: Floats) -> Floats:
    """Squares of the highest speeds from which all limits ahead can be kept, (m,)."""
    x = top.copy()
    for k in range(s.size - 2, -1, -1):
        after = x[k + 1]
        step = 2 * (s[k + 1] - s[k])
        if x[k] <= after:
            continue
        if step <= 0.0:
            x[k] = after
            continue
        for i in range(limit.size):
            for g, h in (
                (second[k, i] - first[k, i] / step, first[k, i] * after / step),
                (-first[k + 1, i] / step, (first[k + 1, i] / step + second[k + 1, i]) * after),
            ):
                if g > 0.0:
                    x[k] = min(x[k], (limit[i] - h) / g)
                elif g < 0.0:
                    x[k] = min(x[k], (limit[i] + h) / -g)
        x[k] = max(x[k], after)
    return x
