"""A trust region: the points around the best one at which a surrogate expects the least value.

The surrogate predicts the logarithm of the metric and, where it comes near its limit, that of the torque ripple. A
round of points is chosen one after the other as the least of

    metric - c deviation + penalty of (ripple + its deviation) above the limit

with several c, each point then taken to have its predicted value. While the centre moves, the last point of a round
repeats its last two moves at once: the least values lie along the floor of a narrow, sharp valley, where a smooth
surrogate expects them near the centre. The region grows when a round finds a better point, and shrinks when it does
not.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize

from gantrysim.base.arrays import Floats
from gantrysim.tuning.surrogate import Surrogate

# half the side of the region
_RADIUS = 0.4
_LARGEST = 0.8
_SMALLEST = 0.01
_GROWTH = 1.6
_SHRINKAGE = 0.6
_SIDES = (0.4, 2.5)  # of the region along a coordinate, over their mean: as the scales of the metric
_NEAREST = 100  # measured points in a surrogate
_ABOVE = 2.0  # values further above the least are cut, so that they do not bend the surrogate there
_RIPPLES = (-2.0, 1.0)  # the ripple is cut likewise, on both sides
_NEAR = -0.7  # a ripple below this at all points is far from its limit, and needs no surrogate
_CAUTION = (0.0, 1.0, 2.0, 1.0)  # c of the points of a round, in turn
_PENALTY = 20.0
# to find the least: random points, descents from the best, steps of each
_SAMPLES = 400
_STARTS = 3
_STEPS = 40
_CHANGED = 10  # coordinates of a random point that differ from the centre, in the mean
_MOVES = 2  # of the centre that are repeated at once
_NUDGE = 1e-5  # of a difference quotient


class Measured(NamedTuple):
    """Measured points.

    Attributes:
        points: (n, d).
        metric: logarithm of the metric, inf where there is none, (n,).
        ripple: logarithm of the torque ripple over its limit, inf where there is none, (n,).
    """

    points: Floats
    metric: Floats
    ripple: Floats


@dataclass(eq=False)
class TrustRegion:
    """A box around the best point that shrinks until it holds the minimum.

    Attributes:
        bounds: of the coordinates, (d, 2).
        rng: of the random points.
        radius: half the mean side.
    """

    bounds: Floats
    rng: np.random.Generator
    radius: float = _RADIUS
    _metric: Surrogate | None = None
    _ripple: Surrogate | None = None
    _centres: list[Floats] = field(default_factory=list)

    @property
    def converged(self) -> bool:
        """Whether the region is small."""
        return self.radius < _SMALLEST

    def adapt(self, *, improved: bool) -> None:
        """Grow or shrink the region after a round."""
        self.radius = min(self.radius * _GROWTH, _LARGEST) if improved else self.radius * _SHRINKAGE

    def ask(self, measured: Measured, best: int, count: int) -> list[Floats]:
        """Return the points of a round, (d,) each.

        Args:
            measured: so far.
            best: number of the best measured point, the centre of the region.
            count: number of points to return.
        """
        centre = measured.points[best]
        near = np.argsort(((measured.points - centre) ** 2).sum(axis=1), kind="stable")[:_NEAREST]
        points = measured.points[near]
        values = measured.metric[near]
        slack = measured.ripple[near]
        least = float(values.min())
        values = np.minimum(values, _ABOVE + (least if np.isfinite(least) else 0.0))
        metric = self._metric = Surrogate.fitted(points, values, self._metric)
        known = np.isfinite(slack)
        ripple = None
        if known.any() and slack[known].max() > _NEAR:
            ripple = self._ripple = Surrogate.fitted(points[known], np.clip(slack[known], *_RIPPLES), self._ripple)
        half = self.radius * np.clip(metric.scales / np.exp(np.log(metric.scales).mean()), *_SIDES)
        low = np.maximum(centre - half, self.bounds[:, 0])
        high = np.minimum(centre + half, self.bounds[:, 1])
        repeated = self._repeated(centre) if count > 1 else []
        chosen = []
        for k in range(count - len(repeated)):
            point = self._least(metric, ripple, centre, np.stack([low, high], axis=1), _CAUTION[k % len(_CAUTION)])
            chosen.append(point)
            # as if it had been measured there, or all points of the round would be the same
            metric = metric.extended(point, float(metric.predict(point[None])[0][0]))
        return chosen + repeated

    def _repeated(self, centre: Floats) -> list[Floats]:
        """Return the point that repeats the last moves, if the centre has just moved so often."""
        if self._centres and np.array_equal(self._centres[-1], centre):
            return []
        self._centres.append(centre)
        if len(self._centres) <= _MOVES:
            return []
        return [np.clip(2 * centre - self._centres[-1 - _MOVES], *self.bounds.T)]

    def _least(
        self, metric: Surrogate, ripple: Surrogate | None, centre: Floats, box: Floats, caution: float
    ) -> Floats:
        def cost(points: Floats) -> Floats:
            value, deviation = metric.predict(points)
            value = value - caution * deviation
            if ripple is not None:
                slack, deviation = ripple.predict(points)
                value = value + _PENALTY * np.maximum(slack + deviation, 0.0)
            return value

        def sloped(point: Floats) -> tuple[float, Floats]:
            values = cost(np.vstack([point, point + _NUDGE * np.eye(len(point))]))
            return float(values[0]), (values[1:] - values[0]) / _NUDGE

        samples = self.rng.uniform(box[:, 0], box[:, 1], (_SAMPLES, len(centre)))
        changed = self.rng.random(samples.shape) < _CHANGED / len(centre)
        samples = np.where(changed, samples, centre)  # in many dimensions, points that differ in all lie at the walls
        best = samples[np.argsort(cost(samples), kind="stable")[:_STARTS]]
        descents = [
            minimize(sloped, start, jac=True, method="L-BFGS-B", bounds=box, options={"maxiter": _STEPS}).x
            for start in best
        ]
        ends = np.vstack([descents, best])
        return np.asarray(ends[cost(ends).argmin()], float)
