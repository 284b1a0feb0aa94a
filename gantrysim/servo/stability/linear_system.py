"""Sampled linear systems: their transfer functions, and a servo's law as one, as the stability of its loop needs it.

Transfer functions at many frequencies are computed in one compiled pass. A loop's margins ask for a few points at a
time, thousands of times in a search for gains: there LAPACK's solver would spend its time on being called.
"""

# ruff: noqa: N803, N806 - matrices bear the letters of the equations

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

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
    def polynomials(self) -> tuple[Floats, Floats]:
        """Numerator and denominator of the transfer function, by falling powers of z, (states + 1,) each.

        By the algorithm of Faddeev and LeVerrier: (z - A)^-1 = sum(M[k] z^(n-1-k)) / sum(c[k] z^(n-k)).
        """
        n = len(self.A)
        denominator = np.ones(n + 1)
        numerator = np.full(n + 1, self.D)
        M = np.eye(n)
        for k in range(1, n + 1):
            numerator[k] = self.C @ M @ self.B
            M = self.A @ M
            denominator[k] = -M.trace() / k
            M = M + denominator[k] * np.eye(n)
        numerator[1:] += self.D * denominator[1:]
        return numerator, denominator
