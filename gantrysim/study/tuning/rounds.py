"""The points of every round of a search: the first ones, then one simplex after another around the best."""

from __future__ import annotations

import math
from collections.abc import Generator, Sequence

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.study.tuning.candidates import Candidate, SearchLimits
from gantrysim.study.tuning.simplex import Simplex, Vertex

_STEP = 0.2  # of a new simplex
_PROGRESS = 0.002  # share by which the metric must fall
_IDLE = 3  # simplexes in succession without progress, after which there are no more rounds
_LEAST = 1e-12  # of a metric or a torque ripple


def rounds(
    valleys: Sequence[Sequence[Floats]], bounds: Floats, limits: SearchLimits
) -> Generator[list[Floats], Sequence[Candidate], None]:
    """Yield the points of a round, and receive all candidates considered so far, the round's last.

    Args:
        valleys: points of the first round, (d,) each, by the valley of the metric in which they lie; a simplex begins
            around the best point of each, the best valley first.
        bounds: of the coordinates, (d, 2).
        limits: of the search.
    """
    signs = np.random.default_rng(limits.seed).choice([-1.0, 1.0], len(bounds))
    estimates = Estimates((yield [point for valley in valleys for point in valley]), limits)
    begins = sorted((estimates.best(valley) for valley in valleys), key=estimates.keys.__getitem__)
    begins[0] = estimates.best()  # which may be the start of the search
    idle = 0
    while begins or idle < _IDLE:
        best = estimates.best()
        start = begins.pop(0) if begins else best
        centre = estimates.points[start]
        points = _around(centre, signs, bounds)
        estimates = Estimates((yield points), limits)
        count = len(estimates.keys)
        vertices = [Vertex(centre, start)]
        vertices += [Vertex(point, count - len(points) + k) for k, point in enumerate(points)]
        descent = Simplex(vertices, bounds, limits.batch, estimates.keys).descend()
        points = next(descent, [])
        while points:
            estimates = Estimates((yield points), limits)
            try:
                points = descent.send(estimates.keys)
            except StopIteration:
                points = []
        idle = 0 if estimates.falls(best, estimates.best(), _PROGRESS) else idle + 1
        signs = -signs  # a simplex may have collapsed: the next one begins on the other side


def _around(centre: Floats, signs: Floats, bounds: Floats) -> list[Floats]:
    """Return a point in the direction of each coordinate, (d,), on the other side where a bound is near."""
    low, high = bounds.T
    ahead = centre + _STEP * signs
    steps = _STEP * np.where((low <= ahead) & (ahead <= high), signs, -signs)
    return list(np.clip(centre + np.diag(steps), low, high))


class Estimates:
    """Candidates by their metric and torque ripple over all machines, estimated where they were run on some.

    A candidate that was not run on all machines has its largest value so far, times the ratio of the largest of all
    to that of the same machines at the nearest candidate that was.

    Attributes:
        points: of the candidates, (n, d).
        metric: logarithm of the metric, inf where there is none, (n,).
        ripple: logarithm of the torque ripple over its limit, inf where there is none, (n,).
        keys: rank and amount, to be minimised; the amount of a feasible candidate is the logarithm of its metric.
    """

    def __init__(self, candidates: Sequence[Candidate], limits: SearchLimits) -> None:
        points = np.array([candidate.point for candidate in candidates])
        run_on_all = [
            k
            for k, candidate in enumerate(candidates)
            if len(candidate.results) == limits.machines and math.isfinite(candidate.metric)
        ]
        metric = np.full(len(points), np.inf)
        ripples = np.full(len(points), np.inf)
        for k, candidate in enumerate(candidates):
            if not candidate.results:
                continue
            metric[k] = candidate.metric
            ripples[k] = candidate.ripple
            if len(candidate.results) < limits.machines and run_on_all:
                distances = ((points[run_on_all] - points[k]) ** 2).sum(axis=1)
                near = candidates[run_on_all[int(np.argmin(distances))]]
                # the same machines at the nearest candidate tell how much harder the others are
                metric[k] *= near.metric / max(*(near.results[m].metric for m in candidate.results), _LEAST)
                ripples[k] *= near.ripple / max(*(near.results[m].ripple for m in candidate.results), _LEAST)
        self.points = points
        self.metric = np.log(np.maximum(metric, _LEAST))
        self.ripple = np.log(np.maximum(ripples / limits.ripple, _LEAST))
        self.keys = [self._key(candidate, k, limits.ripple) for k, candidate in enumerate(candidates)]

    def _key(self, candidate: Candidate, k: int, ripple: float) -> tuple[int, float]:
        if not math.isfinite(self.metric[k]):
            return candidate.order(ripple)
        slack = float(self.ripple[k])
        return (2, slack) if slack > 0 else (1, float(self.metric[k]))

    def best(self, points: Sequence[Floats] = ()) -> int:
        """Return the number of the best candidate, of those at some points if any was considered."""
        numbers = [k for k, place in enumerate(self.points) if any(np.array_equal(place, point) for point in points)]
        return min(numbers or range(len(self.keys)), key=self.keys.__getitem__)

    def falls(self, old: int, new: int, share: float) -> bool:
        """Return whether candidate `new` has a better rank than `old`, or a metric that is less by a share."""
        old_rank, old_amount = self.keys[old]
        new_rank, new_amount = self.keys[new]
        if old_rank == new_rank == 1:  # amounts are logarithms: a share is a difference
            old_amount -= share
        return (new_rank, new_amount) < (old_rank, old_amount)
