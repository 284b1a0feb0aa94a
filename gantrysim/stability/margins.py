"""Stability margins of the sampled loop of each axis.

Rotor, load, compliance, winding or current loop, hold and delays are in them, exactly and in continuous time between
the ticks. Encoder quantisation, noise and interpolation errors, torque and voltage limits and Coulomb friction are left
out.
"""

# ruff: noqa: N806 - functions of z bear the letters of the law

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike

from gantrysim.base.arrays import Complexes, Floats
from gantrysim.base.errors import InputError, at_least, positive
from gantrysim.stability.cascade import with_velocity_loops
from gantrysim.stability.compensator import Compensator
from gantrysim.stability.loops import FrequencyResponse, Loops
from gantrysim.stability.motion import Drives, LinearSystem, Motion, UnknownLoopError

_MIN_GAIN = 1e-6  # a loop that is stable down to this factor has no lower gain margin
# factors on all gains
_LEAST = 1e-3
_MOST = 10.0
_FACTORS = 60  # up to either, to begin with
_SHARP = 1e-6  # accuracy of a factor on all gains
_COARSE = 4  # points of the grid for each of a coarse one
_REAL = 1e-6  # largest imaginary part of a real loop, relative


@dataclass(frozen=True)
class Margins:
    """Margins of the loop of one axis, broken at its torque demand.

    A stable axis comes to rest at its position. A loop without kp, or without gains, does not hold a position: it has a
    pole at z = 1 and counts as unstable, with a gain of 0.

    Attributes:
        gain: largest factor on the axis' gains up to which the loop is stable, inf without limit; for an unstable loop
            the largest factor below 1 that makes it stable, 0 if none does.
        gain_lower: smallest factor down to which the loop is stable, 0 without limit.
        phase: smallest phase lag or lead that makes the loop unstable, 180 if none does; 0 for an unstable loop [deg].
        delay: smallest delay that makes the loop unstable, inf if none does; 0 for an unstable loop [s].
        sensitivity: peak of |S| = |1/(1 + L)|; inf for an unstable loop.
        crossover: lowest frequency at which |L| falls below 1; 0 if |L| < 1 at all frequencies [Hz].
        stable: whether the loop is stable.
        together: as gain, but a factor on the gains of all axes that move each other, sought from 0.001 to 10.
    """

    gain: float
    gain_lower: float
    phase: float
    delay: float
    sensitivity: float
    crossover: float
    stable: bool
    together: float

    def __str__(self) -> str:
        if self == NO_LOOP:
            return "without a loop"
        if not self.stable:
            return "unstable" + (f", stable with its gains times {self.gain:.2g}" if self.gain > 0 else "")
        return f"gain {self.gain:.3g}, phase {self.phase:.0f} deg, crossover {self.crossover:.3g} Hz"


NO_LOOP = Margins(math.inf, 0.0, 180.0, math.inf, 1.0, 0.0, stable=True, together=math.inf)  # nothing is fed back


class LinearLaw(Protocol):
    """A servo, as its stability depends on it."""

    @property
    def period(self) -> float:
        """Servo period T [s]."""

    @property
    def delay(self) -> float:
        """Time from sample to output [s]."""

    @property
    def drives(self) -> Drives:
        """What of the drives lies in the loops."""

    def compensators(self) -> tuple[Compensator, ...]:
        """Return the law of each axis."""


class Laws(NamedTuple):
    """Laws of axes that no servo holds yet.

    Attributes:
        period: servo period T [s].
        delay: time from sample to output [s].
        each: the law of each axis.
        drives: what of the drives lies in the loops.
    """

    period: float
    delay: float
    each: tuple[Compensator, ...]
    drives: Drives = Drives()

    def compensators(self) -> tuple[Compensator, ...]:
        """Return the law of each axis."""
        return self.each


class Movable(Protocol):
    """A machine, as its stability depends on it."""

    def motion(self, position: ArrayLike | None = None) -> Motion:
        """Return the motion about rest at a position of the axes, by default zero, (axes,) [mm or deg]."""


_PLAIN = Drives()


