"""The spacing of neighbouring turns of a trace."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gantrysim.base.arrays import Floats, dot
from gantrysim.base.columns import Column, blocks, by_blocks, table_by_blocks
from gantrysim.base.jit import jit
from gantrysim.paths.feet import Frames
from gantrysim.paths.nearest import chord_near
from gantrysim.paths.path import Path, Projection

_NEWTON_STEPS = 20
_LAST_STEP = 1e-7  # Newton step below which the remaining error is of the order of its square [mm]
_SLOPE_REACH = 0.25  # [mm]; a shorter one differentiates encoder counts
_LEAST_SLOPE = 0.3  # cosine between the directions of two turns, below which Newton's step is shortened
_CORNER = 0.5  # least jump of the heading between two points that is a corner [rad]
_CORNER_LENGTH = 1.0  # larger distances mean that points in between are left out [mm]
_LEAST_OVERLAP = 0.02  # of the second turn over the first [rad]


@dataclass(frozen=True)
class Spacing:
    """Distance from each point of a spiral's trace to the next turn, along the trace's normal.

    Attributes:
        s: arc length of the points on the requested path, (m,) [mm].
        turn: turns of the tangent since the start of the requested path, (m,).
        distance: distance to the neighbouring turn, (m,) [mm].
        next_s: arc length of the neighbouring turn's points on the requested path, (m,) [mm].
        link: both points on the trace, (m, 2, 3) [mm].
    """

    s: Column[Floats] = Column()
    turn: Column[Floats] = Column()
    distance: Column[Floats] = Column()
    next_s: Column[Floats] = Column()
    link: Column[Floats] = Column()

    @property
    def rise(self) -> float:
        """Largest difference in height between both points of a link, 0 without any [mm]."""
        rises = 0.0
        for block in blocks(len(self.turn)):
            link = self.link[block]
            rises = max(rises, float(np.abs(link[:, 1, 2] - link[:, 0, 2]).max(initial=0.0)))
        return rises


def spacing(path: Path, trace: ArrayLike) -> Spacing:
    """Return the distance of neighbouring turns of a trace, along the trace's own normal in the path's plane.

    With s the foot of a point on the requested path and e(s) its lateral error, the trace in the plane is
    q(s) = c(s) + e(s) n(s), and its direction (cos(beta) - kappa e) h + e' n, with h the heading, beta the climb and e'
    taken over a quarter millimetre to both sides. The normal at each point p meets the trace again a turn later where
    (q(s') - p).direction = 0, solved by Newton's method. Points without a next turn are left out. On a path that turns
    both ways only the stretch that turns furthest one way counts.

    Args:
        path: the requested path.
        trace: points in the order of the motion, (n, 3) [mm].
    """
    foot = path.follow(trace)
    return spacing_of(path, foot, np.arange(foot.s.size))


def spacing_of(path: Path, foot: Projection, ticks: NDArray[np.intp], heading: Floats | None = None) -> Spacing:
    """Return the spacing of a trace as `spacing` does, from its projection.

    Args:
        path: the requested path.
        foot: the trace's projection onto it.
        ticks: ticks of the trace's points, ascending, (n,); missing ticks are gaps of the trace.
        heading: of the path at the furthest foot so far, if it is known, (n,) [rad].
    """
    advancing = forward(foot.s)
    s = foot.s[advancing]
    heading = by_blocks(lambda block: path.heading(s[block]), s.size) if heading is None else heading[advancing]
    heading, (first, last) = one_way(heading, s)
    s = s[first:last]
    trace = _Trace(s, foot.lateral[advancing][first:last])
    parts = np.concatenate([[0], np.cumsum(np.diff(ticks) > 1)])[advancing][first:last]
    if heading.size < 2 or heading[-1] < 2 * np.pi + _LEAST_OVERLAP:
        return _none()
    inner = np.flatnonzero(heading + 2 * np.pi <= heading[-1])

    def links(rows: NDArray[np.intp]) -> Spacing:
        place = s[rows]
        point, tangent, across = np.empty((3, place.size, 3))
        _find_directions(trace, place, path.local(place).columns, (point, tangent, across))
        guess = np.interp(heading[rows] + 2 * np.pi, heading, s)
        met_at = guess.copy()
        met_point = np.full_like(point, np.nan)
        before = np.zeros(place.size, np.intp)
        active = np.arange(place.size)
        for _ in range(_NEWTON_STEPS):
            frames = path.local(met_at[active]).columns
            active = active[: _approach(trace, active, frames, (point, tangent), (met_at, met_point, before))]
            if not active.size:
                break
        met = (met_at <= s[-1]) & (met_at > 0.5 * (place + guess))  # not on the turn that it left
        met[active] = False  # Newton's method has not settled there
        met &= parts[before + 1] == parts[before]  # no trace, and no glue, in a gap between stretches
        link = np.stack([point, met_point], axis=1)
        distance = np.abs(dot(met_point - point, across))
        return Spacing(place[met], heading[rows][met] / (2 * np.pi), distance[met], met_at[met], link[met])

    spacing = table_by_blocks((links(inner[block]) for block in blocks(inner.size)), inner.size)
    # a closed loop meets its own start, which is no turn beside it
    return spacing if spacing.turn.size and 2 * np.pi * np.ptp(spacing.turn) >= _LEAST_OVERLAP else _none()


class _Trace(NamedTuple):
    """A trace where it advances: arc lengths of its feet, ascending, and its lateral errors, (n,) each [mm]."""

    s: Floats
    lateral: Floats


class _Place(NamedTuple):
    """A trace at an arc length s, with q(s) = c(s) + e(s) n(s).

    Attributes:
        error: e [mm].
        ahead: component of its derivative in the plane along the heading.
        across: that along the path's normal.
    """

    error: float
    ahead: float
    across: float


@jit
def _place_on(trace: _Trace, place: float, bend: tuple[float, float], near: NDArray[np.intp]) -> _Place:
    """Return the place of a trace at an arc length.

    Args:
        trace: the trace.
        place: arc length [mm].
        bend: of the path there, cosine of the climb and turning [1/mm].
        near: points of the trace near the place and near both ends of its slope's reach, moved there, (3,).
    """
    low = max(place - _SLOPE_REACH, trace.s[0])
    high = min(place + _SLOPE_REACH, trace.s[-1])
    error = _interpolated_error(trace, place, near, 0)
    across = (_interpolated_error(trace, high, near, 1) - _interpolated_error(trace, low, near, 2)) / (high - low)
    return _Place(error, bend[0] - bend[1] * error, across)


@jit
def _interpolated_error(trace: _Trace, place: float, near: NDArray[np.intp], which: int) -> float:
    """Return a trace's lateral error at an arc length, that of its ends before and behind them [mm]."""
    s = trace.s
    lateral = trace.lateral
    if place <= s[0]:
        near[which] = 0
        return lateral[0]
    if place >= s[-1]:
        near[which] = s.size - 2
        return lateral[-1]
    i = chord_near(s, place, near[which])  # type: ignore[no-untyped-call]
    near[which] = i
    return (lateral[i + 1] - lateral[i]) / (s[i + 1] - s[i]) * (place - s[i]) + lateral[i]


@jit
def _directions_at(frames: Frames, j: int, k: int) -> tuple[float, float, float]:
    """Return component k of the heading, of the left normal and of the plane's normal at place j."""
    _, cosine, sine, _, _, planes, plane = frames
    u = planes[plane[j], 0, k]
    v = planes[plane[j], 1, k]
    return cosine[j] * u + sine[j] * v, cosine[j] * v - sine[j] * u, planes[plane[j], 2, k]


@jit
def _find_directions(trace: _Trace, places: Floats, frames: Frames, aims: tuple[Floats, Floats, Floats]) -> None:
    """Write the points of a trace at arc lengths, its directions in the plane, and its left normals, (n, 3) each.

    A trace that touches the path's centre of curvature has no direction there: nan, so that its link is left out.
    """
    position, _, _, climb, turning, _, _ = frames
    point, tangent, across = aims
    near = np.zeros(3, np.intp)
    for j in range(places.size):
        cosine = np.sqrt(max(1.0 - climb[j] * climb[j], 0.0))
        here = _place_on(trace, places[j], (cosine, turning[j]), near)
        square = 0.0
        for k in range(3):
            along, normal, _ = _directions_at(frames, j, k)
            point[j, k] = position[j, k] + normal * here.error
            tangent[j, k] = along * here.ahead + normal * here.across
            square += tangent[j, k] * tangent[j, k]
        length = np.sqrt(square)
        for k in range(3):
            tangent[j, k] /= length
        for k in range(3):
            a = (k + 1) % 3
            b = (k + 2) % 3
            up_a = _directions_at(frames, j, a)[2]
            up_b = _directions_at(frames, j, b)[2]
            across[j, k] = up_a * tangent[j, b] - up_b * tangent[j, a]


@jit
def _approach(
    trace: _Trace,
    rows: NDArray[np.intp],
    frames: Frames,
    aims: tuple[Floats, Floats],
    met: tuple[Floats, Floats, NDArray[np.intp]],
) -> int:
    """Move places towards where normals meet the trace a turn later, and write the points of those that are there.

    Args:
        trace: the trace.
        rows: of the normals, (m,); those that go on are moved to its begin.
        frames: of the path at the places.
        aims: points and directions of the trace, (n, 3) each.
        met: places, moved, (n,) [mm]; written: points, (n, 3) [mm], and those of the trace before them, (n,).

    Returns:
        How many go on.
    """
    position, _, _, climb, turning, _, _ = frames
    point, tangent = aims
    met_at, met_point, before = met
    near = np.zeros(3, np.intp)
    count = 0
    for j in range(rows.size):
        i = rows[j]
        cosine = np.sqrt(max(1.0 - climb[j] * climb[j], 0.0))
        there = _place_on(trace, met_at[i], (cosine, turning[j]), near)
        slope = 0.0
        beyond = 0.0
        for k in range(3):
            along, normal, _ = _directions_at(frames, j, k)
            slope += (along * there.ahead + normal * there.across) * tangent[i, k]
            beyond += (position[j, k] + normal * there.error - point[i, k]) * tangent[i, k]
        # short steps where the directions of the two turns differ much
        step = beyond / max(slope, _LEAST_SLOPE)
        met_at[i] -= step
        if abs(step) >= _LAST_STEP:
            rows[count] = i
            count += 1
            continue
        # on the path's tangent from the last place, with the heading there
        error = _interpolated_error(trace, met_at[i], near, 0)
        before[i] = near[0]
        for k in range(3):
            along, normal, up = _directions_at(frames, j, k)
            moved = position[j, k] - step * (cosine * along + climb[j] * up)
            met_point[i, k] = moved + error * (normal + turning[j] * step * along)
    return count


def _none() -> Spacing:
    nothing = np.zeros(0)
    return Spacing(nothing, nothing, nothing, nothing, np.zeros((0, 2, 3)))


def forward(s: Floats) -> NDArray[np.bool_]:
    """Whether each arc length exceeds all before it, (n,)."""
    ahead = np.ones(s.size, np.bool_)
    ahead[1:] = s[1:] > np.fmax.accumulate(s)[:-1]
    return ahead


def one_way(heading: Floats, s: Floats) -> tuple[Floats, tuple[int, int]]:
    """Return the stretch of a heading that turns furthest one way.

    Args:
        heading: in the order of the motion, not wrapped, (n,) [rad]; a jump is a corner, which ends a stretch.
        s: arc lengths, (n,) [mm].

    Returns:
        The angle turned since the start of the stretch, (k,) [rad], and its first index and the one after its last.
    """
    low, high = _furthest_turned(heading, s)
    if low == high:
        return np.zeros(0), (0, 0)
    turned = heading[low : high + 1] - heading[low]
    return np.abs(turned, out=turned), (low, high + 1)


@jit
def _furthest_turned(heading: Floats, s: Floats) -> tuple[int, int]:
    """Return the first and the last index of the stretch that turns furthest one way, twice 0 where nothing turns."""
    n = heading.size
    before = 0.0  # sense of the last turning
    for k in range(n - 1):
        if heading[k + 1] != heading[k]:
            before = math.copysign(1.0, heading[k + 1] - heading[k])
            break
    if before == 0.0:
        return 0, 0
    begin = 0
    low = 0
    high = 0
    furthest = -1.0
    stretch = 0.0  # sense of the present stretch, 0 for that of a corner
    for k in range(n):
        sense = 2.0  # of no stretch, behind the last
        if k < n - 1:
            change = heading[k + 1] - heading[k]
            if change != 0.0:
                before = math.copysign(1.0, change)
            # a straight belongs to the turning before it, a corner to no stretch
            sense = 0.0 if abs(change) > _CORNER and s[k + 1] - s[k] < _CORNER_LENGTH else before
        if k == 0:
            stretch = sense
        elif sense != stretch:
            turned = abs(heading[k] - heading[begin]) * abs(stretch)
            if turned > furthest:
                low = begin
                high = k
                furthest = turned
            begin = k
            stretch = sense
    return low, high
