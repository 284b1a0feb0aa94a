"""Circular tests in the manner of ISO 230-4.

ISO 230-4 "Test code for machine tools, part 4: Circular tests for numerically controlled machine tools", editions of
2005 and 2022; its terms and symbols as publicly described, without the standard's own text:

- radial deviation F, with its extremes Fmax and Fmin: from the actual path to the nominal path
- circular deviation G: least radial separation of two concentric circles that envelop the actual path (minimum zone)
- bidirectional circular deviation G(b): the same of two paths, one clockwise and one counter-clockwise
- mean bidirectional radial deviation D: radius of the least-squares circle of both paths less the nominal radius

Reversal spikes and steps are not in the standard, and instruments define them differently; see `Trace.reversals`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError, positive
from gantrysim.base.quantity import UM
from gantrysim.record.run import Run

# Circles through and around points: the least-squares circle and the minimum zone.

_FIT_ROUNDS = 60
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
    # or a circle far from the origin would lose digits in |p|^2
    q = p - middle
    matrix = np.column_stack([2 * q, np.ones(len(q))])
    solution, _, rank, _ = np.linalg.lstsq(matrix, (q**2).sum(axis=1), rcond=None)
    if rank < 3:
        raise InputError(f"{len(p)} points: must be at least three that do not lie on one line, for a circle")
    c = solution[:2]
    r = float(np.sqrt(solution[2] + solution[:2] @ solution[:2]))
    for _ in range(_FIT_ROUNDS):
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
    for _ in range(_FIT_ROUNDS):
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


SPIKE_REACH = 15.0  # range of a spike after its reversal [deg]
_LARGEST_REACH = 45.0  # [deg]
_LARGEST_GAP = 5.0  # between neighbouring points of a full circle [deg]


@dataclass(frozen=True)
class Reversal:
    """The radial deviation at the reversal of an axis.

    Attributes:
        axis: 0 for the axis along x, 1 for that along y.
        angle: position of the reversal on the circle, counter-clockwise from x [deg].
        step: change of the radial deviation across the reversal, outward positive; a backlash b gives b [mm].
        spike: largest further deviation shortly after the reversal [mm].
        spike_at: position of the spike after the reversal [deg].
    """

    axis: int
    angle: float
    step: float
    spike: float
    spike_at: float


@dataclass(frozen=True, eq=False)
class Trace:
    """One actual path round a nominal circle, in one direction.

    Args:
        points: a full circle in the order of the motion, evenly over the angle, (n, 2) [mm].
        centre: centre of the nominal path [mm].
        radius: radius of the nominal path [mm].

    Raises:
        InputError: points that leave out a part of the circle.
    """

    points: Floats
    centre: tuple[float, float]
    radius: float

    def __post_init__(self) -> None:
        positive("radius", self.radius, "mm")
        object.__setattr__(self, "points", plane_points(self.points))
        gap = float(np.diff(np.sort(self.angle), append=self.angle.min() + 360).max())
        if gap > _LARGEST_GAP:
            raise InputError(
                f"actual path: leaves out {gap:.4g} deg of the circle, must be at most {_LARGEST_GAP:g} deg"
            )

    @property
    def angle(self) -> Floats:
        """Angle of the points about the nominal centre, counter-clockwise from x, 0 to 360, (n,) [deg]."""
        x, y = (self.points - self.centre).T
        return np.degrees(np.arctan2(y, x)) % 360

    @property
    def clockwise(self) -> bool:
        """Whether the path is run clockwise."""
        # across 0 deg by the short way
        turned = (np.diff(self.angle) + 180) % 360 - 180
        return bool(turned.sum() < 0)

    @property
    def deviation(self) -> Floats:
        """Radial deviation F, (n,) [mm]."""
        return np.linalg.norm(self.points - self.centre, axis=1) - self.radius

    @cached_property
    def circular_deviation(self) -> float:
        """Circular deviation G [mm]."""
        return minimum_zone(self.points).width

    def reversals(self, reach: float = SPIKE_REACH) -> tuple[Reversal, ...]:
        """Return the four reversals of the axes, by their angle.

        With psi_k the angle passed since reversal k, negative before it, the deviation is fitted by

            F = a0 + a1 cos(theta) + b1 sin(theta) + a2 cos(2 theta) + b2 sin(2 theta)
                + sum over k of h_k sign(psi_k) cos(psi_k) / 2, where |psi_k| < 90 deg:

        size, eccentricity, scales and squareness of the axes, and at each reversal a jump h_k of the reversing axis, as
        from backlash, seen along the radius. The fit leaves out the reach after each reversal. The step is h_k; the
        spike is F less the fit where that is largest within the reach.

        Args:
            reach: range after a reversal in which to look for its spike [deg].

        Raises:
            InputError: a reach above 45 deg, which leaves too little for the fit.
        """
        if not 0 < reach <= _LARGEST_REACH:
            raise InputError(f"reach = {reach:g} deg: must be above 0 deg and at most {_LARGEST_REACH:g} deg")
        theta = np.radians(self.angle)
        sense = -1.0 if self.clockwise else 1.0
        since = [sense * ((self.angle - 90.0 * k + 180) % 360 - 180) for k in range(4)]
        smooth = [np.ones(theta.size), np.cos(theta), np.sin(theta), np.cos(2 * theta), np.sin(2 * theta)]
        jumps = [0.5 * np.sign(psi) * np.maximum(np.cos(np.radians(psi)), 0.0) for psi in since]
        model = np.column_stack(smooth + jumps)
        within = [(psi >= 0) & (psi < reach) for psi in since]
        # a spike decays within the reach: with it in the fit, part of it would count as step and eccentricity
        undisturbed = ~np.any(within, axis=0)
        deviation = self.deviation
        fit = np.linalg.lstsq(model[undisturbed], deviation[undisturbed], rcond=None)[0]
        residual = deviation - model @ fit
        reversals = []
        for k, (psi, near) in enumerate(zip(since, within, strict=True)):
            peak = int(np.flatnonzero(near)[np.abs(residual[near]).argmax()])
            step = float(fit[len(smooth) + k])
            reversals.append(Reversal(k % 2, 90.0 * k, step, float(residual[peak]), float(psi[peak])))
        return tuple(reversals)


@dataclass(frozen=True)
class CircularTest:
    """Both paths of a circular test.

    Raises:
        InputError: paths of other directions, or about different circles.
    """

    clockwise: Trace
    counter_clockwise: Trace

    def __post_init__(self) -> None:
        first = self.clockwise
        second = self.counter_clockwise
        if not first.clockwise or second.clockwise:
            raise InputError("circular test: must have one path clockwise and one counter-clockwise")
        if (first.centre, first.radius) != (second.centre, second.radius):
            raise InputError("circular test: both paths must have one nominal circle")

    @property
    def _both_directions(self) -> Floats:
        return np.concatenate([self.clockwise.points, self.counter_clockwise.points])

    @cached_property
    def bidirectional_circular_deviation(self) -> float:
        """G(b) [mm]."""
        return minimum_zone(self._both_directions).width

    @property
    def mean_bidirectional_radial_deviation(self) -> float:
        """D, positive for paths that are too large [mm]."""
        return least_squares_circle(self._both_directions)[1] - self.clockwise.radius


def circle_row(run: Run, centre: tuple[float, float], radius: float, lead: float, reach: float) -> dict[str, Any]:
    """Return the values of one circle, and its radial deviation as curves over the angle.

    Args:
        run: of a circle with leads.
        centre: of the nominal circle [mm].
        radius: of the nominal circle [mm].
        lead: angle commanded before the evaluated circle [deg].
        reach: as in `Trace.reversals` [deg].
    """
    commanded = run.commanded_tip[:, :2] - centre
    angle = np.degrees(np.unwrap(np.arctan2(commanded[:, 1], commanded[:, 0])))
    passed = np.abs(angle - angle[0])
    evaluated = (passed >= lead) & (passed < lead + 360)
    nozzle = Trace(run.nozzle[evaluated, :2], centre, radius)
    motor = Trace(run.motor_tip[evaluated, :2], centre, radius)
    row: dict[str, Any] = {
        "circular_deviation_um": UM * nozzle.circular_deviation,
        "radial_deviation_max_um": UM * float(nozzle.deviation.max()),
        "radial_deviation_min_um": UM * float(nozzle.deviation.min()),
    }
    for reversal in nozzle.reversals(reach):
        row |= _reversal_row(reversal)
    # the motors' deviation is given at the nozzle's angle: their distance changes it in second order only
    curves = {
        "angle_deg": nozzle.angle,
        "radial_deviation_um": UM * nozzle.deviation,
        "motor_deviation_um": UM * motor.deviation,
    }
    return row | {name: np.round(curve, 6).tolist() for name, curve in curves.items()}


def _reversal_row(reversal: Reversal) -> dict[str, Any]:
    name = f"reversal_{'xy'[reversal.axis]}_{reversal.angle:.0f}"
    return {
        f"{name}_step_um": UM * reversal.step,
        f"{name}_spike_um": UM * reversal.spike,
        f"{name}_spike_at_deg": reversal.spike_at,
    }
