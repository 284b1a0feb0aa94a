"""The theory of the Move Spiral's loop, as a study of any controller's program loop asks for it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError
from gantrysim.controllers.loop_theory import Deviation, LoopErrors, LoopTheory, Spread

# Closed forms of the arcs that the Move Spiral's loop commands instead of the involute.
#
# They share no code with the loop itself and with the analysis: `SteppedArcs` is exact, the functions below it are of
# first order in the loop period. Points are complex, x + i y; the spiral starts at 0 towards +i and turns clockwise, as
# in AN-225.

Points = NDArray[np.complex128]

_SAMPLES = 10_000  # points of the arcs that values are taken over
_ROUNDING = 1e-9  # of a wait, in parts of wait_resolution


@dataclass(frozen=True)
class SteppedArcs:
    """The arcs that the loop of the Move Spiral commands, and their distance from the requested involute.

    Pass k = 1, 2, ... has the ratio x_k = 1 - k change and lasts t_k = WA(T x_k) + d. In it the virtual circle of the
    radius R turns with the speed v = V / x_k by the angle theta_k = v t_k / R, and the axes run an arc of that angle
    and of the radius x_k R, tangent to the arc before. With the centre c, which moves by
    (x_{k+1} - x_k) R exp(-i phi_k) from one pass to the next, p(phi) = c - x_k R exp(-i phi).

    The requested path is the involute about C = R + i a, p(phi) = C - (rho + i a) exp(-i phi), rho = R - a phi, with
    a = thickness / 2 pi. Involutes of one base circle are parallel curves: a point p at r = |p - C| lies on the one
    whose radius of curvature there is sqrt(r^2 - a^2), at the tangent's angle phi_p = arg(rho_p + i a) - arg(C - p).
    Hence the exact distance to the requested one, outwards positive:

        e = sqrt(r^2 - a^2) - (R - a phi_p).

    A finite ACCEL ramps v from pass to pass and from rest at the start; braking at the end is neglected.

    Args:
        diameter: of the virtual circle, 2 R [mm].
        turns: number of circles.
        thickness: requested pitch [mm].
        speed: path speed V [mm/s].
        loop_period: T [s].
        interpreter_time: d [s].
        wait_resolution: of WA, which rounds waits down to multiples of it; 0 for exact waits [s].
        acceleration: ACCEL [mm/s²].
        ratio_bits: fractional bits of the CONNECT ratio, None for an exact one.

    Raises:
        InputError: the ratio reaches zero before the last turn ends.
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
        """The ratio of every possible pass, down to zero, (k,)."""
        most = math.ceil(1 / self.change) - 1
        ratios = 1 - self.change * np.arange(1.0, most + 1)
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
            return wanted * time / self.radius
        distance = np.empty(time.size)
        v = 0.0
        for k, (target, span) in enumerate(zip(wanted.tolist(), time.tolist(), strict=True)):
            ramp = min((target - v) / self.acceleration, span)
            reached = v + self.acceleration * ramp
            distance[k] = 0.5 * (v + reached) * ramp + reached * (span - ramp)
            v = reached
        return distance / self.radius

    @cached_property
    def _arcs(self) -> tuple[Floats, Floats, Points]:
        """Start angle, radius and centre of every arc, (k,)."""
        begin = np.concatenate([[0.0], np.cumsum(self._angles)])
        count = int(np.searchsorted(begin, self._end * (1 - 1e-15)))
        begin = begin[:count]
        ratio = self._ratios[:count]
        if self.ratio_bits is not None:
            ratio = np.round(ratio * 2.0**self.ratio_bits) / 2.0**self.ratio_bits
        radius = ratio * self.radius
        centre = radius[0] + np.concatenate([[0.0], np.cumsum(np.diff(radius) * np.exp(-1j * begin[1:]))])
        return begin, radius, centre

    def position(self, phi: ArrayLike) -> Points:
        """Points of the arcs at the angles phi of the circle, (m,) [mm]."""
        angle = np.asarray(phi, float)
        begin, radius, centre = self._arcs
        k = np.clip(np.searchsorted(begin, angle, side="right") - 1, 0, begin.size - 1)
        return centre[k] - radius[k] * np.exp(-1j * angle)

    def error(self, phi: ArrayLike) -> Floats:
        """Distance of the arcs at the angles phi from the requested involute, outwards positive, (m,) [mm]."""
        angle = np.asarray(phi, float)
        # C - p = (rho_p + i a) exp(-i phi_p)
        back = self.radius + 1j * self.a - self.position(angle)
        rho = np.sqrt(np.maximum(np.abs(back) ** 2 - self.a**2, 0.0))
        ahead = np.angle((rho + 1j * self.a) / back * np.exp(-1j * angle))  # phi_p - phi
        return rho - (self.radius - self.a * (angle + ahead))

    def spacing(self, phi: ArrayLike) -> Floats:
        """Distance from the arcs at the angles phi to the next turn, along their own normal, (m,) [mm].

        From p the normal n = exp(-i phi) meets the arc about c of the radius r that turns through phi + 2 pi at
        D.n - sqrt(r^2 - (D x n)^2), with D = c - p; nan where there is no intersection.
        """
        angle = np.asarray(phi, float)
        begin, radius, centre = self._arcs
        k = np.clip(np.searchsorted(begin, angle + 2 * math.pi, side="right") - 1, 0, begin.size - 1)
        to_centre = (centre[k] - self.position(angle)) * np.exp(1j * angle)
        square = radius[k] ** 2 - to_centre.imag**2
        return to_centre.real - np.sqrt(np.where(square < 0, np.nan, square))

    @cached_property
    def _evenly(self) -> Floats:
        """Angles of points evenly spaced along the arcs, (m,) [rad]."""
        begin, radius, _ = self._arcs
        angle = np.concatenate([begin, [self._end]])
        s = np.concatenate([[0.0], np.cumsum(radius * np.diff(angle))])
        return np.interp((np.arange(_SAMPLES) + 0.5) / _SAMPLES * s[-1], s, angle)

    @cached_property
    def program(self) -> Deviation:
        """Root mean square and largest distance from the involute [mm]."""
        return Deviation.of(self.error(self._evenly))

    @cached_property
    def spacings(self) -> Spread | None:
        """Spacing of neighbouring turns [mm], None for a single turn."""
        distance = self.spacing(self._evenly[self._evenly < self._end - 2 * math.pi])
        met = distance[np.isfinite(distance)]
        return Spread.of(met) if met.size else None


