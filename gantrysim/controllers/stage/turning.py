"""The angle of the rotary table along the outline: in proportion to the way in corners, or eased into them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from gantrysim.arrays import Floats


@dataclass(frozen=True)
class Turning:
    """An angle that is linear between knots, and its mean over a window of the way about every place.

    Beyond its ends the angle goes on as straight as it came.

    Args:
        s: knots, (m,), ascending [mm].
        angle: there, (m,) [rad].
        window: over which the mean is taken, 0 for the angle itself [mm].
    """

    s: Floats
    angle: Floats
    window: float = 0.0

    @property
    def breaks(self) -> Floats:
        """Places where the second derivative jumps, or without a window the first, ascending [mm]."""
        if self.window == 0:
            return self.s[1:-1]
        return np.sort(np.concatenate([self.s[1:-1] - 0.5 * self.window, self.s[1:-1] + 0.5 * self.window]))

    def value(self, s: ArrayLike) -> Floats:
        """Angle TH, (n,) [rad]."""
        at = np.asarray(s, float)
        if self.window == 0:
            return self._raw(at)
        half = 0.5 * self.window
        return (self._integral(at + half) - self._integral(at - half)) / self.window

    def rate(self, s: ArrayLike) -> Floats:
        """Derivative TH', (n,) [rad/mm]."""
        at = np.asarray(s, float)
        if self.window == 0:
            return self._slope[self._locate(at)]
        half = 0.5 * self.window
        return (self._raw(at + half) - self._raw(at - half)) / self.window

    def change(self, s: ArrayLike) -> Floats:
        """Second derivative TH'' between the breaks, (n,) [rad/mm²]."""
        at = np.asarray(s, float)
        if self.window == 0:
            return np.zeros(at.shape)
        half = 0.5 * self.window
        return (self._slope[self._locate(at + half)] - self._slope[self._locate(at - half)]) / self.window

    @property
    def _slope(self) -> Floats:
        return np.diff(self.angle) / np.diff(self.s)

    def _locate(self, s: Floats) -> np.ndarray[tuple[int, ...], np.dtype[np.intp]]:
        return np.clip(np.searchsorted(self.s, s, side="right") - 1, 0, self.s.size - 2)

    def _raw(self, s: Floats) -> Floats:
        k = self._locate(s)
        return self.angle[k] + self._slope[k] * (s - self.s[k])

    def _integral(self, s: Floats) -> Floats:
        whole = np.concatenate([[0.0], np.cumsum(0.5 * (self.angle[1:] + self.angle[:-1]) * np.diff(self.s))])
        k = self._locate(s)
        rest = s - self.s[k]
        return whole[k] + rest * (self.angle[k] + 0.5 * self._slope[k] * rest)
