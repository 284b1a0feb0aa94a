"""A Gaussian process through measured points: a prediction with its standard deviation between them.

    k(x, x') = s^2 (1 + r + r^2/3) exp(-r),    r^2 = 5 sum(((x - x')/l)^2)        (Matérn 5/2)

with a scale l for each coordinate, a constant mean, and noise. s and the mean follow from the values; l and the noise
are the most likely ones under a prior (Rasmussen and Williams, Gaussian Processes for Machine Learning, 2.2 and 5.4).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular
from scipy.optimize import minimize

from gantrysim.base.arrays import Floats

# prior of a scale, lognormal: its median, and the deviation of its logarithm
_SCALE = 1.0
_SCALE_SPREAD = 1.0
# prior of the noise's deviation over s, likewise
_NOISE = 1e-2
_NOISE_SPREAD = 1.5
# bounds
_SCALES = (0.05, 30.0)
_NOISES = (1e-4, 0.3)
_STEPS = 60  # of the optimiser of the likelihood
_LEAST = 1e-9  # of s, where all values are equal


class Surrogate(NamedTuple):
    """A Gaussian process given measured values.

    Attributes:
        points: measured, (n, d).
        values: at the points, (n,).
        scales: l, (d,).
        noise: its standard deviation over s.
        mean: the constant mean.
        size: s.
        factor: Cholesky factor of the correlations, (n, n).
        weights: of the correlations with the points, in the predicted value, (n,).
    """

    points: Floats
    values: Floats
    scales: Floats
    noise: float
    mean: float
    size: float
    factor: Floats
    weights: Floats

    @classmethod
    def fitted(cls, points: Floats, values: Floats, guess: Surrogate | None = None) -> Surrogate:
        """Return the process with the most likely scales and noise.

        Args:
            points: (n, d).
            values: (n,).
            guess: a process with similar scales, from which the optimiser starts.
        """
        count = points.shape[1]
        middle = np.log([*[_SCALE] * count, _NOISE])
        spread = np.array([*[_SCALE_SPREAD] * count, _NOISE_SPREAD])
        apart = (points[:, None] - points[None]) ** 2

        def cost(logs: Floats) -> tuple[float, Floats]:
            scales = np.exp(logs[:-1])
            noise = math.exp(logs[-1])
            process = cls._given(points, values, scales, noise, apart)
            likelihood = len(values) * math.log(process.size) + float(np.log(np.diag(process.factor)).sum())
            # d/dlog of the likelihood: half the trace of (K^-1 - w w^T / s^2) dK
            inner = (
                cho_solve((process.factor, True), np.eye(len(values)))
                - np.outer(process.weights, process.weights) / process.size**2
            )
            r = np.sqrt(5 * apart @ scales**-2)
            slope = inner * (5 / 3 * (1 + r) * np.exp(-r))
            gradient = np.append(
                0.5 * np.einsum("ij,ijk->k", slope, apart) / scales**2, noise**2 * float(np.trace(inner))
            )
            off = (logs - middle) / spread
            return likelihood + 0.5 * float(off @ off), gradient + off / spread

        start = middle if guess is None else np.log([*guess.scales, guess.noise])
        bounds = np.log([*[_SCALES] * count, _NOISES])
        logs = minimize(cost, start, jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": _STEPS}).x
        return cls._given(points, values, np.exp(logs[:-1]), math.exp(logs[-1]), apart)

    @classmethod
    def _given(cls, points: Floats, values: Floats, scales: Floats, noise: float, apart: Floats) -> Surrogate:
        factor, _ = cho_factor(_correlation(apart @ scales**-2) + noise**2 * np.eye(len(values)), lower=True)
        # generalised least squares: K^-1 1 weighs the values of crowded points less
        weights_of_mean = cho_solve((factor, True), np.ones(len(values)))
        mean = float(weights_of_mean @ values / weights_of_mean.sum())
        weights = cho_solve((factor, True), values - mean)
        size = max(math.sqrt(max(float((values - mean) @ weights), 0.0) / len(values)), _LEAST)
        return cls(points, values, scales, noise, mean, size, np.tril(factor), weights)

    def extended(self, point: Floats, value: float) -> Surrogate:
        """Return the process with one more value, its scales and noise unchanged."""
        points = np.vstack([self.points, point])
        values = np.append(self.values, value)
        apart = (points[:, None] - points[None]) ** 2
        return self._given(points, values, self.scales, self.noise, apart)

    def predict(self, points: Floats) -> tuple[Floats, Floats]:
        """Return value and standard deviation at points, (m, d), without the noise, (m,) each."""
        apart = (points[:, None] - self.points[None]) ** 2
        correlation = _correlation(apart @ self.scales**-2)
        whitened = solve_triangular(self.factor, correlation.T, lower=True)
        unexplained = np.maximum(1 - (whitened**2).sum(axis=0), 0)
        return self.mean + correlation @ self.weights, self.size * np.sqrt(unexplained)


def _correlation(squares: Floats) -> Floats:
    r = np.sqrt(5 * squares)
    return (1 + r + r**2 / 3) * np.exp(-r)
