"""Stability margins of the sampled loop of each axis, alone and with all closed; these values as people see them.

Rotor, load, compliance, winding or current loop, hold and delays are in them, exactly and in continuous time between
the ticks. Encoder quantisation, noise and interpolation errors, torque and voltage limits and Coulomb friction are left
out.
"""

# ruff: noqa: N806 - matrices bear the letters of the equations
from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike

from gantrysim.base.arrays import Complexes, Floats
from gantrysim.base.errors import InputError, at_least, positive
from gantrysim.base.quantity import Quantity
from gantrysim.servo.stability.linear_system import Compensator
from gantrysim.servo.stability.loops import (
    NO_LOOP,
    FrequencyResponse,
    Loops,
    Margins,
    margins_of_loops,
    peaks_of,
)
from gantrysim.servo.stability.motion import Drives, LinearSystem, Motion, UnknownLoopError

GAIN_MARGIN = Quantity[Margins](
    "gain_margin",
    label="gain margin",
    unit="",
    form=".2f",
    meaning="Largest stable factor on the gains, of the axis alone or of all axes that move each other, whichever is "
    "smaller",
    path=("least_gain",),
)
GAIN_MARGIN_ALONE = Quantity[Margins](
    "gain_margin_alone",
    label="gain margin alone",
    unit="",
    form=".2f",
    meaning="Largest factor on the axis' gains up to which its loop is stable",
    path=("gain",),
)
GAIN_MARGIN_TOGETHER = Quantity[Margins](
    "gain_margin_together",
    label="gain margin with all it moves",
    unit="",
    form=".2f",
    meaning="Largest factor on the gains of all axes that move each other up to which they are stable",
    path=("together",),
)
GAIN_MARGIN_LOWER = Quantity[Margins](
    "gain_margin_lower",
    label="lower gain margin",
    unit="",
    form=".2f",
    meaning="Smallest factor on the axis' gains down to which its loop is stable",
    path=("gain_lower",),
)
PHASE_MARGIN = Quantity[Margins](
    "phase_margin",
    label="phase margin",
    unit="deg",
    form=".1f",
    meaning="Smallest phase lag or lead that makes the loop unstable",
    path=("phase",),
)
DELAY_MARGIN = Quantity[Margins](
    "delay_margin",
    label="delay margin",
    unit="ms",
    form=".2f",
    meaning="Smallest delay that makes the loop unstable",
    path=("delay",),
    factor=1e3,
)
SENSITIVITY = Quantity[Margins](
    "sensitivity",
    label="peak of |S|",
    unit="",
    form=".2f",
    meaning="Largest amplification of a disturbance of the loop, |S| = |1/(1 + L)|, over all frequencies",
    path=("sensitivity",),
)
CROSSOVER = Quantity[Margins](
    "crossover",
    label="crossover",
    unit="Hz",
    form=".1f",
    meaning="Lowest frequency at which the loop's gain |L| falls below 1",
    path=("crossover",),
)

MARGINS = (
    GAIN_MARGIN,
    GAIN_MARGIN_ALONE,
    GAIN_MARGIN_TOGETHER,
    GAIN_MARGIN_LOWER,
    PHASE_MARGIN,
    DELAY_MARGIN,
    SENSITIVITY,
    CROSSOVER,
)


# relative difference below which a delay counts as one of whole samples
_SAME_TIME = 1e-9


