"""Exact geometry of paths, by arc length.

A path is a curve c(s) [mm] in the work frame with 0 <= s <= length. It follows a plane (u, v), usually the XY plane,
and may climb along the plane's normal w. With the heading theta in the plane and the angle of climb beta,

    t = cos(beta) (cos(theta) u + sin(theta) v) + sin(beta) w

is the unit tangent, n = -sin(theta) u + cos(theta) v the left normal, and kappa = d(theta)/ds the turning, positive
to the left; without a climb that is the signed curvature.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gantrysim.base.arrays import Floats, LastCall, at_rows, lengths, read_only, read_only_view
from gantrysim.base.columns import blocks, by_blocks, table_by_blocks
from gantrysim.base.errors import InputError
from gantrysim.base.jit import jit
from gantrysim.paths.corners import Corners
from gantrysim.paths.feet import Local, Projection, assigned_progress, foot_between
from gantrysim.paths.nearest import Bends, Table, find_feet, find_furthest, find_starts, find_stretches

# Table of points from which a projection starts: of two stretches of the path the wrong one can be chosen where their
# distances differ by less than the sagitta of a chord, curvature spacing^2 / 8.
_TABLE_SPACING = 0.05  # [mm]
_SAGITTA = 5e-6  # [mm] at that spacing; at a larger one in proportion to its square
_MOST_PARTS = 64  # of a chord, where the path is curved: a spiral may end at its centre
_TABLE_SIZE = (256, 1_000_000)  # beyond that the spacing grows,
_WIDEST_SPACING = 0.5  # but not above that [mm]: a bead's neighbour is further away
UPRIGHT = read_only(np.eye(3)[None])  # the frame of the XY plane
_LONGEST_PATH = 1e7  # that memory has room for: 640 MB of points [mm]
_ROUNDING = 1e-9  # of a number of chords
_INSIDE_CHORD = 1e-6  # of a chord's length, from its ends


class Path(ABC):
    """A curve in the work frame, parametrised by its arc length s [mm]."""

    @abstractmethod
    def parameters(self) -> dict[str, Any]:
        """The constructor's arguments, which a record holds: numbers, texts, and lists or tables of them."""

    def coincides(self, other: Path) -> bool:
        """Return whether another path has the same class and parameters."""
        # cheap, and seldom the same of two paths that differ
        if type(self) is not type(other) or self.length != other.length:
            return False
        mine = self.parameters()
        theirs = other.parameters()
        return mine.keys() == theirs.keys() and all(np.array_equal(mine[name], theirs[name]) for name in mine)

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
        return np.broadcast_to(UPRIGHT[0], (np.size(s), 3, 3))

    def local(self, s: ArrayLike) -> Local:
        """Return points and the path's frame there."""
        theta = self.heading(s)
        plane = np.zeros(theta.size, np.intp)
        return Local(self.position(s), (np.cos(theta), np.sin(theta)), self.climb(s), self.curvature(s), UPRIGHT, plane)

    def tangent(self, s: ArrayLike) -> Floats:
        """Unit tangents t(s), (n, 3)."""
        return tangent_of(self.heading(s), self.climb(s), self.frame(s))

    def normal(self, s: ArrayLike) -> Floats:
        """Left unit normals n(s) in the plane, (n, 3)."""
        theta = self.heading(s)
        return _in_frame(self.frame(s), -np.sin(theta), np.cos(theta), np.zeros_like(theta))

    @cached_property
    def table(self) -> Table:
        """Points along the path from which feet on it are found; errors as of `table_with`."""
        return self.table_with(_TABLE_SPACING, _SAGITTA)

    def table_with(self, spacing: float, sagitta: float) -> Table:
        """Return points along the path, with all corners and joints; between them evenly spaced, or denser in bends.

        Args:
            spacing: distance of neighbours along the path, at most; larger where the path has very many [mm].
            sagitta: distance of the path from the chords between neighbours, at most; larger with the spacing [mm].

        Raises:
            InputError: a path too long for the table.
        """
        if self.length > _LONGEST_PATH:
            raise InputError(
                f"path length = {self.length:.4g} mm: must be at most {_LONGEST_PATH:g} mm to find feet on it"
            )
        count = int(np.clip(np.ceil(self.length / spacing), *_TABLE_SIZE))
        size = min(self.length / count, _WIDEST_SPACING)
        edges = np.concatenate([[0.0], self.joints, [self.length]])
        s = _divided_spans(edges, np.ceil(np.diff(edges) / size - _ROUNDING))
        sizes = np.diff(s)
        # of the piece on which each chord lies
        inside = _INSIDE_CHORD * sizes
        bend = np.maximum(np.abs(self.curvature(s[:-1] + inside)), np.abs(self.curvature(s[1:] - inside)))
        sagitta = sagitta * max(size / spacing, 1.0) ** 2
        s = _divided_spans(s, np.minimum(np.ceil(sizes * np.sqrt(bend / (8 * sagitta))), _MOST_PARTS))
        is_corner = np.isin(s, self.corners) if self.corners.size else np.zeros(s.size, bool)
        return Table(
            read_only_view(s),
            read_only_view(np.asfortranarray(self.position(s))),
            read_only_view(is_corner),
            float(np.diff(s).max()),
        )

    @cached_property
    def _bends(self) -> Bends:
        s = self.table.s
        curvature = self.local(0.5 * (s[:-1] + s[1:])).curvature
        sharpest = float(lengths(curvature).max())
        return Bends(
            read_only_view(curvature), read_only_view(self.corners), 1.0 / sharpest if sharpest > 0 else np.inf
        )

    def project(self, points: ArrayLike) -> Projection:
        """Project points onto the path: the nearest point of the whole curve, ends included.

        Args:
            points: in any order, (n, 3) [mm].
        """
        p = _points(points)
        places = np.zeros(len(p))
        find_starts(self.table, p, places)  # type: ignore[no-untyped-call]
        return self.near(p, places, np.tile([[0.0], [self.length]], len(p)))

    def follow(self, trace: ArrayLike, progress: Floats | None = None) -> Projection:
        """Project a trace onto the path in the order of its points, each near its own progress.

        A trace thus stays on its own turn of a spiral, at any distance, and on its own leg of a path that retraces
        itself.

        Args:
            trace: points in the order of the motion, (n, 3) [mm].
            progress: arc length of the path that each point stands for, ascending, (n,) [mm]; by default as of
                `gantrysim.paths.feet`, which takes long.
        """
        p = _points(trace)
        if progress is None:
            progress = assigned_progress(self, p)
        return self.near(p, progress, self.stretches(lambda block: [p[block]], progress))

    def stretches(self, traces: Callable[[slice], Sequence[Floats]], progress: Floats) -> Floats:
        """Return begin and end of the stretch in which feet lie, see `gantrysim.paths.nearest`, (2, n) [mm].

        Args:
            traces: returns the points of the command and of each trace that follows it, (k, 3) each, for a block of the
                ticks [mm]; with the command alone the stretches are its own.
            progress: of the command, ascending, (n,) [mm].
        """

        def squares(block: slice) -> Floats:
            place = self._last_position(progress[block])
            command, *followers = map(read_only_view, traces(block))
            furthest = np.zeros((len(command), 2))
            for points in (command, *followers):
                find_furthest(points, place, command, furthest)  # type: ignore[no-untyped-call]
            return furthest

        count = progress.size
        stretches = np.empty((2, count))
        find_stretches(self.table, read_only_view(progress), by_blocks(squares, count), stretches)  # type: ignore[no-untyped-call]
        return stretches

    @cached_property
    def _last_position(self) -> LastCall[Floats]:
        # the progress of a command is the same in all runs of its program
        return LastCall(self.position)

    @cached_property
    def _last_local(self) -> LastCall[Local]:
        return LastCall(self.local)

    @cached_property
    def last_tangent(self) -> LastCall[Floats]:
        """As `tangent`; the last result is remembered, as that at the feet of a command is the same in all runs."""
        return LastCall(self._local_tangent)

    def _local_tangent(self, s: Floats) -> Floats:
        return self.local(s).tangent

    def near(
        self,
        trace: Floats,
        places: Floats,
        stretches: Floats | Sequence[Floats],
        rows: NDArray[np.intp] | None = None,
        *,
        again: bool = False,
    ) -> Projection:
        """Project points onto the nearest point of the stretch of the path that belongs to each.

        Args:
            trace: points, (m, 3) [mm].
            places: of the path, the one nearest to which is taken out of several nearest points, (n,) [mm].
            stretches: begin and end of each stretch, (2, n), or two arrays (n,) [mm].
            rows: of the trace, (n,); by default all.
            again: whether the same points are projected again and again, as a command in all runs of its program.
        """
        if rows is None:
            rows = np.arange(places.size)

        def feet(block: slice) -> Projection:
            p = _points(at_rows(trace, rows[block]))
            parts = np.empty((3, len(p)))
            between = np.stack([edge[block] for edge in stretches])
            find_feet(self.table, self._bends, p, read_only_view(places[block]), between, parts)  # type: ignore[no-untyped-call]

            def local(s: Floats) -> Local:
                # the first look, at all points
                return self._last_local(s) if again and s.size == len(p) else self.local(s)

            projection = foot_between(local, p, *parts)
            if self.corners.size:
                at_corner, components = self.legs.about(projection.s, projection.offset)
                for name, values in vars(components).items():
                    vars(projection)[name][at_corner] = values
            return projection

        return table_by_blocks((feet(block) for block in blocks(places.size)), places.size)

    @cached_property
    def corners(self) -> Floats:
        """Arc lengths at which the tangent jumps, ascending, (m,) [mm]."""
        return np.zeros(0)

    @property
    def joints(self) -> Floats:
        """Arc lengths at which pieces of the path meet, its corners among them, ascending, (m,) [mm]."""
        return self.corners

    @cached_property
    def legs(self) -> Corners:
        """The corners, and the frames of the legs between them."""
        return Corners.of(self)


