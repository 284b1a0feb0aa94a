"""Transfer functions of small sampled systems at many frequencies, in one compiled pass.

A loop's margins ask for a few points at a time, thousands of times in a search for gains: there LAPACK's solver would
spend its time on being called.
"""

# ruff: noqa: N803 - matrices bear the letters of the equations

from __future__ import annotations

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
    """Write the transfer functions, by Gaussian elimination with pivots of the largest magnitude in their columns."""
    n = len(A)
    inputs = B0.shape[1]
    # z - A, and B1 + B0/z to the right of it
    rows = np.empty((n, n + inputs), np.complex128)
    for point in range(z.size):
        for i in range(n):
            for j in range(n):
                rows[i, j] = -A[i, j]
            rows[i, i] += z[point]
            for j in range(inputs):
                rows[i, n + j] = B1[i, j] + B0[i, j] / z[point]
        for k in range(n):
            pivot = k
            for i in range(k + 1, n):
                if _size(rows[i, k]) > _size(rows[pivot, k]):
                    pivot = i
            for j in range(k, n + inputs):
                rows[k, j], rows[pivot, j] = rows[pivot, j], rows[k, j]
            for i in range(k + 1, n):
                factor = rows[i, k] / rows[k, k]
                for j in range(k + 1, n + inputs):
                    rows[i, j] -= factor * rows[k, j]
        for j in range(n, n + inputs):
            for k in range(n - 1, -1, -1):
                for i in range(k + 1, n):
                    rows[k, j] -= rows[k, i] * rows[i, j]
                rows[k, j] /= rows[k, k]
            for output in range(len(C)):
                total = 0.0j
                for k in range(n):
                    total += C[output, k] * rows[k, j]
                values[point, output, j - n] = total


@jit
def _size(value: complex) -> float:
    return abs(value.real) + abs(value.imag)
