"""The involute of a circle: the spiral whose turns are evenly apart along its normal."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from gantrysim.arrays import Floats
from gantrysim.controllers.paths.lengths import arc_length, swept_angle
from gantrysim.controllers.paths.path import Path
from gantrysim.errors import InputError, finite, point, positive


@dataclass(frozen=True)
class Involute(Path):
    """The involute of a circle of radius a = pitch / 2 pi: its normal pitch is exactly `pitch`.

    With the radius of curvature rho = R - a phi over the tangent's angle phi, in coordinates along the first
    tangent (u) and towards the centre (w),

        u = a - a cos(phi) + rho sin(phi),    w = R - a sin(phi) - rho cos(phi).

    The true centre, that of the base circle, is (u, w) = (a, R). A height makes it climb evenly with phi.

    Args:
        radius: radius of curvature at the start, R [mm].
        pitch: normal distance of neighbouring turns in the XY plane [mm].
        turns: number of turns, of the tangent's angle.
        start: first point (x, y), at z = 0 [mm].
        heading_start: direction of the first tangent from +x, counter-clockwise [rad].
        clockwise: sense of the turning.
        height: z at the end [mm].
    """

    radius: float
    pitch: float
    turns: float
    start: tuple[float, float] = (0.0, 0.0)
    heading_start: float = 0.5 * np.pi
    clockwise: bool = True
    height: float = 0.0
    _last: tuple[Floats, Floats] = field(default=(np.zeros(0), np.zeros(0)), init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        positive("radius", self.radius, "mm")
        positive("pitch", self.pitch, "mm")
        positive("turns", self.turns)
        object.__setattr__(self, "start", point("start", self.start))
        finite("heading_start", self.heading_start, "rad")
        finite("height", self.height, "mm")
        if self.pitch * self.turns > self.radius * (1 + 1e-12):
            raise InputError(
                f"end radius = {self.radius - self.pitch * self.turns:g} mm "
                f"(radius {self.radius:g} - turns {self.turns:g} x pitch {self.pitch:g}): must be at least 0 mm"
            )

    def parameters(self) -> dict[str, Any]:
        return {item.name: getattr(self, item.name) for item in fields(self) if item.init}

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
    def _rise(self) -> float:
        """Climb per radian [mm/rad]."""
        return self.height / self.angle

    @property
    def _turn(self) -> float:
        return -1.0 if self.clockwise else 1.0

    @property
    def length(self) -> float:
        return float(arc_length(self.radius, -self.a, abs(self._rise), self.angle)[0])

    @property
    def centre(self) -> Floats:
        """Centre of the base circle, (3,) [mm]."""
        return self._place(np.array([self.a]), np.array([self.radius]), np.zeros(1))[0]

    def phi(self, s: ArrayLike) -> Floats:
        """Angle of the tangent since the start, (n,) [rad]."""
        at = np.atleast_1d(np.asarray(s, float))
        # position, heading, curvature and climb ask for the same ones in turn
        if not np.array_equal(self._last[0], at):
            angles = swept_angle(self.radius, -self.a, abs(self._rise), at, self.angle)
            angles.flags.writeable = False
            object.__setattr__(self, "_last", (at.copy(), angles))
        return self._last[1]

    def _place(self, along: Floats, inward: Floats, up: Floats) -> Floats:
        """Turn coordinates along the first heading and square to it, towards the centre, into points."""
        c, s = np.cos(self.heading_start), np.sin(self.heading_start)
        left = self._turn * inward
        return np.stack([self.start[0] + along * c - left * s, self.start[1] + along * s + left * c, up], axis=-1)

    def position(self, s: ArrayLike) -> Floats:
        phi = self.phi(s)
        rho = self.radius - self.a * phi
        along = self.a - self.a * np.cos(phi) + rho * np.sin(phi)
        inward = self.radius - self.a * np.sin(phi) - rho * np.cos(phi)
        return self._place(along, inward, self._rise * phi)

    def heading(self, s: ArrayLike) -> Floats:
        return self.heading_start + self._turn * self.phi(s)

    def curvature(self, s: ArrayLike) -> Floats:
        rho = self.radius - self.a * self.phi(s)
        return self._turn / np.maximum(np.hypot(rho, self._rise), 1e-9)

    def climb(self, s: ArrayLike) -> Floats:
        rho = self.radius - self.a * self.phi(s)
        return self._rise / np.maximum(np.hypot(rho, self._rise), 1e-9)
