"""The virtual axis: its way along the circles over time, with a SPEED that changes on the way, ACCEL and DECEL."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from gantrysim.arrays import Floats

_ROUNDING = 1e-12


@dataclass(frozen=True)
class Law:
    """A way s(t) in phases of constant acceleration.

    Attributes:
        time: at which each phase begins, and the last one ends, (m + 1,) [s].
        way: there, (m + 1,) [mm].
        speed: with which each phase begins, (m,) [mm/s].
        acceleration: of each phase, (m,) [mm/s²].
    """

    time: Floats
    way: Floats
    speed: Floats
    acceleration: Floats

    @property
    def length(self) -> float:
        """Way in all [mm]."""
        return float(self.way[-1])

    @property
    def duration(self) -> float:
        """Time in all [s]."""
        return float(self.time[-1])

    def position(self, t: ArrayLike) -> Floats:
        """Way at the times t, (n,) [mm]."""
        at = np.clip(np.asarray(t, float), 0.0, self.duration)
        k = np.clip(np.searchsorted(self.time, at, side="right") - 1, 0, self.speed.size - 1)
        rest = at - self.time[k]
        return np.minimum(self.way[k] + rest * (self.speed[k] + 0.5 * self.acceleration[k] * rest), self.way[k + 1])

    def velocity(self, t: ArrayLike) -> Floats:
        """Speed at the times t, (n,) [mm/s]."""
        at = np.asarray(t, float)
        k = np.clip(np.searchsorted(self.time, at, side="right") - 1, 0, self.speed.size - 1)
        inside = (at >= 0) & (at <= self.duration)
        return np.where(inside, self.speed[k] + self.acceleration[k] * (at - self.time[k]), 0.0)


@dataclass
class VirtualAxis:
    """Runs along a way towards its end, at the SPEED that the program has set last.

    Args:
        length: of the way [mm].
        acceleration: ACCEL, inf where it is not limited [mm/s²].
        deceleration: DECEL, likewise; the axis brakes so as to stand at the end [mm/s²].
    """

    length: float
    acceleration: float
    deceleration: float
    time: float = 0.0
    way: float = 0.0
    speed: float = 0.0
    braking: bool = False
    _phases: list[tuple[float, float, float, float]] = field(default_factory=list)

    @property
    def done(self) -> bool:
        """Whether the end is reached."""
        return self.way >= self.length * (1 - _ROUNDING)

    def advance(self, until: float, target: float) -> None:
        """Run until a time or the end, whichever comes first, with the SPEED `target` [s, mm/s]."""
        while not self.done and until - self.time > _ROUNDING:
            if self.braking:
                rate, reached, ending = -self.deceleration, math.inf, self.speed / self.deceleration
            else:
                rate, reached = self._towards(target)
                ending = self._until_braking(rate)
            lasting = min(until - self.time, reached, ending)
            self._run(rate, lasting)
            if lasting == ending and (self.braking or math.isinf(self.deceleration)):
                self.way = self.length
            elif lasting == ending:
                self.braking = True
            elif lasting == reached:
                self.speed = target

    def _towards(self, target: float) -> tuple[float, float]:
        """Acceleration towards the target, and how long it takes."""
        if math.isinf(self.acceleration) and self.speed < target:
            limit = math.inf
            if math.isfinite(self.deceleration):
                limit = math.sqrt(2 * self.deceleration * (self.length - self.way))
            self.speed = min(target, limit)
            return 0.0, math.inf
        if math.isinf(self.deceleration) and self.speed > target:
            self.speed = target
        if self.speed < target:
            return self.acceleration, (target - self.speed) / self.acceleration
        if self.speed > target:
            return -self.deceleration, (self.speed - target) / self.deceleration
        return 0.0, math.inf

    def _until_braking(self, rate: float) -> float:
        """Time until (v + a t)^2 / 2 d is what is left of the way, less v t + a t^2 / 2."""
        share = rate / self.deceleration + 1
        a, b = 0.5 * rate * share, self.speed * share
        c = max(self.length - self.way - 0.5 * self.speed**2 / self.deceleration, 0.0)
        root = b + math.sqrt(max(b**2 + 4 * a * c, 0.0))
        return 2 * c / root if root > 0 else math.inf

    def _run(self, rate: float, lasting: float) -> None:
        self._phases.append((self.time, self.way, self.speed, rate))
        self.way = min(self.way + lasting * (self.speed + 0.5 * rate * lasting), self.length)
        self.speed = max(self.speed + rate * lasting, 0.0)
        self.time += lasting

    def law(self) -> Law:
        """Return the way that was run."""
        time, way, speed, rate = np.array(self._phases).T
        return Law(np.append(time, self.time), np.append(way, self.way), speed, rate)
