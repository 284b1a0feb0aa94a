"""Exact geometry of paths, by arc length.

A path is a curve c(s) [mm] in the work frame with 0 <= s <= length. It follows a plane (u, v), usually the XY plane,
and may climb along the plane's normal w. With the heading theta in the plane and the angle of climb beta,

    t = cos(beta) (cos(theta) u + sin(theta) v) + sin(beta) w

is the unit tangent, n = -sin(theta) u + cos(theta) v the left normal, and kappa = d(theta)/ds the turning, positive
to the left; without a climb that is the signed curvature.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gantrysim.base.arrays import Floats, dot
from gantrysim.base.columns import Column, blocks, by_blocks, table_by_blocks
from gantrysim.base.errors import InputError
from gantrysim.paths.corners import Corners
from gantrysim.paths.nearest import along_blocks, longer_steps, vertices

# Table of points from which a projection starts. The wrong branch of a path can be chosen only where the distances
# of two differ by less than spacing^2 / (8 distance).
_TABLE_SPACING = 0.05  # [mm]
_TABLE_SIZE = (256, 1_000_000)  # beyond that the spacing grows,
_WIDEST_SPACING = 0.5  # but not above that [mm]: a bead's neighbour is further away
_LONGEST = 1e7  # that memory has room for: 640 MB of points [mm]
_STEPS = 60
# Within so many entries of the table the feet on both sides of a corner are compared; of a trace and a corner so sharp
# that the path nearly retraces itself within two entries and a step of the trace, where it cannot tell the two apart.
_NEAR_CORNER = 12
_NEAR_SHARP = 2
# Where a path does not nearly retrace itself, the foot of a point at a distance d inside a corner lies at most
# d tan(alpha / 2) from it, alpha being the angle by which the tangent turns there, at most 143 degrees.
_INSIDE_CORNER = 3.1
_TOLERANCE = 1e-11  # [mm]
_INSIDE = 1e-11  # [mm]
_LAST_STEP = 1e-7  # of Newton's method, after which the error is of the order of its square [mm]


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


@dataclass(frozen=True)
class Local:
    """A path and its frame at arc lengths.

    Attributes:
        position: points c, (n, 3) [mm].
        along: directions h of the heading, in the plane, (n, 3).
        normal: left normals n, (n, 3).
        up: normals w of the plane, (n, 3).
        cosine, sine: of the angle of climb beta, (n,).
        turning: kappa = d(theta)/ds, (n,) [1/mm].
    """

    position: Floats
    along: Floats
    normal: Floats
    up: Floats
    cosine: Floats
    sine: Floats
    turning: Floats

    @classmethod
    def of(cls, position: Floats, heading: Floats, climb: Floats, frame: Floats, turning: Floats) -> Local:
        """Return the frame from the values of `Path`'s methods."""
        cos = np.cos(heading)[:, None]
        sin = np.sin(heading)[:, None]
        u = frame[:, 0]
        v = frame[:, 1]
        w = frame[:, 2]
        level = np.sqrt(np.maximum(1 - climb**2, 0.0))
        return cls(position, cos * u + sin * v, cos * v - sin * u, w, level, climb, turning)

    @property
    def tangent(self) -> Floats:
        """Unit tangents t, (n, 3)."""
        return self.cosine[:, None] * self.along + self.sine[:, None] * self.up

    @property
    def curvature(self) -> Floats:
        """Curvature vectors kappa cos(beta) n, that is dt/ds at a constant climb, (n, 3) [1/mm]."""
        return (self.turning * self.cosine)[:, None] * self.normal


