"""Figures in the manner of ISO 230-4 for circles and of ISO 9283 for repeated paths.

Circular tests: ISO 230-4 "Test code for machine tools, part 4: Circular tests for numerically controlled machine
tools" (editions of 2005 and 2022). Its terms and symbols are used as they are publicly described; the standard's own
text was not at hand:

- radial deviation F, its largest and smallest value Fmax and Fmin: from the actual path to the nominal path
- circular deviation G: least radial separation of two concentric circles that envelop the actual path (minimum zone)
- bidirectional circular deviation G(b): the same of two paths, one run clockwise and one counter-clockwise
- mean bidirectional radial deviation D: radius of the least-squares circle of both paths less the nominal radius

Sizes of reversal spikes and steps are not in the standard; instruments for circular tests give such figures, each in
a way of its own. The way taken here is that of `reversals`.

Repeated paths: ISO 9283:1998 "Manipulating industrial robots, performance criteria and related test methods",
clause 8 as publicly described: path accuracy ATp and path repeatability RTp. With n cycles, m places along the
command path, and the points x_ij in which the j-th attained path meets the plane square to the command path at its
i-th place c_i:

    xbar_i = mean over j of x_ij            barycentre
    ATp = max over i of |xbar_i - c_i|
    l_ij = |x_ij - xbar_i|,  lbar_i = mean over j of l_ij,  S_i^2 = sum over j of (l_ij - lbar_i)^2 / (n - 1)
    RTp = max over i of (lbar_i + 3 S_i)

Departures: the machine is a simulated one and the paths are the nozzle's, measured without an instrument; loads,
speeds and the shape of the path are the job's and not those that the standards prescribe; orientation is left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gantrysim.controllers.path import Floats, Path
from gantrysim.errors import InputError, positive

__all__ = [
    "SPIKE_REACH",
    "CircularTest",
    "MinimumZone",
    "RepeatedPath",
    "Reversal",
    "Trace",
    "interpolated",
    "least_squares_circle",
    "minimum_zone",
    "offset_over_length",
]

_LARGEST_GAP = 5.0  # between neighbouring points of a full circle [deg]
_ZONE_ROUNDS = 60
_SECTORS = 36
_ZONE_TOLERANCE = 1e-12  # of the radius
SPIKE_REACH = 15.0  # after a reversal, within which a spike is looked for [deg]
_LARGEST_REACH = 45.0  # [deg]
_LEAST_CYCLES = 2


@dataclass(frozen=True)
class MinimumZone:
    """Two concentric circles that envelop points, as near to each other as they can be.

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
    """Return centre and radius of the circle with the least sum of squared radial distances.

    Gauss-Newton on sum of (|p_i - c| - r)^2, begun at the algebraic fit |p|^2 = 2 c.p + k.

    Args:
        points: (n, 2) [mm].

    Raises:
        InputError: fewer than three points, or points on one line.
    """
    p = _plane_points(points)
    middle = p.mean(axis=0)
    q = p - middle
    matrix = np.column_stack([2 * q, np.ones(len(q))])
    solution, _, rank, _ = np.linalg.lstsq(matrix, (q**2).sum(axis=1), rcond=None)
    if rank < 3:
        raise InputError(f"{len(p)} points: must be at least three that do not lie on one line, for a circle")
    c, r = solution[:2], float(np.sqrt(solution[2] + solution[:2] @ solution[:2]))
    for _ in range(_ZONE_ROUNDS):
        out = q - c
        distance = np.linalg.norm(out, axis=1)
        jacobian = np.column_stack([-out / distance[:, None], -np.ones(len(q))])
        step = np.linalg.lstsq(jacobian, -(distance - r), rcond=None)[0]
        c, r = c + step[:2], r + float(step[2])
        if np.abs(step).max() < _ZONE_TOLERANCE * r:
            break
    centre = c + middle
    return (float(centre[0]), float(centre[1])), r


