"""Exact geometry of paths, by arc length.

A path is a curve c(s) [mm] in the work frame with 0 <= s <= length. It follows a plane (u, v), usually the XY plane,
and may climb along the plane's normal w. With the heading theta in the plane and the angle of climb beta,

    t = cos(beta) (cos(theta) u + sin(theta) v) + sin(beta) w

is the unit tangent, n = -sin(theta) u + cos(theta) v the left normal, and kappa = d(theta)/ds the turning, positive
to the left; without a climb that is the signed curvature.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gantrysim.base.arrays import Floats, at_rows, read_only, seen
from gantrysim.base.columns import blocks, table_by_blocks
from gantrysim.base.errors import InputError
from gantrysim.paths.corners import Corners
from gantrysim.paths.feet import NEAR_SHARP, Projection, compare_legs, foot_between, longer_steps, travel_between
from gantrysim.paths.local import Local
from gantrysim.paths.minima import vertices
from gantrysim.paths.nearest import along_blocks

# Table of points from which a projection starts. The wrong branch of a path can be chosen only where the distances
# of two differ by less than spacing^2 / (8 distance).
_TABLE_SPACING = 0.05  # [mm]
_TABLE_SIZE = (256, 1_000_000)  # beyond that the spacing grows,
_WIDEST_SPACING = 0.5  # but not above that [mm]: a bead's neighbour is further away
_UPRIGHT = read_only(np.eye(3)[None])  # the frame of the XY plane
_LONGEST = 1e7  # that memory has room for: 640 MB of points [mm]


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
        return np.broadcast_to(_UPRIGHT[0], (np.size(s), 3, 3))

    def local(self, s: ArrayLike) -> Local:
        """Return points and the path's frame there."""
        theta = self.heading(s)
        plane = np.zeros(theta.size, np.intp)
        return Local(
            self.position(s), (np.cos(theta), np.sin(theta)), self.climb(s), self.curvature(s), _UPRIGHT, plane
        )

    def tangent(self, s: ArrayLike) -> Floats:
        """Unit tangents t(s), (n, 3)."""
        return tangent_of(self.heading(s), self.climb(s), self.frame(s))

    def normal(self, s: ArrayLike) -> Floats:
        """Left unit normals n(s) in the plane, (n, 3)."""
        theta = self.heading(s)
        return _in_frame(self.frame(s), -np.sin(theta), np.cos(theta), np.zeros_like(theta))

    @cached_property
    def table(self) -> tuple[Floats, Floats]:
        """Arc lengths, evenly spaced from start to end, (m,), and the points there, (m, 3), by columns [mm].

        Raises:
            InputError: a path too long for the table.
        """
        if self.length > _LONGEST:
            raise InputError(f"path length = {self.length:.4g} mm: must be at most {_LONGEST:g} mm to find feet on it")
        count = int(np.clip(np.ceil(self.length / _TABLE_SPACING), *_TABLE_SIZE))
        count = max(count, int(np.ceil(self.length / _WIDEST_SPACING))) + 1
        s = np.linspace(0.0, self.length, count)
        return s, np.asfortranarray(self.position(s))

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
        all_points = np.atleast_2d(np.asarray(trace, float))
        if rows is None:
            rows = np.arange(len(all_points))
        # where the first point that counts is not the trace's, the way to it decides on which turn it lies
        led_in = begin is not None and rows.size > 0 and rows[0] > 0
        followed = np.concatenate([[0], rows]) if led_in else rows
        travel = travel_between(all_points, followed)
        s_table, p_table = self.table
        spacing = s_table[1]
        # distance from a sharp corner within which both its legs are searched [mm]
        sharp: Floats | None = None
        if self.corners.size and self.legs.sharp.any():
            sharp = NEAR_SHARP * spacing + longer_steps(all_points, followed)

        def points(block: slice) -> Floats:
            return _points(at_rows(all_points, followed[block]))

        first = -1 if begin is None else round(float(np.clip(begin, 0.0, self.length)) / spacing)
        count = followed.size
        parts = ((points(block), travel[block]) for block in blocks(count))
        entries = along_blocks(p_table, parts, count, spacing, first)  # type: ignore[no-untyped-call]
        if led_in:
            followed = rows
            entries = entries[1:]
            sharp = None if sharp is None else sharp[1:]
        count = rows.size

        def feet(block: slice) -> Projection:
            return self._foot(points(block), entries[block], np.inf if sharp is None else sharp[block])

        return table_by_blocks((feet(block) for block in blocks(count)), count)

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
        spacing = s_table[1]
        low = s_table[np.maximum(nearest - 1, 0)]
        high = s_table[np.minimum(nearest + 1, s_table.size - 1)]
        guess = vertices(p_table, p, nearest) * spacing  # type: ignore[no-untyped-call]
        projection = foot_between(self, p, low, high, guess)
        if self.corners.size:
            compare_legs(self, p, projection, spacing, sharp)
            rows, at_corners = self.legs.about(projection.s, projection.offset)
            for name, values in vars(at_corners).items():
                vars(projection)[name][rows] = values
        return projection

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
        return foot_between(self, p, low, high, 0.5 * (low + high))


def _points(points: ArrayLike) -> Floats:
    p = np.atleast_2d(np.asarray(points, float))
    if p.shape[-1] != 3 or not np.isfinite(p).all():
        raise InputError(f"points of shape {p.shape}: must be finite and of shape (n, 3)")
    return seen(p)


def tangent_of(heading: Floats, climb: Floats, frame: Floats) -> Floats:
    """Unit tangents from the heading, the sine of the climb and the plane's directions, (n, 3)."""
    cosine = np.sqrt(np.maximum(1 - climb**2, 0.0))
    return _in_frame(frame, cosine * np.cos(heading), cosine * np.sin(heading), climb)


def _in_frame(frame: Floats, along: Floats, across: Floats, up: Floats) -> Floats:
    return np.einsum("ij,ijk->ik", np.stack([along, across, up], axis=1), frame)
