"""Feet of points on a path, the nearest points of smooth parts of it, and the progress of a trace along it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gantrysim.base.arrays import Floats, read_only_view, scaled_rows
from gantrysim.base.columns import Column
from gantrysim.base.jit import jit
from gantrysim.paths.nearest import find_assignment

_LONGEST_CHORD = 0.05  # chord of the path [mm]
_MOST_POINTS = 10_000  # of the trace; of a longer one every k-th is taken, and between them the progress is even
_MOST_CHORDS = 1_000_000  # of the path
_MOST_CELLS = 100_000_000  # of the dynamic program, a byte each

# The frame that moves along a path, at arc lengths.

Frames = tuple[Floats, Floats, Floats, Floats, Floats, Floats, NDArray[np.intp]]


class SearchedPath(Protocol):
    """A path on which feet are searched for: what an assignment needs of it."""

    @property
    def length(self) -> float:
        """Arc length [mm]."""

    @property
    def corners(self) -> Floats:
        """Arc lengths at which the tangent jumps, ascending, (m,) [mm]."""

    def position(self, s: ArrayLike) -> Floats:
        """Points at arc lengths, (n, 3) [mm]."""

    def near(self, trace: Floats, places: Floats, stretches: Floats | Sequence[Floats]) -> Projection:
        """Project points onto stretches of the path, (2, n) [mm], about places, (n,) [mm]."""


def assigned_progress(path: SearchedPath, trace: Floats, between: Floats | None = None) -> Floats:
    """Return the progress of a trace along a path, (n,) [mm].

    Among all that never fall it is the one with the least sum of squared distances between the points of the trace and
    chords of the path; then the nearest place on the part of the path that belongs to the chord.

    Args:
        path: the path.
        trace: points in the order of the motion, (n, 3) [mm].
        between: least and largest progress of each point, (2, n); by default 0 and the path's length [mm].
    """
    if between is None:
        between = np.tile([[0.0], [path.length]], len(trace))
    rows = np.unique(np.linspace(0, len(trace) - 1, min(len(trace), _MOST_POINTS)).astype(np.intp))
    widest = float((between[1, rows] - between[0, np.maximum(rows - 1, 0)]).max())
    longest = max(_LONGEST_CHORD, path.length / _MOST_CHORDS, widest * rows.size / _MOST_CELLS)
    even = np.linspace(0.0, path.length, max(int(np.ceil(path.length / longest)), 1) + 1)
    s = np.union1d(even, path.corners)
    tried = np.clip(np.searchsorted(s, between[:, rows], side="right") - 1, 0, s.size - 2)
    tried[0] = np.maximum.accumulate(tried[0])
    tried[1] = np.maximum(np.minimum.accumulate(tried[1, ::-1])[::-1], tried[0])
    before = np.append(tried[0, :1], tried[0, :-1])
    chords = np.empty(rows.size, np.int64)
    find_assignment(  # type: ignore[no-untyped-call]
        read_only_view(np.asfortranarray(path.position(s))),
        read_only_view(np.ascontiguousarray(trace[rows])),
        tried,
        np.full(s.size - 1, np.inf),
        np.empty((rows.size, int((tried[1] - before).max()) + 1), np.bool_),
        chords,
    )
    begin, end = (np.interp(np.arange(len(trace)), rows, s[chords + later]) for later in (0, 1))
    stretches = np.clip(np.stack([begin, end]), *between[:, None])
    return np.maximum.accumulate(path.near(trace, begin, stretches).s)


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

    @property
    def columns(self) -> Frames:
        """Position, cosine and sine of the heading, sine of the climb, turning, frames and plane."""
        return self.position, *self.heading, self.sine, self.turning, self.frames, self.plane

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


_NEWTON_STEPS = 60
# of Newton's method, after which the error is of the order of its square, and the path a line [mm]
_LAST_STEP = 1e-7
_BISECTED = 1e-11  # interval that is no longer halved [mm]
# inside the ends of a smooth part, where its own tangent holds, not that behind a corner [mm]
_INSIDE_PART = 1e-11
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
        turning: curvature of the path there, as of `Path.curvature`, (n,) [1/mm].
    """

    s: Column[Floats] = Column()
    offset: Column[Floats] = Column()
    lateral: Column[Floats] = Column()
    vertical: Column[Floats] = Column()
    beyond: Column[Floats] = Column()
    distance: Column[Floats] = Column()
    turning: Column[Floats] = Column()


def foot_between(local: Callable[[Floats], Local], p: Floats, low: Floats, high: Floats, guess: Floats) -> Projection:
    """Project points onto smooth parts of a path between two arc lengths, from a guess.

    Newton's method on g(s) = (c(s) - p).t(s) = 0, with g' = 1 + (c(s) - p).t'(s). A step beyond an end of the part
    goes to that end, which is the foot if g points outwards there; one beyond a place that is known to be on the other
    side of the foot, as at centres of curvature, is replaced by bisection.

    Args:
        local: points and frame of the path at arc lengths.
        p: points, (n, 3) [mm].
        low: begin of each part, (n,) [mm].
        high: end of each part, (n,) [mm].
        guess: of the foot, (n,) [mm].
    """
    inset = np.maximum(_INSIDE_PART, _INSIDE_ROUNDING * np.spacing(high))
    first = np.minimum(low + inset, high)
    last = np.maximum(high - inset, first)
    s = np.clip(guess, first, last)
    # behind and ahead no place is known so far
    search = _Search(p, s, low, first, last, high, first - 1.0, last + 1.0)
    n = len(p)
    feet = _Feet(*(np.empty((n, 3) if name == "offset" else n) for name in _Feet._fields))
    rows = np.arange(n)
    for step in range(_NEWTON_STEPS + 1):
        rows = rows[: _approach(search, rows, local(s[rows]).columns, feet, step == _NEWTON_STEPS)]
        if not rows.size:
            break
    return Projection(*feet)