class Plant:
    """The motion of axes, sampled by servos of one period and delay.

    It is exact: the demand is held from tick to tick, and the matrix exponential integrates what it moves; no step of a
    simulation is in it. The loop of an axis has all others closed by the same servo. Axes that do not move each other,
    as on a gantry, are stable or unstable separately; coupled axes are so together. The methods raise InputError for a
    servo of another number of axes, period, delay or drives.

    Args:
        motion: the motion of the axes.
        period: servo period T [s].
        delay: time from sample to output, at most the period [s].
        drives: of the servos.

    Attributes:
        groups: axes that move each other, by number, but for steppers in open loop.

    Raises:
        InputError: a period or delay out of range.
    """

    def __init__(self, motion: Motion, period: float, delay: float = 0.0, drives: Drives = _PLAIN) -> None:
        self.period = positive("servo period", period, "s")
        self.delay = at_least("servo delay", delay, 0, "s")
        if delay > period:
            raise InputError(f"servo delay = {delay:g} s: must be at most the period, {period:g} s")
        self.axes = len(motion.C)
        self.drives = drives
        motors = motion.C
        if drives != _PLAIN:
            motion = motion.driven(drives)
        self._responses: list[FrequencyResponse] = []
        self._periods: list[float] = []  # of the loop around each of them
        for states, axes in motion.groups():
            modes = {drives.mode_of(a) for a in axes}
            if len(modes) > 1:
                raise InputError(
                    f"servo mode: axes {', '.join(str(a + 1) for a in axes)} move each other: must have one mode, not "
                    f"{' and '.join(map(repr, sorted(modes)))}"
                )
            if modes != {"stepper"}:
                own, system = self._sampled(motion, motors, states, axes)
                self._periods.append(own)
                self._responses.append(FrequencyResponse.of(system))
        self.groups = tuple(response.system.axes for response in self._responses)

    def _sampled(
        self, motion: Motion, motors: Floats, states: list[int], axes: list[int]
    ) -> tuple[float, LinearSystem]:
        """Return the motion of a group between the samples of the loop that is closed around it, and their period."""
        drives = self.drives
        mode = self.drives.mode_of(axes[0])
        if mode == "position":
            return drives.period, motion.sampled_group(states, axes, drives.period)
        if mode != "velocity":
            return self.period, motion.sampled_group(states, axes, self.period, self.delay)
        gain, rate = np.array([drives.velocity[a] for a in axes]).T
        own = motion.sampled_group(states, axes, drives.period)
        times = drives.period, self.period, self.delay
        return self.period, with_velocity_loops(own, motors[np.ix_(axes, states)], gain, rate, times)

    @classmethod
    def of(
        cls,
        machine: Movable,
        period: float,
        delay: float = 0.0,
        *,
        drives: Drives = _PLAIN,
        position: ArrayLike | None = None,
    ) -> Plant:
        """Return the plant of a machine about a position of its axes.

        Args:
            machine: a `Machine`.
            period: servo period [s].
            delay: time from sample to output, at most the period [s].
            drives: of the servo.
            position: by default zero, (axes,) [mm or deg].

        Raises:
            InputError: a period or delay out of range, or a position that is not one finite number per axis.
            UnknownLoopError: an actuator has a delay in the MJCF.
        """
        return cls(machine.motion(position), period, delay, drives)

    def margins(self, servo: LinearLaw) -> tuple[Margins, ...]:
        """Return the margins of each axis."""
        margins: dict[int, Margins] = {}
        for loops in self._loops(servo):
            margins |= zip(loops.system.axes, _margins(loops), strict=True)
        return tuple(margins.get(a, NO_LOOP) for a in range(self.axes))

    def sensitivity(self, servo: LinearLaw) -> Floats:
        """Return the peak of |S| of each axis, inf for an unstable loop, (axes,); as in `margins`, but much faster."""
        peaks = np.full(self.axes, np.inf)
        for loops in self._loops(servo):
            if loops.stable():
                peaks[list(loops.system.axes)] = loops.peaks(loops.open(loops.plant.theta, loops.plant.P))
        return peaks

    def exceeds(self, servo: LinearLaw, peak: float) -> bool:
        """Return whether a loop is unstable, or its |S| above a peak on a coarse grid; much faster than `margins`.

        |S| between the points may be higher: where this is False, `margins` decides.
        """
        for loops in self._loops(servo):
            if not loops.stable():
                return True
            L = loops.open(loops.plant.theta[::_COARSE], loops.plant.P[::_COARSE])
            if np.abs(1 + L).min() < 1 / peak:
                return True
        return False

    def loop(self, servo: LinearLaw, frequency: ArrayLike) -> Complexes:
        """Return L, the open loop of each axis with all others closed, (n, axes).

            L = C P of a single axis, C(z) the law and its notch, P(z) the motion with hold and delay

        Args:
            servo: the servo.
            frequency: above 0 and at most the Nyquist frequency of the servo, (n,) [Hz].
        """
        groups = self._loops(servo)
        angle = 2 * np.pi * np.atleast_1d(np.asarray(frequency, float))
        if not ((angle > 0) & (angle * self.period <= np.pi * (1 + 1e-9))).all():
            raise InputError(f"frequency: must be above 0 and at most {0.5 / self.period:g} Hz")
        L = np.zeros((len(angle), self.axes), complex)
        for loops in groups:
            L[:, loops.system.axes] = loops.at(loops.T * angle)
        return L

    def poles(self, servo: LinearLaw) -> Complexes:
        """Return the closed-loop poles, each of a step of its loop, unstable outside the unit circle, (n,)."""
        return np.concatenate([np.zeros(0, complex), *(loops.poles() for loops in self._loops(servo))])

    def _loops(self, servo: LinearLaw) -> list[Loops]:
        """Return the loops of each group of axes that move each other."""
        laws = servo.compensators()
        if len(laws) != self.axes:
            raise InputError(f"servo has {len(laws)} axes: the plant has {self.axes}")
        for name in ("period", "delay"):
            given = getattr(servo, name)
            own = getattr(self, name)
            if abs(given - own) > 1e-12:
                raise InputError(f"servo {name} = {given:g} s: must be the plant's, {own:g} s")
        if servo.drives != self.drives:
            raise InputError("servo drives: their modes, loops and feedback must be the plant's")
        return [
            Loops(response, [laws[a] for a in response.system.axes], period)
            for response, period in zip(self._responses, self._periods, strict=True)
        ]


