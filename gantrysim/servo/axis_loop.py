"""The loop of an axis and those of coupled axes, by their natural frequency, and the margins they must keep."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.servo import notch
from gantrysim.servo.axis_dynamics import AxisDynamics, Lags, coupled_groups
from gantrysim.servo.gains import Gains
from gantrysim.servo.laws import PID
from gantrysim.servo.laws.law import Law, LawDesign, Timing
from gantrysim.servo.laws.linear import added_laws, linear_law
from gantrysim.servo.laws.user import LawName
from gantrysim.servo.stability.compensator import Compensator
from gantrysim.servo.stability.margins import NO_LOOP, LinearLaw, Margins, Plant, UnheldLaws

LEAST_GAIN_MARGIN = 2.0  # of every derived loop
LARGEST_PEAK = 2.0  # of its |S|

_SWINGS = 0.3  # damping ratio below which a closed loop's mode is to be left out by input shaping
_BESIDE = 1e-5
_BELOW_NYQUIST = 0.9  # highest frequency of a notch, relative


class LoopTask(NamedTuple):
    """Axes whose loops demand torques at one period, and the shape of these loops.

    Attributes:
        axes: the machine's axes, or some of them.
        period: of the loops [s].
        lags: what makes them late, of these axes.
        damping: damping ratio zeta.
        integral_time: kp / ki, inf for no integral term [s].
        law: names of the laws in the loops.
        notched: whether there may be notches.
    """

    axes: tuple[AxisDynamics, ...]
    period: float
    lags: Lags
    damping: float = 1.0
    integral_time: float = math.inf
    law: tuple[LawName, ...] = (PID.name,)
    notched: bool = True

    @property
    def lag(self) -> float:
        """Time constant of winding, sampling and output together, of the slowest axis [s]."""
        slowest = max(self.lags.of_axes([a]).winding(axis) for a, axis in enumerate(self.axes))
        return slowest + self.period + self.lags.delay + self.lags.feedback * self.period


class AxisLoop:
    """The loop of one axis, by its natural frequency and with or without a notch."""

    def __init__(self, task: LoopTask, axis: int) -> None:
        self.axis = task.axes[axis]
        self.lags = task.lags.of_axes([axis])
        self._task = task
        motion = self.axis.motion
        self._plant = None if motion is None else Plant(motion, task.period, self.lags.delay, self.lags.drives)

    def law(self, frequency: float, mode: float) -> Compensator:
        """Return the law at a natural frequency with a notch at a mode, `notch.NONE` for none."""
        task = self._task
        gains = pd_gains(self.axis, frequency, task.damping, task.integral_time)
        coefficients = notch.coefficients(mode, notch.NOTCH_WIDTH, notch.NOTCH_DEPTH, task.period)
        in_loop = [law for law in added_laws(task.law) if law.answers_to_position]
        values = self._values(in_loop, frequency, mode)
        timing = Timing(task.period, self.lags.delay, self.lags.feedback)
        return linear_law(task.law, gains, coefficients, values, timing)

    def law_values(self, frequency: float, mode: float) -> dict[str, float]:
        """Return the parameters of all laws at a natural frequency, with a notch at a mode."""
        return self._values(added_laws(self._task.law), frequency, mode)

    def _values(self, laws: Sequence[Law], frequency: float, mode: float) -> dict[str, float]:
        lag = self.lags.winding(self.axis)
        swing = partial(self.slowest_swing, frequency, mode)
        design = LawDesign(self.axis, frequency, lag, self._task.period, swing)
        values: dict[str, float] = {}
        for law in laws:
            values |= law.derived(design)
        return values

    def notch_at(self, frequency: float) -> float | None:
        """Return the notch with which the axis keeps its margins, `notch.NONE` if without, None if with none."""
        if self._keeps(frequency, notch.NONE):
            return notch.NONE
        mode = self._mode(frequency)
        return mode if self._usable(mode) and self._keeps(frequency, mode) else None

    def limit(self, frequency: float) -> str:
        """Return what is wrong at a natural frequency at which no notch helps, in words."""
        mode = self._mode(frequency)
        if not mode:
            return self.trouble(frequency)
        if self._usable(mode):
            return f"{self.trouble(frequency, mode)} even with a notch at its mode of {mode:.0f} Hz"
        if not self._task.notched:
            return self.trouble(frequency)
        nyquist = 0.5 / self._task.period
        where = "above" if mode > nyquist else "too near"
        return f"{self.trouble(frequency)}, and its mode of {mode:.0f} Hz is {where} half the servo's, {nyquist:.0f} Hz"

    def trouble(self, frequency: float, mode: float = notch.NONE) -> str:
        """Return which margin a notch, or none, leaves too small, in words."""
        return margin_in_words(self.axis.name, self._margins(frequency, mode))

    def slowest_swing(self, frequency: float, mode: float) -> tuple[float, float]:
        """Return frequency [Hz] and damping ratio of the closed loop's slowest mode that swings, 0 without one."""
        if self._plant is None:
            return 0.0, 0.0
        period = self._task.period
        roots = np.log(self._plant.poles(self._laws(frequency, mode)).astype(complex) + 1e-300) / period
        swings = roots[
            (roots.imag > 0) & (-roots.real < _SWINGS * np.abs(roots)) & (roots.imag * period < 0.9 * math.pi)
        ]
        if not swings.size:
            return 0.0, 0.0
        slowest = swings[np.abs(swings).argmin()]
        return float(np.abs(slowest)) / (2 * math.pi), max(float(-slowest.real / np.abs(slowest)), 0.0)

    @cached_property
    def _resonances(self) -> Floats:
        """Natural frequencies of the axis' modes, rising, (n,) [Hz]."""
        return np.zeros(0) if self.axis.motion is None else self.axis.motion.resonances()

    def _usable(self, mode: float) -> bool:
        return self._task.notched and 0 < mode < _BELOW_NYQUIST * 0.5 / self._task.period

    def _keeps(self, frequency: float, mode: float) -> bool:
        return self._plant is None or keeps_margins(self._plant, self._laws(frequency, mode))

    def _margins(self, frequency: float, mode: float = notch.NONE) -> Margins:
        if self._plant is None:
            return NO_LOOP
        return self._plant.margins(self._laws(frequency, mode))[0]

    def _laws(self, frequency: float, mode: float) -> UnheldLaws:
        return UnheldLaws(self._task.period, self.lags.delay, (self.law(frequency, mode),), self.lags.drives)

    def _mode(self, frequency: float) -> float:
        """Return the frequency of the mode at which the loop is largest, 0 without modes [Hz]."""
        if self._plant is None:
            return 0.0
        modes = self._resonances
        below = modes[modes < 0.5 / self._task.period]
        if not below.size:
            return float(modes.min(initial=math.inf)) if modes.size else 0.0
        plain = self._laws(frequency, notch.NONE)
        # the loop has no bound at a mode without damping
        beside = below * (1 + _BESIDE)
        return float(below[np.abs(self._plant.loop(plain, beside)[:, 0]).argmax()])