def loop_error(thickness: float, radius: float, speed: float, loop_period: float, acceleration: float) -> Deviation:
    """Return the program error of the Move Spiral to first order in the loop period and in 1 / ACCEL [mm].

    The ratio is half a step ahead on average, and falls while the axes still start, V / (2 ACCEL) too early. Every arc
    is too small by delta = (a V / 2 R) (T + V / ACCEL), and tangent to the involute at the start:
    e = delta (1 - cos phi), rms sqrt(3/2) delta, max 2 delta. Loop and ACCEL contribute equally at T = V / ACCEL.

    Args:
        thickness: 2 pi a [mm].
        radius: of the virtual circle, R [mm].
        speed: V [mm/s].
        loop_period: T [s].
        acceleration: ACCEL [mm/s²].
    """
    delta = thickness / (2 * math.pi) * speed / (2 * radius) * (loop_period + speed / acceleration)
    return Deviation(math.sqrt(1.5) * delta, 2 * delta)


def local_pitch(
    thickness: float,
    loop_period: float,
    ratio: ArrayLike,
    interpreter_time: ArrayLike = 0.0,
    wait_resolution: float = 0.0,
) -> Floats:
    """Return the pitch at a ratio x: thickness / (1 + (d - r/2) / (T x)) [mm].

    The circle keeps turning for the interpreter time d in every pass; rounding down to a multiple of r shortens a wait
    by r/2 on average. To first order in r / (T x).

    Args:
        thickness: requested pitch [mm].
        loop_period: T [s].
        ratio: x, (m,) or one.
        interpreter_time: d, (m,) or one [s].
        wait_resolution: r [s].
    """
    late = (np.asarray(interpreter_time, float) - 0.5 * wait_resolution) / (loop_period * np.asarray(ratio, float))
    return thickness / (1 + late)


