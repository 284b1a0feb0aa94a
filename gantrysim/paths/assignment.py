"""The progress of a trace along a path, where a controller does not state it, or only between which places it lies."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from gantrysim.base.arrays import Floats, read_only_view
from gantrysim.paths.feet import Projection
from gantrysim.paths.nearest import find_assignment

_LONGEST = 0.05  # chord of the path [mm]
_MOST_POINTS = 10_000  # of the trace; of a longer one every k-th is taken, and between them the progress is even
_MOST_CHORDS = 1_000_000  # of the path
_MOST_CELLS = 100_000_000  # of the dynamic program, a byte each


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

    def near(self, trace: Floats, places: Floats, stretches: Floats) -> Projection:
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
    longest = max(_LONGEST, path.length / _MOST_CHORDS, widest * rows.size / _MOST_CELLS)
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
