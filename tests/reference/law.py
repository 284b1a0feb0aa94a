"""The sampled servo of one axis in plain numbers.

Once per period T the encoder gives the nearest count, and with the following error E the servo demands

    torque = kp E + ki T sum(E) + kd dE/T + velocity_ff dDPOS/T + acceleration_ff ddDPOS/T² + output_velocity dMPOS/T

through the notch and the torque limit; it takes effect after the delay and is held for a period. The sum leaves out a
tick whose demand is beyond the limit on the side to which the error drives it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numba
import numpy as np

MEMORY = 8  # numbers that the servo of an axis keeps from tick to tick


@dataclass(frozen=True)
class Law:
    """The servo of one axis; u is mm or deg.

    Attributes:
        period: T [s].
        delay: from the sample to the output [s].
        kp, ki, kd, velocity_ff, acceleration_ff, output_velocity: see above [N·m per u, u·s, u/s, u/s²].
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


@numba.njit(cache=True, error_model="numpy")
def sampled(numbers, memory, first, command, position):
    """Return measured position [u] and torque demand [N·m] of one tick; memory is zero before the first."""
    kp, ki, kd, velocity_ff, acceleration_ff, output_velocity, b0, b1, b2, a1, a2, limit, count, period = numbers
    total, w1, w2, old_command, old_measured, old_error, old_velocity, _ = memory
    measured = count * np.rint(position / count) if count > 0 else position
    error = command - measured
    if first:
        old_command, old_measured, old_error = command, measured, error
    velocity = (command - old_command) / period
    trial = total + period * error
    torque = (
        kp * error
        + ki * trial
        + kd * (error - old_error) / period
        + velocity_ff * velocity
        + acceleration_ff * (velocity - old_velocity) / period
        + output_velocity * (measured - old_measured) / period
    )
    filtered = b0 * torque + w1
    demand = min(max(filtered, -limit), limit)
    memory[0] = trial if demand == filtered or demand * error < 0 else total
    memory[1] = b1 * torque - a1 * filtered + w2
    memory[2] = b2 * torque - a2 * filtered
    memory[3], memory[4], memory[5], memory[6] = command, measured, error, velocity
    return measured, demand
