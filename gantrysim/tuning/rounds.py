"""The points of every round of a search: first around the start, then from one trust region after another."""

from __future__ import annotations

import math
from collections.abc import Generator, Sequence

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.tuning.candidates import Candidate, SearchLimits
from gantrysim.tuning.region import Measured, TrustRegion

_STEP = 0.3  # of the simplex
_RANDOM = 4  # points among which a region begins that is not around the best one
_PROGRESS = 0.002  # share by which the metric must fall
_IDLE = 6  # regions in succession without progress, after which there are no more rounds
_LEAST = 1e-12  # of a metric or a torque ripple
# a region this small is left if its metric is larger than the least by this share
_SMALL = 0.1
_HOPELESS = 0.2


def rounds(
    begin: Floats, bounds: Floats, natural: Floats, limits: SearchLimits, *, known: bool
) -> Generator[list[Floats], Sequence[Candidate], None]:
    """Yield the points of a round, and receive all candidates considered so far, the round's last.

    The first coordinates are rho, as in `gantrysim.tuning.search`, the others the shape.

    Args:
        begin: the start, (d,).
        bounds: of the coordinates, (d, 2).
        natural: shape of the natural numbers, (shapes,).
        limits: of the search.
        known: whether the start is the first of the candidates that are received, and need not be proposed.
    """
    rng = np.random.default_rng(limits.seed)
    low, high = bounds.T
    groups = len(begin) - len(natural)
    usual = np.concatenate([np.zeros(groups), natural])
    edge = np.concatenate([np.zeros(groups), begin[groups:]])
    first = [edge, usual] if known or np.array_equal(begin, edge) else [begin, edge, usual]
    estimates = Estimates((yield first), limits)
    centre = estimates.measured.points[estimates.best()]
    steps = np.where(centre + _STEP <= high, _STEP, -_STEP)
    estimates = Estimates((yield list(np.clip(centre + np.diag(steps), low, high))), limits)
    idle = 0
    turn = 0
    since = 0  # number of the first candidate that belongs to the present region
    while idle < _IDLE:
        least = estimates.best()
        if turn % 2:  # every other region begins elsewhere: the metric has more than one valley
            since = len(estimates.keys)
            points = rng.uniform(np.maximum(usual - 1, low), np.minimum(usual + 1, high), (_RANDOM, len(begin)))
            points[:, :groups] = 0.0
            estimates = Estimates((yield list(points)), limits)
        else:
            since = 0
        region = TrustRegion(bounds, rng)
        while not region.converged:
            best = estimates.best(since)
            estimates = Estimates((yield region.ask(estimates.measured, best, limits.batch)), limits)
            region.adapt(improved=estimates.falls(best, estimates.best(since), _PROGRESS))
            if region.radius < _SMALL and estimates.falls(estimates.best(since), estimates.best(), _HOPELESS):
                break
        idle = 0 if estimates.falls(least, estimates.best(), _PROGRESS) else idle + 1
        turn += 1


class Estimates:
    """Candidates by their metric and torque ripple over all machines, estimated where they were run on some.

    A candidate that was not run on all machines has its largest value so far, times the ratio of the largest of all
    to that of the same machines at the nearest candidate that was.

    Attributes:
        measured: points and values of the candidates.
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
        log_metric = np.log(np.maximum(metric, _LEAST))
        log_ripple = np.log(np.maximum(ripples / limits.ripple, _LEAST))
        self.measured = Measured(points, log_metric, log_ripple)
        self.keys = [self._key(candidate, k, limits.ripple) for k, candidate in enumerate(candidates)]

    def _key(self, candidate: Candidate, k: int, ripple: float) -> tuple[int, float]:
        if not math.isfinite(self.measured.metric[k]):
            return candidate.order(ripple)
        slack = float(self.measured.ripple[k])
        return (2, slack) if slack > 0 else (1, float(self.measured.metric[k]))

    def best(self, since: int = 0) -> int:
        """Return the number of the best candidate among those from number `since` on."""
        return min(range(since, len(self.keys)), key=self.keys.__getitem__)

    def falls(self, old: int, new: int, share: float) -> bool:
        """Return whether candidate `new` has a better rank than `old`, or a metric that is less by a share."""
        old_rank, old_amount = self.keys[old]
        new_rank, new_amount = self.keys[new]
        if old_rank == new_rank == 1:  # amounts are logarithms: a share is a difference
            old_amount -= share
        return (new_rank, new_amount) < (old_rank, old_amount)
