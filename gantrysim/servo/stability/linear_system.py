"""Sampled linear systems: their transfer functions, a servo's law as one, and the peak of |S| of a loop of both.

Transfer functions at many frequencies are computed in one compiled pass. A loop's margins ask for a few points at a
time, thousands of times in a search for gains: there LAPACK's solver would spend its time on being called.
"""

# ruff: noqa: N803, N806 - matrices bear the letters of the equations

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from gantrysim.base.arrays import Complexes, Floats, read_only_view
from gantrysim.base.jit import jit


def transfer(z: Complexes, A: Floats, B: tuple[Floats, Floats], C: Floats) -> Complexes:
    """Return C (z - A)^-1 (B1 + B0/z) at every z, (n, outputs, inputs).

    Args:
        z: (n,).
        A: (states, states).
        B: B0 and B1, (states, inputs).
        C: (outputs, states).

    Raises:
        ZeroDivisionError: a z that is exactly a pole.
    """
    values = np.empty((z.size, len(C), B[0].shape[1]), complex)
    motion, before, present, outputs = (read_only_view(np.ascontiguousarray(matrix, float)) for matrix in (A, *B, C))
    _find_values(read_only_view(z), motion, before, present, outputs, values)
    return values


@jit
def _find_values(z: Complexes, A: Floats, B0: Floats, B1: Floats, C: Floats, values: Complexes) -> None:
    """Write the transfer functions at every z."""
    rows = np.empty((len(A), len(A) + B0.shape[1]), np.complex128)
    for point in range(z.size):
        find_value(z[point], A, (B0, B1), C, rows, values[point])


@jit
def find_value(z: complex, A: Floats, B: tuple[Floats, Floats], C: Floats, rows: Complexes, value: Complexes) -> None:
    """Write the transfer functions at one z, (outputs, inputs).

    Args:
        z: where.
        A: (states, states).
        B: B0 and B1, (states, inputs).
        C: (outputs, states).
        rows: for the work, (states, states + inputs).
        value: to be written.
    """
    n = len(A)
    B0, B1 = B
    # z - A, and B1 + B0/z to the right of it
    for i in range(n):
        for j in range(n):
            rows[i, j] = -A[i, j]
        rows[i, i] += z
        for j in range(B0.shape[1]):
            rows[i, n + j] = B1[i, j] + B0[i, j] / z
    solve(rows)
    for output in range(len(C)):
        for j in range(B0.shape[1]):
            total = 0.0j
            for k in range(n):
                total += C[output, k] * rows[k, n + j]
            value[output, j] = total


@jit
def solve(rows: Complexes) -> None:
    """Solve linear equations: of (M, R) to the right of each other, R becomes M^-1 R, and M is used up.

    Gaussian elimination with pivots of the largest magnitude in their columns.

    Args:
        rows: (n, n + m).
    """
    n, width = rows.shape
    for k in range(n):
        pivot = k
        for i in range(k + 1, n):
            if _size(rows[i, k]) > _size(rows[pivot, k]):
                pivot = i
        for j in range(k, width):
            rows[k, j], rows[pivot, j] = rows[pivot, j], rows[k, j]
        # the divisions take most of the time: one for each pivot
        inverse = 1.0 / rows[k, k]
        rows[k, k] = inverse
        for i in range(k + 1, n):
            factor = rows[i, k] * inverse
            for j in range(k + 1, width):
                rows[i, j] -= factor * rows[k, j]
    for j in range(n, width):
        for k in range(n - 1, -1, -1):
            for i in range(k + 1, n):
                rows[k, j] -= rows[k, i] * rows[i, j]
            rows[k, j] *= rows[k, k]


@jit
def _size(value: complex) -> float:
    return abs(value.real) + abs(value.imag)


