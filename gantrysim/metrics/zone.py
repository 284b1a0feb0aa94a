"""Circles through and around points: the least-squares circle and the minimum zone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError

_ROUNDS = 60
_SECTORS = 36  # enough that the first linear program holds most of the points that bound the zone
_TOLERANCE = 1e-12  # of the radius


@dataclass(frozen=True)
class MinimumZone:
    """The two closest concentric circles that envelop points.

    Attributes:
        centre: (x, y) [mm].
        inner: radius of the inner circle [mm].
        outer: radius of the outer circle [mm].
    """

    centre: tuple[float, float]
    inner: float
    outer: float

    @property
    def width(self) -> float:
        """Radial separation, the circular deviation G [mm]."""
        return self.outer - self.inner


def least_squares_circle(points: ArrayLike) -> tuple[tuple[float, float], float]:
    """Return centre and radius of the least-squares circle.

    Gauss-Newton on sum of (|p_i - c| - r)^2 from the algebraic fit |p|^2 = 2 c.p + k.

    Args:
        points: (n, 2) [mm].

    Raises:
        InputError: fewer than three points, or points on one line.
    """
    p = plane_points(points)
    middle = p.mean(axis=0)
    q = p - middle  # or a circle far from the origin would lose digits in |p|^2
    matrix = np.column_stack([2 * q, np.ones(len(q))])
    solution, _, rank, _ = np.linalg.lstsq(matrix, (q**2).sum(axis=1), rcond=None)
    if rank < 3:
        raise InputError(f"{len(p)} points: must be at least three that do not lie on one line, for a circle")
    c = solution[:2]
    r = float(np.sqrt(solution[2] + solution[:2] @ solution[:2]))
    for _ in range(_ROUNDS):
        out = q - c
        distance = np.linalg.norm(out, axis=1)
        jacobian = np.column_stack([-out / distance[:, None], -np.ones(len(q))])
        step = np.linalg.lstsq(jacobian, -(distance - r), rcond=None)[0]
        c = c + step[:2]
        r = r + float(step[2])
        if np.abs(step).max() < _TOLERANCE * r:
            break
    centre = c + middle
    return (float(centre[0]), float(centre[1])), r


def minimum_zone(points: ArrayLike) -> MinimumZone:
    """Return the minimum zone of points: min over c of max |p_i - c| - min |p_i - c|.

    For a small step d from a centre c0 the distances are linear, |p_i - c0 - d| = |p_i - c0| - u_i.d with the unit
    vectors u_i from c0 to p_i, and the width is the least of a linear program in d and the two radii,

        min  b - a   with   a <= |p_i - c0| - u_i.d <= b.

    It holds the outermost and innermost point of each of 36 sectors and every point later found beyond them. Its step
    is halved until the width shrinks, and it is solved anew until the step vanishes. The first centre is that of the
    least-squares circle.

    Args:
        points: (n, 2) [mm].

    Raises:
        InputError: fewer than three points, or points on one line.
    """
    p = plane_points(points)
    first, radius = least_squares_circle(p)
    c = np.array(first)
    least = _TOLERANCE * radius

    def distances(centre: Floats) -> Floats:
        return np.linalg.norm(p - centre, axis=1)

    r = distances(c)
    counted = _extremes(p - c, r)
    for _ in range(_ROUNDS):
        width = float(np.ptp(r))
        if width <= least:
            break
        step = width * _zone_step(((p - c) / r[:, None])[counted], (r[counted] - r.mean()) / width)
        tried = distances(c + step)
        beyond = np.setdiff1d([tried.argmin(), tried.argmax()], counted)
        counted = np.append(counted, beyond)
        # distances are not quite linear: a long step may overshoot
        while np.ptp(tried) >= width and np.abs(step).max() > least:
            step = 0.5 * step
            tried = distances(c + step)
        if np.ptp(tried) < width:
            c = c + step
            r = tried
        elif not beyond.size:
            break
    return MinimumZone((float(c[0]), float(c[1])), float(r.min()), float(r.max()))


def _extremes(out: Floats, r: Floats) -> NDArray[np.intp]:
    """Indices of the outermost and the innermost point of each sector."""
    sector = ((np.arctan2(out[:, 1], out[:, 0]) / (2 * np.pi) + 0.5) * _SECTORS).astype(int)
    order = np.lexsort((r, sector))
    begins = np.flatnonzero(np.diff(sector[order], prepend=-1))
    ends = np.append(begins[1:], r.size) - 1
    return np.unique(order[np.concatenate([begins, ends])])


def _zone_step(unit: Floats, deviation: Floats) -> Floats:
    """The step d that minimises b - a with a <= deviation - unit.d <= b, all in units of the width, (2,)."""
    from scipy.optimize import linprog  # slow to import

    ones = np.ones((deviation.size, 1))
    zeros = np.zeros((deviation.size, 1))
    solved = linprog(
        [0, 0, -1, 1],
        A_ub=np.concatenate([np.hstack([-unit, zeros, -ones]), np.hstack([unit, ones, zeros])]),
        b_ub=np.concatenate([-deviation, deviation]),
        bounds=[(-1, 1), (-1, 1), (None, None), (None, None)],
        method="highs",
    )
    if solved.status != 0:
        raise InputError(f"minimum zone of {deviation.size} points: {solved.message}")
    return solved.x[:2]


def plane_points(points: ArrayLike) -> Floats:
    """Return points of the plane as an array, (n, 2) [mm].

    Raises:
        InputError: another shape, or fewer than three points.
    """
    p = np.asarray(points, float)
    if p.ndim != 2 or p.shape[1] != 2 or len(p) < 3:
        raise InputError(f"points of shape {p.shape}: must be (n, 2) with at least three points")
    return p
