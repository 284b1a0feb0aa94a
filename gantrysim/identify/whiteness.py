"""Correlation of a residual, and the covariance of parameters that it leads to."""

# ruff: noqa: N803, N806 - matrices bear the letters of the equations

from __future__ import annotations

import numpy as np

from gantrysim.base.arrays import Floats

LAGS = 25  # of the correlation of the residual


def correlation(residual: Floats) -> Floats:
    """Return the correlation of a residual, (n,), with itself at each lag from 1, (LAGS,)."""
    power = max(float(residual @ residual), 1e-300)
    return np.array([float(residual[k:] @ residual[:-k]) / power for k in range(1, LAGS + 1)])


def covariance_of(J: Floats, residual: Floats) -> Floats:
    """Return the covariance of the variables with the residual's own correlation over `LAGS`, (p, p)."""
    return long_run_covariance(J, residual, LAGS)


def long_run_covariance(J: Floats, residual: Floats, lags: int) -> Floats:
    """Return the covariance of the variables: (J'J)^-1 S (J'J)^-1, S with the residual's correlation over some lags.

    S sums the products of neighbours over lags with falling weights (W. Newey and K. West, Econometrica 55, 1987); for
    a white residual it is s² J'J, and this the covariance of Gauss and Newton.
    """
    inverse = np.linalg.pinv(J.T @ J)
    scores = J * residual[:, None]
    S = scores.T @ scores
    for lag in range(1, min(lags, len(residual) - 1) + 1):
        cross = scores[lag:].T @ scores[:-lag]
        S += (1 - lag / (lags + 1)) * (cross + cross.T)
    n, p = J.shape
    return np.asarray(inverse @ S @ inverse * n / max(n - p, 1))
