"""Gains that follow from the axes: from inertia, lags, and the mode in which each axis swings on its drive."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple, Protocol

import numpy as np

from gantrysim.controllers import notch
from gantrysim.controllers.law import GAIN_NAMES
from gantrysim.controllers.laws.defaults import law_values
from gantrysim.controllers.laws.friction import Friction
from gantrysim.controllers.laws.linear import linear_law
from gantrysim.controllers.laws.parameters import PID, ZV, ZVD
from gantrysim.controllers.laws.user import LawName
from gantrysim.errors import between, positive
from gantrysim.stability.compensator import Compensator
from gantrysim.stability.margins import NO_LOOP, Laws, Margins, Plant
from gantrysim.stability.motion import Drives, Motion

LEAST_GAIN_MARGIN = 2.0  # of every derived loop
LARGEST_PEAK = 2.0  # of its |S|

# Narrow enough to leave phase at the crossover, wide enough for a mode that is off by a tenth.
NOTCH_WIDTH = 0.35
NOTCH_DEPTH = 0.1

SWINGS = 0.3  # damping ratio below which a closed loop's mode is to be left out by input shaping

FREQUENCIES = (1e-3, 1e5)  # natural frequencies that can be given [Hz]

_SLOWER = 0.97  # from one frequency tried to the next
_SLOWEST = 1e-3  # relative to what the lags leave room for
_BESIDE = 1e-5
_BELOW_NYQUIST = 0.9  # highest frequency of a notch, relative


class AxisDynamics(Protocol):
    """What the derivation of gains needs to know of an axis."""

    @property
    def name(self) -> str:
        """Of the axis."""

    @property
    def inertia(self) -> float:
        """Motor torque per acceleration of the axis [N·m·s²/mm]."""

    @property
    def viscous(self) -> float:
        """Motor torque per speed of the axis [N·m·s/mm]."""

    @property
    def lag(self) -> float:
        """Time constant from torque demand to torque [s]."""

    @property
    def peak_torque(self) -> float:
        """Largest torque the drive delivers [N·m]."""

    @property
    def resolution(self) -> float:
        """Axis travel per encoder count, 0 for an exact measurement [mm]."""

    @property
    def friction(self) -> Friction:
        """Friction at the motor."""

    @property
    def mode(self) -> str:
        """What its drive is made to be told, one of `MODES`."""

    @property
    def motion(self) -> Motion | None:
        """Linear motion of the axis alone; None if it is not known, and no mode is taken into account."""

    @property
    def chain(self) -> Motion | None:
        """Linear motion of all axes, where a closed chain couples them; None if none does."""


class Lags(NamedTuple):
    """What makes the loops of a servo late, besides its period and the machine.

    Attributes:
        delay: from sample to output [s].
        feedback: from the encoder to the servo [servo periods].
        drives: feedback and current loops of the drives.
    """

    delay: float = 0.0
    feedback: int = 0
    drives: Drives = Drives()

    def of_axis(self, axis: int) -> Lags:
        """Return those of one axis."""
        return self._replace(drives=self.drives.of_axes([axis]))

    def winding(self, axis: AxisDynamics) -> float:
        """Return the time constant of the torque, given those of one axis [s]."""
        width = max(self.drives.bandwidth, default=0.0)
        return 1 / (2 * math.pi * width) if width else axis.lag


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
def loop(
    axes: tuple[AxisDynamics, ...],
    period: float,
    frequency: float | None,
    damping: float,
    integral_time: float,
    lags: Lags,
    law: tuple[LawName, ...] = (PID,),
    notched: bool = True,
) -> Loop:
    """Return the fastest loop that keeps a gain margin of 2 and |S| <= 2 on every axis.

    The lags of winding, sampling and output leave room for a natural frequency, see `natural_frequency`. An axis that
    would not keep the margins at it, for it swings on its drive, gets a notch at that mode. Where a notch does not do,
    or the mode is too near half the servo's frequency, all axes are slowed down until they keep the margins. So are
    axes in a closed chain until each keeps them with all loops closed, and all together a gain margin of 2.

    Args:
        axes: the machine's axes.
        period: servo period [s].
        frequency: natural frequency that is to be taken, whatever the margins are; None for the fastest [Hz].
        damping: damping ratio zeta.
        integral_time: kp / ki [s].
        lags: what makes the loops late, of axes that all take torques.
        law: names of the laws in the loops.
        notched: whether there may be notches.
    """
    own = [lags.of_axis(a) for a in range(len(axes))]
    loops = [_AxisLoop(axis, period, damping, integral_time, own[a], law, notched) for a, axis in enumerate(axes)]
    if frequency is not None:
        at, why = between("frequency", frequency, *FREQUENCIES, "Hz"), f"natural frequency {frequency:.4g} Hz, as given"
    else:
        slowest = max(one.lags.winding(one.axis) for one in loops)
        lag = slowest + period + lags.delay + lags.feedback * period
        at = room = natural_frequency(lag, damping)
        bound, chain = "", _Chain.of(axes, loops, period, lags)
        while at > _SLOWEST * room:
            failing = next((one for one in loops if one.notch_at(at) is None), None)
            trouble = failing.limit(at) if failing else chain.trouble(at) if chain else ""
            if not trouble:
                break
            bound, at = trouble, at * _SLOWER
        why = f"natural frequency {at:.3g} Hz: "
        if bound:
            why += f"at more, {bound}; the lags alone leave room for {room:.3g} Hz"
        else:
            why += f"the lags of sampling, output and winding, {1e3 * lag:.3g} ms, leave room for no more"
    notches = tuple(one.notch_at(at) or notch.NONE for one in loops)
    for one, mode in zip(loops, notches, strict=True):
        if mode != notch.NONE:
            why += f"; notch of {one.axis.name} at its mode of {mode:.0f} Hz, without it {one.trouble(at)}"
    return Loop(at, notches, why)


class _AxisLoop:
    """The loop of one axis, by its natural frequency and with or without a notch."""

    def __init__(
        self,
        axis: AxisDynamics,
        period: float,
        damping: float,
        integral_time: float,
        lags: Lags,
        names: tuple[LawName, ...] = (PID,),
        notched: bool = True,
    ) -> None:
        self.axis, self.period, self.lags, self._names, self._notched = axis, period, lags, names, notched
        self._damping, self._integral_time = damping, integral_time
        self._plant = None if axis.motion is None else Plant(axis.motion, period, lags.delay, lags.drives)

    def law(self, frequency: float, mode: float) -> Compensator:
        """Return the law at a natural frequency with a notch at a mode, `notch.NONE` for none."""
        gains = pd_gains(self.axis, frequency, self._damping, self._integral_time)
        own = tuple(gains.get(name, 0.0) for name in GAIN_NAMES)
        filter = notch.coefficients(mode, NOTCH_WIDTH, NOTCH_DEPTH, self.period)
        values = self.law_values(frequency)
        return linear_law(self._names, own, filter, values, self.period, self.lags.delay, self.lags.feedback)

    def law_values(self, frequency: float) -> dict[str, float]:
        """Return the parameters of the laws at a natural frequency."""
        return law_values(self._names, self.axis, frequency, self.lags.winding(self.axis), self.period)

    def notch_at(self, frequency: float) -> float | None:
        """Return the notch with which the axis keeps its margins, `notch.NONE` if without, None if with none."""
        if kept(self._margins(frequency)):
            return notch.NONE
        mode = self._mode(frequency)
        return mode if self._usable(mode) and kept(self._margins(frequency, mode)) else None

    def limit(self, frequency: float) -> str:
        """Return what is wrong at a natural frequency at which no notch helps, in words."""
        mode = self._mode(frequency)
        if not mode:
            return self.trouble(frequency)
        if self._usable(mode):
            return f"{self.trouble(frequency, mode)} even with a notch at its mode of {mode:.0f} Hz"
        if not self._notched:
            return self.trouble(frequency)
        nyquist = 0.5 / self.period
        where = "above" if mode > nyquist else "too near"
        return f"{self.trouble(frequency)}, and its mode of {mode:.0f} Hz is {where} half the servo's, {nyquist:.0f} Hz"

    def trouble(self, frequency: float, mode: float = notch.NONE) -> str:
        """Return which margin a notch, or none, leaves too small, in words."""
        found, name = self._margins(frequency, mode), self.axis.name
        if found.gain < LEAST_GAIN_MARGIN:
            return f"{name} has a gain margin of {found.gain:.3g} (at least {LEAST_GAIN_MARGIN:g})"
        return f"{name} has a peak of |S| of {found.sensitivity:.4g} (at most {LARGEST_PEAK:g})"

    def slowest_swing(self, frequency: float, mode: float) -> tuple[float, float]:
        """Return frequency [Hz] and damping ratio of the closed loop's slowest mode that swings, 0 without one."""
        if self._plant is None:
            return 0.0, 0.0
        roots = np.log(self._plant.poles(self._laws(frequency, mode)).astype(complex) + 1e-300) / self.period
        swings = roots[
            (roots.imag > 0) & (-roots.real < SWINGS * np.abs(roots)) & (roots.imag * self.period < 0.9 * math.pi)
        ]
        if not swings.size:
            return 0.0, 0.0
        slowest = swings[np.abs(swings).argmin()]
        return float(np.abs(slowest)) / (2 * math.pi), max(float(-slowest.real / np.abs(slowest)), 0.0)

    def _usable(self, mode: float) -> bool:
        return self._notched and 0 < mode < _BELOW_NYQUIST * 0.5 / self.period

    def _margins(self, frequency: float, mode: float = notch.NONE) -> Margins:
        if self._plant is None:
            return NO_LOOP
        return self._plant.margins(self._laws(frequency, mode))[0]

    def _laws(self, frequency: float, mode: float) -> Laws:
        return Laws(self.period, self.lags.delay, (self.law(frequency, mode),), self.lags.drives)

    def _mode(self, frequency: float) -> float:
        """Return the frequency of the mode at which the loop is largest, 0 without modes [Hz]."""
        if self.axis.motion is None or self._plant is None:
            return 0.0
        modes = self.axis.motion.resonances()
        below = modes[modes < 0.5 / self.period]
        if not below.size:
            return float(modes.min(initial=math.inf)) if modes.size else 0.0
        plain = self._laws(frequency, notch.NONE)
        beside = below * (1 + _BESIDE)  # the loop has no bound at a mode without damping
        return float(below[np.abs(self._plant.loop(plain, beside)[:, 0]).argmax()])