def involute_radius(diameter: float, turns: int, thickness: float, share: ArrayLike) -> Floats:
    """Return the radius of curvature of the requested involute after a share of its length, (m,) [mm].

    From ds = rho d(phi) and d(rho) = -a d(phi): rho^2 = R^2 - 2 a s, down to (R - turns thickness)^2 at the end.

    Args:
        diameter: 2 R [mm].
        turns: of the involute.
        thickness: 2 pi a [mm].
        share: of the length, 0 to 1, (m,).
    """
    start = (0.5 * diameter) ** 2
    return np.sqrt(start - np.asarray(share, float) * (start - (0.5 * diameter - turns * thickness) ** 2))


_ARCS = ("diameter", "turns", "thickness", "speed", "loop_period", "interpreter_time", "wait_resolution")


@dataclass(frozen=True)
class SpiralTheory(LoopTheory):
    """Errors of the Move Spiral by the closed forms of its arcs.

    Attributes:
        arguments: of the program, all of them; the controller may refuse them.
    """

    arguments: Mapping[str, Any]

    alone: ClassVar[Mapping[str, Any]] = {
        "acceleration": math.inf,
        "deceleration": None,
        "wait_resolution": 0.0,
        "ratio_bits": None,
        "interpreter_time": 0.0,
        "servo_period": 0.0,
        "as_published": False,
        "mhelical_mode": 1,
    }
    exact_waits: ClassVar[Mapping[str, Any]] = {"wait_resolution": 0.0}
    ramps = "ACCEL"
    wait = "WA"
    first_order = "√(3/2) a V T / 2R"

    @property
    def speed(self) -> float:
        return float(self.arguments["speed"])

    @property
    def pitch(self) -> float:
        return float(self.arguments["thickness"])

    @property
    def wait_resolution(self) -> float:
        return float(self.arguments["wait_resolution"])

    @property
    def ramp_period(self) -> float | None:
        acceleration = float(self.arguments["acceleration"])
        return self.speed / acceleration if math.isfinite(acceleration) else None

    def errors(self) -> LoopErrors | None:
        if not self.arguments["loop_period"]:
            return None
        try:
            arcs = SteppedArcs(
                **{name: self.arguments[name] for name in _ARCS},
                acceleration=self.arguments["acceleration"],
                ratio_bits=self.arguments.get("ratio_bits"),
            )
        except InputError:
            return None
        return LoopErrors(arcs.program, arcs.spacings)

    def first_order_error(self, loop_period: float) -> float:
        radius = 0.5 * self.arguments["diameter"]
        return loop_error(self.pitch, radius, self.speed, loop_period, math.inf).rms

    def local_pitches(self, interpreter_time: ArrayLike) -> dict[str, Floats]:
        last_ratio = 1 - 2 * self.arguments["turns"] * self.pitch / self.arguments["diameter"]
        ratios = {"start": 1.0, "end": last_ratio}
        time = np.asarray(interpreter_time, float)
        # a spiral that ends in its centre has no pitch there
        return {
            place: local_pitch(self.pitch, self.arguments["loop_period"], ratio, time)
            for place, ratio in ratios.items()
            if ratio > 0
        }

    def radius_of_curvature(self, share: ArrayLike) -> Floats:
        return involute_radius(self.arguments["diameter"], self.arguments["turns"], self.pitch, share)
