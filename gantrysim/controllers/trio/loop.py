"""The program loop of the method: when it changes the ratio and the virtual speed, and how the real axes move."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from gantrysim.base.arrays import Floats, read_only
from gantrysim.paths.arcs import ArcChain
from gantrysim.paths.chain import Chain
from gantrysim.paths.path import Path
from gantrysim.paths.pieces import Coil, Line, Vector, vector

# The virtual axis: its motion along the circles, with a changing SPEED, ACCEL and DECEL.

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


MAX_PASSES = 2_000_000
_FEW_PASSES = 10_000  # half a megabyte

RATIO_BITS = 16  # fractional bits of CONNECT's ratio
LEAST_RATIO = 2.0**-RATIO_BITS


class RatioTooSmallError(Exception):
    """The ratio x falls below the resolution of CONNECT while the virtual axes still run at SPEED."""

    def __init__(self, number: int, ratio: float) -> None:
        super().__init__(number, ratio)
        self.number = number
        self.ratio = ratio


class EndlessError(Exception):
    """The virtual axes are not at the end of their circles after MAX_PASSES passes."""

    def __init__(self, ratio: float, time: float) -> None:
        super().__init__(ratio, time)
        self.ratio = ratio
        self.time = time


@dataclass(frozen=True)
class Passes:
    """The passes of the loop.

    Attributes:
        ratio: x of the program, (p,).
        connected: the ratio that CONNECT holds, (p,).
        time: at which the pass takes effect, (p,) [s].
        distance: of the virtual axis then, and at the end, (p + 1,) [mm].
        profile: of the virtual axis.
        halted: whether a division by zero stopped the program.
    """

    ratio: Floats
    connected: Floats
    time: Floats
    distance: Floats
    profile: Phases
    halted: bool

    def connect(self, lengths: Floats) -> Connected:
        """Return the real axes' profile, given the length of their path in every pass, (p,) [mm]."""
        return Connected(self.profile, self.distance, np.concatenate([[0.0], np.cumsum(lengths)]))

    def path(self, start: Vector, radius: float, climb: float, clockwise: bool) -> Path:
        """Return the commanded path of the real axes: the virtual circles scaled by the ratio of every pass.

        Args:
            start: first point; the first motion is towards +y [mm].
            radius: of the virtual circles [mm].
            climb: height per radian of the virtual circles [mm/rad].
            clockwise: sense of rotation.
        """
        ratio = self.connected
        angle = np.diff(self.distance) / radius
        turn = -1.0 if clockwise else 1.0
        if np.all(ratio > 0):
            return ArcChain(start, 0.5 * math.pi, turn / (ratio * radius), angle * ratio * radius, climb * angle)
        return _with_cusps(start, -turn * ratio * radius, turn * angle, climb * angle)


def _with_cusps(start: Vector, radius: Floats, angle: Floats, rise: Floats) -> Chain:
    """Arcs of signed radii: a negative radius runs backwards, radius zero is a straight climb.

    A point of the virtual circle at the angle psi is at centre + r (cos psi, sin psi) with the signed radius r.
    """
    pieces: list[Line | Coil] = []
    place = np.array(start)
    psi = math.pi
    for r, swept, up in zip(radius.tolist(), angle.tolist(), rise.tolist(), strict=True):
        centre = place - r * np.array([math.cos(psi), math.sin(psi), 0.0])
        begin = psi if r >= 0 else psi + math.pi
        psi += swept
        end = centre + np.array([r * math.cos(psi), r * math.sin(psi), up])
        if r:
            pieces.append(Coil(vector(centre), (abs(r), abs(r)), begin, swept, up))
        else:
            pieces.append(Line(vector(place), vector(end)))
        place = end
    return Chain(pieces)


@dataclass(frozen=True)
class Connected:
    """Speed profile of the real axes: in every pass in proportion to that of the virtual axis.

    Attributes:
        virtual_profile: of the virtual axis.
        virtual: its distance at the start of every pass and at the end, (p + 1,) [mm].
        real: distance of the real axes there, (p + 1,) [mm].
    """

    virtual_profile: Phases
    virtual: Floats
    real: Floats

    @property
    def length(self) -> float:
        return float(self.real[-1])

    @property
    def duration(self) -> float:
        return self.virtual_profile.duration

    def position(self, t: ArrayLike) -> Floats:
        return np.interp(self.virtual_profile.position(t), self.virtual, self.real)

    def velocity(self, t: ArrayLike) -> Floats:
        following = np.searchsorted(self.virtual, self.virtual_profile.position(t), side="right")
        k = np.clip(following, 1, self.virtual.size - 1)
        step = self.virtual[k] - self.virtual[k - 1]
        ratio = np.divide(self.real[k] - self.real[k - 1], step, out=np.zeros_like(step), where=step > 0)
        return ratio * self.virtual_profile.velocity(t)


