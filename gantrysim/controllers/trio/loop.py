"""The program loop of the method: when it changes the ratio and the virtual speed, and how the real axes move."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from gantrysim.base.arrays import Floats, read_only
from gantrysim.base.jit import jit
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
        instants = np.asarray(t, float)
        places = np.empty(instants.shape)
        columns = (self.time, self.distance, self.speed, self.acceleration)
        _find_places(columns, np.ascontiguousarray(instants).ravel(), places.reshape(-1))
        return places

    def velocity(self, t: ArrayLike) -> Floats:
        instant = np.asarray(t, float)
        k = np.clip(np.searchsorted(self.time, instant, side="right") - 1, 0, self.speed.size - 1)
        inside = (instant >= 0) & (instant <= self.duration)
        return np.where(inside, self.speed[k] + self.acceleration[k] * (instant - self.time[k]), 0.0)


@jit
def _find_places(phases: tuple[Floats, Floats, Floats, Floats], instants: Floats, places: Floats) -> None:
    """Write the distances at instants, (n,) [mm]; phases are time, distance, speed and acceleration of `Phases`."""
    time, distance, speed, acceleration = phases
    last = speed.size - 1
    k = 0
    for j in range(instants.size):
        instant = min(max(instants[j], 0.0), time[-1])
        if instant < time[k]:
            k = 0
        # mostly ascending, one tick after the other
        while k < last and time[k + 1] <= instant:
            k += 1
        elapsed = instant - time[k]
        travelled = distance[k] + elapsed * (speed[k] + 0.5 * acceleration[k] * elapsed)
        places[j] = min(travelled, distance[k + 1])


class _Limits(NamedTuple):
    """Limits of a virtual axis.

    Attributes:
        length: distance to its end [mm].
        acceleration: ACCEL, inf for no limit [mm/s²].
        deceleration: DECEL, inf for no limit [mm/s²].
    """

    length: float
    acceleration: float
    deceleration: float


class _Axis(NamedTuple):
    """A virtual axis, which moves towards its end at the SPEED set last, and brakes to stop there.

    Attributes:
        time: of the motion so far [s].
        distance: travelled [mm].
        speed: present one [mm/s].
        braking: whether it brakes for the end.
    """

    time: float
    distance: float
    speed: float
    braking: bool


_Phase = tuple[float, float, float, float]  # time, distance, speed and acceleration at the start of a phase


@jit
def _is_at_end(axis: _Axis, limits: _Limits) -> bool:
    return axis.distance >= limits.length * (1 - _ROUNDING)


@jit
def _axis_after(axis: _Axis, limits: _Limits, until: float, target: float, phases: list[_Phase]) -> _Axis:
    """Return the axis at a time [s] or the end, whichever comes first, after motion at the SPEED `target` [mm/s].

    The phases of the motion are appended.
    """
    time, distance, speed, braking = axis
    length, _, deceleration = limits
    while not _is_at_end(_Axis(time, distance, speed, braking), limits) and until - time > _ROUNDING:
        if braking:
            rate = -deceleration
            to_speed = math.inf
            to_end = speed / deceleration
        else:
            speed, rate, to_speed = _towards(speed, target, length - distance, limits)
            to_end = _until_braking(speed, rate, length - distance, deceleration)
        duration = min(until - time, to_speed, to_end)
        phases.append((time, distance, speed, rate))
        distance = min(distance + duration * (speed + 0.5 * rate * duration), length)
        speed = max(speed + rate * duration, 0.0)
        time += duration
        if duration == to_end and (braking or math.isinf(deceleration)):
            distance = length
        elif duration == to_end:
            braking = True
        elif duration == to_speed:
            speed = target
    return _Axis(time, distance, speed, braking)


@jit
def _towards(speed: float, target: float, remaining: float, limits: _Limits) -> tuple[float, float, float]:
    """Return the speed, the acceleration towards another speed, and its duration."""
    _, acceleration, deceleration = limits
    if math.isinf(acceleration) and speed < target:
        limit = math.inf if math.isinf(deceleration) else math.sqrt(2 * deceleration * remaining)
        return min(target, limit), 0.0, math.inf
    if math.isinf(deceleration) and speed > target:
        speed = target
    if speed < target:
        return speed, acceleration, (target - speed) / acceleration
    if speed > target:
        return speed, -deceleration, (speed - target) / deceleration
    return speed, 0.0, math.inf


@jit
def _until_braking(speed: float, rate: float, remaining: float, deceleration: float) -> float:
    """Time until (v + a t)^2 / 2 d is the remaining distance less v t + a t^2 / 2."""
    share = rate / deceleration + 1
    a = 0.5 * rate * share
    b = speed * share
    c = max(remaining - 0.5 * (speed * speed) / deceleration, 0.0)
    root = b + math.sqrt(max(b * b + 4 * a * c, 0.0))
    return 2 * c / root if root > 0 else math.inf


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
        speeds: pairs of a ratio and the path speed of a pass that begins at it, linear between them, the ratios falling
            from 1 [1, mm/s]; x then falls by change * v / speed on a pass at v. Empty for `speed` on every pass.
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
    speeds: tuple[tuple[float, float], ...] = ()

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
        limits = _Limits(float(self.length), float(self.acceleration), float(self.deceleration))
        waits = _Waits(
            float(self.period),
            float(self.interpreter_time),
            float(self.wait_resolution),
            float(self.servo_period),
            self.guarded,
        )
        places = np.array([ratio for ratio, _ in self.speeds])
        speeds = np.array([speed for _, speed in self.speeds])
        end, passes, phases, last = _run(
            limits, float(self.speed), float(self.change), _Speeds(places, speeds), waits, MAX_PASSES
        )
        if end == _TOO_SMALL:
            number = passes.shape[1] + 1
            before = float(passes[0, -1]) if number > 1 else 1.0
            raise RatioTooSmallError(number, before - self.change if self.speeds else 1 - self.change * number)
        ratio, time, distance = passes
        if end == _ENDLESS:
            raise EndlessError(float(ratio[-1]), last[0])
        connected = ratio
        if self.ratio_bits is not None:
            connected = np.round(ratio * 2.0**self.ratio_bits) / 2.0**self.ratio_bits
        profile = Phases(
            time=read_only(np.append(phases[0], last[0])),
            distance=read_only(np.append(phases[1], last[1])),
            speed=read_only(phases[2].copy()),
            acceleration=read_only(phases[3].copy()),
        )
        return Passes(
            ratio=read_only(ratio.copy()),
            connected=read_only(connected.copy()),
            time=read_only(time.copy()),
            distance=read_only(np.append(distance, last[1])),
            profile=profile,
            halted=end == _HALTED,
        )


class _Waits(NamedTuple):
    """What the time of a pass depends on: fields of `Loop`."""

    period: float
    interpreter_time: float
    wait_resolution: float
    servo_period: float
    guarded: bool


class _Speeds(NamedTuple):
    """Path speeds of the passes: fields of `Loop.speeds`; empty for one speed."""

    ratio: Floats
    speed: Floats


# ends of the loop
_DONE, _HALTED, _TOO_SMALL, _ENDLESS = range(4)


@jit
def _run(
    limits: _Limits, speed: float, change: float, places: _Speeds, waits: _Waits, most: int
) -> tuple[int, Floats, Floats, tuple[float, float]]:
    """Return how a loop of `most` passes ends, the passes, the axis' phases, and its last time [s] and distance [mm].

    Passes are ratio, time [s] and distance [mm], (3, p); phases as of `_Phase`, (4, m).
    """
    axis = _Axis(0.0, 0.0, 0.0, False)
    # of one type from the first
    phases = [(0.0, 0.0, 0.0, 0.0)]
    phases.pop()
    passes = [(0.0, 0.0, 0.0)]
    passes.pop()
    begun = 0.0
    end = _DONE
    v = speed
    place = 0
    x = 1.0
    while not _is_at_end(axis, limits):
        if places.ratio.size:
            while place + 1 < places.ratio.size and x <= places.ratio[place + 1]:
                place += 1
            v = places.speed[place]
            if place + 1 < places.ratio.size:
                share = (places.ratio[place] - x) / (places.ratio[place] - places.ratio[place + 1])
                v += share * (places.speed[place + 1] - v)
            x -= change / speed * v
        else:
            x = 1 - change * (len(passes) + 1)
        zero = abs(x) < _ROUNDING
        too_small = waits.guarded and x < LEAST_RATIO
        if (too_small and not axis.braking) or (zero and not passes):
            end = _TOO_SMALL
            break
        if zero or too_small:
            # the published program stops at SPEED = V / 0, a guarded one holds x; the axes continue either way
            if not waits.guarded:
                end = _HALTED
            axis = _axis_after(axis, limits, math.inf, v / abs(passes[-1][0]), phases)
            break
        if len(passes) == most:
            end = _ENDLESS
            break
        passes.append((x, axis.time, axis.distance))
        begun += _wait(x, waits) + waits.interpreter_time
        axis = _axis_after(axis, limits, _effect(begun, waits.servo_period), v / abs(x), phases)
    pass_columns = np.empty((3, len(passes)))
    for k in range(len(passes)):
        for column in range(3):
            pass_columns[column, k] = passes[k][column]
    phase_columns = np.empty((4, len(phases)))
    for k in range(len(phases)):
        for column in range(4):
            phase_columns[column, k] = phases[k][column]
    return end, pass_columns, phase_columns, (axis.time, axis.distance)


@jit
def _wait(x: float, waits: _Waits) -> float:
    """Return the wait of a pass at a ratio [s]."""
    # WA of a negative time does not wait
    wait = max(waits.period * x, 0.0)
    if waits.wait_resolution > 0:
        wait = math.floor(wait / waits.wait_resolution + 1e-9) * waits.wait_resolution
    # one pass per tick at most
    if wait + waits.interpreter_time <= 0:
        least = 0.0 if waits.guarded else waits.wait_resolution or waits.period
        return waits.servo_period or least
    return wait


@jit
def _effect(time: float, servo_period: float) -> float:
    """Return when commands of a time take effect [s]."""
    if servo_period <= 0:
        return time
    return math.ceil(time / servo_period - 1e-9) * servo_period


@lru_cache(maxsize=512)
def _passes_of(loop: Loop) -> Passes:
    return loop.run()
