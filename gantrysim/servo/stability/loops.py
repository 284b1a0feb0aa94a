"""Servo loops closed around a linear machine: frequency responses, crossings and poles."""

# ruff: noqa: N803, N806 - matrices and functions of z bear the letters of the law

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Complexes, Floats, compiled_view, read_only_view
from gantrysim.servo.stability.linear_system import (
    NARROW_DAMPING,
    Compensator,
    CompiledLaws,
    CompiledPlant,
    sensitivity_peaks,
)
from gantrysim.servo.stability.motion import LinearSystem

_LOWEST_FREQUENCY = 1e-5  # lowest frequency of the grid, relative to the Nyquist frequency
_PER_DECADE = 80
_AT_NYQUIST = 0.2  # distance from the Nyquist angle within which the grid is finer [rad]
_AROUND_A_PEAK = np.geomspace(1e-6, 0.03, 24)  # relative distances of these points from the peak
_HIGH_GAIN = 1e6  # gain at which the poles have reached the zeros
_ASYMPTOTIC = 1e-9  # least distance of a stable pole from the unit circle
_CROSSING_ACCURACY = 1e-8  # accuracy of a crossing, relative
_MOST_STEPS = 60  # iterations to find a crossing
_NO_LOOP = 1e-300  # magnitude of a loop without gains


@dataclass(frozen=True, eq=False)
class FrequencyResponse:
    """A linear system and its response on a grid of angles theta = 2 pi f T.

    Attributes:
        system: the system.
        theta: angles up to pi, the Nyquist frequency, (n,).
        P: response, (n, axes, axes) [mm/N·m or deg/N·m].
    """

    system: LinearSystem
    theta: Floats
    P: Complexes

    @classmethod
    def of(cls, system: LinearSystem) -> FrequencyResponse:
        """Return the response on a grid that resolves the system's modes."""
        theta = _grid(system)
        return cls(system, theta, system.response(np.exp(1j * theta)))

    @cached_property
    def compiled(self) -> CompiledPlant:
        """The response and its system as compiled functions take them."""
        system = self.system
        return CompiledPlant(
            theta=read_only_view(self.theta),
            w=read_only_view(-2 * np.sin(0.5 * self.theta) ** 2 + 1j * np.sin(self.theta)),
            P=read_only_view(self.P),
            F=compiled_view(system.F),
            G0=compiled_view(system.G0),
            G1=compiled_view(system.G1),
            H=compiled_view(system.H),
        )


def _grid(system: LinearSystem) -> Floats:
    """Return angles up to the Nyquist frequency, finer around lightly damped modes and zeros, (n,)."""
    count = round(-math.log10(_LOWEST_FREQUENCY) * _PER_DECADE)
    even = np.pi * np.logspace(math.log10(_LOWEST_FREQUENCY), 0, count + 1)
    # pairs of poles leave the circle near -1
    even = np.append(even, np.pi - even[even < _AT_NYQUIST][::4])
    G = system.G0 + system.G1
    roots = [np.linalg.eigvals(system.F)]
    # high gain takes the poles of an axis to its zeros
    for a in range(len(system.axes)):
        through = np.outer(G[:, a], system.H[a])
        strength = np.abs(system.H[a] @ G[:, a])
        with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
            drawn = system.F - _HIGH_GAIN / strength * through
        # not where the axis does not move at once
        if np.isfinite(drawn).all():
            roots.append(np.linalg.eigvals(drawn))
    z = np.concatenate(roots)
    z = z[np.abs(z) > 0]
    angle = np.angle(z)
    width = np.abs(np.log(np.abs(z)))
    peaked = (angle > 0) & (angle < np.pi) & (width < NARROW_DAMPING * angle)
    close = np.outer(np.append(1 - _AROUND_A_PEAK, 1 + _AROUND_A_PEAK), angle[peaked]).ravel()
    return np.unique(np.concatenate([even, close[(close > even[0]) & (close < np.pi)]]))


