"""Spirals as exact paths: the involute of a circle and Archimedes' spiral, both by arc length."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from gantrysim.controllers.path import Floats, Path
from gantrysim.errors import InputError, finite, point, positive

__all__ = ["Archimedean", "Involute"]

_NEWTON_STEPS = 50
_NEWTON_TOLERANCE = 1e-14  # relative


@dataclass(frozen=True)
class _Spiral(Path):
    """Turns inward from `start`; its circle's centre lies `radius` off the start, square to the heading."""

    radius: float
    pitch: float
    turns: float
    start: tuple[float, float] = (0.0, 0.0)
    heading_start: float = 0.5 * np.pi
    clockwise: bool = True

    def __post_init__(self) -> None:
        positive("radius", self.radius, "mm")
        positive("pitch", self.pitch, "mm")
        positive("turns", self.turns)
        object.__setattr__(self, "start", point("start", self.start))
        finite("heading_start", self.heading_start, "rad")
        if self.pitch * self.turns > self.radius * (1 + 1e-12):
            raise InputError(
                f"end radius = {self.radius - self.pitch * self.turns:g} mm "
                f"(radius {self.radius:g} - turns {self.turns:g} x pitch {self.pitch:g}): must be at least 0 mm"
            )

    def parameters(self) -> dict[str, Any]:
        return asdict(self)

    @property
    def turn_spacing(self) -> float:
        return self.pitch

    @property
    def a(self) -> float:
        """Decrease of the radius per radian, pitch / 2 pi [mm/rad]."""
        return self.pitch / (2 * np.pi)

    @property
    def angle(self) -> float:
        """Angle from start to end [rad]."""
        return 2 * np.pi * self.turns

    @property
    def _turn(self) -> float:
        return -1.0 if self.clockwise else 1.0

    def _place(self, along: Floats, inward: Floats) -> Floats:
        """Turn coordinates along the first heading and square to it, towards the centre, into points."""
        c, s = np.cos(self.heading_start), np.sin(self.heading_start)
        left = self._turn * inward
        x = self.start[0] + along * c - left * s
        y = self.start[1] + along * s + left * c
        return np.stack([x, y, np.zeros_like(x)], axis=-1)


class Involute(_Spiral):
    """The involute of a circle of radius a = pitch / 2 pi: its normal pitch is exactly `pitch`.

    With the radius of curvature rho = R - a phi over the tangent's angle phi the arc length is
    s = R phi - a phi^2 / 2, and in coordinates along the first tangent (u) and towards the centre (w)

        u = a - a cos(phi) + rho sin(phi),    w = R - a sin(phi) - rho cos(phi).

    The true centre, that of the base circle, is (u, w) = (a, R).

    Args:
        radius: radius of curvature at the start, R [mm].
        pitch: normal distance of neighbouring turns [mm].
        turns: number of turns, of the tangent's angle.
        start: first point (x, y) [mm].
        heading_start: direction of the first tangent from +x, counter-clockwise [rad].
        clockwise: sense of the turning.
    """

    @property
    def length(self) -> float:
        return float(self.radius * self.angle - 0.5 * self.a * self.angle**2)

    @property
    def centre(self) -> Floats:
        """Centre of the base circle, (3,) [mm]."""
        centre: Floats = self._place(np.array([self.a]), np.array([self.radius]))[0]
        return centre

    def phi(self, s: ArrayLike) -> Floats:
        """Angle of the tangent since the start, (n,) [rad]."""
        arc = np.atleast_1d(np.asarray(s, float))
        root = np.sqrt(np.maximum(self.radius**2 - 2 * self.a * arc, 0.0))
        # (R - root) / a without the cancellation near s = 0
        return 2 * arc / (self.radius + root)

    def position(self, s: ArrayLike) -> Floats:
        phi = self.phi(s)
        rho = self.radius - self.a * phi
        along = self.a - self.a * np.cos(phi) + rho * np.sin(phi)
        inward = self.radius - self.a * np.sin(phi) - rho * np.cos(phi)
        return self._place(along, inward)

    def heading(self, s: ArrayLike) -> Floats:
        theta: Floats = self.heading_start + self._turn * self.phi(s)
        return theta

    def curvature(self, s: ArrayLike) -> Floats:
        rho = self.radius - self.a * self.phi(s)
        kappa: Floats = self._turn / np.maximum(rho, 1e-9)
        return kappa


class Archimedean(_Spiral):
    """Archimedes' spiral r = R - a psi about a centre that lies R off the start, square to the heading.

    Its arc length is s = a/2 [u sqrt(1 + u^2) + asinh(u)] between u = r/a and u = R/a; the inverse is
    found by Newton's method to 1e-14. `heading_start` is the direction square to the first radius; the
    tangent itself leans inward from it by atan(a / R).

    Args: as those of Involute, with `radius` the distance of the start from the centre.
    """

    @property
    def length(self) -> float:
        return float(_archimedes_length(self.radius / self.a) - _archimedes_length(self._u_end)) * self.a

    @property
    def centre(self) -> Floats:
        """Centre of the spiral, (3,) [mm]."""
        centre: Floats = self._place(np.zeros(1), np.array([self.radius]))[0]
        return centre

    @property
    def _u_end(self) -> float:
        return max(self.radius / self.a - self.angle, 0.0)

    def _u(self, s: ArrayLike) -> Floats:
        """u = r/a at the arc length s, (n,)."""
        arc = np.atleast_1d(np.asarray(s, float))
        target = _archimedes_length(self.radius / self.a) - arc / self.a
        u = np.sqrt(np.maximum(2 * target, 0.0))  # s ~ a u^2 / 2 where u is large
        for _ in range(_NEWTON_STEPS):
            step = (_archimedes_length(u) - target) / np.sqrt(1 + u**2)
            u = np.maximum(u - step, 0.0)
            if np.max(np.abs(step), initial=0.0) <= _NEWTON_TOLERANCE * (1 + float(np.max(u, initial=0.0))):
                break
        return u

    def position(self, s: ArrayLike) -> Floats:
        u = self._u(s)
        psi = self.radius / self.a - u
        r = self.a * u
        return self._place(r * np.sin(psi), self.radius - r * np.cos(psi))

    def heading(self, s: ArrayLike) -> Floats:
        u = self._u(s)
        psi = self.radius / self.a - u
        theta: Floats = self.heading_start + self._turn * (psi + np.arctan2(1.0, u))
        return theta

    def curvature(self, s: ArrayLike) -> Floats:
        u = self._u(s)
        kappa: Floats = self._turn * (u**2 + 2) / (self.a * (u**2 + 1) ** 1.5)
        return kappa


def _archimedes_length(u: ArrayLike) -> Floats:
    """Arc length of r = psi from the centre out to r = u."""
    r = np.asarray(u, float)
    length: Floats = 0.5 * (r * np.sqrt(1 + r**2) + np.arcsinh(r))
    return length
