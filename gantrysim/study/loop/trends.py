"""Trends of a swept value: its knee, crossing, power law and convergence."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from gantrysim.base.arrays import Floats
from gantrysim.study.cases import Row
from gantrysim.study.drawing import series
from gantrysim.study.loop.study import LOOP_ALONE, NO_LOOP

FLOOR_EXCESS = 0.1  # over a floor, up to which the swept setting has no effect

# values whose convergence over the physics step is examined
CONVERGING_VALUES = {
    "contour_rms_um": "contour error",
    "servo_rms_um": "servo error",
    "following_along_rms_um": "following error along the path",
    "structure_rms_um": "structure part",
    "spacing_std_mm": "standard deviation of the spacing",
}

_LEAST_GAIN = 1.05  # of one difference over the next, for an order of convergence


def knee(x: ArrayLike, y: ArrayLike, floor: float, excess: float = FLOOR_EXCESS) -> float | None:
    """Return the knee of y: the x up to which y stays below (1 + excess) floor, so that x has no effect.

    The first crossing is interpolated in the logarithms of x and y, both above zero, (m,), x ascending. None if y is
    above from the first x on, inf if it never is.
    """
    places = np.asarray(x, float)
    values = np.asarray(y, float)
    bound = (1 + excess) * floor
    above = np.flatnonzero(values > bound)
    if not above.size:
        return math.inf
    k = int(above[0])
    return None if k == 0 else _between(places, np.log(values / bound), k)


def crossing(x: ArrayLike, y: ArrayLike, other: ArrayLike) -> float | None:
    """Return the first x at which y rises above another value, interpolated in logarithms, or None.

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
    """Return the x between x[k - 1] and x[k] at which the logarithm of a ratio crosses zero."""
    share = ratio[k - 1] / (ratio[k - 1] - ratio[k])
    return float(np.exp((1 - share) * np.log(x[k - 1]) + share * np.log(x[k])))


def power(x: ArrayLike, y: ArrayLike) -> float:
    """Return p of y ~ x^p, fitted by least squares of the logarithms; both above zero, (m,)."""
    return float(np.polyfit(np.log(np.asarray(x, float)), np.log(np.asarray(y, float)), 1)[0])


@dataclass(frozen=True)
class Convergence:
    """Convergence of a value over halving physics steps: f(h) = f0 + C h^p + ...

    With d = f(h) - f(h/2) of one pair of steps and d' of the next, p = log2(d / d'), and by Richardson's extrapolation
    f0 = f(h/4) - d' / (2^p - 1), from the last three steps. Where the differences do not shrink or change sign, there
    is no order but scatter, and f0 is the value at the finest step.

    Attributes:
        steps: physics steps, descending, (m,) [s].
        values: at the steps, (m,).
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
        h = np.asarray(steps, float)
        f = np.asarray(values, float)
        before = f[-3] - f[-2]
        after = f[-2] - f[-1]
        order = None
        limit = float(f[-1])
        if after and before / after > _LEAST_GAIN:
            order = math.log2(before / after)
            limit = float(f[-1] - after / (2**order - 1))
        return cls(tuple(h.tolist()), tuple(f.tolist()), order, limit)

    @property
    def deviation(self) -> float:
        """Relative deviation of the first step's value from the limit; without an order, the largest of any step."""
        others = [self.limit] if self.order is not None else self.values
        return max(abs(self.values[0] - other) for other in others) / abs(self.limit) if self.limit else 0.0


def loop_knee(rows: Sequence[Row]) -> tuple[float | None, float] | None:
    """Return the knee of the loop alone [s], as `knee`, and its floor, the contour error without any loop [µm].

    None without the cases for it.
    """
    period, contour = series(rows, "value", "contour_rms_um", sweep="loop_period", variant=LOOP_ALONE)
    floor = series(rows, "contour_rms_um", sweep="loop_period", variant=NO_LOOP)[0]
    if not floor.size or period.size < 2:
        return None
    return knee(period, contour, float(floor[0])), float(floor[0])


def convergence(rows: Sequence[Row], variant: str) -> dict[str, Convergence]:
    """Return the convergence of a variant's values over the physics step, by column."""
    trends = {}
    for column in CONVERGING_VALUES:
        step, value = series(rows, "value", column, sweep="physics_step", variant=variant)
        if step.size >= 3:
            trends[column] = Convergence.of(step[::-1], value[::-1])
    return trends
