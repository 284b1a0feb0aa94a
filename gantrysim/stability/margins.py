"""Stability margins of the sampled loop of each axis.

The machine is MuJoCo's step, linearised: rotor, load, compliance, winding, hold and delay are those of the simulation.
Encoder quantisation, torque and voltage limits and Coulomb friction are left out.
"""

# ruff: noqa: N806 - functions of z bear the letters of the law

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from gantrysim.arrays import Floats
from gantrysim.controllers.servo import Servo
from gantrysim.errors import InputError, at_least, positive
from gantrysim.machine.machine import Machine
from gantrysim.machine.timing import delay_steps, substeps_of
from gantrysim.stability.linear_model import Complexes, LinearSystem, UnknownLoopError, linearise
from gantrysim.stability.loops import FrequencyResponse, Loops

_MIN_GAIN = 1e-6  # a loop that is stable down to this factor has no lower gain margin
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
    """

    gain: float
    gain_lower: float
    phase: float
    delay: float
    sensitivity: float
    crossover: float
    stable: bool

    def __str__(self) -> str:
        if not self.stable:
            return "unstable" + (f", stable with its gains times {self.gain:.2g}" if self.gain > 0 else "")
        return f"gain {self.gain:.3g}, phase {self.phase:.0f} deg, crossover {self.crossover:.3g} Hz"


class Plant:
    """A linearised machine for servos of one period and delay.

    The loop of an axis has all others closed by the same servo. Axes that do not move each other, as on a gantry, are
    stable or unstable separately; coupled axes are so together. The methods raise InputError for a servo of another
    number of axes, period or delay.

    Args:
        period: servo period T [s].
        delay: time from sample to output [s].
        systems: one per group of axes that move each other.
    """

    def __init__(self, period: float, delay: float, systems: list[LinearSystem]) -> None:
        self.period = period
        self.delay = delay
        self.axes = sum(len(system.axes) for system in systems)
        self._responses = [FrequencyResponse.of(system) for system in systems]

    @classmethod
    def of(
        cls,
        machine: Machine,
        period: float,
        delay: float = 0.0,
        *,
        physics_step: float | None = None,
        position: ArrayLike | None = None,
    ) -> Plant:
        """Return the plant of a machine linearised at rest.

        Args:
            machine: the machine.
            period: servo period [s].
            delay: time from sample to output, a multiple of the physics step and at most the period [s].
            physics_step: as for `gantrysim.simulate` [s].
            position: position of the axes, by default zero, (axes,) [mm or deg].

        Raises:
            InputError: a period, delay or physics step that `gantrysim.simulate` rejects, or a position that is not one
                finite number per axis.
            UnknownLoopError: an actuator has a delay in the MJCF.
        """
        substeps = substeps_of(machine, positive("servo period", period, "s"), physics_step)
        if at_least("servo delay", delay, 0, "s") > period:
            raise InputError(f"servo delay = {delay:g} s: must be at most the period, {period:g} s")
        return cls(period, delay, linearise(machine, period, substeps, delay_steps(delay, period, substeps), position))

    def margins(self, servo: Servo) -> tuple[Margins, ...]:
        """Return the margins of each axis."""
        margins: dict[int, Margins] = {}
        for loops in self._loops(servo):
            margins |= zip(loops.system.axes, _margins(loops), strict=True)
        return tuple(margins[a] for a in range(self.axes))

    def loop(self, servo: Servo, frequency: ArrayLike) -> Complexes:
        """Return L, the open loop of each axis with all others closed, (n, axes).

            L = C P of a single axis,        C(z) = kp + ki T/(1 - z^-1) + (kd - output_velocity) (1 - z^-1)/T

        Args:
            servo: the servo.
            frequency: above 0 and at most the Nyquist frequency of the servo, (n,) [Hz].
        """
        groups = self._loops(servo)
        theta = 2 * np.pi * self.period * np.atleast_1d(np.asarray(frequency, float))
        if not ((theta > 0) & (theta <= np.pi * (1 + 1e-9))).all():
            raise InputError(f"frequency: must be above 0 and at most {0.5 / self.period:g} Hz")
        L = np.empty((len(theta), self.axes), complex)
        for loops in groups:
            L[:, loops.system.axes] = loops.at(theta)
        return L

    def poles(self, servo: Servo) -> Complexes:
        """Return the closed-loop poles, unstable outside the unit circle, (n,)."""
        return np.concatenate([loops.poles() for loops in self._loops(servo)])

    def _loops(self, servo: Servo) -> list[Loops]:
        """Return the loops of each group of axes that move each other."""
        if servo.axes != self.axes:
            raise InputError(f"servo has {servo.axes} axes: the plant has {self.axes}")
        for name in ("period", "delay"):
            given, own = getattr(servo, name), getattr(self, name)
            if abs(given - own) > 1e-12:
                raise InputError(f"servo {name} = {given:g} s: must be the plant's, {own:g} s")
        return [Loops(response, servo) for response in self._responses]


def margins_of(machine: Machine, servo: Servo, physics_step: float | None = None) -> tuple[Margins, ...] | None:
    """Return the margins of each axis, or None if the machine cannot be linearised; arguments as for `simulate`."""
    try:
        plant = Plant.of(machine, servo.period, servo.delay, physics_step=physics_step)
    except UnknownLoopError:
        return None
    return plant.margins(servo)


def _margins(loops: Loops) -> list[Margins]:
    L = loops.open(loops.plant.theta, loops.plant.P)
    crossings, stable = loops.crossings(L), loops.stable()
    peaks = loops.peaks(L) if stable else np.full(len(loops.kp), np.inf)
    margins = []
    for a in range(len(loops.kp)):
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
        if loops.stable(axis, math.sqrt(low * high) or high / 2):
            return low, high
    return 0.0, 0.0