def minimum_zone(points: ArrayLike) -> MinimumZone:
    """Return the minimum zone of points: min over c of max |p_i - c| - min |p_i - c|.

    From a centre c0 the distances are linear in a small step d, |p_i - c0 - d| = |p_i - c0| - u_i.d with the unit
    vectors u_i from c0 to p_i; the least width of that is a linear program in d and the two radii,

        min  b - a   with   a <= |p_i - c0| - u_i.d <= b.

    It is solved for the outermost and the innermost point of each of 36 sectors, and for every point that is then found
    further out or in; the step is taken, halved until it helps, and the program is set up anew until the step is
    nothing. The first centre is that of the least-squares circle.

    Args:
        points: (n, 2) [mm].

    Raises:
        InputError: fewer than three points, or points on one line.
    """
    p = _plane_points(points)
    first, radius = least_squares_circle(p)
    c, least = np.array(first), _ZONE_TOLERANCE * radius

    def distances(at: Floats) -> Floats:
        length: Floats = np.linalg.norm(p - at, axis=1)
        return length

    r = distances(c)
    counted = _extremes(p - c, r)
    for _ in range(_ZONE_ROUNDS):
        width = float(np.ptp(r))
        if width <= least:
            break
        step = width * _zone_step(((p - c) / r[:, None])[counted], (r[counted] - r.mean()) / width)
        tried = distances(c + step)
        beyond = np.setdiff1d([tried.argmin(), tried.argmax()], counted)
        counted = np.append(counted, beyond)
        while np.ptp(tried) >= width and np.abs(step).max() > least:
            step = 0.5 * step
            tried = distances(c + step)
        if np.ptp(tried) < width:
            c, r = c + step, tried
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
    """The step d of the least b - a with a <= deviation - unit.d <= b, all in units of the width, (2,)."""
    from scipy.optimize import linprog  # slow to import, and needed by these figures alone

    ones, zeros = np.ones((deviation.size, 1)), np.zeros((deviation.size, 1))
    solved = linprog(
        [0, 0, -1, 1],
        A_ub=np.concatenate([np.hstack([-unit, zeros, -ones]), np.hstack([unit, ones, zeros])]),
        b_ub=np.concatenate([-deviation, deviation]),
        bounds=[(-1, 1), (-1, 1), (None, None), (None, None)],
        method="highs",
    )
    if solved.status != 0:
        raise InputError(f"minimum zone of {deviation.size} points: {solved.message}")
    step: Floats = solved.x[:2]
    return step


def _plane_points(points: ArrayLike) -> Floats:
    p = np.asarray(points, float)
    if p.ndim != 2 or p.shape[1] != 2 or len(p) < 3:
        raise InputError(f"points of shape {p.shape}: must be (n, 2) with at least three points")
    return p


@dataclass(frozen=True)
class Reversal:
    """What the radial deviation does where an axis reverses.

    Attributes:
        axis: 0 for that along x, 1 for that along y.
        angle: of the reversal on the circle, counter-clockwise from x [deg].
        step: change of the radial deviation from before to after, outward positive; backlash b makes it b [mm].
        spike: what the deviation is off beyond that, shortly after the reversal, where it is most [mm].
        spike_at: how far after the reversal [deg].
    """

    axis: int
    angle: float
    step: float
    spike: float
    spike_at: float