class Path(ABC):
    """A curve in the work frame, parametrised by its arc length s [mm]."""

    @abstractmethod
    def parameters(self) -> dict[str, Any]:
        """The constructor's arguments, which a record holds: numbers, texts, and lists or tables of them."""

    @property
    @abstractmethod
    def length(self) -> float:
        """Arc length [mm]."""

    @property
    def turn_spacing(self) -> float | None:
        """Requested distance of adjacent turns [mm]; None for a path without."""
        return None

    @abstractmethod
    def position(self, s: ArrayLike) -> Floats:
        """Points c(s), (n, 3) [mm]."""

    @abstractmethod
    def heading(self, s: ArrayLike) -> Floats:
        """Unwrapped angle theta of the tangent in the plane, from u counter-clockwise, (n,) [rad]."""

    @abstractmethod
    def curvature(self, s: ArrayLike) -> Floats:
        """Turning kappa = d(theta)/ds, (n,) [1/mm]."""

    def climb(self, s: ArrayLike) -> Floats:
        """Sine of the angle of climb beta, (n,)."""
        return np.zeros(np.size(s))

    def frame(self, s: ArrayLike) -> Floats:
        """Directions u, v, w of the plane, (n, 3, 3)."""
        return np.broadcast_to(np.eye(3), (np.size(s), 3, 3))

    def local(self, s: ArrayLike) -> Local:
        """Return points and the path's frame there."""
        return Local.of(self.position(s), self.heading(s), self.climb(s), self.frame(s), self.curvature(s))

    def tangent(self, s: ArrayLike) -> Floats:
        """Unit tangents t(s), (n, 3)."""
        theta = self.heading(s)
        sine = self.climb(s)
        cosine = np.sqrt(np.maximum(1 - sine**2, 0.0))
        return _in_frame(self.frame(s), cosine * np.cos(theta), cosine * np.sin(theta), sine)

    def normal(self, s: ArrayLike) -> Floats:
        """Left unit normals n(s) in the plane, (n, 3)."""
        theta = self.heading(s)
        return _in_frame(self.frame(s), -np.sin(theta), np.cos(theta), np.zeros_like(theta))

    @cached_property
    def table(self) -> tuple[Floats, Floats]:
        """Arc lengths, evenly spaced from start to end, (m,), and the points there, (m, 3) [mm].

        Raises:
            InputError: a path too long for the table.
        """
        if self.length > _LONGEST:
            raise InputError(f"path length = {self.length:.4g} mm: must be at most {_LONGEST:g} mm to find feet on it")
        count = int(np.clip(np.ceil(self.length / _TABLE_SPACING), *_TABLE_SIZE))
        count = max(count, int(np.ceil(self.length / _WIDEST_SPACING))) + 1
        s = np.linspace(0.0, self.length, count)
        return s, self.position(s)

    def project(self, points: ArrayLike) -> Projection:
        """Project points onto the path: the nearest point of the whole curve, ends included.

        Args:
            points: in any order, (n, 3) [mm].
        """
        from scipy.spatial import cKDTree  # slow to import

        p = _points(points)
        return self._foot(p, cKDTree(self.table[1]).query(p)[1])

    def follow(self, trace: ArrayLike, begin: float | None = None, rows: NDArray[np.intp] | None = None) -> Projection:
        """Project a trace onto the path in the order of its points: the feet advance as the trace does.

        A trace thus stays on its own turn of a spiral, at any distance, and on its own leg of a path that retraces
        itself. See `gantrysim.paths.nearest.along`.

        Args:
            trace: points in the order of the motion, (n, 3) [mm].
            begin: arc length at which the trace begins; its first foot is at most twice the distance to there
                along the path from it. By default the nearest of the whole path, the earlier of two [mm].
            rows: of the trace that count, ascending, (m,); by default all.
        """
        every = np.atleast_2d(np.asarray(trace, float))
        if rows is None:
            rows = np.arange(len(every))
        led_in = begin is not None and rows.size > 0 and rows[0] > 0
        followed = np.concatenate([[0], rows]) if led_in else rows
        travel = _travel(every, followed)
        sharp = self._reach_of_sharp(every, followed)

        def points(block: slice) -> Floats:
            return _points(every[followed[block]])

        s_table, p_table = self.table
        first = -1 if begin is None else round(float(np.clip(begin, 0.0, self.length)) / s_table[1])
        count = followed.size
        parts = ((points(block), travel[block]) for block in blocks(count))
        entries = along_blocks(p_table, parts, count, s_table[1], first)  # type: ignore[no-untyped-call]
        if led_in:
            followed = rows
            entries = entries[1:]
            sharp = sharp[1:]
        count = rows.size
        return table_by_blocks((self._foot(points(b), entries[b], sharp[b]) for b in blocks(count)), count)

    def _reach_of_sharp(self, trace: Floats, rows: NDArray[np.intp]) -> Floats:
        """Return the distance from a sharp corner within which both its legs are searched, for some points, [mm]."""
        if not self.corners.size:
            return np.zeros(0)

        def steps(block: slice) -> Floats:
            points = trace[rows[block.start : block.stop + 1]]
            return np.sqrt(np.sum(np.diff(points, axis=0) ** 2, axis=1))

        longer: Floats = longer_steps(by_blocks(steps, rows.size - 1))  # type: ignore[no-untyped-call]
        return _NEAR_SHARP * self.table[0][1] + longer

    @cached_property
    def corners(self) -> Floats:
        """Arc lengths at which the tangent jumps, ascending, (m,) [mm]."""
        return np.zeros(0)

    @cached_property
    def legs(self) -> Corners:
        """The corners, and the frames of the legs between them."""
        return Corners.of(self)

    def _foot(self, p: Floats, nearest: NDArray[np.intp], sharp: Floats | float = np.inf) -> Projection:
        """Project points, given the nearest entries of the table.

        The foot is between the neighbours of that entry; near a corner both sides are searched.

        Args:
            p: points, (n, 3) [mm].
            nearest: entries of the table, (n,).
            sharp: distance from a sharp corner within which that is done, (n,) [mm].
        """
        s_table, p_table = self.table
        low = s_table[np.maximum(nearest - 1, 0)]
        high = s_table[np.minimum(nearest + 1, s_table.size - 1)]
        guess = vertices(p_table, p, nearest) * s_table[1]  # type: ignore[no-untyped-call]
        found = self._between(p, low, high, guess)
        if self.corners.size:
            self._compare_legs(p, found, sharp)
            rows, outside = self.legs.about(found.s, found.offset)
            for name, values in vars(outside).items():
                vars(found)[name][rows] = values
        return found

    def project_on_leg(self, points: ArrayLike, leg: NDArray[np.intp]) -> Projection:
        """Project points onto one leg each, between two corners or ends of the path.

        At the leg's ends `beyond` is the distance along its tangent, at a corner too.

        Args:
            points: (n, 3) [mm].
            leg: numbers of the legs from 0, (n,).
        """
        p = _points(points)
        edges = np.concatenate([[0.0], self.corners, [self.length]])
        low = edges[leg]
        high = edges[leg + 1]
        return self._between(p, low, high, 0.5 * (low + high))

    def _compare_legs(self, p: Floats, found: Projection, sharp: Floats | float) -> None:
        """Replace feet near a corner whose other leg is nearer.

        Args:
            p: points, (n, 3) [mm].
            found: their projection, updated.
            sharp: see `_foot`.
        """
        corners = self.corners
        edges = np.concatenate([[0.0], corners, [self.length]])
        k = 1 + np.searchsorted(0.5 * (corners[1:] + corners[:-1]), found.s)
        reach = np.maximum(_NEAR_CORNER * self.table[0][1], _INSIDE_CORNER * found.distance)
        reach = np.where(self.legs.sharp[k - 1], np.minimum(_NEAR_CORNER * self.table[0][1], sharp), reach)
        near = np.flatnonzero(np.abs(edges[k] - found.s) <= reach)
        corner = edges[k[near]]
        before = np.maximum(edges[k[near] - 1], corner - reach[near])
        after = np.minimum(edges[k[near] + 1], corner + reach[near])
        # the last step to a foot may have crossed the corner, with the frame of the leg that it left
        crossed = np.abs(found.s[near] - corner) <= 2 * _LAST_STEP
        ahead = found.s[near] > corner
        for side, low, high in ((~ahead, before, corner), (ahead, corner, after)):
            other = self._between(p[near], low, high, 0.5 * (low + high))
            closer = other.distance < found.distance[near] - _INSIDE  # of two that are as near, the one there is
            closer |= crossed & side
            for name, values in vars(found).items():
                values[near[closer]] = getattr(other, name)[closer]

    def _between(self, p: Floats, low: Floats, high: Floats, guess: Floats) -> Projection:
        """Project points onto the parts of the path between two arc lengths, from a guess, (n,) [mm].

        Newton's method on g(s) = (c(s) - p).t(s) = 0, with g' = 1 + (c(s) - p).t'(s). Where its step leaves the
        interval, as at the path's ends, jumps of curvature or centres of curvature, the end is tried, then bisection.
        """
        first = low
        last = high
        low = low.copy()
        high = high.copy()
        s = np.clip(guess, low, high)
        offset, normal, tangent = np.empty((3, len(p), 3))
        tried = np.zeros(len(p), bool)
        active = np.arange(len(p))
        for _ in range(_STEPS):
            at = s[active]
            local = self.local(at)
            back = local.position - p[active]
            along_path = local.tangent
            ahead = dot(back, along_path)
            slope = 1.0 + dot(back, local.curvature)
            beyond = ahead > 0
            high[active[beyond]], low[active[~beyond]] = at[beyond], at[~beyond]
            step = np.divide(ahead, slope, out=np.full_like(ahead, np.inf), where=slope > 0)
            moved = at - step
            lowest = low[active]
            highest = high[active]
            outside = (moved < lowest) | (moved > highest)
            # just inside, as a corner has another tangent on its other side
            end = np.where(ahead > 0, first[active] + _INSIDE, last[active] - _INSIDE)
            first_time = outside & ~tried[active] & (lowest < end) & (end < highest)
            moved[outside] = np.where(first_time, end, 0.5 * (lowest + highest))[outside]
            tried[active] |= outside
            s[active] = moved
            # the last step is so short that the path is straight along it
            offset[active] = -back - (moved - at)[:, None] * along_path
            normal[active], tangent[active] = local.normal, along_path
            active = active[np.abs(moved - at) > np.where(outside, _TOLERANCE, _LAST_STEP)]
            if not active.size:
                break
        else:  # no convergence about a corner without a foot on either side
            local = self.local(s[active])
            offset[active], normal[active], tangent[active] = p[active] - local.position, local.normal, local.tangent
        s = np.where(s - first <= 2 * _INSIDE, first, np.where(last - s <= 2 * _INSIDE, last, s))
        vertical = dot(offset, np.cross(tangent, normal))
        return Projection(s, offset, dot(offset, normal), vertical, dot(offset, tangent), np.sqrt(dot(offset, offset)))


def _travel(trace: Floats, rows: NDArray[np.intp]) -> Floats:
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
        steps = np.linalg.norm(np.diff(between, axis=0), axis=1)
        travel[k + 1] = steps.sum()
    return travel


def _points(points: ArrayLike) -> Floats:
    p = np.atleast_2d(np.asarray(points, float))
    if p.shape[-1] != 3 or not np.isfinite(p).all():
        raise InputError(f"points of shape {p.shape}: must be finite and of shape (n, 3)")
    return p


def _in_frame(frame: Floats, along: Floats, across: Floats, up: Floats) -> Floats:
    return np.einsum("ij,ijk->ik", np.stack([along, across, up], axis=1), frame)
