"""A simplex that descends to a minimum by the rules of Nelder and Mead, several of its points side by side.

Of the n + 1 points of a simplex in n coordinates, the p worst are replaced in every step. With c the centroid of the
others, a worst point x has these successors, of which the better replaces it if it is better than x:

    c + (c - x)      reflection
    c + e (c - x)    expansion, measured where the reflection is better than all points
    c + k (c - x)    contraction outside, where the reflection is better than x, but worse than all others
    c - k (c - x)    contraction inside, where it is worse than x too

Where no worst point is replaced, all points move towards the best. With p = 1 this is the method of Nelder and Mead
(1965); Lee and Wiswall (2007) move several points at once. e, k and the shrinkage depend on n as in Gao and Han (2012),
so that a simplex in many coordinates does not collapse.
"""

from __future__ import annotations

from collections.abc import Generator, Sequence
from typing import NamedTuple

import numpy as np

from gantrysim.base.arrays import Floats

Key = tuple[int, float]  # rank and amount of a candidate, to be minimised
Descent = Generator[list[Floats], Sequence[Key], None]
_Step = Generator[list[Floats], Sequence[Key], bool]
_Measurement = Generator[list[Floats], Sequence[Key], "list[Vertex]"]

# A simplex has converged if no coordinate differs by more, or if its points have one rank and such equal amounts.
_SMALL = 0.02
_FLAT = 5e-4


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
        coordinates = max(len(bounds), 2)  # in one coordinate, the rules for two
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
        return self.size < _SMALL or (rank == least_rank and amount - least < _FLAT)

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
        reflections = yield from self._measured([2 * centroid - vertex.point for vertex in worst])
        factors = [self._factor(*pair, others) for pair in zip(worst, reflections, strict=True)]
        points = [
            centroid + factor * (centroid - vertex.point)
            for vertex, factor in zip(worst, factors, strict=True)
            if factor is not None
        ]
        trials = iter((yield from self._measured(points)) if points else ())
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
        self._vertices = [best, *(yield from self._measured(points))]

    def _measured(self, points: Sequence[Floats]) -> _Measurement:
        clipped = [np.clip(point, *self._bounds.T) for point in points]
        self._keys = yield clipped
        first = len(self._keys) - len(clipped)
        return [Vertex(point, first + k) for k, point in enumerate(clipped)]
