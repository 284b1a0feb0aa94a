"""Statistics of many machines: the yield, and the influence of every factor."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from gantrysim.base.arrays import Floats

_CONFIDENCE = 0.95
_ROUNDING = 1e-12  # of a variance


@dataclass(frozen=True)
class Yield:
    """Share of machines within a tolerance.

    Attributes:
        within: number of machines within it.
        count: number of all machines.
        low, high: bounds of the share's 95 % Wilson interval; conservative, as a Latin hypercube is more even than
            random samples.
    """

    within: int
    count: int
    low: float
    high: float

    @property
    def share(self) -> float:
        return self.within / self.count


def yield_of(within: int, count: int) -> Yield:
    """Return the yield with its Wilson interval: all shares p for which |within/n - p| <= z sqrt(p (1 - p) / n).

    Source: E. B. Wilson, Probable inference, the law of succession, and statistical inference, 1927.
    """
    from scipy.stats import norm  # slow to import

    z2 = float(norm.ppf(0.5 + 0.5 * _CONFIDENCE)) ** 2
    share = within / count
    middle = (share + z2 / (2 * count)) / (1 + z2 / count)
    half = math.sqrt(z2 * (share * (1 - share) / count + z2 / (4 * count**2))) / (1 + z2 / count)
    return Yield(within, count, max(middle - half, 0.0), min(middle + half, 1.0))


@dataclass(frozen=True)
class Influence:
    """Influence of a factor on a metric.

    Attributes:
        factor: name.
        coefficient: standardised rank regression coefficient, about -1 to 1.
        clear: whether it is significant: by chance any factor would be in one study of twenty.
    """

    factor: str
    coefficient: float
    clear: bool


def influences(factors: dict[str, Floats], metric: Floats) -> tuple[list[Influence], float]:
    """Return the influence of every factor, the largest first, and the share of variance that they explain together.

    The ranks of the metric are fitted by those of the factors, all of mean 0 and variance 1: y = X b + e. For
    uncorrelated factors b is Spearman's rank correlation, but tested against what the others leave unexplained:
    b / sqrt(e.e / (n - k - 1) (X'X)^-1) has Student's distribution for a factor without influence. With few machines
    for many factors hardly any freedom is left for that, and the rank correlation alone is the stronger test: a factor
    is significant by either. Of k factors without influence none is by one of the 2k tests, each at 0.05 / 2k, in 95 %
    of all studies (Bonferroni).

    Args:
        factors: values of k factors by name, (n,) with n above k + 1.
        metric: of the same machines, (n,); inf for a failed run, worse than any other.
    """
    from scipy.stats import rankdata, spearmanr, t  # slow to import

    def standardised(values: Floats) -> Floats:
        ranks = rankdata(values)
        deviation = ranks.std()
        return (ranks - ranks.mean()) / deviation if deviation > 0 else np.zeros(ranks.size)

    n = metric.size
    k = len(factors)
    x = np.column_stack([standardised(values) for values in factors.values()])
    y = standardised(metric)
    inverse = np.linalg.pinv(x.T @ x)
    b = inverse @ x.T @ y
    residual = max(float(np.sum((y - x @ b) ** 2)), _ROUNDING * n)
    error = np.sqrt(residual / (n - k - 1) * np.diag(inverse))
    level = (1 - _CONFIDENCE) / (2 * k)
    bound = float(t.ppf(1 - 0.5 * level, n - k - 1))
    alone = [bool(y.any() and column.any() and spearmanr(column, y).pvalue < level) for column in x.T]
    unsorted = [
        Influence(name, float(coefficient), bool(abs(coefficient) > bound * sigma) or by_itself)
        for name, coefficient, sigma, by_itself in zip(factors, b, error, alone, strict=True)
    ]
    explained = 1 - residual / n if y.any() else 0.0
    return sorted(unsorted, key=lambda influence: -abs(influence.coefficient)), explained