@dataclass(frozen=True, eq=False)
class Compensator:
    """A sampled law of one axis, from the following error to the torque demand.

        s[k+1] = A s[k] + B e[k],        u[k] = C s[k] + D e[k]

    Attributes:
        A: (states, states).
        B: (states,).
        C: (states,).
        D: gain at once.
    """

    A: Floats
    B: Floats
    C: Floats
    D: float

    @classmethod
    def pid(cls, kp: float, ki: float, kd: float, period: float) -> Compensator:
        """Return kp e + ki T sum(e) + kd de/T; the sum is no state of a law without it."""
        D = kp + ki * period + kd / period
        if not ki:
            return cls(np.zeros((1, 1)), np.ones(1), np.array([-kd / period]), D)
        return cls(np.diag([0.0, 1.0]), np.array([1.0, period]), np.array([-kd / period, ki]), D)

    @classmethod
    def fir(cls, taps: Floats) -> Compensator:
        """Return the law taps[0] e[k] + taps[1] e[k-1] + ..., of two taps or more."""
        n = len(taps) - 1
        return cls(np.eye(n, k=-1), np.eye(n)[0], np.asarray(taps[1:], float), float(taps[0]))

    def beside(self, other: Compensator) -> Compensator:
        """Return the sum of two laws that act on one error."""
        A = self._apart(other)
        return Compensator(A, np.append(self.B, other.B), np.append(self.C, other.C), self.D + other.D)

    def _apart(self, other: Compensator) -> Floats:
        """Return the dynamics of both states, which have no effect on each other."""
        n = len(self.A)
        A = np.zeros((n + len(other.A),) * 2)
        A[:n, :n] = self.A
        A[n:, n:] = other.A
        return A

    def around(self, feedback: Compensator) -> Compensator:
        """Return u = self(e) + feedback(u), where the feedback has no gain at once."""
        A = self._apart(feedback)
        C = np.append(self.C, feedback.C)
        n = len(self.A)
        A[n:] += np.outer(feedback.B, C)
        return Compensator(A, np.append(self.B, feedback.B * self.D), C, self.D)

    def then(self, filter: tuple[float, float, float, float, float]) -> Compensator:
        """Return this law followed by (b0 + b1/z + b2/z^2) / (1 + a1/z + a2/z^2), given b0, b1, b2, a1, a2."""
        b0, b1, b2, a1, a2 = filter
        # a mere factor adds no states
        if not (b1 or b2 or a1 or a2):
            return Compensator(self.A, self.B, b0 * self.C, b0 * self.D)
        n = len(self.A)
        # the filter in observer form, its direct part b0 taken out
        enter = np.array([b1 - a1 * b0, b2 - a2 * b0])
        A = np.zeros((n + 2, n + 2))
        A[:n, :n] = self.A
        A[n:, :n] = np.outer(enter, self.C)
        A[n:, n:] = [[-a1, 1.0], [-a2, 0.0]]
        return Compensator(A, np.append(self.B, enter * self.D), np.append(b0 * self.C, [1.0, 0.0]), b0 * self.D)

    def delayed(self, samples: int) -> Compensator:
        """Return this law of the error of some samples ago."""
        A = self.A
        B = self.B
        C = self.C
        D = self.D
        for _ in range(samples):
            n = len(A)
            # the state added is the last error
            delayed = np.zeros((n + 1, n + 1))
            delayed[:n, :n] = A
            delayed[:n, n] = B
            A = delayed
            B = np.append(np.zeros(n), 1.0)
            C = np.append(C, D)
            D = 0.0
        return Compensator(A, B, C, D)

    def response(self, z: Complexes) -> Complexes:
        """Return the transfer function at every z, (n,)."""
        B = self.B[:, None]
        return self.D + transfer(z, self.A, (np.zeros_like(B), B), self.C[None])[:, 0, 0]

    @cached_property
    def triangle(self) -> tuple[Complexes, Complexes, Complexes]:
        """E, b and c with which the transfer function is D + c (w - E)^-1 b, w = z - 1, and E is upper triangular.

        By Schur's decomposition A - 1 = U E U^H. A slow law has all its poles near z = 1: as a ratio of polynomials, it
        would be rounding there.
        """
        from scipy.linalg import schur  # slow to import

        E, U = schur(self.A - np.eye(len(self.A)), output="complex")
        return E, U.conj().T @ self.B, self.C @ U


# The peak of |S|, in one compiled pass: a search for gains asks for it thousands of times.
#
# With P the response of axes that move each other and C_i that of their laws, S = (1 + C P)^-1, and of axis i with the
# others closed 1/(1 + L_i) = S_ii. Its peak is sought on the plant's grid of angles, then on a finer one around the
# largest value and by golden sections of that, and at the angles of lightly damped closed-loop poles, whose peaks are
# narrower than the grid.

