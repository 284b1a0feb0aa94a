"""How far a servo is from instability: margins of the sampled loop of each axis, with all of its lag in it.

The machine is MuJoCo's own step made linear, so rotor, load, the compliance between them, winding, hold and delay are
the simulation's. Quantisation of the encoder, limits of torque and voltage, and Coulomb friction are left out.
"""

# ruff: noqa: N806 - functions of z have the letters of the law

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
from gantrysim.stability.linear_model import Complexes, Linear, UnknownLoopError, linearised
from gantrysim.stability.loops import Gridded, Loops

_MIN_GAIN = 1e-6  # a loop that is stable down to this has no lower gain margin
_REAL = 1e-6  # imaginary part of a loop that counts as real, relative


@dataclass(frozen=True)
class Margins:
    """How far the loop of one axis is from instability, broken where its torque demand leaves the servo.

    Stable is what comes to rest at its position. A loop without kp, or with no gain at all, holds none: it leaves a
    pole at z = 1, and counts as not stable, with a gain of 0.

    Attributes:
        gain: largest factor on the axis' gains up to which the loop is stable; inf where there is none. Of a loop
            that is not stable, the largest below 1, and 0 where there is none.
        gain_lower: smallest factor down to which it is stable; 0 where there is none.
        phase: smallest turn of the loop's phase, lag or lead, that makes it unstable, 180 where none does; of a loop
            that is not stable, 0 [deg].
        delay: smallest lag that makes it unstable, inf where none does; of a loop that is not stable, 0 [s].
        sensitivity: peak of |S| = |1/(1 + L)|; of a loop that is not stable, inf.
        crossover: lowest frequency at which |L| falls below 1; 0 where it is below at every frequency [Hz].
        stable: whether the loop is.
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
            return "unstable" + (f", stable with {self.gain:.2g} of its gains" if self.gain > 0 else "")
        return f"gain {self.gain:.3g}, phase {self.phase:.0f} deg, crossover {self.crossover:.3g} Hz"


class Plant:
    """A machine as a servo of one period and delay sees it.

    The loop of an axis has all the others closed by the same servo, as they are on the machine. Where no axis moves
    another, as on a gantry, they make no difference, and an axis is stable or not by itself; axes that do move each
    other are stable or not together.

    Args:
        period: servo period T [s].
        delay: from the sample to the output [s].
        systems: of the axes that move each other.
    """

    def __init__(self, period: float, delay: float, systems: list[Linear]) -> None:
        self.period = period
        self.delay = delay
        self.axes = sum(len(system.axes) for system in systems)
        self._grids = [Gridded.of(system) for system in systems]

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
        """Return the plant of a machine, made linear at rest.

        Args:
            machine: the machine.
            period: servo period [s].
            delay: from the sample to the output, a multiple of the physics step and at most the period [s].
            physics_step: as of `gantrysim.simulate` [s].
            position: of the axes, home by default, (axes,) [mm or deg].

        Raises:
            InputError: a period, a delay or a physics step that `gantrysim.simulate` refuses; a position that is
                not one finite number per axis.
            UnknownLoopError: an actuator that has a delay of its own.
        """
        substeps = substeps_of(machine, positive("servo period", period, "s"), physics_step)
        if at_least("servo delay", delay, 0, "s") > period:
            raise InputError(f"servo delay = {delay:g} s: must be at most the period, {period:g} s")
        return cls(period, delay, linearised(machine, period, substeps, delay_steps(delay, period, substeps), position))

    def margins(self, servo: Servo) -> tuple[Margins, ...]:
        """Return the margins of every axis' loop.

        Args:
            servo: of the plant's axes, period and delay.

        Raises:
            InputError: a servo of others.
        """
        self._check(servo)
        found: dict[int, Margins] = {}
        for grid in self._grids:
            found |= zip(grid.system.axes, _margins(Loops(grid, servo)), strict=True)
        return tuple(found[a] for a in range(self.axes))

    def loop(self, servo: Servo, frequency: ArrayLike) -> Complexes:
        """Return L, the open loop of every axis with all others closed, (n, axes).

            L = C P of an axis by itself,        C(z) = kp + ki T/(1 - z^-1) + (kd - output_velocity) (1 - z^-1)/T

        Args:
            servo: of the plant's axes, period and delay.
            frequency: above 0 and at most half the servo's, (n,) [Hz].
        """
        self._check(servo)
        theta = 2 * np.pi * self.period * np.atleast_1d(np.asarray(frequency, float))
        if not ((theta > 0) & (theta <= np.pi * (1 + 1e-9))).all():
            raise InputError(f"frequency: must be above 0 and at most {0.5 / self.period:g} Hz")
        found = np.empty((len(theta), self.axes), complex)
        for grid in self._grids:
            found[:, grid.system.axes] = Loops(grid, servo).at(theta)
        return found

    def poles(self, servo: Servo) -> Complexes:
        """Return the poles of the machine with all loops closed, those outside the unit circle being unstable, (n,).

        Args:
            servo: of the plant's axes, period and delay.
        """
        self._check(servo)
        return np.concatenate([Loops(grid, servo).poles() for grid in self._grids])

    def _check(self, servo: Servo) -> None:
        if servo.axes != self.axes:
            raise InputError(f"servo has {servo.axes} axes: the plant has {self.axes}")
        for name in ("period", "delay"):
            given, own = getattr(servo, name), getattr(self, name)
            if abs(given - own) > 1e-12:
                raise InputError(f"servo {name} = {given:g} s: must be the plant's, {own:g} s")


def margins_of(machine: Machine, servo: Servo, physics_step: float | None = None) -> tuple[Margins, ...] | None:
    """Return the margins of every axis' loop; None of a machine whose linear loop is not known.

    Args:
        machine: the machine.
        servo: its servo.
        physics_step: as of `gantrysim.simulate` [s].
    """
    try:
        plant = Plant.of(machine, servo.period, servo.delay, physics_step=physics_step)
    except UnknownLoopError:
        return None
    return plant.margins(servo)


def _margins(loops: Loops) -> list[Margins]:
    """Return the margins of each axis."""
    L = loops.open(loops.grid.theta, loops.grid.P)
    found, stable = loops.crossings(L), loops.stable()
    peaks = loops.peaks(L) if stable else np.full(len(loops.kp), np.inf)
    margins = []
    for a in range(len(loops.kp)):
        real, unit = (found.of(a, unit=kind) for kind in (False, True))
        ends = L[[0, -1], a]  # where the loop is real, or next to it
        crossed = np.append(real.L.real, ends.real[np.abs(ends.imag) < _REAL * np.abs(ends)])
        low, high = _factors(loops, a, -1 / crossed[crossed < 0], stable)
        turn = np.angle(-unit.L)  # what the phase has above -180 degrees
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
    """Return the ends of the factors that keep an axis stable, given those at which a pole is on the circle."""
    critical = np.sort(critical[critical > _MIN_GAIN])
    bounds = [0.0, *critical[critical < 1].tolist()]
    if stable:
        return bounds[-1], float(critical[critical >= 1].min(initial=math.inf))
    for low, high in reversed(list(pairwise(bounds))):
        if loops.stable(axis, math.sqrt(low * high) or high / 2):
            return low, high
    return 0.0, 0.0
