"""Values of a least-squares fit with their 95 % intervals, and whether the data distinguish them from zero."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

from gantrysim.base.arrays import Floats

_BLOCKS = 24  # of rows in their order, that count as independent
_CONFIDENCE = 0.95
_CLAIMED_INTERVALS = 2.0  # intervals from zero: many values are judged, and errors of a model are not random


@dataclass(frozen=True)
class Estimate:
    """A value with its 95 % interval.

    Attributes:
        value: in the unit of what is estimated.
        interval: half its width; inf where the data do not show it.
    """

    value: float
    interval: float

    @property
    def distinguished(self) -> bool:
        """Whether the data distinguish it from zero."""
        return abs(self.value) > _CLAIMED_INTERVALS * self.interval


def scales_of(slopes: Floats) -> Floats:
    """Return the norms of slopes, (n, p), inf for a value on which nothing depends, (p,)."""
    norms = np.linalg.norm(slopes, axis=0)
    return np.where(norms > _NO_SLOPE, norms, np.inf)


_NO_SLOPE = 1e-9  # norm that is rounding
RANK = 1e-6  # of the largest singular value, below which a combination of values is not in the data


def clustered_intervals(residual: Floats, slopes: Floats) -> Floats:
    """Return half the 95 % intervals of the values of a least-squares fit, (p,); inf where the data have none.

    Args:
        residual: (n, k).
        slopes: by each value, (n, k, p).
    """
    count = slopes.shape[2]
    if not count:
        return np.zeros(0)
    blocks = np.array_split(np.arange(len(residual)), min(_BLOCKS, len(residual)))
    scale = scales_of(slopes.reshape(-1, count))
    scaled = slopes / scale
    normal = np.einsum("nkp,nkq->pq", scaled, scaled)
    values, vectors = np.linalg.eigh(normal)
    shown = values > RANK * values.max()
    inverse = (vectors[:, shown] / values[shown]) @ vectors[:, shown].T
    pulls = np.array([np.einsum("nkp,nk->p", scaled[rows], residual[rows]) for rows in blocks])
    freedom = len(blocks) - count
    if freedom < 1:
        return np.full(count, np.inf)
    covariance = inverse @ (pulls.T @ pulls) @ inverse * len(blocks) / freedom
    wide = float(student.ppf(0.5 + 0.5 * _CONFIDENCE, freedom)) * np.sqrt(np.maximum(np.diag(covariance), 0.0)) / scale
    hidden = np.sum(vectors[:, ~shown] ** 2, axis=1) > RANK
    return np.where(hidden, np.inf, wide)
