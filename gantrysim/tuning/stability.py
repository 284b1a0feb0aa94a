"""The margin that every candidate keeps: how near the loops of several machines come to instability.

A gain margin of M alone lets a loop through whose phase margin is next to nothing. It is therefore asked for in every
direction: the open loop L stays as far from -1 as it does where it crosses the real axis at -1/M,

    |1 + L| >= 1 - 1/M,        that is, the peak of |S| = |1/(1 + L)| is at most M/(M - 1).

The gain margin is then at least M and the phase margin at least 2 asin((1 - 1/M)/2): 29 degrees where M is 2.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gantrysim.arrays import Floats
from gantrysim.controllers.servo import Servo
from gantrysim.errors import InputError, finite
from gantrysim.machine.machine import Machine
from gantrysim.stability.linear_model import Complexes
from gantrysim.stability.margins import Margins, Plant
from gantrysim.tuning.laws import Space

_UNSTABLE = 10.0  # excess of a loop that is next to stable: more than that of any that is
_LEAST_GAIN = 1e-6
_STEP = 0.03  # first one of the search for a bracket [decades of w]
_CLOSE = 0.002  # width of the bracket that will do [decades of w]
_NEAR = 0.003  # of the excess to 0, that will do as well
_REACH = 2.0  # of the natural frequency, on both sides [decades of w]


def phase_margin(margin: float) -> float:
    """Return the phase margin that a margin M brings with it [deg]."""
    return 2 * math.degrees(math.asin(0.5 * (1 - 1 / margin)))


@dataclass(frozen=True)
class Fastest:
    """The fastest loops of a shape that keep the margin.

    Attributes:
        frequencies: as of `Space`, (groups,).
        excess: of the margin there: at most 0, unless no frequency keeps it.
        binding: numbers of the machines that bound it.
    """

    frequencies: Floats
    excess: float = 0.0
    binding: tuple[int, ...] = (0,)


class Stability:
    """The margin on several machines.

    Args:
        machines: at least one, with the same axes.
        period: of the servos [s].
        delay: of the servos [s].
        margin: M.
        physics_step: as of `gantrysim.simulate` [s].

    Raises:
        InputError: a margin that is not above 1, or a machine whose margins cannot be told.
    """

    def __init__(
        self,
        machines: Sequence[Machine],
        period: float,
        delay: float,
        margin: float,
        physics_step: float | None = None,
    ) -> None:
        if not finite("margin", margin) > 1:
            raise InputError(f"margin = {margin:g}: must be greater than 1, the factor at which a loop is lost")
        self.peak = margin / (margin - 1)
        self._plants = [Plant.of(machine, period, delay, physics_step=physics_step) for machine in machines]
        self._known: dict[tuple[Servo, int], tuple[Margins, ...]] = {}

    def margins(self, servo: Servo, machine: int = 0) -> tuple[Margins, ...]:
        """Return the margins of every axis on one of the machines."""
        known = self._known.get((servo, machine))
        if known is None:
            known = self._known[servo, machine] = self._plants[machine].margins(servo)
        return known

    def loop(self, servo: Servo, frequency: Floats, machine: int = 0) -> Complexes:
        """Return the open loop L of every axis on one of the machines, (n, axes).

        Args:
            servo: the servo.
            frequency: above 0 and at most half the servo's, (n,) [Hz].
            machine: its number.
        """
        return self._plants[machine].loop(servo, frequency)

    def excess(self, servo: Servo, machines: Sequence[int] | None = None) -> Floats:
        """Return by how much the peak of |S| exceeds its bound, the worst of the machines, (axes,).

        It is log(peak / bound), at most 0 where the margin is kept; of a loop that is not stable 10 and more, the more
        the smaller the share of its gains with which it would be.

        Args:
            servo: the servo.
            machines: numbers of the machines that are looked at, by default all.
        """
        looked_at = range(len(self._plants)) if machines is None else machines
        excess = [[self._excess(own) for own in self.margins(servo, k)] for k in looked_at]
        return np.max(excess, axis=0)

    def _excess(self, margins: Margins) -> float:
        if margins.stable:
            return math.log(max(margins.sensitivity, _LEAST_GAIN) / self.peak)
        return _UNSTABLE - math.log(max(margins.gain, _LEAST_GAIN))

    def fastest(self, space: Space, shape: Floats, guess: Fastest) -> Fastest:
        """Return the fastest loops of a shape that keep the margin on all machines.

        Every group of axes is made as fast as it can be; where axes move each other, all together if need be.

        Args:
            space: of the servos.
            shape: as of the space, (shapes,).
            guess: those of another shape: the machines that bound them are tried first.
        """
        at, binding, together = guess.frequencies, guess.binding, False
        while True:
            found = self._edge(space, shape, at, binding, together)
            if found.excess > 0:
                return found
            servo = space.servo(found.frequencies, shape)
            excess = [float(self.excess(servo, [k]).max()) for k in range(len(self._plants))]
            worst = int(np.argmax(excess))
            if excess[worst] <= 0:
                return Fastest(found.frequencies, binding=(max(binding, key=lambda k: excess[k]),))
            at = found.frequencies
            if worst in binding:  # by itself each group was at its own edge
                at, together = at - _STEP, True
            else:
                binding = (*binding, worst)

    def _edge(self, space: Space, shape: Floats, guess: Floats, machines: Sequence[int], together: bool) -> Fastest:
        """Find the frequency of every group by itself, or a shift of all together, on some of the machines.

        A bracket, then false position; halves where a loop at its upper end is not stable.
        """
        low, high = np.full(space.groups, -np.inf), np.full(space.groups, np.inf)
        kept, missed = np.full(space.groups, -np.inf), np.full(space.groups, np.inf)  # excess at low and at high
        least = np.full(space.groups, np.inf)
        at, step = guess, _STEP
        while True:
            excess = self.excess(space.servo(at, shape), machines).reshape(space.groups, -1).max(axis=1)
            if together:
                excess = np.full(space.groups, excess.max())
            least, keeps = np.minimum(least, excess), excess <= 0
            low, kept = np.where(keeps, at, low), np.where(keeps, excess, kept)
            high, missed = np.where(keeps, high, at), np.where(keeps, missed, excess)
            none_kept, none_missed = np.isneginf(low), np.isposinf(high)
            if np.any(none_kept & (high < np.minimum(guess, 0) - _REACH)):
                return Fastest(at, float(least.max()), tuple(machines))
            done = (high - low <= _CLOSE) | (kept > -_NEAR) | (low > np.maximum(guess, 0) + _REACH)
            if done.all():
                return Fastest(low)
            with np.errstate(invalid="ignore"):  # where one of them is not yet known
                share = np.where(missed < _UNSTABLE, np.clip(kept / (kept - missed), 0.1, 0.9), 0.5)
                inside = low + share * (high - low)
            at = np.where(none_kept, high - step, np.where(none_missed, low + step, inside))
            at = np.where(done, low, at)
            step *= 2
