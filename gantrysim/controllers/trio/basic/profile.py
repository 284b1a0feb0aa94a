"""The speed along a path within one servo period: SPEED, ACCEL, DECEL, and a stop exactly at the end."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.jit import inner_jit, jit

_TINY = 1e-12


class Glide(NamedTuple):
    """Periods of a move, one after the other.

    Attributes:
        s: distance covered after each, (n,) [units].
        speed: then, (n,) [units/s].
        braking: whether the axis then slows down for the end of its path, (n,).
    """

    s: Floats
    speed: Floats
    braking: NDArray[np.bool_]


@dataclass(slots=True)
class Speed:
    """Speed of an axis along its path.

    Attributes:
        value: the speed [units/s].
        braking: whether the axis slows down for the end of its path.
    """

    value: float = 0.0
    braking: bool = False

    def advance(self, left: float, target: float, up: float, down: float, period: float) -> float:
        """Run for a period and return the distance covered.

        Phases of constant acceleration follow one another within the period: towards `target`, at it, and with
        `down` from where v^2 = 2 down (left - s) on.

        Args:
            left: to the stop, inf for none [units].
            target: SPEED [units/s].
            up: ACCEL, inf for no limit [units/s²].
            down: DECEL, inf for no limit [units/s²].
            period: [s].
        """
        gone, self.value, self.braking = _advance(self.value, self.braking, left, target, up, down, period)
        return gone

    def glide(
        self, s: float, lengths: Floats, target: float, up: float, down: float, period: float, most: int
    ) -> Glide:
        """Return the next periods, at most `most`, before the one in which a path ends; the speed itself stays.

        `s` is the distance covered of the path, `lengths` holds its length and those of the paths that follow without
        a stop; the others are those of `advance`.
        """
        return Glide(*_glide(self.value, self.braking, s, lengths, target, up, down, period, most))


@inner_jit
def _towards(value: float, target: float, up: float, down: float, left: float) -> tuple[float, float, float]:
    """Return speed, acceleration, and time until the speed is `target`."""
    if value < target and math.isinf(up):
        value = min(target, math.sqrt(2 * down * left))
    elif value > target and math.isinf(down):
        value = target
    elif value < target:
        return value, up, (target - value) / up
    elif value > target:
        return value, -down, (value - target) / down
    return value, 0.0, math.inf


@inner_jit
def _until_braking(value: float, rate: float, down: float, left: float) -> float:
    """Positive root t of a t^2 + b t = c, where (v + rate t)^2 = 2 down (left - v t - rate t^2 / 2)."""
    if math.isinf(left):
        return math.inf
    share = rate / down + 1
    a = 0.5 * rate * share
    b = value * share
    c = max(left - 0.5 * value**2 / down, 0.0)
    root = b + math.sqrt(max(b * b + 4 * a * c, 0.0))
    return 2 * c / root if root > 0 else math.inf


@jit
def _advance(
    value: float, braking: bool, left: float, target: float, up: float, down: float, period: float
) -> tuple[float, float, bool]:
    """Return the distance covered in a period, and speed and braking after it."""
    if braking and left > 0.5 * value**2 / down * (1 + 1e-6) + 1e-9:
        braking = False  # a move was merged behind, or DECEL was raised
    gone = 0.0
    rest = period
    tiny = _TINY * (1 + left if math.isfinite(left) else 1.0)
    while rest > _TINY and left - gone > tiny:
        if braking:
            rate = -down
            to_target = math.inf
            to_end = value / down
        else:
            value, rate, to_target = _towards(value, target, up, down, left - gone)
            to_end = _until_braking(value, rate, down, left - gone)
        duration = min(rest, to_target, to_end)
        gone += duration * (value + 0.5 * rate * duration)
        value = max(value + rate * duration, 0.0)
        rest -= duration
        if duration == to_end and (braking or math.isinf(down)):
            gone = left
        elif duration == to_end:
            braking = True
        elif duration == to_target:
            value = target
    if left - gone <= tiny:
        gone = left
        value = 0.0
        braking = False
    return gone, value, braking


@jit
def _glide(
    value: float,
    braking: bool,
    s: float,
    lengths: Floats,
    target: float,
    up: float,
    down: float,
    period: float,
    most: int,
) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    """Return distance covered, speed and braking after each period."""
    covered = np.empty(most)
    speed = np.empty(most)
    brakes = np.empty(most, np.bool_)
    for k in range(most):
        left = lengths[0] - s
        for more in lengths[1:]:
            left += more
        gone, value, braking = _advance(value, braking, left, target, up, down, period)
        s += gone
        if s >= lengths[0] or gone >= left:
            return covered[:k], speed[:k], brakes[:k]
        covered[k], speed[k], brakes[k] = s, value, braking
    return covered, speed, brakes
