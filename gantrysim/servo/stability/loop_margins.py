"""Margins of loops from their crossings of the real axis and the unit circle."""

# ruff: noqa: N806 - functions of z bear the letters of the law

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.servo.stability.loops import Loops

_MIN_GAIN = 1e-6  # a loop that is stable down to this factor has no lower gain margin
# factors on all gains
_LEAST = 1e-3
_MOST = 10.0
_FACTORS = 60  # up to either, to begin with
_SHARP = 1e-6  # accuracy of a factor on all gains
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

    @property
    def least_gain(self) -> float:
        """The smaller of `gain` and `together`."""
        return min(self.gain, self.together)

    def __str__(self) -> str:
        if self == NO_LOOP:
            return "without a loop"
        if not self.stable:
            # rounded down, so that the factor that is shown makes it stable
            return "unstable" + (f", stable with its gains times {_rounded_down(self.gain):g}" if self.gain > 0 else "")
        return f"gain {self.gain:.3g}, phase {self.phase:.0f} deg, crossover {self.crossover:.3g} Hz"


def _rounded_down(factor: float) -> float:
    """Return a positive factor rounded down to two significant digits."""
    unit = 10.0 ** (math.floor(math.log10(factor)) - 1)
    return math.floor(factor / unit) * unit


NO_LOOP = Margins(math.inf, 0.0, 180.0, math.inf, 1.0, 0.0, stable=True, together=math.inf)  # nothing is fed back


def margins_of_loops(loops: Loops) -> list[Margins]:
    """Return the margins of each axis of a group of loops."""
    L = loops.open(loops.plant.theta, loops.plant.P)
    crossings = loops.crossings(L)
    stable = loops.stable()
    peaks = loops.peaks(L) if stable else np.full(len(loops.laws), np.inf)
    margins = []
    together = _together(loops)
    for a in range(len(loops.laws)):
        real = crossings.of(a, unit=False)
        unit = crossings.of(a, unit=True)
        ends = L[[0, -1], a]  # here the loop is real, or nearly so
        crossed = np.append(real.L.real, ends.real[np.abs(ends.imag) < _REAL * np.abs(ends)])
        # a factor -1/L on the gains takes a real L to -1
        low, high = _factors(loops, a, -1 / crossed[crossed < 0], stable)
        turn = np.angle(-unit.L)  # phase above -180 degrees
        lag = turn % (2 * np.pi) / unit.theta * loops.T  # a delay turns L by theta per sample, clockwise only
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
        if loops.stable(axes, middle):
            low = middle
        else:
            high = middle
    return low
