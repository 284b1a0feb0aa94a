"""The involute of a circle: a spiral of constant normal pitch."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from gantrysim.base.arrays import Floats, LastCall
from gantrysim.base.errors import InputError, finite, plane_point, positive
from gantrysim.base.jit import jit
from gantrysim.paths.lengths import arc_length, swept_along
from gantrysim.paths.path import UPRIGHT, Local, Path

_LEAST_RATE = 1e-9  # of the arc length at the centre, where the curvature has no bound [mm/rad]


class _Numbers(NamedTuple):
    """An involute as compiled functions take it.

    Attributes:
        radius, a, rise, start, turn: as of `Involute`.
        direction: of the first tangent, cosine and sine.
    """

    radius: float
    a: float
    rise: float
    start: tuple[float, float]
    direction: tuple[float, float]
    turn: float


@dataclass(frozen=True)
class Involute(Path):
    """The involute of a circle of radius a = pitch / 2 pi: its normal pitch is exactly `pitch`.

    With the angle phi of the tangent and the radius of curvature rho = R - a phi, in coordinates along the first
    tangent (u) and towards the centre (w),

        u = a - a cos(phi) + rho sin(phi),    w = R - a sin(phi) - rho cos(phi).

    The centre of the base circle is (u, w) = (a, R). With a height it climbs in proportion to phi.

    Args:
        radius: radius of curvature at the start, R [mm].
        pitch: normal distance of adjacent turns in the XY plane [mm].
        turns: number of turns of the tangent.
        start: first point (x, y), at z = 0 [mm].
        heading_start: of the first tangent, from +x counter-clockwise [rad].
        clockwise: sense of rotation.
        height: z at the end [mm].
    """

    radius: float
    pitch: float
    turns: float
    start: tuple[float, float] = (0.0, 0.0)
    heading_start: float = 0.5 * np.pi
    clockwise: bool = True
    height: float = 0.0

    def __post_init__(self) -> None:
        positive("radius", self.radius, "mm")
        positive("pitch", self.pitch, "mm")
        positive("turns", self.turns)
        object.__setattr__(self, "start", plane_point("start", self.start))
        finite("heading_start", self.heading_start, "rad")
        finite("height", self.height, "mm")
        if self.pitch * self.turns > self.radius * (1 + 1e-12):
            raise InputError(
                f"end radius = {self.radius - self.pitch * self.turns:g} mm "
                f"(radius {self.radius:g} - turns {self.turns:g} x pitch {self.pitch:g}): must be at least 0 mm"
            )

    def parameters(self) -> dict[str, Any]:
        return {item.name: getattr(self, item.name) for item in fields(self)}

    @property
    def turn_spacing(self) -> float:
        return self.pitch

    @property
    def a(self) -> float:
        """Decrease of the radius per radian, pitch / 2 pi [mm/rad]."""
        return self.pitch / (2 * np.pi)

    @property
    def angle(self) -> float:
        """Angle of the tangent at the end [rad]."""
        return 2 * np.pi * self.turns

    @property
    def _rise(self) -> float:
        """Climb per radian [mm/rad]."""
        return self.height / self.angle

    @property
    def _turn(self) -> float:
        return -1.0 if self.clockwise else 1.0

    @cached_property
    def length(self) -> float:
        return float(arc_length(self.radius, -self.a, abs(self._rise), self.angle)[0])

    @property
    def centre(self) -> Floats:
        """Centre of the base circle, (3,) [mm]."""
        return self._points_at(np.array([self.a]), np.array([self.radius]), np.zeros(1))[0]

    def phi(self, s: ArrayLike) -> Floats:
        """Angle of the tangent since the start, (n,) [rad]."""
        return self._angles(np.atleast_1d(np.asarray(s, float)))

    @cached_property
    def _angles(self) -> LastCall[Floats]:
        return LastCall(self._swept_angles)

    def _swept_angles(self, s: Floats) -> Floats:
        radius = float(self.radius)
        rise = abs(self._rise)
        angles: Floats = swept_along(radius, -self.a, rise, s.ravel(), self.angle)  # type: ignore[no-untyped-call]
        angles = angles.reshape(s.shape)
        angles.flags.writeable = False
        return angles

    def _points_at(self, along: Floats, inward: Floats, up: Floats) -> Floats:
        """Points of coordinates along the first tangent, and towards the centre."""
        c = np.cos(self.heading_start)
        s = np.sin(self.heading_start)
        lateral = self._turn * inward
        return np.stack([self.start[0] + along * c - lateral * s, self.start[1] + along * s + lateral * c, up], axis=-1)

    def position(self, s: ArrayLike) -> Floats:
        phi = self.phi(s)
        points = np.empty((phi.size, 3))
        _find_points(phi, self._numbers, points)
        return points

    @cached_property
    def _numbers(self) -> _Numbers:
        return _Numbers(
            radius=float(self.radius),
            a=self.a,
            rise=self._rise,
            start=self.start,
            direction=(float(np.cos(self.heading_start)), float(np.sin(self.heading_start))),
            turn=self._turn,
        )

    def local(self, s: ArrayLike) -> Local:
        phi = self.phi(s)
        n = phi.size
        here = Local(
            np.empty((n, 3)), (np.empty(n), np.empty(n)), np.empty(n), np.empty(n), UPRIGHT, np.zeros(n, np.intp)
        )
        _find_frames(phi, self._numbers, here.position, here.heading, here.sine, here.turning)
        return here

    def heading(self, s: ArrayLike) -> Floats:
        return self.heading_start + self._turn * self.phi(s)

    def curvature(self, s: ArrayLike) -> Floats:
        rho = self.radius - self.a * self.phi(s)
        return self._turn / np.maximum(np.hypot(rho, self._rise), _LEAST_RATE)

    def climb(self, s: ArrayLike) -> Floats:
        rho = self.radius - self.a * self.phi(s)
        return self._rise / np.maximum(np.hypot(rho, self._rise), _LEAST_RATE)


@jit
def _find_points(phi: Floats, numbers: _Numbers, points: Floats) -> None:
    """Write the points of an involute at the angles phi, (n, 3) [mm]."""
    for k in range(phi.size):
        _write_point(phi[k], np.cos(phi[k]), np.sin(phi[k]), numbers, points[k])


@jit
def _write_point(phi: float, cosine: float, sine: float, numbers: _Numbers, point: Floats) -> None:
    """Write the point of an involute at an angle phi, given with its cosine and sine, (3,) [mm]."""
    radius = numbers.radius
    a = numbers.a
    c, d = numbers.direction
    rho = radius - a * phi
    along = a - a * cosine + rho * sine
    lateral = numbers.turn * (radius - a * sine - rho * cosine)
    point[0] = numbers.start[0] + along * c - lateral * d
    point[1] = numbers.start[1] + along * d + lateral * c
    point[2] = numbers.rise * phi


@jit
def _find_frames(
    phi: Floats, numbers: _Numbers, points: Floats, heading: tuple[Floats, Floats], climb: Floats, turning: Floats
) -> None:
    """Write the points of an involute at the angles phi, (n, 3) [mm], and the frames there.

    These are cosine and sine of the heading, the sine of the climb, and the turning, (n,) each.
    """
    c, d = numbers.direction
    for k in range(phi.size):
        cosine = np.cos(phi[k])
        sine = np.sin(phi[k])
        _write_point(phi[k], cosine, sine, numbers, points[k])
        turned = numbers.turn * sine
        heading[0][k] = c * cosine - d * turned
        heading[1][k] = d * cosine + c * turned
        rate = max(np.hypot(numbers.radius - numbers.a * phi[k], numbers.rise), _LEAST_RATE)
        climb[k] = numbers.rise / rate
        turning[k] = numbers.turn / rate