class Loops:
    """Servo loops around axes that move each other.

    Args:
        plant: frequency response of these axes.
        laws: the law of each axis.
        period: servo period [s].
    """

    def __init__(self, plant: FrequencyResponse, laws: Sequence[Compensator], period: float) -> None:
        self.plant = plant
        self.system = plant.system
        self.laws = tuple(laws)
        self.T = period

    def open(self, theta: Floats, P: Complexes) -> Complexes:
        """Return the open loop of each axis with the others closed, (n, axes).

        With S = (1 + C P)^-1, that of axis i is 1/S_ii - 1.
        """
        C = np.stack([law.response(np.exp(1j * theta)) for law in self.laws], axis=1)
        if len(self.laws) == 1:
            return C * P[:, 0]
        S = np.linalg.inv(np.eye(len(self.laws)) + C[:, :, None] * P)
        return np.asarray(1 / np.einsum("nii->ni", S) - 1, complex)

    def poles(self, axes: Sequence[int] = (), factor: float = 1.0) -> Complexes:
        """Return the closed-loop poles with the demands of some axes scaled by a factor."""
        scales = [factor if a in axes else 1.0 for a in range(len(self.laws))]
        system = self.system
        matrix = _closed_motion((system.F, system.G0, system.G1, system.H), self.laws, scales)
        return np.linalg.eigvals(matrix).astype(complex)

    @cached_property
    def closed_poles(self) -> Complexes:
        """Closed-loop poles of the loops as they are, without a factor."""
        return self.poles()

    def stable(self, axes: Sequence[int] = (), factor: float = 1.0) -> bool:
        """Return whether all closed-loop poles lie inside the unit circle, with the arguments of `poles`."""
        poles = self.poles(axes, factor) if len(axes) else self.closed_poles
        return bool(_are_stable(poles))

    def crossings(self, L: Complexes) -> Crossings:
        """Return the crossings of the real axis and the unit circle, given the loops on the grid, (n, axes)."""
        theta = np.log(self.plant.theta)
        size = np.maximum(np.abs(L), _NO_LOOP)
        values = np.stack([L.imag / size, np.log(size)])  # (2, n, axes)
        kind, k, axis = np.nonzero((values[:, :-1] >= 0) != (values[:, 1:] >= 0))
        unit = kind == 1
        a = theta[k]
        b = theta[k + 1]
        fa = values[kind, k, axis]
        fb = values[kind, k + 1, axis]
        falls = fa >= 0
        value = L[k + 1, axis]
        # regula falsi, Illinois variant
        for _ in range(_MOST_STEPS):
            if not len(k) or np.abs(fb).max() < _CROSSING_ACCURACY:
                break
            c = (a * fb - b * fa) / (fb - fa)
            value = self.at(np.exp(c))[np.arange(len(c)), axis]
            fc = np.where(unit, np.log(np.abs(value)), value.imag / np.abs(value))
            over = (fc >= 0) != (fb >= 0)
            a = np.where(over, b, a)
            fa = np.where(over, fb, 0.5 * fa)
            b = c
            fb = fc
        return Crossings(np.exp(b), axis, unit, falls, value)

    def at(self, theta: Floats) -> Complexes:
        """Return the open loops at given angles, (n, axes)."""
        return self.open(theta, self.system.response(np.exp(1j * theta)))

    def peaks(self) -> Floats:
        """Return the peak of |S| = |1/(1 + L)| of each axis of stable loops, (axes,)."""
        return sensitivity_peaks(self.plant.compiled, CompiledLaws.of(self.laws), self.closed_poles)


def _closed_motion(
    systems: tuple[Floats, Floats, Floats, Floats], laws: Sequence[Compensator], scales: Sequence[float]
) -> Floats:
    """Return the matrices of closed loops, by which their states change in a period, (..., size, size).

    The state is x, those of the laws, and the last u if an output is delayed.

    Args:
        systems: F, G0, G1 and H of `LinearSystem`, each with the same leading dimensions.
        laws: the law of each axis.
        scales: factors on their demands.
    """
    F, G0, G1, H = systems
    several = F.shape[:-2]
    n = F.shape[-1]
    m = len(laws)
    ends = np.cumsum([n, *(len(law.A) for law in laws)])  # of the laws' states
    delayed = bool(np.any(G0))
    size = ends[-1] + (m if delayed else 0)
    A = np.zeros((*several, size, size))
    u = np.zeros((*several, m, size))
    for a, (law, scale) in enumerate(zip(laws, scales, strict=True)):
        part = slice(ends[a], ends[a + 1])
        # the error is -H x: the command is zero
        u[..., a, :n] = -scale * law.D * H[..., a, :]
        u[..., a, part] = scale * law.C
        A[..., part, :n] = -law.B[:, None] * H[..., a, None, :]
        A[..., part, part] = law.A
    A[..., :n, :] = G1 @ u
    A[..., :n, :n] += F
    if delayed:
        A[..., :n, ends[-1] :] += G0
        A[..., ends[-1] :, :] = u
    return A


