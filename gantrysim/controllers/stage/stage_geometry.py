"""Kinematics of the stage: positions of X, Y and TH that bring a place of the work under the needle.

From the base up: the rotary axis TH about C, then X and Y, then the work with its own frame, whose origin is at W
when all axes are at zero. With the needle K in the base frame, the place u in the work frame, R(a) the rotation by
a, and sigma = 1 where a positive stage move moves the work in the positive direction, else -1,

    C + R(TH) (W + u + sigma S - C) = K,    S = sigma [C + w - W - u],    w = R(-TH) (K - C).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gantrysim.base.arrays import Floats

Complex = NDArray[np.complex128]


@dataclass(frozen=True)
class StageGeometry:
    """Positions of the stage, the work and the needle, as complex numbers [mm].

    Args:
        needle: K.
        centre: of the rotation, C.
        work: origin of the work with all axes at zero, W.
        sigma: 1 or -1.
    """

    needle: complex
    centre: complex
    work: complex
    sigma: int

    def _arm(self, theta: Floats) -> Complex:
        return (self.needle - self.centre) * np.exp(-1j * theta)

    def stage(self, u: Complex, theta: Floats) -> Complex:
        """Return S for places u of the work, at angles theta, (n,) complex [mm, rad]."""
        return self.sigma * (self.centre + self._arm(theta) - self.work - u)

    def first(self, tangent: Complex, theta: Floats, rate: Floats) -> Complex:
        """Return dS/ds = sigma [-TH' j w - t], (n,) complex."""
        return self.sigma * (-1j * rate * self._arm(theta) - tangent)

    def second(self, tangent: Complex, curvature: Floats, theta: Floats, rate: Floats, change: Floats) -> Complex:
        """Return d2S/ds2 = sigma [-TH'' j w - TH'^2 w - kappa j t], (n,) complex [1/mm]."""
        arm = self._arm(theta)
        return self.sigma * (-1j * change * arm - rate**2 * arm - 1j * curvature * tangent)


@dataclass(frozen=True)
class Turning:
    """The table's angle along the outline: linear between knots, or its moving average.

    It is extrapolated beyond its ends.

    Args:
        s: knots, ascending, (m,) [mm].
        angle: there, (m,) [rad].
        window: length of the moving average, 0 for none [mm].
    """

    s: Floats
    angle: Floats
    window: float = 0.0

    @property
    def breaks(self) -> Floats:
        """Arc lengths where the second derivative jumps, or without a window the first, ascending [mm]."""
        if self.window == 0:
            return self.s[1:-1]
        return np.sort(np.concatenate([self.s[1:-1] - 0.5 * self.window, self.s[1:-1] + 0.5 * self.window]))

    def value(self, s: ArrayLike) -> Floats:
        """Angle TH, (n,) [rad]."""
        return self._difference(s, self._integral) if self.window else self._raw(np.asarray(s, float))

    def rate(self, s: ArrayLike) -> Floats:
        """Derivative TH', (n,) [rad/mm]."""
        return self._difference(s, self._raw) if self.window else self._raw_rate(np.asarray(s, float))

    def change(self, s: ArrayLike) -> Floats:
        """Second derivative TH'' between the breaks, (n,) [rad/mm²]."""
        return self._difference(s, self._raw_rate) if self.window else np.zeros(np.shape(s))

    def _difference(self, s: ArrayLike, integral: Callable[[Floats], Floats]) -> Floats:
        """The moving average over the window, from the integral of what is averaged."""
        centre = np.asarray(s, float)
        half = 0.5 * self.window
        return (integral(centre + half) - integral(centre - half)) / self.window

    @cached_property
    def _slope(self) -> Floats:
        return np.diff(self.angle) / np.diff(self.s)

    def _locate(self, s: Floats) -> NDArray[np.intp]:
        return np.clip(np.searchsorted(self.s, s, side="right") - 1, 0, self.s.size - 2)

    def _raw(self, s: Floats) -> Floats:
        k = self._locate(s)
        return self.angle[k] + self._slope[k] * (s - self.s[k])

    def _raw_rate(self, s: Floats) -> Floats:
        return self._slope[self._locate(s)]

    def _integral(self, s: Floats) -> Floats:
        whole = np.concatenate([[0.0], np.cumsum(0.5 * (self.angle[1:] + self.angle[:-1]) * np.diff(self.s))])
        k = self._locate(s)
        distance = s - self.s[k]
        return whole[k] + distance * (self.angle[k] + 0.5 * self._slope[k] * distance)