class CoupledLoops:
    """The loops of axes that move each other, all closed."""

    def __init__(self, task: LoopTask, loops: Sequence[AxisLoop], members: Sequence[int]) -> None:
        motion = task.axes[members[0]].coupled
        assert motion is not None  # they are a group
        self._task = task
        self._loops = [loops[a] for a in members]
        self._drives = task.lags.drives.of_axes(members)
        self._plant = Plant(motion, task.period, task.lags.delay, self._drives)

    @classmethod
    def of(cls, task: LoopTask, loops: Sequence[AxisLoop]) -> list[CoupledLoops]:
        """Return those of each group of axes that move each other."""
        return [cls(task, loops, members) for members in coupled_groups(task.axes)]

    def keep(self, frequency: float) -> bool:
        """Return whether all keep their margins at a natural frequency."""
        return keeps_margins(self._plant, self._laws(frequency))

    def trouble(self, frequency: float) -> str:
        """Return which margin is too small at a natural frequency, in words; empty if none is."""
        margins_of_axes = self._plant.margins(self._laws(frequency))
        names = [loop.axis.name for loop in self._loops]
        return next(
            (
                margin_in_words(f"{name} with the loops of all axes closed", margins)
                for name, margins in zip(names, margins_of_axes, strict=True)
                if not are_kept(margins)
            ),
            "",
        )

    def _laws(self, frequency: float) -> UnheldLaws:
        laws = tuple(loop.law(frequency, loop.notch_at(frequency) or notch.NONE) for loop in self._loops)
        return UnheldLaws(self._task.period, self._task.lags.delay, laws, self._drives)


def pd_gains(axis: AxisDynamics, frequency: float, damping: float, integral_time: float) -> Gains:
    """Return the gains that place the poles of the continuous loop of an axis' inertia: kp = J w^2, kd = 2 zeta J w."""
    w = 2 * math.pi * frequency
    kp = axis.inertia * w**2
    return Gains(kp=kp, ki=kp / integral_time, kd=2 * damping * axis.inertia * w)


def are_kept(margins: Margins) -> bool:
    """Return whether a loop keeps the margins of derived ones."""
    gain = margins.least_gain
    return gain >= LEAST_GAIN_MARGIN and margins.sensitivity <= LARGEST_PEAK


def keeps_margins(plant: Plant, servo: LinearLaw) -> bool:
    """Return whether all loops keep the margins of derived ones."""
    # most that fail do so here, in a fraction of the time
    if plant.exceeds(servo, LARGEST_PEAK):
        return False
    return all(are_kept(margins) for margins in plant.margins(servo))


def margin_in_words(name: str, margins: Margins) -> str:
    """Return which margin of an axis is too small."""
    gain = margins.least_gain
    if not gain:
        return f"{name} is unstable"
    if gain < LEAST_GAIN_MARGIN:
        return f"{name} has a gain margin of {gain:.3g} (at least {LEAST_GAIN_MARGIN:g})"
    return f"{name} has a peak of |S| of {margins.sensitivity:.4g} (at most {LARGEST_PEAK:g})"
