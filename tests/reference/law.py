"""The sampled servo of one axis in plain numbers; its law is in `kernels`."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Law:
    """The servo of one axis; u is mm or deg.

    Attributes:
        period: T [s].
        delay: from the sample to the output [s].
        kp, ki, kd, velocity_ff, acceleration_ff, output_velocity: gains [N·m per u, u·s, u/s, u/s²].
        limit: largest torque demand [N·m].
        count: travel per encoder count, 0 for an exact encoder [u].
        notch: centre [Hz] and damping of numerator and denominator of the filter on the torque; no filter at 0 Hz.
    """

    period: float
    delay: float
    kp: float
    ki: float
    kd: float
    velocity_ff: float
    acceleration_ff: float
    output_velocity: float
    limit: float
    count: float
    notch: tuple[float, float, float] = (0.0, 1.0, 1.0)

    def numbers(self) -> np.ndarray:
        """Return the numbers that the compiled law takes."""
        gains = (self.kp, self.ki, self.kd, self.velocity_ff, self.acceleration_ff, self.output_velocity)
        return np.array([*gains, *notch_coefficients(*self.notch, self.period), self.limit, self.count, self.period])

    def steps(self, step: float) -> tuple[int, float, int, float]:
        """Return number and length of the steps before the output takes effect, and of those after."""
        before = math.ceil(self.delay / step - 1e-9)
        after = math.ceil((self.period - self.delay) / step - 1e-9)
        return before, self.delay / max(before, 1), after, (self.period - self.delay) / max(after, 1)


def notch_coefficients(frequency: float, numerator: float, denominator: float, period: float) -> tuple[float, ...]:
    """Return b0, b1, b2, a1, a2 of the sampled notch.

        N(s) = (s² + 2 z_n w0 s + w0²) / (s² + 2 z_d w0 s + w0²),    s = w0 / tan(w0 T / 2) (z - 1) / (z + 1)

    The substitution leaves the centre where it is. At 0 Hz it is the identity.
    """
    if frequency == 0:
        return 1.0, 0.0, 0.0, 0.0, 0.0
    k = math.tan(math.pi * frequency * period)
    whole = 1 + 2 * denominator * k + k * k
    middle = 2 * (k * k - 1) / whole
    return (
        (1 + 2 * numerator * k + k * k) / whole,
        middle,
        (1 - 2 * numerator * k + k * k) / whole,
        middle,
        (1 - 2 * denominator * k + k * k) / whole,
    )
