"""The fastest progress along a route within the limits of the axes, with pauses."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gantrysim.base.arrays import Floats, scaled_rows
from gantrysim.controllers.drawings.corners import SMOOTH_TURN, tangent
from gantrysim.controllers.drawings.routing import Route
from gantrysim.paths.limits import Derivatives, Limited, fastest, nodes, velocity_bound
from gantrysim.paths.pieces import Coil

# Largest angle of an arc between two nodes, within which the acceleration of an axis exceeds its limit by a share of an
# eighth of the angle's square [rad].
_TURN = 0.04
_RAMP_INTERVALS = 16  # intervals of a ramp, and of what is between two
_INSIDE_SHARE = 1e-7  # of a piece, from its ends to its inside


@dataclass(frozen=True)
class Paused:
    """A profile with pauses.

    Args:
        base: the profile without them.
        places: arc lengths of the pauses, ascending, (m,) [mm].
        pauses: their durations, (m,) [s].
    """

    base: Limited
    places: Floats
    pauses: Floats

    @property
    def length(self) -> float:
        return self.base.length

    @property
    def duration(self) -> float:
        return self.base.duration + float(self.pauses.sum())

    @cached_property
    def _pause_starts(self) -> Floats:
        """Times at which the pauses begin, (m,) [s]."""
        reached = np.array([self.base.time_at(s) for s in self.places])
        return reached + np.append(0.0, np.cumsum(self.pauses))[: self.pauses.size]

    def _moving(self, t: ArrayLike) -> Floats:
        """Time spent in motion, (n,) [s]."""
        time = np.asarray(t, float)
        k = np.searchsorted(self._pause_starts, time, side="right")
        paused = np.append(0.0, np.cumsum(self.pauses))
        end_of_pause = np.append(-np.inf, self._pause_starts + self.pauses)[k]
        # during the pause that began last the motion stands still
        return time - paused[k] + np.maximum(end_of_pause - time, 0.0)

    def position(self, t: ArrayLike) -> Floats:
        return self.base.position(self._moving(t))

    def velocity(self, t: ArrayLike) -> Floats:
        return np.where(self.resting(t) >= 0, 0.0, self.base.velocity(self._moving(t)))

    def resting(self, t: ArrayLike) -> NDArray[np.intp]:
        """Index of the pause at times, -1 in motion, (n,)."""
        time = np.asarray(t, float)
        k = np.searchsorted(self._pause_starts, time, side="right") - 1
        # index -1, before the first pause, takes -inf
        ends = np.append(self._pause_starts + self.pauses, -np.inf)
        return np.where(time < ends[k], k, -1)


def planned_progress(route: Route, velocity: ArrayLike, acceleration: ArrayLike, jump: float) -> Paused:
    """Return the fastest progress along a route.

    Args:
        route: the path, with a speed for each of its legs.
        velocity: limits of x, y and z [mm/s].
        acceleration: limits of x, y and z [mm/s²].
        jump: largest jump of an axis' velocity at a corner [mm/s].

    Raises:
        InputError: a path too long, or with too many pieces, for the memory.
    """
    legs = route.legs
    chain = route.chain
    ends, steps, owner = _spans(route, acceleration)
    s, span = nodes(ends, steps)
    piece = owner[span]
    edges = np.append(0.0, chain.ends)
    inset = _INSIDE_SHARE * np.diff(edges)[piece]
    inside = np.clip(s, edges[piece] + inset, edges[piece + 1] - inset)
    first = chain.tangent(inside)
    second = scaled_rows(chain.normal(inside), chain.curvature(inside) * np.sqrt(1 - chain.climb(inside) ** 2))
    speed = np.minimum(np.array([leg.speed for leg in legs])[piece], velocity_bound(s, first, velocity))
    limited = np.isfinite(np.asarray(acceleration, float))
    if limited.any():
        change = np.abs(np.diff(first, axis=0))[:, limited].max(axis=1)
        corner = (np.diff(piece) > 0) & (change > SMOOTH_TURN)
        # a corner has two nodes, at the end of one piece and at the begin of the next
        for side in (slice(None, -1), slice(1, None)):
            speed[side][corner] = np.minimum(speed[side][corner], jump / change[corner])
    pausing = np.array([k for k, leg in enumerate(legs) if leg.pause > 0], int)
    pauses = np.isin(piece, pausing) & (s == edges[piece + 1])
    if limited.any():
        speed[pauses] = 0.0
    base = fastest(Derivatives(s, first, second), speed, velocity, acceleration)
    return Paused(base, chain.ends[pausing], np.array([legs[k].pause for k in pausing]))


def _spans(route: Route, acceleration: ArrayLike) -> tuple[Floats, Floats, NDArray[np.intp]]:
    """Spans of even nodes: the legs, in three parts if they are longer than the ramps between rest and speed.

    Returns:
        ends: arc length at the end of every span, (p,) [mm].
        steps: largest distance of nodes, (p,) [mm].
        owner: leg of every span, (p,).
    """
    limits = np.asarray(acceleration, float)
    finite = [float(limit) for limit in limits if np.isfinite(limit)]
    starts = np.append(0.0, route.chain.ends[:-1])
    ends = []
    steps = []
    owner = []
    for k, (leg, begin, end) in enumerate(zip(route.legs, starts.tolist(), route.chain.ends.tolist(), strict=True)):
        length = end - begin
        if isinstance(leg.piece, Coil):
            largest_step = _TURN * leg.piece.radius[0]
            slowest = min(finite, default=np.inf)
        else:
            largest_step = np.inf
            direction = np.abs(tangent(leg.piece, 0.0))
            slowest = min(limit / share for limit, share in zip(limits, direction, strict=True) if share > 0)
        ramp = 0.5 * leg.speed**2 / slowest
        if 0 < ramp < 0.4 * length:
            lengths = [ramp, length - 2 * ramp, ramp]
            ends += [begin + ramp, end - ramp, end]
        else:
            lengths = [length]
            ends.append(end)
        # rounding must not add an interval
        steps += [min(part / _RAMP_INTERVALS * (1 + 1e-9), largest_step) for part in lengths]
        owner += [k] * len(lengths)
    return np.array(ends), np.array(steps), np.array(owner)
