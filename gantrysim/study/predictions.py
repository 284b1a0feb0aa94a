"""What a loop study must find, in closed forms that share no code with the controllers and the analysis.

Move Spiral: the program loop lays arcs instead of the involute, see `SteppedArcs`, and the laws of first order in the
loop period below it. Servo: `circle_response`, the following error that the sampling and the winding leave.
Encoder: `quantisation`. The plane is that of complex numbers, x + i y; the spiral begins at 0 towards +i and turns
clockwise, as in Trio's application note AN-225.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gantrysim.controllers.path import Floats
from gantrysim.controllers.servo import AxisDynamics, Servo
from gantrysim.errors import InputError
from gantrysim.metrics import Range, Spread

__all__ = [
    "FollowingError",
    "SteppedArcs",
    "circle_response",
    "involute_radius",
    "local_pitch",
    "loop_error",
    "quantisation",
    "sample_and_hold",
]

Points = NDArray[np.complex128]

_SAMPLES = 10_000  # points of the arcs that figures are taken over
_ROUNDING = 1e-9  # of a wait, in parts of wait_resolution


@dataclass(frozen=True)
class SteppedArcs:
    """The arcs that the loop of the Move Spiral really commands, and their distance from the involute asked for.

    Pass k = 1, 2, ... has the ratio x_k = 1 - k change and lasts t_k = WA(T x_k) + d. In it the virtual circle of the
    radius R turns with the speed v = V / x_k by the angle theta_k = v t_k / R, and the axes run an arc of that angle
    and of the radius x_k R, tangent to the arc before. With the centre c, which moves by
    (x_{k+1} - x_k) R exp(-i phi_k) from one pass to the next, p(phi) = c - x_k R exp(-i phi).

    The path asked for is the involute about C = R + i a, p(phi) = C - (rho + i a) exp(-i phi), rho = R - a phi, with
    a = thickness / 2 pi. Involutes of one base circle are parallel curves: a point p at r = |p - C| lies on the one
    whose radius of curvature there is sqrt(r^2 - a^2), at the tangent's angle phi_p = arg(rho_p + i a) - arg(C - p).
    Hence the distance to the one asked for, exact, outwards positive:

        e = sqrt(r^2 - a^2) - (R - a phi_p).

    A finite ACCEL ramps v from one pass to the next, and from rest at the start; the braking at the end is left out.

    Args:
        diameter: of the virtual circle, 2 R [mm].
        turns: number of circles.
        thickness: pitch asked for [mm].
        speed: path speed V [mm/s].
        loop_period: T [s].
        interpreter_time: d [s].
        wait_resolution: WA waits whole multiples of it, cut off; 0 for exact waits [s].
        acceleration: ACCEL [mm/s²].
        ratio_bits: fractional bits of the ratio that the axes are CONNECTed by, None for an exact one.

    Raises:
        InputError: the ratio comes to zero before the circles are at their end.
    """

    diameter: float
    turns: int
    thickness: float
    speed: float
    loop_period: float
    interpreter_time: float = 0.0
    wait_resolution: float = 0.0
    acceleration: float = math.inf
    ratio_bits: int | None = None

    def __post_init__(self) -> None:
        if self._angles.sum() < self._end * (1 - 1e-12):
            raise InputError(
                f"ratio x = 0 after {self._angles.sum() / (2 * math.pi):.4g} of {self.turns} turns: "
                "must be above 0 to the end"
            )

    @property
    def radius(self) -> float:
        """Radius R of the virtual circle [mm]."""
        return 0.5 * self.diameter

    @property
    def a(self) -> float:
        """Decrease of the radius per radian [mm/rad]."""
        return self.thickness / (2 * math.pi)

    @property
    def change(self) -> float:
        """Decrease of the ratio at every pass, a V T / R^2."""
        return self.a * self.speed * self.loop_period / self.radius**2

    @property
    def _end(self) -> float:
        return 2 * math.pi * self.turns

    @cached_property
    def _ratios(self) -> Floats:
        """The ratio of every pass that could be run, down to zero, (k,)."""
        most = math.ceil(1 / self.change) - 1
        ratios: Floats = 1 - self.change * np.arange(1.0, most + 1)
        return ratios[ratios > 0]

    @cached_property
    def _angles(self) -> Floats:
        """Angle of the circle in every such pass, (k,) [rad]."""
        wait = self.loop_period * self._ratios
        if self.wait_resolution > 0:
            wait = np.floor(wait / self.wait_resolution + _ROUNDING) * self.wait_resolution
        time = wait + self.interpreter_time
        wanted = self.speed / self._ratios
        if self.acceleration == math.inf:
            angles: Floats = wanted * time / self.radius
            return angles
        way, v = np.empty(time.size), 0.0
        for k, (target, span) in enumerate(zip(wanted.tolist(), time.tolist(), strict=True)):
            ramp = min((target - v) / self.acceleration, span)
            reached = v + self.acceleration * ramp
            way[k] = 0.5 * (v + reached) * ramp + reached * (span - ramp)
            v = reached
        return way / self.radius

    @cached_property
    def _arcs(self) -> tuple[Floats, Floats, Points]:
        """Angle at the begin of every arc, its radius, and its centre, (k,)."""
        begin = np.concatenate([[0.0], np.cumsum(self._angles)])
        count = int(np.searchsorted(begin, self._end * (1 - 1e-15)))
        begin, ratio = begin[:count], self._ratios[:count]
        if self.ratio_bits is not None:
            ratio = np.round(ratio * 2.0**self.ratio_bits) / 2.0**self.ratio_bits
        radius = ratio * self.radius
        centre = radius[0] + np.concatenate([[0.0], np.cumsum(np.diff(radius) * np.exp(-1j * begin[1:]))])
        return begin, radius, centre

    def position(self, phi: ArrayLike) -> Points:
        """Points of the arcs at the angles phi of the circle, (m,) [mm]."""
        at = np.asarray(phi, float)
        begin, radius, centre = self._arcs
        k = np.clip(np.searchsorted(begin, at, side="right") - 1, 0, begin.size - 1)
        points: Points = centre[k] - radius[k] * np.exp(-1j * at)
        return points

    def error(self, phi: ArrayLike) -> Floats:
        """Distance of the arcs at the angles phi from the involute asked for, outwards positive, (m,) [mm]."""
        at = np.asarray(phi, float)
        back = self.radius + 1j * self.a - self.position(at)  # C - p = (rho_p + i a) exp(-i phi_p)
        rho = np.sqrt(np.maximum(np.abs(back) ** 2 - self.a**2, 0.0))
        ahead = np.angle((rho + 1j * self.a) / back * np.exp(-1j * at))  # phi_p - phi
        distance: Floats = rho - (self.radius - self.a * (at + ahead))
        return distance

    def spacing(self, phi: ArrayLike) -> Floats:
        """Distance from the arcs at the angles phi to the next turn, along their own normal, (m,) [mm].

        From p the normal n = exp(-i phi) meets the arc about c of the radius r that turns through phi + 2 pi at
        D.n - sqrt(r^2 - (D x n)^2), with D = c - p; nan where it misses it.
        """
        at = np.asarray(phi, float)
        begin, radius, centre = self._arcs
        k = np.clip(np.searchsorted(begin, at + 2 * math.pi, side="right") - 1, 0, begin.size - 1)
        to_centre = (centre[k] - self.position(at)) * np.exp(1j * at)
        square = radius[k] ** 2 - to_centre.imag**2
        distance: Floats = to_centre.real - np.sqrt(np.where(square < 0, np.nan, square))
        return distance

    @cached_property
    def _evenly(self) -> Floats:
        """Angles of points evenly spaced along the arcs, which is in time but for the ramps, (m,) [rad]."""
        begin, radius, _ = self._arcs
        angle = np.concatenate([begin, [self._end]])
        way = np.concatenate([[0.0], np.cumsum(radius * np.diff(angle))])
        evenly: Floats = np.interp((np.arange(_SAMPLES) + 0.5) / _SAMPLES * way[-1], way, angle)
        return evenly

    @cached_property
    def generation(self) -> Spread:
        """Root mean square and largest distance from the involute [mm]."""
        return Spread.of(self.error(self._evenly))

    @cached_property
    def spacings(self) -> Range | None:
        """Spacing of neighbouring turns [mm]; None where there are none."""
        distance = self.spacing(self._evenly[self._evenly < self._end - 2 * math.pi])
        met = distance[np.isfinite(distance)]
        return Range.of(met) if met.size else None


def loop_error(thickness: float, radius: float, speed: float, loop_period: float, acceleration: float) -> Spread:
    """Return the generation error of the Move Spiral to first order in the loop period and in 1 / ACCEL [mm].

    The ratio is a step ahead in every pass, on average half a step, and falls while the axes still start: for
    V / (2 ACCEL) too early. So every arc is too small by delta = (a V / 2 R) (T + V / ACCEL), and tangent to the
    involute at the start: e = delta (1 - cos phi), rms sqrt(3/2) delta, max 2 delta. The two are alike where T is
    V / ACCEL.

    Args:
        thickness: 2 pi a [mm].
        radius: of the virtual circle, R [mm].
        speed: V [mm/s].
        loop_period: T [s].
        acceleration: ACCEL [mm/s²].
    """
    delta = thickness / (2 * math.pi) * speed / (2 * radius) * (loop_period + speed / acceleration)
    return Spread(math.sqrt(1.5) * delta, 2 * delta)


def local_pitch(
    thickness: float,
    loop_period: float,
    ratio: ArrayLike,
    interpreter_time: ArrayLike = 0.0,
    wait_resolution: float = 0.0,
) -> Floats:
    """Return the pitch where the ratio is x: thickness / (1 + (d - r/2) / (T x)) [mm].

    The circle turns on for the interpreter's time d in every pass; a wait cut to a multiple of r is shorter by r/2 on
    average. To first order in r / (T x).

    Args:
        thickness: pitch asked for [mm].
        loop_period: T [s].
        ratio: x, (m,) or one.
        interpreter_time: d, (m,) or one [s].
        wait_resolution: r [s].
    """
    late = (np.asarray(interpreter_time, float) - 0.5 * wait_resolution) / (loop_period * np.asarray(ratio, float))
    pitch: Floats = thickness / (1 + late)
    return pitch


def circle_response(servo: Servo, index: int, axis: AxisDynamics, rate: float) -> complex:
    """Return the following error E over the command R of one axis that runs R exp(i w t), of the linear, rigid axis.

    Motor torque J M'' + b M' moves the position M = R - E. A sampled output is held for a period T, which delays it by
    T/2, and comes through the winding's lag tau and the delay delta of the servo; a backward difference is late by T/2,
    the second one by T. With s = i w, H = exp(-s (T/2 + tau + delta)) and B = (1 - exp(-s T)) / T,

        E / R = (J s^2 + b s - H (kvff B + kaff B^2 + kov B)) / (J s^2 + b s + H (kp + ki / s + kd B - kov B)).

    To leading order the feed-forward of the acceleration, late by 3/2 T + tau + delta, is what is left over:
    E = (3/2 T + tau + delta) J R''' / kp, see `sample_and_hold`.

    Args:
        servo: with its gains.
        index: of the axis in the servo.
        axis: inertia J, viscous friction b and lag tau of it.
        rate: w [rad/s].
    """
    s = 1j * rate
    hold = cmath.exp(-s * (0.5 * servo.period + axis.lag + servo.delay))
    back = (1 - cmath.exp(-s * servo.period)) / servo.period
    plant = axis.inertia * s**2 + axis.viscous * s
    output = servo.output_velocity[index] * back
    forward = servo.velocity_ff[index] * back + servo.acceleration_ff[index] * back**2
    law = servo.kp[index] + servo.ki[index] / s + servo.kd[index] * back
    return (plant - hold * (forward + output)) / (plant + hold * (law - output))


@dataclass(frozen=True)
class FollowingError:
    """Root mean squares of a following error in the plane [mm].

    Attributes:
        along: along the path.
        normal: square to it.
    """

    along: float
    normal: float


def sample_and_hold(
    servo: Servo, axes: Sequence[AxisDynamics], plane: tuple[int, int], speed: float, radius: ArrayLike
) -> FollowingError:
    """Return the following error of two axes on a path whose radius of curvature changes slowly.

    At each radius it is that of a circle at the rate w = V / rho, by `circle_response`. With h the mean of the two
    axes' responses and d half their difference, the error turns with the path by rho h and against it by rho d:
    mean squares rho^2 (Im(h)^2 + |d|^2 / 2) along the path and rho^2 (Re(h)^2 + |d|^2 / 2) square to it.

    Args:
        servo: with the gains of the machine's axes.
        axes: of the machine.
        plane: indices of the two axes that span the plane.
        speed: V [mm/s].
        radius: of curvature at times evenly apart, rho, (m,) [mm].
    """
    along = normal = 0.0
    radii = np.atleast_1d(np.asarray(radius, float)).tolist()
    for rho in radii:
        first, second = (circle_response(servo, k, axes[k], speed / rho) for k in plane)
        mean, half = 0.5 * (first + second), 0.5 * (first - second)
        along += rho**2 * (mean.imag**2 + 0.5 * abs(half) ** 2) / len(radii)
        normal += rho**2 * (mean.real**2 + 0.5 * abs(half) ** 2) / len(radii)
    return FollowingError(math.sqrt(along), math.sqrt(normal))


def involute_radius(diameter: float, turns: int, thickness: float, share: ArrayLike) -> Floats:
    """Return the radius of curvature of the involute asked for after a share of its length, (m,) [mm].

    From ds = rho d(phi) and d(rho) = -a d(phi): rho^2 = R^2 - 2 a s, down to (R - turns thickness)^2 at the end.

    Args:
        diameter: 2 R [mm].
        turns: of the involute.
        thickness: 2 pi a [mm].
        share: of the length, 0 to 1, (m,).
    """
    start = (0.5 * diameter) ** 2
    rho: Floats = np.sqrt(start - np.asarray(share, float) * (start - (0.5 * diameter - turns * thickness) ** 2))
    return rho


def quantisation(resolution: ArrayLike) -> Floats:
    """Return the rms of the error of counts of a resolution q, evenly distributed within one: q / sqrt(12).

    It is the same in any direction of a plane whose axes have equal counts.

    Args:
        resolution: q, (m,) [mm].
    """
    error: Floats = np.asarray(resolution, float) / math.sqrt(12)
    return error
