"""The program loop of the method: when it changes the ratio and the virtual speed, and how the real axes move."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from gantrysim.base.arrays import Floats, read_only
from gantrysim.controllers.trio.virtual import Phases, VirtualAxis
from gantrysim.paths.arcs import ArcChain
from gantrysim.paths.chain import Chain
from gantrysim.paths.path import Path
from gantrysim.paths.pieces import Coil, Line, Vector, vector

MAX_PASSES = 2_000_000
_FEW_PASSES = 10_000  # half a megabyte

RATIO_BITS = 16  # fractional bits of CONNECT's ratio
LEAST_RATIO = 2.0**-RATIO_BITS
_ROUNDING = 1e-12


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
        wait = max(self.period * x, 0.0)  # WA of a negative time does not wait
        if self.wait_resolution > 0:
            wait = math.floor(wait / self.wait_resolution + 1e-9) * self.wait_resolution
        if wait + self.interpreter_time <= 0:  # one pass per tick at most
            return self.servo_period or (0.0 if self.guarded else self.wait_resolution or self.period)
        return wait

    def _effect(self, time: float) -> float:
        if self.servo_period <= 0:
            return time
        return math.ceil(time / self.servo_period - 1e-9) * self.servo_period


@lru_cache(maxsize=32)
def _passes_of(loop: Loop) -> Passes:
    return loop.run()
