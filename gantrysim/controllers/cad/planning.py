"""The fastest progress along a route within the limits of the axes, with rests."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gantrysim.arrays import Floats
from gantrysim.controllers.cad.corners import SMOOTH
from gantrysim.controllers.cad.routing import Route
from gantrysim.controllers.limits import Limited, fastest, nodes
from gantrysim.controllers.paths.pieces import Coil

# Largest distance of nodes: between them the acceleration of an axis exceeds its limit by a share of an eighth of the
# square of the angle that an arc turns.
_STEP = 0.2  # [mm]
_TURN = 0.04  # [rad]
_SHARE = 1e-7  # of a piece, from its ends to its inside


@dataclass(frozen=True)
class Paused:
    """A profile with rests.

    Args:
        base: without them.
        at: arc lengths of the rests, ascending, (m,) [mm].
        rest: their durations, (m,) [s].
    """

    base: Limited
    at: Floats
    rest: Floats

    @property
    def length(self) -> float:
        return self.base.length

    @property
    def duration(self) -> float:
        return self.base.duration + float(self.rest.sum())

    @cached_property
    def _begins(self) -> Floats:
        """Times at which the rests begin, (m,) [s]."""
        reached = np.array([self.base.reached(s) for s in self.at])
        return reached + np.append(0.0, np.cumsum(self.rest))[: self.rest.size]

    def _moving(self, t: ArrayLike) -> Floats:
        """Time spent in motion, (n,) [s]."""
        at = np.asarray(t, float)
        k = np.searchsorted(self._begins, at, side="right")
        done = np.append(0.0, np.cumsum(self.rest))
        began = np.append(-np.inf, self._begins + self.rest)[k]
        # during the rest that began last the motion stands still
        return at - done[k] + np.maximum(began - at, 0.0)

    def position(self, t: ArrayLike) -> Floats:
        return self.base.position(self._moving(t))

    def velocity(self, t: ArrayLike) -> Floats:
        return np.where(self.resting(t) >= 0, 0.0, self.base.velocity(self._moving(t)))

    def resting(self, t: ArrayLike) -> NDArray[np.intp]:
        """Index of the rest at times, -1 in motion, (n,)."""
        at = np.asarray(t, float)
        k = np.searchsorted(self._begins, at, side="right") - 1
        ends = np.append(self._begins + self.rest, -np.inf)
        return np.where(at < ends[k], k, -1)


def planned(route: Route, velocity: ArrayLike, acceleration: ArrayLike, jump: float) -> Paused:
    """Return the fastest progress along a route.

    Args:
        route: the path, with a speed for each of its legs.
        velocity: limits of x, y and z [mm/s].
        acceleration: limits of x, y and z [mm/s²].
        jump: largest jump of an axis' velocity at a corner [mm/s].

    Raises:
        InputError: a path too long, or with too many pieces, for the memory.
    """
    legs, chain = route.legs, route.chain
    steps = [
        min(_STEP, _TURN * leg.piece.radius[0]) if isinstance(leg.piece, Coil) else max(_STEP, leg.length / 500)
        for leg in legs
    ]
    s, piece = nodes(chain.ends, steps)
    edges = np.append(0.0, chain.ends)
    inset = _SHARE * np.diff(edges)[piece]
    local = chain.local(np.clip(s, edges[piece] + inset, edges[piece + 1] - inset))
    first, second = local.tangent, local.curvature
    speed = np.array([leg.speed for leg in legs])[piece]
    limited = np.isfinite(np.asarray(acceleration, float))
    if limited.any():
        change = np.abs(np.diff(first, axis=0))[:, limited].max(axis=1)
        corner = (np.diff(piece) > 0) & (change > SMOOTH)
        for side in (slice(None, -1), slice(1, None)):
            at = speed[side]
            at[corner] = np.minimum(at[corner], jump / change[corner])
    pauses = np.array([k for k, leg in enumerate(legs) if leg.pause > 0], int)
    rests = np.isin(piece, pauses) & (s == edges[piece + 1])
    if limited.any():
        speed[rests] = 0.0
    base = fastest(s, speed, first, second, velocity, acceleration)
    return Paused(base, chain.ends[pauses], np.array([legs[k].pause for k in pauses]))
