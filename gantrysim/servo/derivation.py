"""Gains that follow from the axes: from inertia, lags, and the mode in which each axis swings on its drive.

The loops of an axis and of coupled axes follow from their natural frequency; the fastest that keep their margins count.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import cached_property, lru_cache, partial
from typing import NamedTuple

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError, between, positive
from gantrysim.base.quantity import text_beside
from gantrysim.servo import notch
from gantrysim.servo.axis_dynamics import AxisDynamics, Lags, coupled_groups
from gantrysim.servo.gains import Gains
from gantrysim.servo.laws import PID
from gantrysim.servo.laws.law import Law, LawDesign, Timing
from gantrysim.servo.laws.selection import added_laws, linear_law
from gantrysim.servo.laws.user import LawName
from gantrysim.servo.stability.linear_system import Compensator
from gantrysim.servo.stability.margins import NO_LOOP, LinearLaw, Margins, Plant, UnheldLaws, plant_of
from gantrysim.servo.stability.motion import Motion

# natural frequencies that can be given [Hz]
FREQUENCIES = (1e-3, 1e5)
# what every derived loop keeps: its gain margin, and the peak of its |S|
LEAST_GAIN_MARGIN = 2.0
LARGEST_PEAK = 2.0

# from one frequency tried to the next, and the lowest one tried, relative to the one that the lags admit
_FREQUENCY_STEP = 0.97
_LOWEST_FREQUENCY = 1e-3
# damping ratio below which a closed loop's mode is to be left out by input shaping
_SWINGING_DAMPING = 0.3
# distance from a mode, relative, at which loops are compared there: without damping they have no bound at it
_MODE_OFFSET = 1e-5
# highest frequency of a notch, relative to Nyquist's
_BELOW_NYQUIST = 0.9


class NoLoopError(InputError):
    """Axes of which no loop keeps its margins, at whatever natural frequency.

    Attributes:
        trouble: which margins the loops tried leave too small, in words.
    """

    def __init__(self, trouble: str) -> None:
        super().__init__(
            f"servo: no loop keeps a gain margin of {LEAST_GAIN_MARGIN:g} and a peak of |S| of at most "
            f"{LARGEST_PEAK:g} on every axis: {trouble}"
        )
        self.trouble = trouble


class Loop(NamedTuple):
    """The natural frequency of all axes and the notch of each.

    Attributes:
        frequency: [Hz].
        notches: frequency of each axis' notch, 0 for none [Hz].
        reason: what bounds the frequency, and why there are notches, in words.
    """

    frequency: float
    notches: tuple[float, ...]
    reason: str


@lru_cache(maxsize=256)
def loop(task: LoopTask, frequency: float | None = None) -> Loop:
    """Return the fastest loop that keeps a gain margin of 2 and |S| <= 2 on every axis.

    The lags of winding, sampling and output leave room for a natural frequency, see `natural_frequency`. An axis that
    would not keep the margins at it, for it swings on its drive, gets a notch at that mode. Where a notch does not do,
    or the mode is too near half the servo's frequency, all axes are slowed down until they keep the margins. So are
    axes that move each other until each keeps them with all loops closed, and all together a gain margin of 2.

    Slower is not always safer: with an integral term a loop slower than about 1 / integral_time is unstable, and one
    on the load may be held back by its mode at any speed. The slowest loop tried has a thousandth of what the lags
    leave room for.

    Args:
        task: the axes, and the shape of their loops.
        frequency: natural frequency that is to be taken, whatever the margins are; None for the fastest [Hz].

    Raises:
        NoLoopError: no loop keeps the margins.
    """
    loops = [AxisLoop(task, a) for a in range(len(task.axes))]
    if frequency is None:
        chosen, reason = _fastest(task, loops)
    else:
        chosen = between("frequency", frequency, *FREQUENCIES, "Hz")
        reason = f"natural frequency {frequency:.4g} Hz, as given"
    notches = tuple(axis_loop.notch_at(chosen) or notch.NONE for axis_loop in loops)
    for axis_loop, mode in zip(loops, notches, strict=True):
        if mode != notch.NONE:
            name = axis_loop.axis.name
            reason += f"; notch of {name} at its mode of {mode:.0f} Hz, without it {axis_loop.trouble(chosen)}"
    return Loop(chosen, notches, reason)


def _fastest(task: LoopTask, loops: Sequence[AxisLoop]) -> tuple[float, str]:
    """Return the highest natural frequency at which all axes keep their margins [Hz], and what bounds it in words."""
    groups = CoupledLoops.of(task, loops)
    room = natural_frequency(task.lag, task.damping)
    too_fast = None
    slowest_first = list(loops)
    for frequency in _tried_frequencies(room):
        failing = _failing(slowest_first, frequency)
        if failing is None and all(group.keep(frequency) for group in groups):
            break
        too_fast = frequency
        # it is likely to fail at the next frequency too, which saves trying the others
        if failing is not None:
            slowest_first = [failing, *(axis_loop for axis_loop in loops if axis_loop is not failing)]
    else:
        slowest = _failing(loops, frequency)
        at_slowest = slowest.trouble(frequency) if slowest else _trouble(loops, groups, frequency)
        raise NoLoopError(f"at {room:.3g} Hz {_trouble(loops, groups, room)}, at {frequency:.3g} Hz {at_slowest}")
    reason = f"natural frequency {frequency:.3g} Hz: "
    if too_fast is not None:
        bound = _trouble(loops, groups, too_fast)
        return frequency, f"{reason}at more, {bound}; the lags alone leave room for {room:.3g} Hz"
    lags = f"the lags of sampling, output and winding, {1e3 * task.lag:.3g} ms, leave room for no more"
    return frequency, reason + lags


def _tried_frequencies(room: float) -> Iterator[float]:
    """Yield natural frequencies from the highest that the lags leave room for to the slowest [Hz]."""
    frequency = room
    while frequency > _LOWEST_FREQUENCY * room:
        yield frequency
        frequency *= _FREQUENCY_STEP


def _failing(loops: Sequence[AxisLoop], frequency: float) -> AxisLoop | None:
    """Return the first loop that no notch helps to keep its margins, None if all keep them."""
    return next((axis_loop for axis_loop in loops if axis_loop.notch_at(frequency) is None), None)


def _trouble(loops: Sequence[AxisLoop], groups: Sequence[CoupledLoops], frequency: float) -> str:
    """Return which margin is too small at a natural frequency, in words."""
    failing = _failing(loops, frequency)
    if failing is not None:
        return failing.limit(frequency)
    return next(filter(None, (group.trouble(frequency) for group in groups)), "")


def derived_laws(task: LoopTask, design: Loop) -> list[dict[str, float]]:
    """Return the parameters of each axis' laws, by name.

    Args:
        task: the axes, and the shape of their loops.
        design: of their loops.
    """
    return [AxisLoop(task, a).law_values(design.frequency, mode) for a, mode in enumerate(design.notches)]


def nominal_motions(axes: Sequence[AxisDynamics]) -> tuple[Motion, ...]:
    """Return the motion of each axis alone, or of all axes in one where a chain couples them; none if unknown."""
    if axes[0].chain is not None:
        return (axes[0].chain,)
    return tuple(axis.motion for axis in axes if axis.motion is not None)


def natural_frequency(lag: float, damping: float, phase_share: float = 2 / 3) -> float:
    """Return the natural frequency at which a PD loop with a lag keeps a share of its phase margin [Hz].

    The loop L(s) = (2 zeta w s + w^2) / s^2 crosses over at wc = w c, c^2 = 2 zeta^2 + sqrt(4 zeta^4 + 1),
    with the phase margin atan(2 zeta c): 76 degrees where zeta is 1. A lag tau takes wc tau of it, so that
    w = (1 - share) atan(2 zeta c) / (c tau). For a sampled servo tau is the drive's time constant plus one
    period: half of it for the hold and half for the difference that stands for the derivative.

    Args:
        lag: tau [s].
        damping: damping ratio zeta.
        phase_share: share of the phase margin that remains.
    """
    zeta = positive("damping", damping)
    c = math.sqrt(2 * zeta**2 + math.sqrt(4 * zeta**4 + 1))
    return (1 - phase_share) * math.atan(2 * zeta * c) / (c * positive("lag", lag, "s")) / (2 * math.pi)


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
        self._notches: dict[float, float | None] = {}
        motion = self.axis.motion
        self._plant = None if motion is None else plant_of(motion, task.period, self.lags.delay, self.lags.drives)

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
        # the frequency that is found, and the ones before it, are asked for again
        if frequency not in self._notches:
            self._notches[frequency] = self._notch_at(frequency)
        return self._notches[frequency]

    def _notch_at(self, frequency: float) -> float | None:
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
        return f"{self.trouble(frequency)}, and its mode of {mode:.0f} Hz is {where} half the servo's, {nyquist:.4g} Hz"

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
            (roots.imag > 0) & (-roots.real < _SWINGING_DAMPING * np.abs(roots)) & (roots.imag * period < 0.9 * math.pi)
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
        beside = below * (1 + _MODE_OFFSET)
        return float(below[np.abs(self._plant.loop(plain, beside)[:, 0]).argmax()])


class CoupledLoops:
    """The loops of axes that move each other, all closed."""

    def __init__(self, task: LoopTask, loops: Sequence[AxisLoop], members: Sequence[int]) -> None:
        motion = task.axes[members[0]].coupled
        assert motion is not None  # they are a group
        self._task = task
        self._loops = [loops[a] for a in members]
        self._drives = task.lags.drives.of_axes(members)
        self._plant = plant_of(motion, task.period, task.lags.delay, self._drives)

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
        return f"{name} has a gain margin of {text_beside(gain, LEAST_GAIN_MARGIN, 3)} (at least {LEAST_GAIN_MARGIN:g})"
    peak = text_beside(margins.sensitivity, LARGEST_PEAK, 4)
    return f"{name} has a peak of |S| of {peak} (at most {LARGEST_PEAK:g})"