def with_velocity_loops(
    system: LinearSystem, motors: Floats, gain: Floats, rate: Floats, times: tuple[float, float, float]
) -> LinearSystem:
    """Return the motion of axes whose drives close velocity loops, from velocity demand to position, per servo period.

    At each of its samples j, t apart, a drive takes the velocity v[j] = (y[j] - y[j-1]) / t of its motor and sets

        u[j] = K (w - v[j] + z[j+1] / Ti),        z[j+1] = z[j] + t (w - v[j])

    until the next. The demand w changes once per servo period, at the drive's first sample not before the servo's
    delay.

    Args:
        system: the motion over t, torque demands in.
        motors: positions of the motors, (axes, states) [mm or deg].
        gain: K, (axes,) [N·m·s/u].
        rate: 1 / Ti, (axes,) [1/s].
        times: t, servo period, servo delay [s].
    """
    t, period, delay = times
    n = len(system.F)
    m = len(gain)
    G = system.G0 + system.G1
    H = motors
    K = np.diag(gain)
    # a drive without an integral term holds no z, which would be a pole at 1
    integrates = np.diag(rate > 0).astype(float)
    whole = np.diag(gain * (1 + rate * t))
    step = np.zeros((n + 2 * m, n + 2 * m))
    enter = np.zeros((n + 2 * m, m))
    x = slice(0, n)
    before = slice(n, n + m)
    z = slice(n + m, n + 2 * m)
    # z[j+1] put into u[j]: the factor 1 + t / Ti on w - v[j], and z[j] / Ti beside it
    step[x, x] = system.F - G @ whole @ H / t
    step[x, before] = G @ whole / t
    step[x, z] = G @ K @ np.diag(rate)
    step[before, x] = H
    step[z, x] = -integrates @ H
    step[z, before] = integrates
    step[z, z] = integrates
    enter[x] = G @ whole
    enter[z] = t * integrates
    F = np.eye(n + 2 * m)
    G0 = np.zeros_like(enter)
    G1 = np.zeros_like(enter)
    # drive samples that still act on the last demand; rounding must not make one of a delay of whole samples
    late = math.ceil(delay / t * (1 - _SAME_TIME))
    for j in range(round(period / t)):
        F = step @ F
        G0 = step @ G0 + enter * (j < late)
        G1 = step @ G1 + enter * (j >= late)
    return LinearSystem(system.axes, F, G0, G1, np.concatenate([system.H, np.zeros((m, 2 * m))], axis=1))


_COARSE_EVERY = 4  # points of the grid for each of a coarse one


class LinearLaw(Protocol):
    """The part of a servo on which stability depends."""

    @property
    def period(self) -> float:
        """Servo period T [s]."""

    @property
    def delay(self) -> float:
        """Time from sample to output [s]."""

    @property
    def loop_drives(self) -> Drives:
        """Drive dynamics inside the loops."""

    def compensators(self) -> tuple[Compensator, ...]:
        """Return the law of each axis."""


class UnheldLaws(NamedTuple):
    """Laws of axes that no servo holds yet.

    Attributes:
        period: servo period T [s].
        delay: time from sample to output [s].
        laws: the law of each axis.
        loop_drives: drive dynamics inside the loops.
    """

    period: float
    delay: float
    laws: tuple[Compensator, ...]
    loop_drives: Drives = Drives()

    def compensators(self) -> tuple[Compensator, ...]:
        """Return the law of each axis."""
        return self.laws


class Movable(Protocol):
    """The part of a machine on which stability depends."""

    def motion(self, position: ArrayLike | None = None) -> Motion:
        """Return the motion about rest at a position of the axes, by default zero, (axes,) [mm or deg]."""