@dataclass(frozen=True, eq=False)
class Trace:
    """One actual path round a nominal circle, run one way.

    Args:
        points: a full circle, in the order of the motion, evenly over the angle, (n, 2) [mm].
        centre: of the nominal path [mm].
        radius: of the nominal path [mm].

    Raises:
        InputError: points that do not go all the way round.
    """

    points: Floats
    centre: tuple[float, float]
    radius: float

    def __post_init__(self) -> None:
        positive("radius", self.radius, "mm")
        object.__setattr__(self, "points", _plane_points(self.points))
        gap = float(np.diff(np.sort(self.angle), append=self.angle.min() + 360).max())
        if gap > _LARGEST_GAP:
            raise InputError(
                f"actual path: leaves out {gap:.4g} deg of the circle, must be at most {_LARGEST_GAP:g} deg"
            )

    @property
    def angle(self) -> Floats:
        """Of the points about the nominal centre, counter-clockwise from x, 0 to 360, (n,) [deg]."""
        x, y = (self.points - self.centre).T
        angle: Floats = np.degrees(np.arctan2(y, x)) % 360
        return angle

    @property
    def clockwise(self) -> bool:
        """Whether it is run clockwise."""
        turned = (np.diff(self.angle) + 180) % 360 - 180
        return bool(turned.sum() < 0)

    @property
    def deviation(self) -> Floats:
        """Radial deviation F, (n,) [mm]."""
        deviation: Floats = np.linalg.norm(self.points - self.centre, axis=1) - self.radius
        return deviation

    @cached_property
    def circular_deviation(self) -> float:
        """Circular deviation G [mm]."""
        return minimum_zone(self.points).width

    def reversals(self, reach: float = SPIKE_REACH) -> tuple[Reversal, ...]:
        """Return what happens at the four reversals of the axes, in the order of their angle.

        With psi_k the angle passed since reversal k, negative before it, the deviation is fitted by

            F = a0 + a1 cos(theta) + b1 sin(theta) + a2 cos(2 theta) + b2 sin(2 theta)
                + sum over k of h_k sign(psi_k) cos(psi_k) / 2, where |psi_k| < 90 deg:

        size, eccentricity, the axes' scales and their square angle, and at each reversal a jump h_k of the axis that
        reverses, as backlash makes it, seen along the radius. The reach after each reversal is left out of the fit. The
        step is h_k; the spike is the largest magnitude of F less the fit within the reach.

        Args:
            reach: after a reversal, within which a spike is looked for [deg].

        Raises:
            InputError: a reach beyond 45 deg, which leaves too little for the fit.
        """
        if not 0 < reach <= _LARGEST_REACH:
            raise InputError(f"reach = {reach:g} deg: must be above 0 deg and at most {_LARGEST_REACH:g} deg")
        theta, sense = np.radians(self.angle), -1.0 if self.clockwise else 1.0
        since = [sense * ((self.angle - 90.0 * k + 180) % 360 - 180) for k in range(4)]
        smooth = [np.ones(theta.size), np.cos(theta), np.sin(theta), np.cos(2 * theta), np.sin(2 * theta)]
        jumps = [0.5 * np.sign(psi) * np.maximum(np.cos(np.radians(psi)), 0.0) for psi in since]
        model = np.column_stack(smooth + jumps)
        within = [(psi >= 0) & (psi < reach) for psi in since]
        undisturbed = ~np.any(within, axis=0)
        deviation = self.deviation
        fit = np.linalg.lstsq(model[undisturbed], deviation[undisturbed], rcond=None)[0]
        rest = deviation - model @ fit
        found = []
        for k, (psi, near) in enumerate(zip(since, within, strict=True)):
            most = int(np.flatnonzero(near)[np.abs(rest[near]).argmax()])
            found.append(Reversal(k % 2, 90.0 * k, float(fit[5 + k]), float(rest[most]), float(psi[most])))
        return tuple(found)


