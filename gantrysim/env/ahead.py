"""Episodes drawn ahead on threads, while others run."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import numpy as np

from gantrysim.env.episodes import Episode, Source

_THREADS = 2  # for Python's part of the work is done by one thread at a time


class DrawnAhead:
    """Draws episodes from copies of random number generators; each is used only if its generator is unchanged.

    Args:
        source: of the episodes.
    """

    def __init__(self, source: Source) -> None:
        self._source = source
        self._threads = ThreadPoolExecutor(_THREADS, "episodes")
        self._next: dict[int, tuple[Any, Future[tuple[Episode, Any]]]] = {}  # state before; episode and state after

    def prepare(self, randoms: Mapping[int, np.random.Generator]) -> None:
        """Begin to draw the next episode of each place from a copy of its random numbers."""
        for place, random in randoms.items():
            before = random.bit_generator.state
            own = np.random.Generator(type(random.bit_generator)(0))
            own.bit_generator.state = before
            self._next[place] = before, self._threads.submit(self._draw, own)

    def take(self, randoms: Mapping[int, np.random.Generator]) -> dict[int, Episode]:
        """Return the episodes that `Source.draw` would return, and advance the random numbers as it would."""
        missing = {
            place: random
            for place, random in randoms.items()
            if place not in self._next or self._next[place][0] != random.bit_generator.state
        }
        for place in missing:
            if place in self._next:
                self._next.pop(place)[1].cancel()
        self.prepare(missing)
        episodes = {}
        for place, random in randoms.items():
            episodes[place], random.bit_generator.state = self._next.pop(place)[1].result()
        return episodes

    def _draw(self, random: np.random.Generator) -> tuple[Episode, Any]:
        return self._source.draw(random), random.bit_generator.state

    def close(self) -> None:
        """Draw no more."""
        self._threads.shutdown(wait=False, cancel_futures=True)
