"""The points of every round of a search: first ones around the start, then those of one trust region after another."""

from __future__ import annotations

import math
from collections.abc import Generator, Sequence

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.tuning.candidates import Candidate
from gantrysim.tuning.region import Measured, TrustRegion

BATCH = 4  # points of a round, unless it is the first one of a region

_STEP = 0.3  # of the simplex
_RANDOM = 4  # points among which a region begins that is not around the best one
_PROGRESS = 0.002  # share by which the metric must fall
_IDLE = 6  # regions in succession without progress, after which there are no more rounds
_LEAST = 1e-12  # of a metric or a torque ripple
# a region this small is left if its metric is larger than the least by this share
_SMALL = 0.1
_HOPELESS = 0.2


def rounds(
    begin: Floats,
    bounds: Floats,
    natural: Floats,
    *,
    known: bool,
    machines: int,
    ripple: float,
    seed: int,
    batch: int = BATCH,
) -> Generator[list[Floats], Sequence[Candidate], None]:
    """Yield the points of a round, and receive all candidates considered so far, those of the round last.

    The first coordinates are rho, as in `gantrysim.tuning.search`, the others the shape.

    Args:
        begin: the start, (d,).
        bounds: of the coordinates, (d, 2).
        natural: shape of the natural numbers, (shapes,).
        known: whether the start is the first of the candidates that are received, and need not be proposed.
        machines: number of them.
        ripple: largest torque ripple allowed, a share of the peak torque.
        seed: of the random numbers.
        batch: number of points of a round.
    """
    rng = np.random.default_rng(seed)
    low, high = bounds.T
    groups = len(begin) - len(natural)
    usual = np.concatenate([np.zeros(groups), natural])
    edge = np.concatenate([np.zeros(groups), begin[groups:]])
    first = [edge, usual] if known or np.array_equal(begin, edge) else [begin, edge, usual]
    now = Estimates((yield first), machines, ripple)
    centre = now.measured.points[now.best()]
    steps = np.where(centre + _STEP <= high, _STEP, -_STEP)
    now = Estimates((yield list(np.clip(centre + np.diag(steps), low, high))), machines, ripple)
    idle = 0
    turn = 0
    since = 0
    while idle < _IDLE:
        least = now.best()
        if turn % 2:
            since = len(now.keys)
            points = rng.uniform(np.maximum(usual - 1, low), np.minimum(usual + 1, high), (_RANDOM, len(begin)))
            points[:, :groups] = 0.0
            now = Estimates((yield list(points)), machines, ripple)
        else:
            since = 0
        region = TrustRegion(bounds, rng)
        while not region.converged:
            best = now.best(since)
            now = Estimates((yield region.ask(now.measured, best, batch)), machines, ripple)
            region.adapt(improved=now.falls(best, now.best(since), _PROGRESS))
            if region.radius < _SMALL and now.falls(now.best(since), now.best(), _HOPELESS):
                break
        idle = 0 if now.falls(least, now.best(), _PROGRESS) else idle + 1
        turn += 1


class Estimates:
    """Candidates by their metric and torque ripple over all machines, estimated where they were run on some.

    A candidate that was not run on all machines has its largest value so far, times the ratio of the largest of all
    to that of the same machines at the nearest candidate that was.

    Attributes:
        measured: points and values of the candidates.
        keys: rank and amount, to be minimised; the amount of a feasible candidate is the logarithm of its metric.
    """

    def __init__(self, candidates: Sequence[Candidate], machines: int, ripple: float) -> None:
        points = np.array([one.point for one in candidates])
        full = [k for k, one in enumerate(candidates) if len(one.results) == machines and math.isfinite(one.metric)]
        metric = np.full(len(points), np.inf)
        ripples = np.full(len(points), np.inf)
        for k, one in enumerate(candidates):
            if not one.results:
                continue
            metric[k], ripples[k] = one.metric, one.ripple
            if len(one.results) < machines and full:
                near = candidates[full[int(np.argmin(((points[full] - points[k]) ** 2).sum(axis=1)))]]
                metric[k] *= near.metric / max(*(near.results[m].metric for m in one.results), _LEAST)
                ripples[k] *= near.ripple / max(*(near.results[m].ripple for m in one.results), _LEAST)
        logs = (np.log(np.maximum(values, _LEAST)) for values in (metric, ripples / ripple))
        self.measured = Measured(points, *logs)
        self.keys = [self._key(one, k, ripple) for k, one in enumerate(candidates)]

    def _key(self, candidate: Candidate, k: int, ripple: float) -> tuple[int, float]:
        if not math.isfinite(self.measured.metric[k]):
            return candidate.order(ripple)
        slack = float(self.measured.ripple[k])
        return (2, slack) if slack > 0 else (1, float(self.measured.metric[k]))

    def best(self, since: int = 0) -> int:
        """Return the number of the best candidate from one of a number on."""
        return min(range(since, len(self.keys)), key=self.keys.__getitem__)

    def falls(self, old: int, new: int, share: float) -> bool:
        """Return whether a candidate has a better rank than another, or a metric that is less by a share."""
        (before, amount), (after, left) = self.keys[old], self.keys[new]
        return (after, left) < (before, amount - (share if before == after == 1 else 0.0))
