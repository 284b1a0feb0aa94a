"""Feet of points on a path, within an interval of arc lengths or on the nearer leg of a corner."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats, at_rows, lengths, seen
from gantrysim.base.columns import Column, by_blocks
from gantrysim.base.jit import plain_jit
from gantrysim.paths.corners import Corners
from gantrysim.paths.local import Local
from gantrysim.paths.newton import INSIDE, LAST_STEP, Feet, Places, Search, step

_STEPS = 60
# Within so many entries of the table the feet on both sides of a corner are compared; of a trace and a corner so sharp
# that the path nearly retraces itself within NEAR_SHARP entries and a step of the trace, where it cannot tell the two
# legs apart.
_NEAR_CORNER = 12
NEAR_SHARP = 2
# Where a path does not nearly retrace itself, the foot of a point at a distance d inside a corner lies at most
# d tan(alpha / 2) from it, alpha being the angle by which the tangent turns there, at most 143 degrees.
_INSIDE_CORNER = 3.1


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


class Curve(Protocol):
    """A path, as far as feet need it."""

    @property
    def length(self) -> float:
        """Arc length [mm]."""

    @property
    def corners(self) -> Floats:
        """Arc lengths at which the tangent jumps, ascending, (m,) [mm]."""

    @property
    def legs(self) -> Corners:
        """The corners, and the frames of the legs between them."""

    def local(self, s: Floats) -> Local:
        """Points and the path's frame at arc lengths."""


def foot_between(path: Curve, p: Floats, low: Floats, high: Floats, guess: Floats) -> Projection:
    """Project points onto the parts of a path between two arc lengths, from a guess.

    Newton's method on g(s) = (c(s) - p).t(s) = 0, with g' = 1 + (c(s) - p).t'(s). Where its step leaves the
    interval, as at the path's ends, jumps of curvature or centres of curvature, the end is tried, then bisection.

    Args:
        path: the path.
        p: points, (n, 3) [mm].
        low: begin of each interval, (n,) [mm].
        high: end of each interval, (n,) [mm].
        guess: of the foot, (n,) [mm].
    """
    n = len(p)
    search = Search(
        point=seen(np.ascontiguousarray(p)),
        first=low,
        last=high,
        low=low.copy(),
        high=high.copy(),
        s=np.clip(guess, low, high),
        end_tried=np.zeros(n, bool),
    )
    feet = Feet(np.empty(n), np.empty((n, 3)), np.empty(n), np.empty(n), np.empty(n), np.empty(n))
    active = np.arange(n)
    for _ in range(_STEPS):
        places = _places(path.local(search.s[active]))
        active = active[: step(search, places, active, feet, False)]  # type: ignore[no-untyped-call]
        if not active.size:
            break
    else:  # no convergence about a corner without a foot on either side
        step(search, _places(path.local(search.s[active])), active, feet, True)  # type: ignore[no-untyped-call]
    return Projection(*feet)


def _places(local: Local) -> Places:
    """Return the path at arc lengths as compiled code takes it."""
    cosine, sine = local.heading
    return Places(local.position, cosine, sine, local.sine, local.turning, local.frames, local.plane)


def compare_legs(path: Curve, p: Floats, projection: Projection, spacing: float, sharp: Floats | float) -> None:
    """Replace feet near a corner whose other leg is nearer.

    Args:
        path: a path with corners.
        p: points, (n, 3) [mm].
        projection: of the points, updated.
        spacing: of the path's table [mm].
        sharp: distance from a sharp corner within which that is done, (n,) [mm].
    """
    corners = path.corners
    edges = np.concatenate([[0.0], corners, [path.length]])
    k = 1 + np.searchsorted(0.5 * (corners[1:] + corners[:-1]), projection.s)
    reach = np.maximum(_NEAR_CORNER * spacing, _INSIDE_CORNER * projection.distance)
    reach = np.where(path.legs.sharp[k - 1], np.minimum(_NEAR_CORNER * spacing, sharp), reach)
    near = np.flatnonzero(np.abs(edges[k] - projection.s) <= reach)
    corner = edges[k[near]]
    before = np.maximum(edges[k[near] - 1], corner - reach[near])
    after = np.minimum(edges[k[near] + 1], corner + reach[near])
    # the last step to a foot may have crossed the corner, with the frame of the leg that it left
    crossed = np.abs(projection.s[near] - corner) <= 2 * LAST_STEP
    ahead = projection.s[near] > corner
    for side, low, high in ((~ahead, before, corner), (ahead, corner, after)):
        other = foot_between(path, p[near], low, high, 0.5 * (low + high))
        closer = other.distance < projection.distance[near] - INSIDE  # a tie leaves the foot as it is
        closer |= crossed & side
        for name, values in vars(projection).items():
            values[near[closer]] = getattr(other, name)[closer]


def longer_steps(trace: Floats, rows: NDArray[np.intp]) -> Floats:
    """Return the longer of the steps before and after some points of a trace, (m,) [mm].

    A point at rest has the last step before the rest, and the first after it.

    Args:
        trace: points, (n, 3) [mm].
        rows: of the points, ascending, (m,).
    """

    def steps(block: slice) -> Floats:
        return lengths(np.diff(at_rows(trace, rows[block.start : block.stop + 1]), axis=0))

    longer = np.zeros(rows.size)
    _find_longer(by_blocks(steps, rows.size - 1), longer)
    return longer


def travel_between(trace: Floats, rows: NDArray[np.intp]) -> Floats:
    """Return the length of a trace from each of some points to the next, where others lie between, else 0.

    Args:
        trace: points, (n, 3) [mm].
        rows: of the points, ascending, (m,).

    Returns:
        The length from the point before each, (m,) [mm].
    """
    travel = np.zeros(rows.size)
    for k in np.flatnonzero(np.diff(rows) > 1):
        between = trace[rows[k] : rows[k + 1] + 1]
        steps = lengths(np.diff(between, axis=0))
        travel[k + 1] = steps.sum()
    return travel


@plain_jit
def _find_longer(steps: Floats, longer: Floats) -> None:
    """Write the longer of the steps before and after each point, (m,), of steps from each to the next, (m - 1,)."""
    longer[0] = 0.0
    moved = 0.0
    for k in range(len(steps)):
        if steps[k] > 0.0:
            moved = steps[k]
        longer[k + 1] = moved
    moved = 0.0
    for k in range(len(steps) - 1, -1, -1):
        if steps[k] > 0.0:
            moved = steps[k]
        longer[k] = max(longer[k], moved)
