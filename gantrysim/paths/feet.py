"""Feet of points on a path: the nearest points of smooth parts of it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats, dot, scaled_rows
from gantrysim.base.columns import Column

# The frame that moves along a path, at arc lengths.


@dataclass(frozen=True)
class Local:
    """A path and its frame at arc lengths.

    Attributes:
        position: points c, (n, 3) [mm].
        heading: cosine and sine of the heading theta, (n,) each.
        sine: of the angle of climb beta, (n,).
        turning: kappa = d(theta)/ds, (n,) [1/mm].
        frames: directions u, v, w of planes, (m, 3, 3).
        plane: which of them each point has, (n,).
    """

    position: Floats
    heading: tuple[Floats, Floats]
    sine: Floats
    turning: Floats
    frames: Floats
    plane: NDArray[np.intp]

    @cached_property
    def along(self) -> Floats:
        """Directions h of the heading, in the plane, (n, 3)."""
        cosine, sine = self.heading
        along = scaled_rows(self._direction(0), cosine)
        along += scaled_rows(self._direction(1), sine)
        return along

    @cached_property
    def normal(self) -> Floats:
        """Left normals n, (n, 3)."""
        cosine, sine = self.heading
        normal = scaled_rows(self._direction(1), cosine)
        normal -= scaled_rows(self._direction(0), sine)
        return normal

    @cached_property
    def up(self) -> Floats:
        """Normals w of the plane, (n, 3)."""
        return self._direction(2)

    @cached_property
    def cosine(self) -> Floats:
        """Cosine of the angle of climb, (n,)."""
        return np.sqrt(np.maximum(1 - self.sine**2, 0.0))

    @property
    def tangent(self) -> Floats:
        """Unit tangents t, (n, 3)."""
        return scaled_rows(self.along, self.cosine) + scaled_rows(self.up, self.sine)

    @property
    def curvature(self) -> Floats:
        """Curvature vectors kappa cos(beta) n, that is dt/ds at a constant climb, (n, 3) [1/mm]."""
        return scaled_rows(self.normal, self.turning * self.cosine)

    def _direction(self, k: int) -> Floats:
        """Return one direction of each point's plane, (n, 3)."""
        # most paths have one plane
        if len(self.frames) == 1:
            return np.broadcast_to(self.frames[0, k], (self.plane.size, 3))
        return self.frames[self.plane, k]


_STEPS = 60
_LAST_STEP = 1e-7  # after which the error is of the order of its square [mm]
_BISECTED = 1e-11  # interval that is no longer halved [mm]
# inside the ends of a smooth part, where its own tangent holds, not that behind a corner [mm]
_INSIDE = 1e-11
_INSIDE_ROUNDING = 4.0  # and at least so many times the rounding of the arc length


@dataclass(frozen=True)
class Projection:
    """Points projected onto a path.

    Attributes:
        s: arc length of the foot points, (n,) [mm].
        offset: point minus foot point, (n, 3) [mm].
        lateral: component along the left normal, (n,) [mm].
        vertical: component along the binormal, tangent x left normal, up on a level path, (n,) [mm].
        beyond: distance along the tangent, ahead positive: 0 but at an end of the path, or at a corner at which
            it nearly retraces itself, (n,) [mm].
        distance: distance to the path, (n,) [mm].
    """

    s: Column[Floats] = Column()
    offset: Column[Floats] = Column()
    lateral: Column[Floats] = Column()
    vertical: Column[Floats] = Column()
    beyond: Column[Floats] = Column()
    distance: Column[Floats] = Column()


class SmoothPath(Protocol):
    """A path with a frame everywhere: what feet need of it."""

    def local(self, s: Floats) -> Local:
        """Points and the path's frame at arc lengths."""


def foot_between(path: SmoothPath, p: Floats, low: Floats, high: Floats, guess: Floats) -> Projection:
    """Project points onto smooth parts of a path between two arc lengths, from a guess.

    Newton's method on g(s) = (c(s) - p).t(s) = 0, with g' = 1 + (c(s) - p).t'(s). A step beyond an end of the part
    goes to that end, which is the foot if g points outwards there; one beyond a place that is known to be on the other
    side of the foot, as at centres of curvature, is replaced by bisection.

    Args:
        path: the path.
        p: points, (n, 3) [mm].
        low: begin of each part, (n,) [mm].
        high: end of each part, (n,) [mm].
        guess: of the foot, (n,) [mm].
    """
    inset = np.maximum(_INSIDE, _INSIDE_ROUNDING * np.spacing(high))
    first = np.minimum(low + inset, high)
    last = np.maximum(high - inset, first)
    s = np.clip(guess, first, last)
    # of the foot: the furthest place that is known to be, none so far
    behind = first - 1.0
    ahead = last + 1.0
    rows = np.arange(len(p))
    for _ in range(_STEPS):
        here = path.local(s[rows])
        back = here.position - p[rows]
        g = dot(back, here.tangent)
        slope = 1.0 + dot(back, here.curvature)
        now = s[rows]
        ahead[rows] = np.where(g > 0, now, ahead[rows])
        behind[rows] = np.where(g > 0, behind[rows], now)
        with np.errstate(divide="ignore", invalid="ignore"):
            moved = now - np.where(slope > 0, g / slope, np.copysign(np.inf, g))
        moved = np.clip(moved, first[rows], last[rows])
        known = (moved <= behind[rows]) & (g > 0) | (moved >= ahead[rows]) & (g <= 0)
        moved = np.where(known, 0.5 * (behind[rows] + ahead[rows]), moved)
        s[rows] = moved
        rows = rows[np.abs(moved - now) > np.where(known, _BISECTED, _LAST_STEP)]
        if not rows.size:
            break
    here = path.local(s)
    offset = p - here.position
    normal = here.normal
    tangent = here.tangent
    at_low = s <= first
    at_high = s >= last
    foot = np.where(at_low, low, np.where(at_high, high, s))
    # from just inside the end to the end
    offset -= scaled_rows(tangent, foot - s)
    return Projection(
        s=foot,
        offset=offset,
        lateral=dot(offset, normal),
        vertical=dot(offset, np.cross(tangent, normal)),
        beyond=dot(offset, tangent),
        distance=np.sqrt(dot(offset, offset)),
    )
