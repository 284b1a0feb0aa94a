"""What a swept figure does: its knee, where it crosses another, its power law, and where it converges to."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from gantrysim.arrays import Floats

EXCESS = 0.1  # of a floor, up to which what is swept does not matter

_LEAST_GAIN = 1.05  # of one difference over the next, for an order of convergence to speak of


def knee(x: ArrayLike, y: ArrayLike, floor: float, excess: float = EXCESS) -> float | None:
    """Return the x up to which y stays within its floor and an excess: below it, x does not matter.

    Where y leaves (1 + excess) floor for the first time is interpolated in the logarithms of x and y.

    Args:
        x: ascending, above zero, (m,).
        y: above zero, (m,).
        floor: of y.
        excess: share of the floor.

    Returns:
        The knee; None where y is above from the first x on, inf where it is never.
    """
    places, values = np.asarray(x, float), np.asarray(y, float)
    bound = (1 + excess) * floor
    above = np.flatnonzero(values > bound)
    if not above.size:
        return math.inf
    k = int(above[0])
    return None if k == 0 else _between(places, np.log(values / bound), k)


def crossing(x: ArrayLike, y: ArrayLike, other: ArrayLike) -> float | None:
    """Return the first x at which y rises above another figure, interpolated in logarithms; None where it does not.

    Args:
        x: ascending, above zero, (m,).
        y: above zero, (m,).
        other: above zero, (m,) or one number.
    """
    places = np.asarray(x, float)
    ratio = np.log(np.asarray(y, float) / np.asarray(other, float))
    rising = np.flatnonzero((ratio[:-1] <= 0) & (ratio[1:] > 0))
    return _between(places, ratio, int(rising[0]) + 1) if rising.size else None


def _between(x: Floats, ratio: Floats, k: int) -> float:
    """Where a logarithm passes zero between x[k - 1] and x[k]."""
    share = ratio[k - 1] / (ratio[k - 1] - ratio[k])
    return float(np.exp((1 - share) * np.log(x[k - 1]) + share * np.log(x[k])))


def power(x: ArrayLike, y: ArrayLike) -> float:
    """Return p of the law y ~ x^p that fits best, by least squares of the logarithms; both above zero, (m,)."""
    return float(np.polyfit(np.log(np.asarray(x, float)), np.log(np.asarray(y, float)), 1)[0])


@dataclass(frozen=True)
class Convergence:
    """A figure over physics steps that are each half of the one before: f(h) = f0 + C h^p + ...

    With d = f(h) - f(h/2) of one pair of steps and d' of the next, p = log2(d / d'), and by Richardson's extrapolation
    f0 = f(h/4) - d' / (2^p - 1). Of more steps the last three are taken. Where the differences do not shrink, or change
    their sign, there is no order to be seen: then the steps' scatter is all that they do to the figure, and f0 is the
    value at the finest.

    Attributes:
        steps: physics steps, descending, (m,) [s].
        values: of the figure, (m,).
        order: p, or None.
        limit: f0.
    """

    steps: tuple[float, ...]
    values: tuple[float, ...]
    order: float | None
    limit: float

    @classmethod
    def of(cls, steps: ArrayLike, values: ArrayLike) -> Convergence:
        """Return the convergence of at least three values, (m,), over steps that halve, (m,) [s]."""
        h, f = np.asarray(steps, float), np.asarray(values, float)
        before, after = f[-3] - f[-2], f[-2] - f[-1]
        order, limit = None, float(f[-1])
        if after and before / after > _LEAST_GAIN:
            order = math.log2(before / after)
            limit = float(f[-1] - after / (2**order - 1))
        return cls(tuple(h.tolist()), tuple(f.tolist()), order, limit)

    @property
    def deviation(self) -> float:
        """How far the first step's value is from the limit, without an order from any other, in parts of the limit."""
        others = [self.limit] if self.order is not None else self.values
        return max(abs(self.values[0] - other) for other in others) / abs(self.limit) if self.limit else 0.0