@dataclass(frozen=True)
class CircularTest:
    """Both paths of a circular test.

    Args:
        clockwise: the path run clockwise.
        counter_clockwise: the other.

    Raises:
        InputError: paths of other senses, or about other circles.
    """

    clockwise: Trace
    counter_clockwise: Trace

    def __post_init__(self) -> None:
        one, other = self.clockwise, self.counter_clockwise
        if not one.clockwise or other.clockwise:
            raise InputError("circular test: must have one path clockwise and one counter-clockwise")
        if (one.centre, one.radius) != (other.centre, other.radius):
            raise InputError("circular test: both paths must have one nominal circle")

    @property
    def _both(self) -> Floats:
        return np.concatenate([self.clockwise.points, self.counter_clockwise.points])

    @cached_property
    def bidirectional_circular_deviation(self) -> float:
        """G(b) [mm]."""
        return minimum_zone(self._both).width

    @property
    def mean_bidirectional_radial_deviation(self) -> float:
        """D: positive where the paths are too large [mm]."""
        return least_squares_circle(self._both)[1] - self.clockwise.radius


@dataclass(frozen=True, eq=False)
class RepeatedPath:
    """Path accuracy and repeatability along a path that was run several times.

    Attributes:
        s: places on the command path by arc length, (m,) [mm].
        command: the same as points c_i, (m, 3) [mm].
        attained: where each attained path passes them, x_ij, (n, m, 3) [mm].
    """

    s: Floats
    command: Floats
    attained: Floats

    def __post_init__(self) -> None:
        if self.attained.ndim != 3 or self.attained.shape[1:] != self.command.shape:
            raise InputError(
                f"attained paths of shape {self.attained.shape}: must be (n, {len(self.command)}, 3), as the command"
            )
        if len(self.attained) < _LEAST_CYCLES:
            raise InputError(f"{len(self.attained)} attained path: must be at least {_LEAST_CYCLES}, for a scatter")

    @classmethod
    def of(cls, path: Path, traces: Sequence[ArrayLike], places: int) -> RepeatedPath:
        """Return the figures of traces held against a path.

        Args:
            path: the command path.
            traces: attained paths in the order of the motion, each (k, 3) [mm].
            places: number m of places, evenly from where the last trace begins to where the first one ends.
        """
        offsets = [offset_over_length(path, trace) for trace in traces]
        s = np.linspace(max(at[0] for at, _ in offsets), min(at[-1] for at, _ in offsets), places)
        command = path.position(s)
        attained = [command + interpolated(s, at, offset) for at, offset in offsets]
        return cls(s, command, np.array(attained))

    @property
    def barycentre(self) -> Floats:
        """xbar_i, (m, 3) [mm]."""
        mean: Floats = self.attained.mean(axis=0)
        return mean

    @property
    def accuracy(self) -> Floats:
        """|xbar_i - c_i|, (m,) [mm]."""
        distance: Floats = np.linalg.norm(self.barycentre - self.command, axis=1)
        return distance

    @property
    def repeatability(self) -> Floats:
        """lbar_i + 3 S_i, (m,) [mm]."""
        distance = np.linalg.norm(self.attained - self.barycentre, axis=2)
        radius: Floats = distance.mean(axis=0) + 3 * distance.std(axis=0, ddof=1)
        return radius

    @property
    def path_accuracy(self) -> float:
        """ATp [mm]."""
        return float(self.accuracy.max())

    @property
    def path_repeatability(self) -> float:
        """RTp [mm]."""
        return float(self.repeatability.max())


def offset_over_length(path: Path, trace: ArrayLike) -> tuple[Floats, Floats]:
    """Return how far a trace is from a path, over the path's arc length, where it goes forward.

    Args:
        path: the command path.
        trace: in the order of the motion, (k, 3) [mm].

    Returns:
        Arc lengths, ascending (r,) [mm], and offsets square to the path, (r, 3) [mm].
    """
    foot = path.follow(trace, begin=0.0)
    forward = np.concatenate([[True], foot.s[1:] > np.maximum.accumulate(foot.s)[:-1]])
    return foot.s[forward], foot.offset[forward]


def interpolated(at: Floats, s: Floats, offset: Floats) -> Floats:
    """Return offsets (r, 3) given over s (r,) at other arc lengths (m,), (m, 3) [mm]."""
    return np.stack([np.interp(at, s, offset[:, i]) for i in range(3)], axis=1)