class _Chain:
    """The loops of axes in a closed chain, all closed."""

    def __init__(self, motion: Motion, loops: Sequence[_AxisLoop], period: float, lags: Lags) -> None:
        self.period, self.lags, self._loops = period, lags, loops
        self._plant = Plant(motion, period, lags.delay, lags.drives)

    @classmethod
    def of(cls, axes: Sequence[AxisDynamics], loops: Sequence[_AxisLoop], period: float, lags: Lags) -> _Chain | None:
        """Return the chain of the axes, None if there is none."""
        motion = axes[0].chain
        return None if motion is None else cls(motion, loops, period, lags)

    def trouble(self, frequency: float) -> str:
        """Return which margin is too small at a natural frequency, in words; empty if none is."""
        each = tuple(one.law(frequency, one.notch_at(frequency) or notch.NONE) for one in self._loops)
        found_of = self._plant.margins(Laws(self.period, self.lags.delay, each, self.lags.drives))
        for one, found in zip(self._loops, found_of, strict=True):
            gain, name = min(found.gain, found.together), one.axis.name
            if gain < LEAST_GAIN_MARGIN:
                return f"{name} in its chain has a gain margin of {gain:.3g} (at least {LEAST_GAIN_MARGIN:g})"
            if found.sensitivity > LARGEST_PEAK:
                return f"{name} in its chain has a peak of |S| of {found.sensitivity:.4g} (at most {LARGEST_PEAK:g})"
        return ""