NARROW_DAMPING = 0.3  # damping ratio below which a mode, zero or pole is narrower than the grid
_ZOOM = 9  # points between those of the grid around the peak
_SECTIONS = 10  # after which a peak is within 1e-5 of its height
_GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)


class CompiledLaws(NamedTuple):
    """Laws of axes, as compiled functions take them, see `Compensator.triangle`; all with as many states.

    Attributes:
        E: (axes, states, states).
        b, c: (axes, states).
        D: (axes,).
    """

    E: Complexes
    b: Complexes
    c: Complexes
    D: Floats

    @classmethod
    def of(cls, laws: Sequence[Compensator]) -> CompiledLaws:
        """Return laws; those with fewer states get some that nothing moves."""
        states = max(len(law.A) for law in laws)
        E = np.zeros((len(laws), states, states), complex)
        b, c = np.zeros((2, len(laws), states), complex)
        for a, law in enumerate(laws):
            n = len(law.A)
            E[a, :n, :n], b[a, :n], c[a, :n] = law.triangle
        return cls(E, b, c, np.array([law.D for law in laws], float))


class CompiledPlant(NamedTuple):
    """Axes that move each other, as compiled functions take them.

    Attributes:
        theta: angles of the grid, ascending, (n,).
        w: points exp(j theta) - 1, (n,).
        P: response there, (n, axes, axes).
        F, G0, G1, H: of their sampled motion, see `gantrysim.servo.stability.motion.LinearSystem`.
    """

    theta: Floats
    w: Complexes
    P: Complexes
    F: Floats
    G0: Floats
    G1: Floats
    H: Floats


def sensitivity_peaks(plant: CompiledPlant, laws: CompiledLaws, poles: Complexes) -> Floats:
    """Return the peak of |S| of each axis of a group of stable loops, (axes,).

    Args:
        plant: of these axes.
        laws: of the axes.
        poles: of the closed loops.
    """
    squares = np.zeros(len(laws.D))
    _find_peaks(plant, laws, read_only_view(poles), squares)
    return np.sqrt(squares)


@jit
def _find_peaks(plant: CompiledPlant, laws: CompiledLaws, poles: Complexes, squares: Floats) -> None:
    """Raise the squares of the peaks of |S_ii|, (axes,), from 0."""
    theta = plant.theta
    axes = len(squares)
    states = len(plant.F)
    size = np.empty(axes)
    highest = np.zeros(axes, np.int64)
    rows = np.empty((axes, 2 * axes), np.complex128)
    C = np.empty((len(theta), axes), np.complex128)
    _find_laws(plant.w, laws, np.empty((laws.b.shape[1], len(theta)), np.complex128), C)
    for k in range(len(theta)):
        # a call with arrays would take several times as long as all else
        if axes == 1:
            size[0] = _square_of_one(C[k, 0], plant.P[k, 0, 0])
        else:
            _find_squares(C[k], plant.P[k], rows, size)
        for a in range(axes):
            if size[a] > squares[a]:
                squares[a] = size[a]
                highest[a] = k
    work = _Work(
        w=np.empty(1, np.complex128),
        law_states=np.empty((laws.b.shape[1], 1), np.complex128),
        C=np.empty((1, axes), np.complex128),
        plant_rows=np.empty((states, states + axes), np.complex128),
        P=np.empty((axes, axes), np.complex128),
        rows=rows,
        squares=size,
    )
    for a in range(axes):
        low = theta[max(highest[a] - 1, 0)]
        high = theta[min(highest[a] + 1, len(theta) - 1)]
        squares[a] = max(squares[a], _highest_square(a, low, high, plant, laws, work))
    for pole in poles:
        angle = cmath.phase(pole)
        # those of the upper half plane
        if pole.imag > 0 and abs(pole) > 1 - NARROW_DAMPING * angle:
            _square_at(angle, 0, plant, laws, work)
            for a in range(axes):
                squares[a] = max(squares[a], size[a])


