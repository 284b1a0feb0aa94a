"""Speed profiles in closed form: constant speed, and from rest to rest with ramps of several shapes.

A profile is a distance s(t) [mm] with 0 <= t <= duration [s], constant before and after.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError, at_least, positive

_HALVINGS = 200


@runtime_checkable
class Profile(Protocol):
    """A distance s(t) that never decreases."""

    @property
    def length(self) -> float:
        """Total distance [mm]."""

    @property
    def duration(self) -> float:
        """Total time [s]."""

    def position(self, t: ArrayLike) -> Floats:
        """Distance at the times t, (n,) [mm]."""

    def velocity(self, t: ArrayLike) -> Floats:
        """Speed at the times t, (n,) [mm/s]."""


@dataclass(frozen=True)
class Constant:
    """Constant speed from start to end.

    Args:
        length: distance [mm].
        speed: [mm/s].
    """

    length: float
    speed: float

    def __post_init__(self) -> None:
        at_least("length", self.length, 0, "mm")
        positive("speed", self.speed, "mm/s")

    @property
    def duration(self) -> float:
        return self.length / self.speed

    def position(self, t: ArrayLike) -> Floats:
        return np.clip(np.asarray(t, float) * self.speed, 0.0, self.length)

    def velocity(self, t: ArrayLike) -> Floats:
        time = np.asarray(t, float)
        return np.where((time >= 0) & (time <= self.duration), self.speed, 0.0)


# Shapes of a ramp from 0 to the speed V with an acceleration of at most A. With the time T of the ramp, `velocity` is
# the share of V and `distance` the share of V T after the share x of T. Every shape is odd about its middle, so that a
# ramp covers the distance V T / 2.


@dataclass(frozen=True)
class Ramp:
    """Trapezoidal acceleration; without rise, a trapezoidal speed profile.

    Args:
        rise: share of the ramp's time in which the acceleration rises, and falls, 0 to 1/2.
        peak: of the acceleration, as a share of A.
    """

    rise: float = 0.0
    peak: float = 1.0

    def __post_init__(self) -> None:
        if at_least("rise", self.rise, 0) > 0.5:
            raise InputError(f"rise = {self.rise:g}: must be at most 0.5")
        positive("peak", self.peak)

    def time(self, speed: float, acceleration: float) -> float:
        return speed / (acceleration * self.peak * (1 - self.rise))

    def velocity(self, x: Floats, speed: float, acceleration: float) -> Floats:
        r = self.rise
        y = np.minimum(x, 1 - x)
        low = np.minimum(y, r) ** 2 / (2 * r * (1 - r)) if r > 0 else y
        half = np.where(y < r, low, (y - 0.5 * r) / (1 - r))
        return np.where(x <= 0.5, half, 1 - half)

    def distance(self, x: Floats, speed: float, acceleration: float) -> Floats:
        r = self.rise
        y = np.minimum(x, 1 - x)
        low = np.minimum(y, r) ** 3 / (6 * r * (1 - r)) if r > 0 else y
        half = np.where(y < r, low, (0.5 * (y - 0.5 * r) ** 2 + r**2 / 24) / (1 - r))
        return np.where(x <= 0.5, half, x - 0.5 + half)


@dataclass(frozen=True)
class Sine:
    """Half-sine acceleration: v = V (1 - cos(pi x)) / 2."""

    def time(self, speed: float, acceleration: float) -> float:
        return 0.5 * math.pi * speed / acceleration

    def velocity(self, x: Floats, speed: float, acceleration: float) -> Floats:
        return 0.5 * (1 - np.cos(np.pi * x))

    def distance(self, x: Floats, speed: float, acceleration: float) -> Floats:
        return 0.5 * x - np.sin(np.pi * x) / (2 * np.pi)


@dataclass(frozen=True)
class Jerk:
    """Trapezoidal acceleration of a given jerk, triangular if A is not reached.

    Args:
        jerk: [mm/s³].
    """

    jerk: float

    def __post_init__(self) -> None:
        positive("jerk", self.jerk, "mm/s³")

    def _ramp(self, speed: float, acceleration: float) -> Ramp:
        reached = min(acceleration, math.sqrt(speed * self.jerk))
        rise = reached / self.jerk
        return Ramp(min(rise / (speed / reached + rise), 0.5), reached / acceleration)

    def time(self, speed: float, acceleration: float) -> float:
        if not speed > 0:
            return 0.0
        return self._ramp(speed, acceleration).time(speed, acceleration)

    def velocity(self, x: Floats, speed: float, acceleration: float) -> Floats:
        return self._ramp(speed, acceleration).velocity(x, speed, acceleration)

    def distance(self, x: Floats, speed: float, acceleration: float) -> Floats:
        return self._ramp(speed, acceleration).distance(x, speed, acceleration)


Shape = Ramp | Sine | Jerk


@dataclass(frozen=True)
class PointToPoint:
    """From rest to rest: acceleration, constant speed, deceleration; a short distance does not reach the speed.

    Args:
        length: distance [mm].
        speed: maximum speed [mm/s].
        acceleration: maximum acceleration [mm/s²].
        deceleration: maximum deceleration; the acceleration by default [mm/s²].
        shape: of both ramps.
    """

    length: float
    speed: float
    acceleration: float
    deceleration: float | None = None
    shape: Shape = Ramp()

    def __post_init__(self) -> None:
        at_least("length", self.length, 0, "mm")
        positive("speed", self.speed, "mm/s")
        positive("acceleration", self.acceleration, "mm/s²")
        if self.deceleration is not None:
            positive("deceleration", self.deceleration, "mm/s²")

    @property
    def _down(self) -> float:
        return self.acceleration if self.deceleration is None else self.deceleration

    def _ramps(self, peak: float) -> tuple[float, float]:
        return self.shape.time(peak, self.acceleration), self.shape.time(peak, self._down)

    @cached_property
    def peak(self) -> float:
        """Highest speed reached [mm/s]."""
        if self.speed * sum(self._ramps(self.speed)) <= 2 * self.length:
            return self.speed
        low = 0.0
        high = self.speed
        # bisection from the full speed could run out of steps at a very short distance
        while self.length > 0 and 0.5 * high * sum(self._ramps(0.5 * high)) > 2 * self.length:
            high *= 0.5
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            if not low < middle < high:
                break
            if middle * sum(self._ramps(middle)) <= 2 * self.length:
                low = middle
            else:
                high = middle
        return low

    @cached_property
    def _times(self) -> tuple[float, float, float]:
        """Times of acceleration, constant speed and deceleration."""
        if self.peak <= 0:
            return 0.0, 0.0, 0.0
        up, down = self._ramps(self.peak)
        return up, max(self.length / self.peak - 0.5 * (up + down), 0.0), down

    @property
    def duration(self) -> float:
        return sum(self._times)

    def position(self, t: ArrayLike) -> Floats:
        time = np.asarray(t, float)
        if self.peak <= 0:
            return np.where(time > 0, self.length, 0.0)
        up, constant, down = self._times
        # distances in units of the peak speed: each ramp covers half of its time
        at_speed = np.clip(time - up, 0.0, constant)
        time_to_end = self.duration - time
        rising = np.full(time.shape, 0.5 * up)
        falling = np.zeros(time.shape)
        # most times lie on neither ramp
        ramp = time < up
        share = np.maximum(time[ramp] / up, 0.0)
        rising[ramp] = up * self.shape.distance(share, self.peak, self.acceleration)
        ramp = time_to_end < down
        share = np.maximum(time_to_end[ramp] / down, 0.0)
        falling[ramp] = down * (0.5 - self.shape.distance(share, self.peak, self._down))
        return np.clip(self.peak * (rising + at_speed + falling), 0.0, self.length)

    def velocity(self, t: ArrayLike) -> Floats:
        time = np.asarray(t, float)
        if self.peak <= 0:
            return np.zeros(time.shape)
        up, _, down = self._times
        rising = np.clip(time / up, 0.0, 1.0) if up > 0 else np.ones(time.shape)
        falling = np.clip((self.duration - time) / down, 0.0, 1.0) if down > 0 else np.ones(time.shape)
        first = self.shape.velocity(rising, self.peak, self.acceleration)
        last = self.shape.velocity(falling, self.peak, self._down)
        return self.peak * np.minimum(first, last)