def pd_gains(axis: AxisDynamics, frequency: float, damping: float, integral_time: float) -> dict[str, float]:
    """Return the gains that place the poles of the continuous loop of an axis' inertia: kp = J w^2, kd = 2 zeta J w."""
    w = 2 * math.pi * frequency
    kp = axis.inertia * w**2
    return {"kp": kp, "ki": kp / integral_time, "kd": 2 * damping * axis.inertia * w}


def derived_laws(
    axes: Sequence[AxisDynamics],
    found: Loop,
    law: tuple[LawName, ...],
    period: float,
    damping: float,
    integral_time: float,
    lags: Lags,
) -> list[dict[str, float]]:
    """Return the parameters of each axis' laws, see `LAW_PARAMETERS`.

    Args:
        axes: the machine's axes.
        found: their loop.
        law: names.
        period: as of `loop`; so the others.
        damping: zeta.
        integral_time: kp / ki [s].
        lags: what makes the loops late.
    """
    each = []
    for a, (axis, mode) in enumerate(zip(axes, found.notches, strict=True)):
        own = _AxisLoop(axis, period, damping, integral_time, lags.of_axis(a), law)
        values = own.law_values(found.frequency)
        if ZV in law or ZVD in law:
            values["shaper_frequency"], values["shaper_damping"] = own.slowest_swing(found.frequency, mode)
        each.append(values)
    return each


def nominal_motions(axes: Sequence[AxisDynamics]) -> tuple[Motion, ...]:
    """Return the motion of each axis alone, or of all axes in one where a chain couples them; none if unknown."""
    if axes[0].chain is not None:
        return (axes[0].chain,)
    return tuple(axis.motion for axis in axes if axis.motion is not None)


def natural_frequency(lag: float, damping: float, kept: float = 2 / 3) -> float:
    """Return the natural frequency at which a PD loop with a lag keeps a share of its phase margin [Hz].

    The loop L(s) = (2 zeta w s + w^2) / s^2 crosses over at wc = w c, c^2 = 2 zeta^2 + sqrt(4 zeta^4 + 1),
    with the phase margin atan(2 zeta c): 76 degrees where zeta is 1. A lag tau takes wc tau of it, so that
    w = (1 - kept) atan(2 zeta c) / (c tau). For a sampled servo tau is the drive's time constant plus one
    period: half of it for the hold and half for the difference that stands for the derivative.

    Args:
        lag: tau [s].
        damping: damping ratio zeta.
        kept: share of the phase margin that remains.
    """
    zeta = positive("damping", damping)
    c = math.sqrt(2 * zeta**2 + math.sqrt(4 * zeta**4 + 1))
    return (1 - kept) * math.atan(2 * zeta * c) / (c * positive("lag", lag, "s")) / (2 * math.pi)


def kept(margins: Margins) -> bool:
    """Return whether a loop keeps the margins of derived ones."""
    return margins.gain >= LEAST_GAIN_MARGIN and margins.sensitivity <= LARGEST_PEAK
