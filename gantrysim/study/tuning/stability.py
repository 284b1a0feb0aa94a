"""The stability margin that every candidate keeps on several machines.

A gain margin of M alone admits loops with hardly any phase margin. The margin is therefore required in every direction:
the open loop L stays as far from -1 as it does where it crosses the real axis at -1/M,

    |1 + L| >= 1 - 1/M,        that is, the peak of |S| = |1/(1 + L)| is at most M/(M - 1).

The gain margin is then at least M and the phase margin at least 2 asin((1 - 1/M)/2): 29 degrees where M is 2.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gantrysim.base.arrays import Complexes, Floats
from gantrysim.base.errors import InputError, finite
from gantrysim.machine.machine import Machine
from gantrysim.servo.servo import Servo
from gantrysim.servo.stability.margins import Margins, Plant, sensitivities
from gantrysim.servo.stability.motion import Drives
from gantrysim.study.tuning.space import SearchSpace

_UNSTABLE_EXCESS = 10.0  # excess of a barely unstable loop, above that of any stable one
_MIN_GAIN = 1e-6
_BRACKET_STEP = 0.03  # first step of the search for a bracket [decades of w]
_WIDTH = 0.0003  # of the bracket at which the search ends [decades of w]
_TOLERANCE = 0.0005  # of the excess below 0, at which it ends as well
_DECADES_AROUND = 2.0  # to both sides of the natural frequency [decades of w]


def sensitivity_bound(margin: float) -> float:
    """Return the largest peak of |S| that a margin M admits.

    Raises:
        InputError: M is not above 1.
    """
    if not finite("margin", margin) > 1:
        raise InputError(f"margin = {margin:g}: must be greater than 1, the gain factor at which a loop turns unstable")
    return margin / (margin - 1)


def phase_margin(margin: float) -> float:
    """Return the phase margin that a margin M guarantees [deg]."""
    return 2 * math.degrees(math.asin(0.5 * (1 - 1 / margin)))


@dataclass(frozen=True)
class Fastest:
    """The fastest loops of a shape that keep the margin.

    Attributes:
        frequencies: as in `SearchSpace`, (groups,).
        excess: as in `Stability`: at most 0, unless no frequency keeps the margin.
        binding: numbers of the machines that limit the frequencies.
    """

    frequencies: Floats
    excess: float = 0.0
    binding: tuple[int, ...] = (0,)


_PLAIN_DRIVES = Drives()


class Stability:
    """Stability margins of servos on several machines.

    Args:
        machines: at least one, with the same axes.
        period: of the servos [s].
        delay: of the servos [s].
        margin: M.
        drives: of the servos.

    Attributes:
        peak: bound on the peak of |S|.
        machines: number of machines.

    Raises:
        InputError: a margin that is not above 1, or a machine whose margins cannot be computed.
    """

    def __init__(
        self,
        machines: Sequence[Machine],
        period: float,
        delay: float,
        margin: float,
        drives: Drives = _PLAIN_DRIVES,
    ) -> None:
        self.peak = sensitivity_bound(margin)
        self.machines = len(machines)
        self._plants = [Plant.of(machine, period, delay, drives=drives) for machine in machines]
        self._margins: dict[tuple[Servo, int], tuple[Margins, ...]] = {}
        # by servo and machine
        self._excesses: dict[Servo, dict[int, Floats]] = {}

    def margins(self, servo: Servo, machine: int = 0) -> tuple[Margins, ...]:
        """Return the margins of every axis on one of the machines."""
        key = servo, machine
        if key not in self._margins:
            self._margins[key] = self._plants[machine].margins(servo)
        return self._margins[key]

    def worst(self, servo: Servo) -> list[Margins]:
        """Return the worst margins of every axis over all machines, with the crossover on the first."""
        return [
            Margins(
                gain=min(margins.gain for margins in axis),
                gain_lower=max(margins.gain_lower for margins in axis),
                phase=min(margins.phase for margins in axis),
                delay=min(margins.delay for margins in axis),
                sensitivity=max(margins.sensitivity for margins in axis),
                crossover=axis[0].crossover,
                stable=all(margins.stable for margins in axis),
                together=min(margins.together for margins in axis),
            )
            for axis in zip(*(self.margins(servo, k) for k in range(self.machines)), strict=True)
        ]

    def loop(self, servo: Servo, frequency: Floats, machine: int = 0) -> Complexes:
        """Return the open loop L of every axis on one of the machines, (n, axes).

        Args:
            servo: the servo.
            frequency: above 0 and at most half the servo's, (n,) [Hz].
            machine: its number.
        """
        return self._plants[machine].loop(servo, frequency)

    def excess(self, servo: Servo, machines: Sequence[int] | None = None) -> Floats:
        """Return log(peak / bound) of the peak of |S|, the largest over the machines, (axes,).

        It is at most 0 where the margin is kept. An unstable loop has 10 or more; it grows as the factor on the gains
        at which the loop would be stable falls.

        Args:
            servo: the servo.
            machines: numbers of the machines, by default all.
        """
        chosen = range(self.machines) if machines is None else machines
        return self._excesses_on(servo, chosen).max(axis=0)

    def _excesses_on(self, servo: Servo, machines: Sequence[int]) -> Floats:
        """Return the excess on each of some machines, (machines, axes); where a loop is unstable, of its margins."""
        known = self._excesses.setdefault(servo, {})
        missing = [machine for machine in machines if machine not in known]
        if missing:
            peaks = sensitivities([self._plants[machine] for machine in missing], servo)
            for machine, of_axes in zip(missing, peaks, strict=True):
                if np.isfinite(of_axes).all():
                    known[machine] = np.log(np.maximum(of_axes, _MIN_GAIN) / self.peak)
                else:
                    known[machine] = np.array([self._excess_of(margins) for margins in self.margins(servo, machine)])
        return np.array([known[machine] for machine in machines])

    def _excess_of(self, margins: Margins) -> float:
        if margins.stable:
            return math.log(max(margins.sensitivity, _MIN_GAIN) / self.peak)
        return _UNSTABLE_EXCESS - math.log(max(margins.gain, _MIN_GAIN))

    def fastest(self, space: SearchSpace, shape: Floats, guess: Fastest) -> Fastest:
        """Return the fastest loops of a shape that keep the margin on all machines.

        Every group of axes is as fast as it can be by itself; coupled axes are slowed down together where needed.

        Args:
            space: of the servos.
            shape: in the space, (shapes,).
            guess: the fastest loops of another shape: the machines that limit them are tried first.
        """
        start = guess.frequencies
        binding = guess.binding
        together = False
        while True:
            # most machines never bind: the bracket is narrowed on the few that do, the others only check it
            edge = self._edge(space, shape, start, binding, together)
            if edge.excess > 0:
                return edge
            servo = space.servo(edge.frequencies, shape)
            excess = self._excesses_on(servo, range(self.machines)).max(axis=1).tolist()
            worst = int(np.argmax(excess))
            if excess[worst] <= 0:
                return Fastest(edge.frequencies, binding=(max(binding, key=lambda k: excess[k]),))
            start = edge.frequencies
            # coupled axes: each group kept the margin only by itself
            if worst in binding:
                start = start - _BRACKET_STEP
                together = True
            else:
                binding = (*binding, worst)

    def _edge(
        self, space: SearchSpace, shape: Floats, guess: Floats, machines: Sequence[int], together: bool
    ) -> Fastest:
        """Return the highest frequency of every group by itself, or one shift of all together, on some machines.

        A bracket is found, then narrowed by false position, or by halving where its upper end is unstable.
        """
        low = np.full(space.groups, -np.inf)
        high = np.full(space.groups, np.inf)
        excess_at_low = low.copy()
        excess_at_high = high.copy()
        least = high.copy()
        frequencies = guess
        step = _BRACKET_STEP
        while True:
            servo = space.servo(frequencies, shape)
            excess = self.excess(servo, machines).reshape(space.groups, -1).max(axis=1)
            if together:
                excess = np.full(space.groups, excess.max())
            least = np.minimum(least, excess)
            keeps = excess <= 0
            low = np.where(keeps, frequencies, low)
            excess_at_low = np.where(keeps, excess, excess_at_low)
            high = np.where(keeps, high, frequencies)
            excess_at_high = np.where(keeps, excess_at_high, excess)
            none_kept = np.isneginf(low)
            none_missed = np.isposinf(high)
            if np.any(none_kept & (high < np.minimum(guess, 0) - _DECADES_AROUND)):
                return Fastest(frequencies, float(least.max()), tuple(machines))
            done = (
                (high - low <= _WIDTH) | (excess_at_low > -_TOLERANCE) | (low > np.maximum(guess, 0) + _DECADES_AROUND)
            )
            if done.all():
                return Fastest(low)
            # where an end of the bracket is not known yet
            with np.errstate(invalid="ignore"):
                # the excess of an unstable loop jumps, so a straight line through it would mislead: halve instead
                false_position = np.clip(excess_at_low / (excess_at_low - excess_at_high), 0.1, 0.9)
                share = np.where(excess_at_high < _UNSTABLE_EXCESS, false_position, 0.5)
                inside = low + share * (high - low)
            frequencies = np.where(none_missed, low + step, inside)
            frequencies = np.where(none_kept, high - step, frequencies)
            frequencies = np.where(done, low, frequencies)
            step *= 2