def peaks_of(loops: Sequence[Loops]) -> Floats:
    """Return the peaks of |S| of several loops, inf for unstable ones, (loops, axes); as `Loops.peaks`, but faster.

    Args:
        loops: with the same laws, around systems with the same numbers of states and axes.
    """
    laws = loops[0].laws
    systems = [loop.system for loop in loops]
    F, G0, G1, H = (np.stack([getattr(system, name) for system in systems]) for name in ("F", "G0", "G1", "H"))
    poles = np.linalg.eigvals(_closed_motion((F, G0, G1, H), laws, [1.0] * len(laws))).astype(complex)
    compiled = CompiledLaws.of(laws)
    peaks = np.full((len(loops), len(laws)), np.inf)
    for k in np.flatnonzero(_are_stable(poles)).tolist():
        peaks[k] = sensitivity_peaks(loops[k].plant.compiled, compiled, poles[k])
    return peaks


def _are_stable(poles: Complexes) -> NDArray[np.bool_]:
    """Return whether all poles of loops lie inside the unit circle, given poles (..., n)."""
    return np.abs(poles).max(axis=-1) < 1 - _ASYMPTOTIC


@dataclass(frozen=True, eq=False)
class Crossings:
    """Crossings of the real axis or the unit circle, (n,) each.

    Attributes:
        theta: angle.
        axis: axis of the loop.
        unit: whether the unit circle is crossed.
        falls: whether the imaginary part or the magnitude falls.
        L: value of the loop.
    """

    theta: Floats
    axis: NDArray[np.intp]
    unit: NDArray[np.bool_]
    falls: NDArray[np.bool_]
    L: Complexes

    def of(self, axis: int, *, unit: bool) -> Crossings:
        """Return the crossings of one axis, of the unit circle or of the real axis."""
        chosen = (self.axis == axis) & (self.unit == unit)
        return Crossings(*(value[chosen] for value in vars(self).values()))


# Margins of loops from their crossings of the real axis and the unit circle.

_MIN_GAIN = 1e-6  # a loop that is stable down to this factor has no lower gain margin
# factors on all gains
_LEAST_GAIN = 1e-3
_LARGEST_GAIN = 10.0
_FIRST_FACTORS = 60  # up to either, to begin with
_FACTOR_ACCURACY = 1e-6  # accuracy of a factor on all gains
_REAL_LOOP = 1e-6  # largest imaginary part of a real loop, relative


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
    peaks = loops.peaks() if stable else np.full(len(loops.laws), np.inf)
    margins = []
    together = _together(loops)
    for a in range(len(loops.laws)):
        real = crossings.of(a, unit=False)
        unit = crossings.of(a, unit=True)
        # here the loop is real, or nearly so
        ends = L[[0, -1], a]
        crossed = np.append(real.L.real, ends.real[np.abs(ends.imag) < _REAL_LOOP * np.abs(ends)])
        # a factor -1/L on the gains takes a real L to -1
        low, high = _factors(loops, a, -1 / crossed[crossed < 0], stable)
        # phase above -180 degrees
        turn = np.angle(-unit.L)
        # a delay turns L by theta per sample, clockwise only
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
    for factor in np.geomspace(1, _LARGEST_GAIN if stable else _LEAST_GAIN, _FIRST_FACTORS)[1:].tolist():
        low = min(low, factor)
        high = max(high, factor)
        if loops.stable(axes, factor) is not stable:
            break
        low = factor
        high = factor
    else:
        return math.inf if stable else 0.0
    while high - low > _FACTOR_ACCURACY * low:
        middle = 0.5 * (low + high)
        if loops.stable(axes, middle):
            low = middle
        else:
            high = middle
    return low
