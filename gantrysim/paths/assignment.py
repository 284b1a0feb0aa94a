"""The progress of a trace along a path, where no controller states it."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from gantrysim.base.arrays import Floats, seen
from gantrysim.paths.nearest import find_assignment

_FINEST = 0.05  # distance of the points of the path [mm]
_MOST_POINTS = 10_000  # of the trace; of a longer one every k-th is taken, and between them the progress is even
_MOST_CELLS = 100_000_000  # of the dynamic program, a byte each


class Curve(Protocol):
    """A path, as far as an assignment needs it."""

    @property
    def length(self) -> float:
        """Arc length [mm]."""

    def position(self, s: ArrayLike) -> Floats:
        """Points at arc lengths, (n, 3) [mm]."""


def assigned_progress(path: Curve, trace: Floats) -> Floats:
    """Return the progress of a trace along a path, (n,) [mm].

    Among all that never fall it is the one with the least sum of squared distances between the points of the trace and
    those of the path at their progress. It is exact but for the distance of the points of the path that are tried,
    which a foot near the progress makes up for.

    Args:
        path: the path.
        trace: points in the order of the motion, (n, 3) [mm].
    """
    rows = np.unique(np.linspace(0, len(trace) - 1, min(len(trace), _MOST_POINTS)).astype(np.intp))
    count = int(min(np.ceil(path.length / _FINEST), _MOST_CELLS // rows.size)) + 1
    s = np.linspace(0.0, path.length, max(count, 2))
    entries = np.empty(rows.size, np.int64)
    find_assignment(  # type: ignore[no-untyped-call]
        seen(np.asfortranarray(path.position(s))),
        seen(np.ascontiguousarray(trace[rows])),
        np.zeros(s.size),
        np.empty((rows.size, s.size), np.bool_),
        entries,
    )
    return np.interp(np.arange(len(trace)), rows, s[entries])
