"""Compiled algebra of matrices of a few rows, for which a library's threads cost more than they save."""

# ruff: noqa: N803, N806 - matrices bear the letters of the equations

from __future__ import annotations

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.jit import jit

_TERMS = 14  # of the exponential's series, for a norm of at most 1/2
_DOUBLINGS = 60
_SETTLED = 1e-12


@jit
def _product(A: Floats, B: Floats) -> Floats:
    out = np.zeros((A.shape[0], B.shape[1]))
    for i in range(A.shape[0]):
        for k in range(A.shape[1]):
            for j in range(B.shape[1]):
                out[i, j] += A[i, k] * B[k, j]
    return out


@jit
def _solved_system(A: Floats, B: Floats) -> Floats:
    """Return A^-1 B by elimination with pivots."""
    n = A.shape[0]
    a = A.copy()
    b = B.copy()
    for i in range(n):
        pivot = i
        for k in range(i + 1, n):
            if abs(a[k, i]) > abs(a[pivot, i]):
                pivot = k
        for j in range(n):
            a[i, j], a[pivot, j] = a[pivot, j], a[i, j]
        for j in range(b.shape[1]):
            b[i, j], b[pivot, j] = b[pivot, j], b[i, j]
        for k in range(n):
            if k != i:
                factor = a[k, i] / a[i, i]
                for j in range(n):
                    a[k, j] -= factor * a[i, j]
                for j in range(b.shape[1]):
                    b[k, j] -= factor * b[i, j]
    for i in range(n):
        for j in range(b.shape[1]):
            b[i, j] /= a[i, i]
    return b


@jit
def sampled_system(A: Floats, B: Floats, time: float) -> tuple[Floats, Floats]:
    """Return the effect of the state, (n, n), and of constant inputs, (n, m), on the state of x' = A x + B u."""
    n, m = B.shape
    joint = np.zeros((n + m, n + m))
    # exp of [[A, B], [0, 0]] holds both effects (C. Van Loan, IEEE Transactions on Automatic Control 23, 1978)
    joint[:n, :n] = A * time
    joint[:n, n:] = B * time
    halvings = 0
    norm = 0.0
    for i in range(n):
        norm = max(norm, np.abs(joint[i]).sum())
    # scaling and squaring: the series converges fast only for small matrices
    while norm > 0.5:
        norm *= 0.5
        halvings += 1
    joint *= 0.5**halvings
    total = np.eye(n + m)
    term = np.eye(n + m)
    for k in range(1, _TERMS):
        term = _product(term, joint) / k
        total += term
    for _ in range(halvings):
        total = _product(total, total)
    return total[:n, :n].copy(), total[:n, n:].copy()


@jit
def kalman_gain(F: Floats, G: Floats, noise: float) -> Floats:
    """Return the stationary gain of the correction by the first state, measured with white noise of variance 1, (n,).

    The Riccati equation is solved by doubling (E. K.-W. Chu et al., International Journal of Control 77, 2004).

    Args:
        F: state transition, (n, n).
        G: effect of the inputs; the first has white noise, (n, m).
        noise: its standard deviation.
    """
    n = F.shape[0]
    A = np.ascontiguousarray(F.T)
    P = np.zeros((n, n))
    S = np.zeros((n, n))
    S[0, 0] = 1.0
    for i in range(n):
        for j in range(n):
            P[i, j] = noise * noise * G[i, 0] * G[j, 0]
    for _ in range(_DOUBLINGS):
        W = np.eye(n) + _product(S, P)
        V1 = _solved_system(W, A)
        V2 = _solved_system(W, np.ascontiguousarray(S))
        AT = np.ascontiguousarray(A.T)
        change = _product(_product(AT, P), V1)
        S = S + _product(_product(A, V2), AT)
        A = _product(A, V1)
        P = P + change
        P = 0.5 * (P + P.T)
        if np.abs(change).max() <= _SETTLED * np.abs(P).max():
            break
    return P[:, 0] / (P[0, 0] + 1.0)
