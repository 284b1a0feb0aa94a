"""The speed along a path within one servo period: SPEED, ACCEL, DECEL, and a stop exactly at the end."""

from __future__ import annotations

import math
from dataclasses import dataclass

_TINY = 1e-12


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
        gone, rest, tiny = 0.0, period, _TINY * (1 + left if math.isfinite(left) else 1.0)
        while rest > _TINY and left - gone > tiny:
            if self.braking:
                rate, to_target, to_end = -down, math.inf, self.value / down
            else:
                rate, to_target = self._towards(target, up, down, left - gone)
                to_end = self._until_braking(rate, down, left - gone)
            duration = min(rest, to_target, to_end)
            gone += duration * (self.value + 0.5 * rate * duration)
            self.value = max(self.value + rate * duration, 0.0)
            rest -= duration
            if duration == to_end and (self.braking or math.isinf(down)):
                gone = left
            elif duration == to_end:
                self.braking = True
            elif duration == to_target:
                self.value = target
        if left - gone <= tiny:
            gone, self.value, self.braking = left, 0.0, False
        return gone

    def _towards(self, target: float, up: float, down: float, left: float) -> tuple[float, float]:
        if self.value < target and math.isinf(up):
            self.value = min(target, math.sqrt(2 * down * left))
        elif self.value > target and math.isinf(down):
            self.value = target
        elif self.value < target:
            return up, (target - self.value) / up
        elif self.value > target:
            return -down, (self.value - target) / down
        return 0.0, math.inf

    def _until_braking(self, rate: float, down: float, left: float) -> float:
        """Positive root t of a t^2 + b t = c, where (v + rate t)^2 = 2 down (left - v t - rate t^2 / 2)."""
        if math.isinf(left):
            return math.inf
        share = rate / down + 1
        a, b = 0.5 * rate * share, self.value * share
        c = max(left - 0.5 * self.value**2 / down, 0.0)
        root = b + math.sqrt(max(b * b + 4 * a * c, 0.0))
        return 2 * c / root if root > 0 else math.inf