@jit
def _divided_spans(edges: Floats, counts: Floats) -> Floats:
    """Return ascending numbers, with so many even intervals, but at least one, from each to the next."""
    whole = np.maximum(counts, 1.0)
    divided = np.empty(int(whole.sum()) + 1)
    place = 0
    for k in range(len(whole)):
        span = edges[k + 1] - edges[k]
        for part in range(int(whole[k])):
            divided[place] = edges[k] + part / whole[k] * span
            place += 1
    divided[-1] = edges[-1]
    return divided


def _points(points: ArrayLike) -> Floats:
    p = np.atleast_2d(np.asarray(points, float))
    if p.shape[-1] != 3 or not np.isfinite(p).all():
        raise InputError(f"points of shape {p.shape}: must be finite and of shape (n, 3)")
    return read_only_view(p)


def tangent_of(heading: Floats, climb: Floats, frame: Floats) -> Floats:
    """Unit tangents from the heading, the sine of the climb and the plane's directions, (n, 3)."""
    cosine = np.sqrt(np.maximum(1 - climb**2, 0.0))
    return _in_frame(frame, cosine * np.cos(heading), cosine * np.sin(heading), climb)


def _in_frame(frame: Floats, along: Floats, across: Floats, up: Floats) -> Floats:
    return np.einsum("ij,ijk->ik", np.stack([along, across, up], axis=1), frame)