class _Work(NamedTuple):
    """Arrays for the work at one angle.

    Attributes:
        w: exp(j theta) - 1, (1,).
        law_states: (states, 1).
        C: responses of the laws, (1, axes).
        plant_rows: as of `find_value`.
        P: response of the plant, (axes, axes).
        rows: of the equations of S, (axes, 2 axes).
        squares: |S_ii|^2, (axes,).
    """

    w: Complexes
    law_states: Complexes
    C: Complexes
    plant_rows: Complexes
    P: Complexes
    rows: Complexes
    squares: Floats


@jit
def _highest_square(
    axis: int,
    low: float,
    high: float,
    plant: CompiledPlant,
    laws: CompiledLaws,
    work: _Work,
) -> float:
    """Return the highest |S_ii|^2 of an axis between two angles."""
    step = (high - low) / (_ZOOM - 1)
    best = 0
    highest = 0.0
    for i in range(_ZOOM):
        square = _square_at(low + i * step, axis, plant, laws, work)
        if square > highest:
            highest = square
            best = i
    high = low + min(best + 1, _ZOOM - 1) * step
    low += max(best - 1, 0) * step
    lower = high - _GOLDEN * (high - low)
    upper = low + _GOLDEN * (high - low)
    at_lower = _square_at(lower, axis, plant, laws, work)
    at_upper = _square_at(upper, axis, plant, laws, work)
    for _ in range(_SECTIONS):
        if at_lower > at_upper:
            high = upper
            upper = lower
            at_upper = at_lower
            lower = high - _GOLDEN * (high - low)
            at_lower = _square_at(lower, axis, plant, laws, work)
        else:
            low = lower
            lower = upper
            at_lower = at_upper
            upper = low + _GOLDEN * (high - low)
            at_upper = _square_at(upper, axis, plant, laws, work)
    return max(highest, at_lower, at_upper)


@jit
def _square_at(angle: float, axis: int, plant: CompiledPlant, laws: CompiledLaws, work: _Work) -> float:
    """Return |S_ii|^2 of an axis at an angle; all of them are written into the work."""
    find_value(cmath.exp(1j * angle), plant.F, (plant.G0, plant.G1), plant.H, work.plant_rows, work.P)
    half = math.sin(0.5 * angle)
    work.w[0] = complex(-2.0 * half * half, math.sin(angle))
    _find_laws(work.w, laws, work.law_states, work.C)
    _find_squares(work.C[0], work.P, work.rows, work.squares)
    return float(work.squares[axis])


@jit
def _find_squares(C: Complexes, P: Complexes, rows: Complexes, squares: Floats) -> None:
    """Write |S_ii|^2, (axes,), given the responses of laws, (axes,), and plant, (axes, axes)."""
    axes = len(squares)
    # as most are, for which equations take three times as long
    if axes == 1:
        squares[0] = _square_of_one(C[0], P[0, 0])
        return
    for i in range(axes):
        for j in range(axes):
            rows[i, j] = C[i] * P[i, j]
            rows[i, axes + j] = 0.0
        rows[i, i] += 1.0
        rows[i, axes + i] = 1.0
    solve(rows)
    for i in range(axes):
        squares[i] = _square(rows[i, axes + i])


@jit
def _square_of_one(C: complex, P: complex) -> float:
    """Return |S|^2 of a single axis, given the responses of its law and of the plant."""
    return 1.0 / _square(1.0 + C * P)


@jit
def _find_laws(w: Complexes, laws: CompiledLaws, states: Complexes, C: Complexes) -> None:
    """Write the responses of laws at points w, (n, axes); the states, (states, n), are for the work."""
    E, b, c, D = laws
    last = len(states) - 1
    for a in range(len(D)):
        for k in range(len(w)):
            C[k, a] = D[a]
        for i in range(last, -1, -1):
            for k in range(len(w)):
                total = b[a, i]
                for j in range(i + 1, last + 1):
                    total += E[a, i, j] * states[j, k]
                pivot = w[k] - E[a, i, i]
                # faster than a division of complex numbers
                share = 1.0 / _square(pivot)
                states[i, k] = total * complex(pivot.real * share, -pivot.imag * share)
                C[k, a] += c[a, i] * states[i, k]


@jit
def _square(value: complex) -> float:
    """Return the square of the magnitude."""
    return value.real**2 + value.imag**2