class _Search(NamedTuple):
    """Points, and what is known of their feet, (n,) each.

    Attributes:
        points: (n, 3) [mm].
        s: places on the way to the feet [mm].
        low, high: ends of the smooth parts on which the feet lie [mm].
        first, last: places just inside [mm].
        behind, ahead: of the foot, the furthest places that are known to be [mm].
    """

    points: Floats
    s: Floats
    low: Floats
    first: Floats
    last: Floats
    high: Floats
    behind: Floats
    ahead: Floats


class _Feet(NamedTuple):
    """Columns of a `Projection`."""

    s: Floats
    offset: Floats
    lateral: Floats
    vertical: Floats
    beyond: Floats
    distance: Floats
    turning: Floats


class _View(NamedTuple):
    """A point from a place of the path.

    Attributes:
        offset: of the point from there [mm].
        along, across, up: components of the offset in the plane, along the heading and to its left, and normal to it.
        cosine, sine: of the angle of climb.
        turning: kappa [1/mm].
    """

    offset: tuple[float, float, float]
    along: float
    across: float
    up: float
    cosine: float
    sine: float
    turning: float


@jit
def _approach(search: _Search, rows: NDArray[np.intp], frames: Frames, feet: _Feet, stay: bool) -> int:
    """Move places towards the feet, and write the feet of those that are as good as there.

    Args:
        search: for the feet.
        rows: of the points, (m,); those that go on are moved to its begin.
        frames: columns of a `Local` at the places of these rows.
        feet: written.
        stay: whether the places are the feet.

    Returns:
        How many go on.
    """
    count = 0
    for j in range(rows.size):
        k = rows[j]
        view = _view_from(frames, j, search.points[k])
        g = -(view.cosine * view.along + view.sine * view.up)
        slope = 1.0 - view.across * view.turning * view.cosine
        now = search.s[k]
        place = now
        if not stay:
            if g > 0.0:
                search.ahead[k] = now
            else:
                search.behind[k] = now
            place = now - (g / slope if slope > 0.0 else np.copysign(np.inf, g))
            place = min(max(place, search.first[k]), search.last[k])
            is_known = place <= search.behind[k] if g > 0.0 else place >= search.ahead[k]
            if is_known:
                place = 0.5 * (search.behind[k] + search.ahead[k])
            search.s[k] = place
            if abs(place - now) > (_BISECTED if is_known else _LAST_STEP):
                rows[count] = k
                count += 1
                continue
        foot = place
        if place <= search.first[k]:
            foot = search.low[k]
        elif place >= search.last[k]:
            foot = search.high[k]
        feet.s[k] = foot
        feet.turning[k] = view.turning
        feet.beyond[k] = -(g + slope * (foot - now))
        _write_offset(view, (frames[1][j], frames[2][j]), frames[5][frames[6][j]], foot - now, feet, k)
    return count


@jit
def _view_from(frames: Frames, j: int, point: Floats) -> _View:
    """Return the view of a point from the place j of some frames."""
    position, heading_cosine, heading_sine, climb, turning, planes, plane = frames
    offset = (point[0] - position[j, 0], point[1] - position[j, 1], point[2] - position[j, 2])
    u = _component(offset, planes[plane[j], 0])
    v = _component(offset, planes[plane[j], 1])
    return _View(
        offset=offset,
        along=heading_cosine[j] * u + heading_sine[j] * v,
        across=heading_cosine[j] * v - heading_sine[j] * u,
        up=_component(offset, planes[plane[j], 2]),
        cosine=np.sqrt(max(1.0 - climb[j] * climb[j], 0.0)),
        sine=climb[j],
        turning=turning[j],
    )


@jit
def _component(vector: tuple[float, float, float], direction: Floats) -> float:
    return vector[0] * direction[0] + vector[1] * direction[1] + vector[2] * direction[2]


@jit
def _write_offset(view: _View, heading: tuple[float, float], plane: Floats, moved: float, feet: _Feet, k: int) -> None:
    """Write the offset of point k from its foot, on the tangent at a short way from the place of the view.

    Args:
        view: from the last place on the way to the foot.
        heading: its cosine and sine there.
        plane: its directions there, (3, 3).
        moved: way from there [mm].
        feet: written.
        k: point.
    """
    square = 0.0
    for a in range(3):
        along = heading[0] * plane[0, a] + heading[1] * plane[1, a]
        component = view.offset[a] - moved * (view.cosine * along + view.sine * plane[2, a])
        feet.offset[k, a] = component
        square += component * component
    # the heading turns on the way
    turned = view.turning * moved
    along = view.along - view.cosine * moved
    up = view.up - view.sine * moved
    feet.lateral[k] = view.across - turned * along
    feet.vertical[k] = view.cosine * up - view.sine * (along + turned * view.across)
    feet.distance[k] = np.sqrt(square)
