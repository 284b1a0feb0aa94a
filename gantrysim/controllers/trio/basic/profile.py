"""The speed along a path within one servo period: SPEED, ACCEL, DECEL, and a stop exactly at the end."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.jit import jit

_TINY_DISTANCE = 1e-12


# SPEED, ACCEL, DECEL, inf for no limit, and the servo period [units/s, units/s², units/s², s]. A plain tuple: numba
# looks up the types of the arguments on every call, and finds those of a named one slowly.
Rates = tuple[float, float, float, float]


@dataclass(slots=True)
class Speed:
    """Speed of an axis along its path.

    Attributes:
        value: the speed [units/s].
        braking: whether the axis slows down for the end of its path.
    """

    value: float = 0.0
    braking: bool = False

    def advance(self, remaining: float, rates: Rates) -> float:
        """Run for a period and return the distance covered.

        Phases of constant acceleration follow one another within the period: towards SPEED, at it, and with
        DECEL from where v^2 = 2 DECEL (remaining - s) on.

        Args:
            remaining: distance to the stop, inf for none [units].
            rates: of the axis.
        """
        return self.advance_to(math.inf, remaining, rates)[0]

    def advance_to(self, stretch: float, remaining: float, rates: Rates) -> tuple[float, float]:
        """Run to the end of a stretch, at most for a period; return the distance covered and the time left.

        Args:
            stretch: distance at which the run ends early, inf for none [units].
            remaining: distance to the stop, inf for none [units].
            rates: of the axis.
        """
        distance, self.value, self.braking, time_left = _advance(self.value, self.braking, remaining, stretch, rates)
        return distance, time_left

    def glide(self, s: float, lengths: Floats, rates: Rates, most: int) -> tuple[Floats, Speed]:
        """Return the distances covered after the next periods, (n,) [units], and the speed after the last of them.

        The speed itself stays. The period in which the path ends is not among them.

        Args:
            s: distance covered of the path [units].
            lengths: of the path, and of those that follow without a stop, (m,) [units].
            rates: of the axis.
            most: periods.
        """
        covered = np.empty(most)
        count, value, braking = _glide(self.value, self.braking, s, lengths, rates, covered)
        return covered[:count], Speed(value, braking)


@jit
def _towards(value: float, target: float, up: float, down: float, remaining: float) -> tuple[float, float, float]:
    """Return speed, acceleration, and time until the speed is `target`."""
    if value < target and math.isinf(up):
        value = min(target, math.sqrt(2 * down * remaining))
    elif value > target and math.isinf(down):
        value = target
    elif value < target:
        return value, up, (target - value) / up
    elif value > target:
        return value, -down, (value - target) / down
    return value, 0.0, math.inf


@jit
def _until_braking(value: float, rate: float, down: float, remaining: float) -> float:
    """Positive root t of a t^2 + b t = c, where (v + rate t)^2 = 2 down (remaining - v t - rate t^2 / 2)."""
    if math.isinf(remaining):
        return math.inf
    share = rate / down + 1
    a = 0.5 * rate * share
    b = value * share
    c = max(remaining - 0.5 * value**2 / down, 0.0)
    root = b + math.sqrt(max(b * b + 4 * a * c, 0.0))
    # the form of the root that loses no digits where a is near 0
    return 2 * c / root if root > 0 else math.inf


@jit
def _until(stretch: float, value: float, rate: float) -> float:
    """First root t of v t + rate t^2 / 2 = stretch, inf for none."""
    square = value**2 + 2 * rate * stretch
    if math.isinf(stretch) or square < 0:
        return math.inf
    root = value + math.sqrt(square)
    return 2 * stretch / root if root > 0 else math.inf


@jit
def _advance(
    value: float, braking: bool, remaining: float, stretch: float, rates: Rates
) -> tuple[float, float, bool, float]:
    """Return the distance covered in a period or to the end of a stretch, speed and braking then, and the time left."""
    target, up, down, period = rates
    if 0 < value == target and not braking and math.isinf(stretch) and period > _TINY_DISTANCE:
        at_speed = period * value
        # far from where it brakes: the loop's one phase
        if remaining - 0.5 * value**2 / down > 2 * at_speed + 1e-9:
            return at_speed, value, False, 0.0
    if braking and remaining > 0.5 * value**2 / down * (1 + 1e-6) + 1e-9:
        # a move was merged behind, or DECEL was raised
        braking = False
    covered = 0.0
    time_left = period
    tiny = _TINY_DISTANCE * (1 + remaining if math.isfinite(remaining) else 1.0)
    while time_left > _TINY_DISTANCE and remaining - covered > tiny and stretch - covered > tiny:
        if braking:
            rate = -down
            to_target = math.inf
            to_end = value / down
        else:
            value, rate, to_target = _towards(value, target, up, down, remaining - covered)
            to_end = _until_braking(value, rate, down, remaining - covered)
        to_stretch = _until(stretch - covered, value, rate)
        duration = min(time_left, to_target, to_end, to_stretch)
        covered += duration * (value + 0.5 * rate * duration)
        value = max(value + rate * duration, 0.0)
        time_left -= duration
        if duration == to_end and (braking or math.isinf(down)):
            covered = remaining
        elif duration == to_end:
            braking = True
        elif duration == to_target:
            value = target
        if duration == to_stretch:
            covered = stretch
    if stretch - covered <= tiny:
        covered = stretch
    if remaining - covered <= tiny:
        covered = remaining
        value = 0.0
        braking = False
    return covered, value, braking, time_left


@jit
def _glide(
    value: float, braking: bool, s: float, lengths: Floats, rates: Rates, covered: Floats
) -> tuple[int, float, bool]:
    """Write the distance covered after each period; return the number of periods, and speed and braking then."""
    for k in range(covered.size):
        remaining = lengths[0] - s
        for follower in range(1, lengths.size):
            remaining += lengths[follower]
        distance, value_after, brakes_after, _ = _advance(value, braking, remaining, math.inf, rates)
        s += distance
        if s >= lengths[0] or distance >= remaining:
            return k, value, braking
        covered[k] = s
        value = value_after
        braking = brakes_after
    return covered.size, value, braking
