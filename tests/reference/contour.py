"""Contour error of a trace: its distance from a finely sampled path, near where the command is."""

from __future__ import annotations

from collections.abc import Callable

import numba
import numpy as np

CHORD = 0.1e-3  # [mm]
SPACING = 0.05  # [mm]
WINDOW = 4.0  # of path to either side of the command in which the trace's foot is sought [mm]
AHEAD = 1.0  # most that the command advances in one tick [mm]


def polyline(position: Callable[[np.ndarray], np.ndarray], length: float) -> np.ndarray:
    """Return points of a path whose chords leave it by no more than CHORD where it was checked, (m, 2) [mm].

    Args:
        position: points at arc lengths, (m,) to (m, 2) [mm].
        length: of the path [mm].
    """
    s = np.linspace(0.0, length, int(length / SPACING) + 2)
    while True:
        points, middle = position(s), 0.5 * (s[1:] + s[:-1])
        error = np.hypot(*(position(middle) - 0.5 * (points[1:] + points[:-1])).T)
        if error.max() <= CHORD:
            return points
        s = np.sort(np.concatenate([s, middle[error > CHORD]]))


def contour_error(path: np.ndarray, command: np.ndarray, trace: np.ndarray) -> np.ndarray:
    """Return the distance from the path at each tick, positive on its left, (n,) [mm].

    The command begins near the path's first point and follows it forwards. A trace is compared only with the part of
    the path near its command, so that a turn or a crossing that is nearer does not count.

    Args:
        path: points of the path, close enough for chords to stand for arcs, (m, 2) [mm].
        command: commanded positions, (n, 2) [mm].
        trace: positions of the nozzle, (n, 2) [mm].
    """
    length = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))])
    return _errors(*map(np.ascontiguousarray, (path, length, command, trace)), WINDOW, AHEAD)


@numba.njit(cache=True, error_model="numpy")
def _nearest(path, length, low, high, x, y):
    """Return the distance from the chords between two lengths of path, left positive, and the length of the foot."""
    first = max(np.searchsorted(length, low) - 1, 0)
    best, signed, foot = np.inf, 0.0, 0.0
    for k in range(first, len(path) - 1):
        if length[k] > high:
            break
        dx, dy = path[k + 1, 0] - path[k, 0], path[k + 1, 1] - path[k, 1]
        ex, ey = x - path[k, 0], y - path[k, 1]
        square = dx * dx + dy * dy
        share = min(max((ex * dx + ey * dy) / square, 0.0), 1.0)
        distance = np.hypot(ex - share * dx, ey - share * dy)
        if distance < best:
            best = distance
            signed = distance if dx * ey - dy * ex >= 0 else -distance
            foot = length[k] + share * (length[k + 1] - length[k])
    return signed, foot


@numba.njit(cache=True, error_model="numpy")
def _errors(path, length, command, trace, window, ahead):
    errors = np.empty(len(trace))
    progress = 0.0
    for tick in range(len(trace)):
        _, progress = _nearest(path, length, progress, progress + ahead, command[tick, 0], command[tick, 1])
        errors[tick], _ = _nearest(path, length, progress - window, progress + window, trace[tick, 0], trace[tick, 1])
    return errors
