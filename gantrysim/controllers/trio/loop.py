"""The program loop of the method: when it changes the ratio and the virtual speed, and what the axes then do."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from gantrysim.arrays import Floats
from gantrysim.controllers.trio.virtual import Law, VirtualAxis

MAX_PASSES = 2_000_000

RATIO_BITS = 16  # fractional bits of CONNECT's ratio
LEAST_RATIO = 2.0**-RATIO_BITS
_ROUNDING = 1e-12


class RatioTooSmallError(Exception):
    """The ratio x falls below what CONNECT can hold while the virtual axes still run at SPEED."""

    def __init__(self, number: int, ratio: float) -> None:
        super().__init__(number, ratio)
        self.number, self.ratio = number, ratio


class EndlessError(Exception):
    """The virtual axes are not at the end of their circles after MAX_PASSES passes."""

    def __init__(self, ratio: float, time: float) -> None:
        super().__init__(ratio, time)
        self.ratio, self.time = ratio, time


@dataclass(frozen=True)
class Passes:
    """What the loop did, pass by pass.

    Attributes:
        ratio: x as the program has it, (p,).
        connected: the ratio that CONNECT holds, (p,).
        time: at which the pass took effect, (p,) [s].
        way: of the virtual axis there, and at the end, (p + 1,) [mm].
        law: of the virtual axis.
        halted: whether the program stopped at a division by zero.
    """

    ratio: Floats
    connected: Floats
    time: Floats
    way: Floats
    law: Law
    halted: bool

    def connect(self, lengths: Floats) -> Connected:
        """Return the real axes' law, given the length of their path in every pass, (p,) [mm]."""
        return Connected(self.law, self.way, np.concatenate([[0.0], np.cumsum(lengths)]))


@dataclass(frozen=True)
class Connected:
    """The way of the real axes: in every pass in proportion to that of the virtual axis.

    Attributes:
        law: of the virtual axis.
        virtual: its way at the begin of every pass and at the end, (p + 1,) [mm].
        real: way of the real axes there, (p + 1,) [mm].
    """

    law: Law
    virtual: Floats
    real: Floats

    @property
    def length(self) -> float:
        """Way in all [mm]."""
        return float(self.real[-1])

    @property
    def duration(self) -> float:
        """Time in all [s]."""
        return self.law.duration

    def position(self, t: ArrayLike) -> Floats:
        """Way at the times t, (n,) [mm]."""
        return np.interp(self.law.position(t), self.virtual, self.real)

    def velocity(self, t: ArrayLike) -> Floats:
        """Speed at the times t, (n,) [mm/s]."""
        at = np.searchsorted(self.virtual, self.law.position(t), side="right")
        k = np.clip(at, 1, self.virtual.size - 1)
        step = self.virtual[k] - self.virtual[k - 1]
        ratio = np.divide(self.real[k] - self.real[k - 1], step, out=np.zeros_like(step), where=step > 0)
        return ratio * self.law.velocity(t)


@dataclass(frozen=True)
class Loop:
    """Lowers the ratio x by `change` on every pass, sets SPEED to speed / x, and waits.

    Args:
        length: of the virtual circles [mm].
        speed: path speed V, as SPEED at x = 1 [mm/s].
        change: decrease of x at every pass.
        period: T, the wait at x = 1 [s].
        interpreter_time: d, what every pass takes besides its wait [s].
        acceleration: ACCEL of the virtual axes [mm/s²].
        deceleration: DECEL [mm/s²].
        wait_resolution: the wait is cut to a multiple of it; 0 does not cut it [s].
        ratio_bits: fractional bits of the ratio, None for an exact one.
        servo_period: commands take effect at the next multiple of it; 0 has them do so at once [s].
        guarded: x stays above zero: it is held where the last braking lasts beyond that. The published listing
            has no such guard. A pass that does not wait takes one servo_period, or without ticks no time where
            guarded, and one wait_resolution or period where not.
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

    def run(self) -> Passes:
        """Run the loop until the virtual axes have come to the end of their circles.

        Raises:
            RatioTooSmallError: x would fall below 2^-16 before the axes brake for the end.
            EndlessError: the end is not reached within MAX_PASSES passes.
        """
        axis = VirtualAxis(self.length, self.acceleration, self.deceleration)
        ratio: list[float] = []
        time: list[float] = []
        way: list[float] = []
        begun, halted = 0.0, False
        while not axis.done:
            x = 1 - self.change * (len(ratio) + 1)
            zero = abs(x) < _ROUNDING
            if (self.guarded and x < LEAST_RATIO and not axis.braking) or (zero and not ratio):
                raise RatioTooSmallError(len(ratio) + 1, x)
            if zero or (self.guarded and x < LEAST_RATIO):
                # the published program stops at SPEED = V / 0, a guarded one holds x; either way the axes go on
                halted = not self.guarded
                axis.advance(math.inf, self.speed / abs(ratio[-1]))
                break
            if len(ratio) == MAX_PASSES:
                raise EndlessError(ratio[-1], axis.time)
            ratio.append(x)
            time.append(axis.time)
            way.append(axis.way)
            begun += self._wait(x) + self.interpreter_time
            axis.advance(self._effect(begun), self.speed / abs(x))
        held = connected = np.array(ratio)
        if self.ratio_bits is not None:
            connected = np.round(held * 2.0**self.ratio_bits) / 2.0**self.ratio_bits
        return Passes(held, connected, np.array(time), np.array([*way, axis.way]), axis.law(), halted)

    def _wait(self, x: float) -> float:
        wait = max(self.period * x, 0.0)  # WA of a negative time does not wait
        if self.wait_resolution > 0:
            wait = math.floor(wait / self.wait_resolution + 1e-9) * self.wait_resolution
        if wait + self.interpreter_time <= 0:  # one pass a tick at most
            return self.servo_period or (0.0 if self.guarded else self.wait_resolution or self.period)
        return wait

    def _effect(self, time: float) -> float:
        if self.servo_period <= 0:
            return time
        return math.ceil(time / self.servo_period - 1e-9) * self.servo_period
