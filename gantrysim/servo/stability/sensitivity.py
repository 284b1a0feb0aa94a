"""The peak of |S| of servo loops, in one compiled pass: a search for gains asks for it thousands of times.

With P the response of axes that move each other and C = diag(C_i) that of their laws, S = (1 + C P)^-1, and of axis i
with the others closed 1/(1 + L_i) = S_ii. Its peak is sought on the plant's grid of angles, then on finer ones around
the largest value, and at the angles of lightly damped closed-loop poles, whose peaks are narrower than the grid.
"""

# ruff: noqa: N803, N806 - matrices bear the letters of the equations

from __future__ import annotations

import cmath
from collections.abc import Sequence

import numpy as np

from gantrysim.base.arrays import Complexes, Floats, read_only_view
from gantrysim.base.jit import jit
from gantrysim.servo.stability.linear_system import Compensator, find_value, solve

# damping ratio below which a mode, zero or pole needs grid points of its own
NARROW = 0.3
_ZOOM = 9  # points between those of the grid around the peak
_ZOOMS = 4  # after which a peak is within 1e-5 of its height

Matrices = tuple[Floats, Floats, Floats, Floats]
Polynomials = tuple[Floats, Floats]


def peaks_of(theta: Floats, P: Complexes, system: Matrices, laws: Sequence[Compensator], poles: Complexes) -> Floats:
    """Return the peak of |S| of each axis of a group of stable loops, (axes,).

    Args:
        theta: angles of the grid, (n,).
        P: response of the plant there, (n, axes, axes).
        system: F, G0, G1 and H of the plant.
        laws: of the axes.
        poles: of the closed loops.
    """
    peaks = np.zeros(len(laws))
    F, G0, G1, H = (read_only_view(np.ascontiguousarray(matrix, float)) for matrix in system)
    grid = read_only_view(theta), read_only_view(P)
    _find_peaks(*grid, (F, G0, G1, H), _polynomials(laws), read_only_view(poles), peaks)
    return peaks


def _polynomials(laws: Sequence[Compensator]) -> tuple[Floats, Floats]:
    """Return numerators and denominators of laws by falling powers of z, all of one degree, (axes, degree + 1) each."""
    degree = max(len(law.A) for law in laws)
    numerators = np.zeros((len(laws), degree + 1))
    denominators = np.zeros((len(laws), degree + 1))
    for a, law in enumerate(laws):
        numerator, denominator = law.polynomials
        # both times a power of z
        numerators[a, : len(numerator)] = numerator
        denominators[a, : len(denominator)] = denominator
    return numerators, denominators


@jit
def _find_peaks(
    theta: Floats, P: Complexes, system: Matrices, laws: Polynomials, poles: Complexes, peaks: Floats
) -> None:
    """Raise the peaks of |S_ii|, (axes,), from 0."""
    axes = len(peaks)
    size = np.empty(axes)
    highest = np.zeros(axes, np.int64)
    rows = np.empty((axes, 2 * axes), np.complex128)
    for k in range(len(theta)):
        _find_sizes(cmath.exp(1j * theta[k]), P[k], laws, rows, size)
        for a in range(axes):
            if size[a] > peaks[a]:
                peaks[a] = size[a]
                highest[a] = k
    work = (rows, np.empty((len(system[0]), len(system[0]) + axes), np.complex128), np.empty_like(P[0]))
    for a in range(axes):
        low = theta[max(highest[a] - 1, 0)]
        high = theta[min(highest[a] + 1, len(theta) - 1)]
        for _ in range(_ZOOMS):
            step = (high - low) / (_ZOOM - 1)
            best = 0
            largest = 0.0
            for i in range(_ZOOM):
                _find_sizes_at(low + i * step, system, laws, work, size)
                if size[a] > largest:
                    largest = size[a]
                    best = i
            peaks[a] = max(peaks[a], largest)
            high = low + min(best + 1, _ZOOM - 1) * step
            low += max(best - 1, 0) * step
    for pole in poles:
        angle = cmath.phase(pole)
        # those of the upper half plane
        if pole.imag > 0 and abs(pole) > 1 - NARROW * angle:
            _find_sizes_at(angle, system, laws, work, size)
            for a in range(axes):
                peaks[a] = max(peaks[a], size[a])


@jit
def _find_sizes_at(
    angle: float,
    system: Matrices,
    laws: Polynomials,
    work: tuple[Complexes, Complexes, Complexes],
    size: Floats,
) -> None:
    """Write |S_ii| at an angle, (axes,); the work is for axes, states, and the response of the plant."""
    F, G0, G1, H = system
    rows, state_rows, P = work
    z = cmath.exp(1j * angle)
    find_value(z, F, (G0, G1), H, state_rows, P)
    _find_sizes(z, P, laws, rows, size)


@jit
def _find_sizes(z: complex, P: Complexes, laws: Polynomials, rows: Complexes, size: Floats) -> None:
    """Write |S_ii|, (axes,), given the response of the plant, (axes, axes)."""
    axes = len(size)
    # as most are, for which equations take three times as long
    if axes == 1:
        size[0] = abs(1.0 / (1.0 + _law_value(z, laws, 0) * P[0, 0]))
        return
    for i in range(axes):
        law = _law_value(z, laws, i)
        for j in range(axes):
            rows[i, j] = law * P[i, j]
            rows[i, axes + j] = 0.0
        rows[i, i] += 1.0
        rows[i, axes + i] = 1.0
    solve(rows)
    for i in range(axes):
        size[i] = abs(rows[i, axes + i])


@jit
def _law_value(z: complex, laws: Polynomials, axis: int) -> complex:
    """Return the response of the law of an axis."""
    numerators, denominators = laws
    numerator = denominator = 0.0j
    for k in range(numerators.shape[1]):
        numerator = numerator * z + numerators[axis, k]
        denominator = denominator * z + denominators[axis, k]
    return numerator / denominator
