"""The spacing of neighbouring turns of a trace."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gantrysim.base.arrays import Floats, dot, lengths, scaled_rows
from gantrysim.base.columns import Column, blocks, by_blocks, table_by_blocks
from gantrysim.base.jit import jit
from gantrysim.paths.path import Local, Path, Projection

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


def spacing_of(path: Path, foot: Projection, ticks: NDArray[np.intp]) -> Spacing:
    """Return the spacing of a trace as `spacing` does, from its projection.

    Args:
        path: the requested path.
        foot: the trace's projection onto it.
        ticks: ticks of the trace's points, ascending, (n,); missing ticks are gaps of the trace.
    """
    advancing = forward(foot.s)
    s = foot.s[advancing]
    lateral = foot.lateral[advancing]
    parts = np.concatenate([[0], np.cumsum(np.diff(ticks) > 1)])[advancing]

    def offset(place: Floats) -> Floats:
        return np.interp(place, s, lateral)

    def trace(place: Floats) -> tuple[Floats, Floats, Local]:
        """The trace's points, (m, 3), their lateral errors, (m,), and the path there."""
        here = path.local(place)
        error = offset(place)
        return here.position + scaled_rows(here.normal, error), error, here

    def derivative(place: Floats, error: Floats, here: Local) -> Floats:
        """The trace's derivative by s in the plane, (m, 3)."""
        low = np.maximum(place - _SLOPE_REACH, s[0])
        high = np.minimum(place + _SLOPE_REACH, s[-1])
        across = (offset(high) - offset(low)) / (high - low)
        ahead = here.cosine - here.turning * error
        return scaled_rows(here.along, ahead) + scaled_rows(here.normal, across)

    heading, (first, last) = one_way(by_blocks(lambda block: path.heading(s[block]), s.size), s)
    s = s[first:last]
    lateral = lateral[first:last]
    parts = parts[first:last]
    if heading.size < 2 or heading[-1] < 2 * np.pi + _LEAST_OVERLAP:
        return _none()
    inner = np.flatnonzero(heading + 2 * np.pi <= heading[-1])

    def links(rows: NDArray[np.intp]) -> Spacing:
        place = s[rows]
        point, error, here = trace(place)
        tangent = _directions(derivative(place, error, here))
        normal = np.cross(here.up, tangent)
        guess = np.interp(heading[rows] + 2 * np.pi, heading, s)
        met_at = guess.copy()
        active = np.arange(place.size)
        for _ in range(_NEWTON_STEPS):
            ahead = tangent[active]
            there, error, here = trace(met_at[active])
            # short steps where the directions of the two turns differ much
            slope = np.maximum(dot(derivative(met_at[active], error, here), ahead), _LEAST_SLOPE)
            step = dot(there - point[active], ahead) / slope
            met_at[active] -= step
            active = active[np.abs(step) >= _LAST_STEP]
            if not active.size:
                break
        met = (met_at <= s[-1]) & (met_at > 0.5 * (place + guess))  # not on the turn that it left
        met[active] = False  # Newton's method has not settled there
        after = np.clip(np.searchsorted(s, met_at), 1, s.size - 1)
        met &= parts[after] == parts[after - 1]  # no trace, and no glue, in a gap between stretches
        link = np.stack([point, trace(met_at)[0]], axis=1)
        distance = np.abs(dot(link[:, 1] - point, normal))
        return Spacing(place[met], heading[rows][met] / (2 * np.pi), distance[met], met_at[met], link[met])

    spacing = table_by_blocks((links(inner[block]) for block in blocks(inner.size)), inner.size)
    # a closed loop meets its own start, which is no turn beside it
    return spacing if spacing.turn.size and 2 * np.pi * np.ptp(spacing.turn) >= _LEAST_OVERLAP else _none()


def _directions(tangents: Floats) -> Floats:
    """Return vectors of length 1, (m, 3); nan for one of length 0, whose link is then left out.

    A trace that touches the path's centre of curvature has no direction there.
    """
    with np.errstate(invalid="ignore"):
        length = lengths(tangents)
        return np.stack([tangents[:, k] / length for k in range(3)], axis=1)


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
