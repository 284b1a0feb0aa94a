"""The virtual axis: its motion along the circles, with a changing SPEED, ACCEL and DECEL."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from gantrysim.base.arrays import Floats, read_only

_ROUNDING = 1e-12


@dataclass(frozen=True)
class Phases:
    """A speed profile in phases of constant acceleration.

    Attributes:
        time: start of each phase, and end of the last, (m + 1,) [s].
        distance: travelled until then, (m + 1,) [mm].
        speed: at the start of each phase, (m,) [mm/s].
        acceleration: of each phase, (m,) [mm/s²].
    """

    time: Floats
    distance: Floats
    speed: Floats
    acceleration: Floats

    @property
    def length(self) -> float:
        return float(self.distance[-1])

    @property
    def duration(self) -> float:
        return float(self.time[-1])

    def position(self, t: ArrayLike) -> Floats:
        instant = np.clip(np.asarray(t, float), 0.0, self.duration)
        k = np.clip(np.searchsorted(self.time, instant, side="right") - 1, 0, self.speed.size - 1)
        elapsed = instant - self.time[k]
        distance = self.distance[k] + elapsed * (self.speed[k] + 0.5 * self.acceleration[k] * elapsed)
        return np.minimum(distance, self.distance[k + 1])

    def velocity(self, t: ArrayLike) -> Floats:
        instant = np.asarray(t, float)
        k = np.clip(np.searchsorted(self.time, instant, side="right") - 1, 0, self.speed.size - 1)
        inside = (instant >= 0) & (instant <= self.duration)
        return np.where(inside, self.speed[k] + self.acceleration[k] * (instant - self.time[k]), 0.0)


@dataclass
class VirtualAxis:
    """An axis that moves towards its end at the SPEED set last, and brakes to stop there.

    Args:
        length: distance to its end [mm].
        acceleration: ACCEL, inf for no limit [mm/s²].
        deceleration: DECEL, inf for no limit [mm/s²].
    """

    length: float
    acceleration: float
    deceleration: float
    time: float = 0.0
    distance: float = 0.0
    speed: float = 0.0
    braking: bool = False
    _phases: list[tuple[float, float, float, float]] = field(default_factory=list)

    @property
    def done(self) -> bool:
        """Whether the axis is at its end."""
        return self.distance >= self.length * (1 - _ROUNDING)

    def advance(self, until: float, target: float) -> None:
        """Move at the SPEED `target` [mm/s] until a time [s] or the end, whichever comes first."""
        while not self.done and until - self.time > _ROUNDING:
            if self.braking:
                rate = -self.deceleration
                to_speed = math.inf
                to_end = self.speed / self.deceleration
            else:
                rate, to_speed = self._towards(target)
                to_end = self._until_braking(rate)
            duration = min(until - self.time, to_speed, to_end)
            self._run(rate, duration)
            if duration == to_end and (self.braking or math.isinf(self.deceleration)):
                self.distance = self.length
            elif duration == to_end:
                self.braking = True
            elif duration == to_speed:
                self.speed = target

    def _towards(self, target: float) -> tuple[float, float]:
        """Acceleration towards a speed, and its duration."""
        if math.isinf(self.acceleration) and self.speed < target:
            limit = math.inf
            if math.isfinite(self.deceleration):
                limit = math.sqrt(2 * self.deceleration * (self.length - self.distance))
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
        """Time until (v + a t)^2 / 2 d is the remaining distance less v t + a t^2 / 2."""
        share = rate / self.deceleration + 1
        a = 0.5 * rate * share
        b = self.speed * share
        c = max(self.length - self.distance - 0.5 * self.speed**2 / self.deceleration, 0.0)
        root = b + math.sqrt(max(b**2 + 4 * a * c, 0.0))
        return 2 * c / root if root > 0 else math.inf

    def _run(self, rate: float, duration: float) -> None:
        self._phases.append((self.time, self.distance, self.speed, rate))
        self.distance = min(self.distance + duration * (self.speed + 0.5 * rate * duration), self.length)
        self.speed = max(self.speed + rate * duration, 0.0)
        self.time += duration

    def profile(self) -> Phases:
        """Return the motion so far."""
        time, distance, speed, rate = np.array(self._phases).T
        return Phases(
            time=read_only(np.append(time, self.time)),
            distance=read_only(np.append(distance, self.distance)),
            speed=read_only(speed.copy()),
            acceleration=read_only(rate.copy()),
        )
