"""The points of every round of a search: the first ones, then one simplex after another around the best."""

from __future__ import annotations

import math
from collections.abc import Generator, Sequence
from typing import NamedTuple

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.study.tuning.candidates import Candidate, SearchLimits

# A simplex that descends to a minimum by the rules of Nelder and Mead, several of its points side by side.
#
# Of the n + 1 points of a simplex in n coordinates, the p worst are replaced in every step. With c the centroid of the
# others, a worst point x has these successors, of which the better replaces it if it is better than x:
#
#     c + (c - x)      reflection
#     c + e (c - x)    expansion, measured where the reflection is better than all points
#     c + k (c - x)    contraction outside, where the reflection is better than x, but worse than all others
#     c - k (c - x)    contraction inside, where it is worse than x too
#
# Where no worst point is replaced, all points move towards the best. With p = 1 this is the method of Nelder and Mead
# (1965); Lee and Wiswall (2007) move several points at once. e, k and the shrinkage depend on n as in Gao and Han
# (2012), so that a simplex in many coordinates does not collapse.

Key = tuple[int, float]  # rank and amount of a candidate, to be minimised
Descent = Generator[list[Floats], Sequence[Key], None]
_Step = Generator[list[Floats], Sequence[Key], bool]
_Measurement = Generator[list[Floats], Sequence[Key], "list[Vertex]"]

# A simplex has converged if no coordinate differs by more, or if its points have one rank and such equal amounts.
_SMALL_SIDE = 0.02
_FLAT_OBJECTIVE = 5e-4


class Vertex(NamedTuple):
    """A point of a simplex, (n,), and its number among all candidates."""

    point: Floats
    number: int


class Simplex:
    """A simplex within bounds.

    Args:
        vertices: one more than there are coordinates.
        bounds: of the coordinates, (n, 2).
        moved: number of points that are replaced in a step, at most half of them.
        keys: of all candidates so far; later ones are sent to `descend`.
    """

    def __init__(self, vertices: Sequence[Vertex], bounds: Floats, moved: int, keys: Sequence[Key]) -> None:
        self._bounds = bounds
        self._moved = max(1, min(moved, len(vertices) // 2))
        self._keys = keys
        self._vertices = list(vertices)
        # in one coordinate, the rules for two
        coordinates = max(len(bounds), 2)
        self._expansion = 1 + 2 / coordinates
        self._contraction = 0.75 - 0.5 / coordinates
        self._shrinkage = 1 - 1 / coordinates

    def _key(self, vertex: Vertex) -> Key:
        return self._keys[vertex.number]

    @property
    def size(self) -> float:
        """The largest difference of a coordinate from that of the best point."""
        best = min(self._vertices, key=self._key)
        return max(float(np.abs(vertex.point - best.point).max()) for vertex in self._vertices)

    @property
    def converged(self) -> bool:
        """Whether the simplex is small, or its points are equally good."""
        least_rank, least = min(map(self._key, self._vertices))
        rank, amount = max(map(self._key, self._vertices))
        return self.size < _SMALL_SIDE or (rank == least_rank and amount - least < _FLAT_OBJECTIVE)

    def descend(self) -> Descent:
        """Yield points to be measured, and receive the keys of all candidates, the points' last, until converged."""
        while not self.converged:
            replaced = yield from self._step()
            if not replaced:
                yield from self._shrink()

    def _step(self) -> _Step:
        """Replace the worst points, and return whether any was replaced."""
        self._vertices.sort(key=self._key)
        others = self._vertices[: -self._moved]
        worst = self._vertices[-self._moved :]
        centroid = np.mean([vertex.point for vertex in others], axis=0)
        reflections = yield from self._measurement_of([2 * centroid - vertex.point for vertex in worst])
        factors = [self._factor(*pair, others) for pair in zip(worst, reflections, strict=True)]
        points = [
            centroid + factor * (centroid - vertex.point)
            for vertex, factor in zip(worst, factors, strict=True)
            if factor is not None
        ]
        trials = iter((yield from self._measurement_of(points)) if points else ())
        successors = []
        for vertex, reflection, factor in zip(worst, reflections, factors, strict=True):
            candidates = [vertex, reflection] if factor is None else [vertex, reflection, next(trials)]
            successors.append(min(candidates, key=self._key))
        self._vertices = [*others, *successors]
        return any(new.number != old.number for new, old in zip(successors, worst, strict=True))

    def _factor(self, vertex: Vertex, reflection: Vertex, others: Sequence[Vertex]) -> float | None:
        """Return the distance of the second trial from the centroid, over that of the reflection; None without one."""
        key = self._key(reflection)
        if key < min(map(self._key, others)):
            return self._expansion
        if key < max(map(self._key, others)):
            return None
        return self._contraction if key < self._key(vertex) else -self._contraction

    def _shrink(self) -> Descent:
        best, *others = sorted(self._vertices, key=self._key)
        points = [best.point + self._shrinkage * (vertex.point - best.point) for vertex in others]
        self._vertices = [best, *(yield from self._measurement_of(points))]

    def _measurement_of(self, points: Sequence[Floats]) -> _Measurement:
        clipped = [np.clip(point, *self._bounds.T) for point in points]
        self._keys = yield clipped
        first = len(self._keys) - len(clipped)
        return [Vertex(point, first + k) for k, point in enumerate(clipped)]


_SIMPLEX_STEP = 0.2  # of a new simplex
_PROGRESS = 0.002  # share by which the metric must fall
_IDLE_SIMPLEXES = 3  # simplexes in succession without progress, after which there are no more rounds
_LEAST_METRIC = 1e-12  # of a metric or a torque ripple


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
    # which may be the start of the search
    begins[0] = estimates.best()
    idle = 0
    while begins or idle < _IDLE_SIMPLEXES:
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
        # a simplex may have collapsed: the next one begins on the other side
        signs = -signs


def _around(centre: Floats, signs: Floats, bounds: Floats) -> list[Floats]:
    """Return a point in the direction of each coordinate, (d,), on the other side where a bound is near."""
    low, high = bounds.T
    ahead = centre + _SIMPLEX_STEP * signs
    steps = _SIMPLEX_STEP * np.where((low <= ahead) & (ahead <= high), signs, -signs)
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
                metric[k] *= near.metric / max(*(near.results[m].metric for m in candidate.results), _LEAST_METRIC)
                ripples[k] *= near.ripple / max(*(near.results[m].ripple for m in candidate.results), _LEAST_METRIC)
        self.points = points
        self.metric = np.log(np.maximum(metric, _LEAST_METRIC))
        self.ripple = np.log(np.maximum(ripples / limits.ripple, _LEAST_METRIC))
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
        # amounts are logarithms: a share is a difference
        if old_rank == new_rank == 1:
            old_amount -= share
        return (new_rank, new_amount) < (old_rank, old_amount)
