"""Chains of lines and arcs built from arrays."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gantrysim.base.arrays import Floats, dot
from gantrysim.base.errors import InputError
from gantrysim.paths.chain import Chain
from gantrysim.paths.lengths import arc_length
from gantrysim.paths.pieces import SHORTEST_PIECE


class Track(Chain):
    """Consecutive lines and coils, each from the end of the one before.

    Args:
        start: first point, (3,) [mm].
        end: of every piece, (m, 3) [mm].
        angle: swept by every coil, counter-clockwise positive; 0 for a line, (m,) [rad].
        centre: of every coil, at the height of its start, (m, 3) [mm].
        plane: index of every piece's plane, (m,).
        frames: directions u, v, w of the planes, (p, 3, 3).

    Raises:
        InputError: no piece, or one of zero length.
    """

    def __init__(
        self, start: ArrayLike, end: ArrayLike, angle: ArrayLike, centre: ArrayLike, plane: ArrayLike, frames: ArrayLike
    ) -> None:
        self._start = np.asarray(start, float)
        self._points = np.concatenate([self._start[None], np.asarray(end, float).reshape(-1, 3)])
        self._end = self._points[1:]
        self._angle = np.asarray(angle, float)
        self._plane = np.asarray(plane, np.intp)
        self._frames = np.asarray(frames, float)
        if not len(self._end):
            raise InputError("track: must have a piece of positive length")
        begin = self._points[:-1]
        coil = self._angle != 0
        # lines alone, as most programs of many pieces: they begin at their origins, and no array has copies
        has_coils = bool(coil.any())
        self._centre = np.asarray(centre, float) if has_coils else begin
        count = len(coil)
        planes = np.unique(self._plane)
        # no copies of the one frame: programs have many pieces, most in one plane
        if planes.size == 1:
            frame = np.broadcast_to(self._frames[planes[0]], (count, 3, 3))
        else:
            frame = self._frames[self._plane]
        lengths = np.sqrt(((self._end - begin) ** 2).sum(axis=1))
        direction = self._end - begin
        direction /= np.maximum(np.where(coil, 1.0, lengths), SHORTEST_PIECE)[:, None]
        direction[coil] = 0.0
        columns: dict[str, NDArray[Any]] = {
            "coil": coil,
            "frame": frame,
            "origin": np.where(coil[:, None], self._centre, begin) if has_coils else begin,
            "direction": direction,
            "straight": np.einsum("ij,ij->i", frame[:, 2], direction),
            "heading": np.where(coil, 0.0, np.arctan2(dot(direction, frame[:, 1]), dot(direction, frame[:, 0]))),
        }
        for name in ("radius", "growth", "rise", "begin", "turn", "angle"):
            columns[name] = np.zeros(count)
        if has_coils:
            lengths[coil] = self._coils(columns, coil, begin)
        self._columns = columns
        if lengths.min() <= SHORTEST_PIECE:
            raise InputError(f"track: piece {int(lengths.argmin()) + 1} of zero length: must be longer")
        self._s = np.concatenate([[0.0], np.cumsum(lengths)])
        self._continue_headings(lengths)

    def _coils(self, columns: dict[str, NDArray[Any]], coil: NDArray[np.bool_], begin: Floats) -> Floats:
        """Fill in the columns of the coils and return their lengths."""
        frame = columns["frame"][coil]
        angle = np.abs(self._angle[coil])
        # from the centre to start and end, in the frame of the plane
        arms = [np.einsum("ijk,ik->ij", frame, p - self._centre[coil]) for p in (begin[coil], self._end[coil])]
        radii = [np.hypot(arm[:, 0], arm[:, 1]) for arm in arms]
        columns["radius"][coil] = radii[0]
        growth = (radii[1] - radii[0]) / angle
        columns["growth"][coil] = growth
        columns["rise"][coil] = (arms[1][:, 2] - arms[0][:, 2]) / angle
        columns["begin"][coil] = np.arctan2(arms[0][:, 1], arms[0][:, 0])
        columns["turn"][coil] = np.sign(self._angle[coil])
        columns["angle"][coil] = angle
        return arc_length(radii[0], growth, np.hypot(growth, columns["rise"][coil]), angle)

    def _continue_headings(self, lengths: Floats) -> None:
        """Make the headings continuous except at corners; lines along the normal keep the heading before them."""
        k = np.arange(lengths.size)
        first, last = self._end_headings(lengths)
        has_heading = self._columns["coil"] | (np.abs(self._columns["straight"]) < 1 - 1e-12)
        headed = np.flatnonzero(has_heading)
        jumps = np.round((last[headed[:-1]] - first[headed[1:]]) / (2 * np.pi))
        turns = 2 * np.pi * np.concatenate([np.zeros(min(headed.size, 1)), np.cumsum(jumps)])
        heading = self._columns["heading"]
        heading[headed] += turns
        if headed.size < k.size:
            before = np.searchsorted(headed, k[~has_heading]) - 1
            # index -1, of no piece before, takes the 0
            ends = np.append(last[headed] + turns, 0.0)
            heading[~has_heading] = ends[before]

    def _end_headings(self, lengths: Floats) -> tuple[Floats, Floats]:
        """Headings at the start and at the end of every piece; those of a line are one."""
        first = self._columns["heading"].copy()
        coils = np.flatnonzero(self.coil)
        if not coils.size:
            return first, first
        last = first.copy()
        first[coils] = self._at(coils, np.zeros(coils.size), "heading").heading
        last[coils] = self._at(coils, lengths[coils], "heading").heading
        return first, last

    def parameters(self) -> dict[str, Any]:
        return {
            "start": self._start,
            "end": self._end,
            "angle": self._angle,
            "centre": self._centre,
            "plane": self._plane,
            "frames": self._frames,
        }

    @property
    def turn_spacing(self) -> float | None:
        return None

    def points_at(self, k: NDArray[np.intp], distance: Floats) -> Floats:
        """Return the points at distances from the starts of pieces, (n, 3) [mm]."""
        return self._at(k, distance, "point").point

    @property
    def coil(self) -> NDArray[np.bool_]:
        """Whether each piece is a coil, (m,)."""
        coil: NDArray[np.bool_] = self._columns["coil"]
        return coil

    @property
    def points(self) -> Floats:
        """Starts of all pieces and the end of the last, (m + 1, 3) [mm]."""
        return self._points

    @property
    def tightest(self) -> Floats:
        """Smallest radius of every piece, inf for a line, (m,) [mm]."""
        c = self._columns
        ends = np.minimum(c["radius"], c["radius"] + c["growth"] * c["angle"])
        return np.where(self.coil, ends, np.inf)

    def end_tangents(self) -> tuple[Floats, Floats]:
        """Unit tangents at the start and at the end of every piece, (m, 3) each."""
        first = self._columns["direction"]
        k = np.flatnonzero(self.coil)
        if not k.size:
            return first, first
        first = first.copy()
        last = first.copy()
        if k.size:
            lengths = np.diff(self._s)[k]
            for tangent, distance in ((first, 0 * lengths), (last, lengths)):
                places = self._at(k, distance, "heading", "climb")
                cosine = np.sqrt(np.maximum(1 - places.climb**2, 0.0))
                theta = places.heading
                local = np.stack([cosine * np.cos(theta), cosine * np.sin(theta), places.climb], axis=1)
                tangent[k] = np.einsum("ij,ijk->ik", local, self._columns["frame"][k])
        return first, last