@dataclass(frozen=True)
class Loop:
    """Lowers the ratio x by `change` on every pass, sets SPEED to speed / x, and waits.

    Args:
        length: of the virtual circles [mm].
        speed: path speed V, as SPEED at x = 1 [mm/s].
        change: decrease of x per pass.
        period: T, the wait at x = 1 [s].
        interpreter_time: d, execution time of a pass besides its wait [s].
        acceleration: ACCEL of the virtual axes [mm/s²].
        deceleration: DECEL of the virtual axes [mm/s²].
        wait_resolution: waits are truncated to a multiple of it; 0 for exact waits [s].
        ratio_bits: fractional bits of the ratio, None for an exact one.
        servo_period: commands take effect at its next multiple; 0 for at once [s].
        guarded: whether x stays above zero, held while the last braking lasts longer; the published listing has
            no such guard. A pass without a wait takes one servo_period; where that is 0, no time if guarded, else
            one wait_resolution or period.
    """

    length: float
    speed: float
    change: float
    period: float
    interpreter_time: float = 0.0
    acceleration: float = math.inf
    deceleration: float = math.inf
    wait_resolution: float = 0.0
    ratio_bits: int | None = None
    servo_period: float = 0.0
    guarded: bool = True

    def passes(self) -> Passes:
        """Return the passes until the virtual axes are at the end of their circles; of the last loops they are kept.

        Jobs that differ elsewhere have the same loop, and each checks its own.

        Raises:
            RatioTooSmallError: x would fall below 2^-16 before the axes brake for the end.
            EndlessError: the end is not reached within MAX_PASSES passes.
        """
        return _passes_of(self) if self.length < _FEW_PASSES * self.speed * self.period else self.run()

    def run(self) -> Passes:
        """Run the loop; see `passes`."""
        axis = VirtualAxis(self.length, self.acceleration, self.deceleration)
        ratio: list[float] = []
        time: list[float] = []
        distance: list[float] = []
        begun = 0.0
        halted = False
        while not axis.done:
            x = 1 - self.change * (len(ratio) + 1)
            zero = abs(x) < _ROUNDING
            too_small = self.guarded and x < LEAST_RATIO
            if (too_small and not axis.braking) or (zero and not ratio):
                raise RatioTooSmallError(len(ratio) + 1, x)
            if zero or too_small:
                # the published program stops at SPEED = V / 0, a guarded one holds x; the axes continue either way
                halted = not self.guarded
                axis.advance(math.inf, self.speed / abs(ratio[-1]))
                break
            if len(ratio) == MAX_PASSES:
                raise EndlessError(ratio[-1], axis.time)
            ratio.append(x)
            time.append(axis.time)
            distance.append(axis.distance)
            begun += self._wait(x) + self.interpreter_time
            axis.advance(self._effect(begun), self.speed / abs(x))
        ratios = np.array(ratio)
        connected = ratios
        if self.ratio_bits is not None:
            connected = np.round(ratios * 2.0**self.ratio_bits) / 2.0**self.ratio_bits
        return Passes(
            ratio=read_only(ratios),
            connected=read_only(connected),
            time=read_only(np.array(time)),
            distance=read_only(np.array([*distance, axis.distance])),
            profile=axis.profile(),
            halted=halted,
        )

    def _wait(self, x: float) -> float:
        # WA of a negative time does not wait
        wait = max(self.period * x, 0.0)
        if self.wait_resolution > 0:
            wait = math.floor(wait / self.wait_resolution + 1e-9) * self.wait_resolution
        # one pass per tick at most
        if wait + self.interpreter_time <= 0:
            return self.servo_period or (0.0 if self.guarded else self.wait_resolution or self.period)
        return wait

    def _effect(self, time: float) -> float:
        if self.servo_period <= 0:
            return time
        return math.ceil(time / self.servo_period - 1e-9) * self.servo_period


@lru_cache(maxsize=512)
def _passes_of(loop: Loop) -> Passes:
    return loop.run()
