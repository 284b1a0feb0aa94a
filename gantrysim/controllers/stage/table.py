"""Kinematics of the stage: where X, Y and TH must stand for the needle to be at a place of the work.

From the base up: the rotary axis TH about C, then X and Y, then the work piece with its own frame, whose origin is
at W when all axes are at zero. With the needle K in the base frame, the place u in the work frame, R(a) the
rotation by a, and sigma = 1 where a positive stage move moves the work in the positive direction, -1 where it
moves the work in the negative one (so that the axis reads the needle relative to the work),

    C + R(TH) (W + u + sigma S - C) = K,    S = sigma [C + w - W - u],    w = R(-TH) (K - C).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gantrysim.arrays import Floats

Complex = NDArray[np.complex128]


@dataclass(frozen=True)
class Table:
    """Where the stage, the work and the needle stand; places as complex numbers [mm].

    Args:
        needle: K.
        centre: of the rotation, C.
        work: centre of the work at TH = 0, W.
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

    def rate(self, tangent: Complex, theta: Floats, turning: Floats) -> Complex:
        """Return dS/ds = sigma [-TH' j w - t], (n,) complex."""
        return self.sigma * (-1j * turning * self._arm(theta) - tangent)

    def bend(self, tangent: Complex, curvature: Floats, theta: Floats, turning: Floats, change: Floats) -> Complex:
        """Return d2S/ds2 = sigma [-TH'' j w - TH'^2 w - kappa j t], (n,) complex [1/mm]."""
        arm = self._arm(theta)
        return self.sigma * (-1j * change * arm - turning**2 * arm - 1j * curvature * tangent)