def margins_of(machine: Movable, servo: LinearLaw) -> tuple[Margins, ...] | None:
    """Return the margins of each axis with its servo, or None if the machine or the law cannot be linearised."""
    try:
        return Plant.of(machine, servo.period, servo.delay, drives=servo.drives).margins(servo)
    except UnknownLoopError:
        return None


def _margins(loops: Loops) -> list[Margins]:
    L = loops.open(loops.plant.theta, loops.plant.P)
    crossings = loops.crossings(L)
    stable = loops.stable()
    peaks = loops.peaks(L) if stable else np.full(len(loops.laws), np.inf)
    margins = []
    together = _together(loops)
    for a in range(len(loops.laws)):
        real, unit = (crossings.of(a, unit=kind) for kind in (False, True))
        ends = L[[0, -1], a]  # here the loop is real, or nearly so
        crossed = np.append(real.L.real, ends.real[np.abs(ends.imag) < _REAL * np.abs(ends)])
        low, high = _factors(loops, a, -1 / crossed[crossed < 0], stable)
        turn = np.angle(-unit.L)  # phase above -180 degrees
        lag = turn % (2 * np.pi) / unit.theta * loops.T
        crossover = unit.theta[unit.falls].min(initial=math.inf) / (2 * math.pi * loops.T)
        margins.append(
            Margins(
                gain=high,
                gain_lower=low,
                phase=math.degrees(np.abs(turn).min(initial=math.pi)) if stable else 0.0,
                delay=float(lag.min(initial=math.inf)) if stable else 0.0,
                sensitivity=float(peaks[a]),
                crossover=float(crossover) if unit.falls.any() else 0.0,
                stable=stable,
                together=high if together is None else together,
            )
        )
    return margins


def _factors(loops: Loops, axis: int, critical: Floats, stable: bool) -> tuple[float, float]:
    """Return the range of factors that keep an axis stable, given those at which a pole is on the unit circle."""
    critical = np.sort(critical[critical > _MIN_GAIN])
    bounds = [0.0, *critical[critical < 1].tolist()]
    if stable:
        return bounds[-1], float(critical[critical >= 1].min(initial=math.inf))
    for low, high in reversed(list(pairwise(bounds))):
        if loops.stable([axis], math.sqrt(low * high) or high / 2):
            return low, high
    return 0.0, 0.0


def _together(loops: Loops) -> float | None:
    """Return the factor on the gains of all axes of a group at its limit of stability, None for a single axis."""
    axes = range(len(loops.laws))
    if len(axes) == 1:
        return None
    stable = loops.stable()
    low = high = 1.0
    for factor in np.geomspace(1, _MOST if stable else _LEAST, _FACTORS)[1:].tolist():
        low = min(low, factor)
        high = max(high, factor)
        if loops.stable(axes, factor) is not stable:
            break
        low = factor
        high = factor
    else:
        return math.inf if stable else 0.0
    while high - low > _SHARP * low:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if loops.stable(axes, middle) else (low, middle)
    return low
