"""Arc length of curves whose radius is linear in the angle: arcs, helices, spirals, cones, involutes.

All of them have ds = sqrt(rho^2 + c^2) d(phi) with rho = r + b phi. For an involute rho is the radius of
curvature and c the climb per radian; for a spiral about a centre rho is the distance from it and
c^2 = b^2 + climb^2.
"""

# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from gantrysim.base.arrays import Floats
from gantrysim.base.jit import jit

_NEWTON_STEPS = 60
_LAST_STEP = 1e-8  # relative; the remaining error is of the order of its square
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(12)
_EVEN_RADIUS = 0.3  # relative change of the radius up to which the quadrature is exact to rounding


def arc_length(r: ArrayLike, b: ArrayLike, c: ArrayLike, angle: ArrayLike) -> Floats:
    """Return the length of ds = sqrt((r + b phi)^2 + c^2) d(phi) from 0 to `angle` [mm]; all broadcast.

    With F(rho) = rho/2 sqrt(rho^2 + c^2) + c^2/2 asinh(rho/c) it is (F(r + b angle) - F(r)) / b, and where c is 0 the
    mean radius times the angle. Where the radius hardly changes and that difference would cancel, Gauss-Legendre
    quadrature is used.
    """
    (radius, growth, rise, turn), shape = _together(r, b, c, angle)
    lengths = np.empty(radius.size)
    _find_lengths(radius, growth, rise, turn, lengths)
    return lengths.reshape(shape)


def _together(*values: ArrayLike) -> tuple[list[Floats], tuple[int, ...]]:
    """Values broadcast against each other and flattened, and their common shape of at least one dimension."""
    arrays = np.broadcast_arrays(*(np.atleast_1d(np.asarray(value, float)) for value in values))
    # copies: an older NumPy warns where numba asks whether a broadcast array may be written to
    return [array.flatten() for array in arrays], arrays[0].shape


@jit
def _length(r, b, c, angle):
    # in a plane, up to where the radius changes its sign
    if c == 0.0 and r * (r + b * angle) >= 0.0:
        return angle * abs(r + 0.5 * b * angle)
    if _is_even(r, b, c, angle):
        return _quadrature(r, b, c, angle)
    return (_antiderivative(r + b * angle, c) - _antiderivative(r, c)) / b


@jit
def _is_even(r, b, c, angle):
    """Whether the radius changes so little up to an angle that `_quadrature` is exact."""
    middle = r + 0.5 * b * angle
    return abs(b * angle) <= _EVEN_RADIUS * np.sqrt(middle * middle + c * c)


@jit
def _quadrature(r, b, c, angle):
    middle = r + 0.5 * b * angle
    square = c * c
    total = 0.0
    for i in range(_NODES.size):
        rho = middle + 0.5 * b * angle * _NODES[i]
        total += _WEIGHTS[i] * np.sqrt(rho * rho + square)  # faster than hypot
    return 0.5 * angle * total


@jit
def _antiderivative(rho, c):
    return _antiderivative_at(rho, c, np.hypot(rho, c))


@jit
def _antiderivative_at(rho, c, rate):
    """Return F(rho), given the rate hypot(rho, c)."""
    square = c * c
    return 0.5 * (rho * rate + square * (np.arcsinh(rho / abs(c)) if square > 0 else 0.0))


@jit
def _find_lengths(r, b, c, angle, lengths):
    for k in range(r.size):
        lengths[k] = _length(r[k], b[k], c[k], angle[k])


def swept_along(r, b, c, s, most):
    """Return the angles from 0 to `most` at which the arc lengths are s, (n,), see `find_swept` [rad]."""
    angles = np.empty(s.size)
    find_swept((r, b, c, most), s, angles, np.empty(s.size, bool))
    return angles


@jit
def _guess(rate, b, s, most):
    """Angle at an arc length with the rate ds / d(phi) at the start, exact where b or c is 0."""
    guess = 2 * s / max(rate + np.sqrt(max(rate * rate + 2 * b * s, 0.0)), 1e-300)
    return min(max(guess, 0.0), most)


@jit
def find_swept(curve, s, angles, active):
    """Write the angles at which the arc lengths of a curve are s, (n,), by Newton's method to 1e-14 [rad].

    The radius r + b phi must not be negative up to the largest angle. A step is made for all angles before the next: it
    waits for one operation after the other, and the processor works on several angles meanwhile.

    Args:
        curve: r [mm], b and c of `arc_length` [mm/rad], and the largest angle [rad].
        s: arc lengths, (n,) [mm].
        angles: written, (n,) [rad].
        active: for the search, (n,).
    """
    r, b, c, most = curve
    rate_at_start = np.hypot(r, c)
    for k in range(s.size):
        angles[k] = _guess(rate_at_start, b, s[k], most)
        active[k] = True
    if b * c == 0.0:
        return
    from_start = _antiderivative(r, c)
    remaining = s.size
    for _ in range(_NEWTON_STEPS):
        for k in range(s.size):
            if not active[k]:
                continue
            angle = angles[k]
            rho = r + b * angle
            rate = np.hypot(rho, c)
            if _is_even(r, b, c, angle):
                length = _quadrature(r, b, c, angle)
            else:
                length = (_antiderivative_at(rho, c, rate) - from_start) / b
            step = (length - s[k]) / rate if rate > 0 else 0.0
            improved = min(max(angle - step, 0.0), most)
            angles[k] = improved
            if abs(improved - angle) <= _LAST_STEP * improved:
                active[k] = False
                remaining -= 1
        if remaining == 0:
            break
