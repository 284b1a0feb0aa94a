"""Episodes drawn ahead on a thread, while others run."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import numpy as np

from gantrysim.env.episodes import Episode, Source

# Of many places for each core, one thread for each core is done soonest. Where they are few, the next episodes take as
# long to draw as a decision, and the thread that shares its core with them is late with the last place, while the other
# cores have nothing left to do: two threads for each core then.
_MANY = 16


class DrawnAhead:
    """Draws episodes from copies of random number generators; each is used only if its generator is unchanged.

    It draws on one thread, as almost all of the work holds Python's lock, and while the others run natively, as it
    would keep them from that lock.

    Args:
        source: of the episodes.
    """

    def __init__(self, source: Source) -> None:
        self._source = source
        self._thread = ThreadPoolExecutor(1, "episodes")
        self._asked: dict[int, tuple[type[np.random.BitGenerator], Any]] = {}  # random numbers and their state
        self._over: list[Episode | None] = []
        self._next: dict[int, tuple[Any, Future[tuple[Episode, Any]]]] = {}  # state before; episode and state after

    def prepare(self, randoms: Mapping[int, np.random.Generator]) -> None:
        """Ask for the next episode of each place, from a copy of its random numbers."""
        for place, random in randoms.items():
            self._asked[place] = type(random.bit_generator), random.bit_generator.state

    def free(self, episodes: Iterable[Episode | None]) -> None:
        """Take episodes that are over, to free their memory on the thread too."""
        self._over += episodes

    def start(self) -> None:
        """Begin to draw the episodes that are asked for; best before Python waits for native code."""
        if self._over:
            self._thread.submit(self._over.clear)
        for place, (kind, before) in self._asked.items():
            self._next[place] = before, self._thread.submit(self._draw, kind, before)
        self._asked.clear()

    def take(self, randoms: Mapping[int, np.random.Generator]) -> dict[int, Episode]:
        """Return the episodes that `Source.draw` would return, and advance the random numbers as it would."""
        self.start()
        missing = {
            place: random
            for place, random in randoms.items()
            if place not in self._next or self._next[place][0] != random.bit_generator.state
        }
        for place in missing:
            if place in self._next:
                self._next.pop(place)[1].cancel()
        self.prepare(missing)
        self.start()
        episodes = {}
        for place, random in randoms.items():
            episodes[place], random.bit_generator.state = self._next.pop(place)[1].result()
        return episodes

    def _draw(self, kind: type[np.random.BitGenerator], before: Any) -> tuple[Episode, Any]:
        random = np.random.Generator(kind(0))
        random.bit_generator.state = before
        episode = self._source.draw(random)
        _ = episode.simulation.start  # computed here, for the thread that steps not to
        return episode, random.bit_generator.state

    def close(self) -> None:
        """Draw no more."""
        self._thread.shutdown(wait=False, cancel_futures=True)


def threads_for(places: int) -> int:
    """Return the number of threads that step so many places soonest while the next episodes are drawn."""
    cores = os.cpu_count() or 1
    return cores if places >= _MANY * cores else min(places, 2 * cores)