_PLAIN_DRIVES = Drives()


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

    def __init__(self, motion: Motion, period: float, delay: float = 0.0, drives: Drives = _PLAIN_DRIVES) -> None:
        self.period = positive("servo period", period, "s")
        self.delay = at_least("servo delay", delay, 0, "s")
        if delay > period:
            raise InputError(f"servo delay = {delay:g} s: must be at most the period, {period:g} s")
        self.axes = len(motion.C)
        self.drives = drives
        motors = motion.C
        if drives != _PLAIN_DRIVES:
            motion = motion.driven(drives)
        self._responses: list[FrequencyResponse] = []
        # of the loop around each of them
        self._periods: list[float] = []
        for states, axes in motion.groups():
            modes = {drives.mode_of(a) for a in axes}
            if len(modes) > 1:
                raise InputError(
                    f"servo mode: axes {', '.join(str(a + 1) for a in axes)} move each other: must have one mode, not "
                    f"{' and '.join(map(repr, sorted(modes)))}"
                )
            if modes != {"stepper"}:
                loop_period, system = self._sampled_group(motion, motors, states, axes)
                self._periods.append(loop_period)
                self._responses.append(FrequencyResponse.of(system))
        self.groups = tuple(response.system.axes for response in self._responses)

    def _sampled_group(
        self, motion: Motion, motors: Floats, states: list[int], axes: list[int]
    ) -> tuple[float, LinearSystem]:
        """Return the period of the loop that the group's mode closes, and the group's motion between its samples."""
        drives = self.drives
        mode = self.drives.mode_of(axes[0])
        if mode == "position":
            return drives.period, motion.sampled_group(states, axes, drives.period)
        if mode != "velocity":
            return self.period, motion.sampled_group(states, axes, self.period, self.delay)
        gain, rate = np.array([drives.velocity[a] for a in axes]).T
        between_samples = motion.sampled_group(states, axes, drives.period)
        times = (drives.period, self.period, self.delay)
        return self.period, with_velocity_loops(between_samples, motors[np.ix_(axes, states)], gain, rate, times)

    @staticmethod
    def of(
        machine: Movable,
        period: float,
        delay: float = 0.0,
        *,
        drives: Drives = _PLAIN_DRIVES,
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
        return plant_of(machine.motion(position), period, delay, drives)

    def margins(self, servo: LinearLaw) -> tuple[Margins, ...]:
        """Return the margins of each axis."""
        margins: dict[int, Margins] = {}
        for loops in self.loops(servo):
            margins |= zip(loops.system.axes, margins_of_loops(loops), strict=True)
        return tuple(margins.get(a, NO_LOOP) for a in range(self.axes))

    def sensitivity(self, servo: LinearLaw) -> Floats:
        """Return the peak of |S| of each axis, inf for an unstable loop, (axes,); as in `margins`, but much faster."""
        return sensitivities([self], servo)[0]

    def exceeds(self, servo: LinearLaw, peak: float) -> bool:
        """Return whether a loop is unstable, or its |S| above a peak on a coarse grid; much faster than `margins`.

        |S| between the points may be higher: where this is False, `margins` decides.
        """
        for loops in self.loops(servo):
            if not loops.stable():
                return True
            L = loops.open(loops.plant.theta[::_COARSE_EVERY], loops.plant.P[::_COARSE_EVERY])
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
        groups = self.loops(servo)
        angle = 2 * np.pi * np.atleast_1d(np.asarray(frequency, float))
        if not ((angle > 0) & (angle * self.period <= np.pi * (1 + 1e-9))).all():
            raise InputError(f"frequency: must be above 0 and at most {0.5 / self.period:g} Hz")
        L = np.zeros((len(angle), self.axes), complex)
        for loops in groups:
            L[:, loops.system.axes] = loops.at(loops.T * angle)
        return L

    def poles(self, servo: LinearLaw) -> Complexes:
        """Return the closed-loop poles, each of a step of its loop, unstable outside the unit circle, (n,)."""
        return np.concatenate([np.zeros(0, complex), *(loops.poles() for loops in self.loops(servo))])

    def loops(self, servo: LinearLaw) -> list[Loops]:
        """Return the loops of each group of axes that move each other."""
        laws = servo.compensators()
        if len(laws) != self.axes:
            raise InputError(f"servo has {len(laws)} axes: the plant has {self.axes}")
        for name in ("period", "delay"):
            given = getattr(servo, name)
            expected = getattr(self, name)
            if abs(given - expected) > 1e-12:
                raise InputError(f"servo {name} = {given:g} s: must be the plant's, {expected:g} s")
        if servo.loop_drives != self.drives:
            raise InputError("servo drives: their modes, loops and feedback must be the plant's")
        return [
            Loops(response, [laws[a] for a in response.system.axes], period)
            for response, period in zip(self._responses, self._periods, strict=True)
        ]


@lru_cache(maxsize=64)
def plant_of(motion: Motion, period: float, delay: float, drives: Drives) -> Plant:
    """Return the plant of a motion, which servos that differ in their gains share; arguments as of `Plant`."""
    return Plant(motion, period, delay, drives)


def sensitivities(plants: Sequence[Plant], servo: LinearLaw) -> Floats:
    """Return the peak of |S| of each axis on each of several plants, inf for an unstable loop, (plants, axes)."""
    law = UnheldLaws(servo.period, servo.delay, servo.compensators(), servo.loop_drives)
    peaks = np.full((len(plants), plants[0].axes), np.inf)
    # the same axes of several plants together
    groups: dict[tuple[tuple[int, ...], int], list[tuple[int, Loops]]] = {}
    for number, plant in enumerate(plants):
        for loops in plant.loops(law):
            groups.setdefault((loops.system.axes, len(loops.system.F)), []).append((number, loops))
    for (axes, _), group in groups.items():
        numbers = [number for number, _ in group]
        peaks[np.ix_(numbers, axes)] = peaks_of([loops for _, loops in group])
    return peaks


def margins_of(machine: Movable, servo: LinearLaw) -> tuple[Margins, ...] | None:
    """Return the margins of each axis with its servo, or None if the machine or the law cannot be linearised."""
    try:
        return Plant.of(machine, servo.period, servo.delay, drives=servo.loop_drives).margins(servo)
    except UnknownLoopError:
        return None
