"""A batch of episodes: the common part of the scalar and the vector environments of every task."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, ClassVar

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import ArrayLike, NDArray

from gantrysim.base.errors import GantryError, InputError
from gantrysim.engine.places import places_of
from gantrysim.engine.simulate import perfect_follower
from gantrysim.env.decision import Ends, Entry, EpisodeState, IntervalValues, Outcome
from gantrysim.env.episodes import Chosen, Episode, Source
from gantrysim.env.interval import AXIS_VALUES, MEASURED_SPAN, NOT_MEASURED, PATH_VALUES, measure, measuring_stage
from gantrysim.env.settings import PathSettings
from gantrysim.machine.machine import Machine
from gantrysim.record.run import Run

# Episodes drawn ahead on a thread, while others run.

# Of many places for each core, one thread for each core is done soonest. Where they are few, the next episodes take as
# long to draw as a decision, and the thread that shares its core with them is late with the last place, while the other
# cores have nothing left to do: two threads for each core then.
_MANY_PLACES = 16


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
        # random numbers and their state
        self._asked: dict[int, tuple[type[np.random.BitGenerator], Any]] = {}
        self._over: list[Episode | None] = []
        # state before; episode and state after
        self._next: dict[int, tuple[Any, Future[tuple[Episode, Any]]]] = {}

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
        # computed here, for the thread that steps not to
        _ = episode.simulation.start, episode.simulation.hindrance, episode.table
        if self._source.looks_ahead:
            episode.look.prepare()
        return episode, random.bit_generator.state

    def close(self) -> None:
        """Draw no more."""
        self._thread.shutdown(wait=False, cancel_futures=True)


def threads_for(places: int) -> int:
    """Return the number of threads that step so many places soonest while the next episodes are drawn."""
    cores = os.cpu_count() or 1
    return cores if places >= _MANY_PLACES * cores else min(places, 2 * cores)


def addresses_of(array: NDArray[Any]) -> NDArray[np.int64]:
    """Return the addresses of the rows of an array, (n,)."""
    return array.ctypes.data + array.strides[0] * np.arange(len(array))


def _space(entries: Sequence[Entry]) -> Box[np.float32]:
    low = np.array([entry.low for entry in entries], np.float32)
    high = np.array([entry.high for entry in entries], np.float32)
    return Box(low, high, dtype=np.float32)


class EpisodeBatch(ABC):
    """Places in which episodes run; all advance in one native call.

    A task derives from it. For all places at once it defines, in the order in which they are called,

        _reset         begin an episode at a place
        observations   what the agent observes, the entries of `_entries`
        _act           what an action does
        _follow        what the task measures beside the machine
        _outcome       reward, end of the episode, and infos

    Args:
        settings: of the environment.
        places: number of places.
        threads: number of threads; by default one for each core, two where a core has few places.
        ahead: whether the next episodes are drawn on a thread while these run.
        source: of the episodes, by default of spirals and machines alone.

    Attributes:
        source: of the episodes.
        entries: of the observation.
        actions: entries of the action.
        observation_space, action_space: of one place.
        measured: measurements of the last interval at every place, live views.
    """

    # attributes with one row per place, which a saved state holds
    saved: ClassVar[tuple[str, ...]] = ("_action", "_of_path", "_of_axes", "_progress")

    def __init__(
        self, settings: PathSettings, places: int, threads: int | None, ahead: bool, source: Source | None = None
    ) -> None:
        self.settings = settings
        self.source = Source(settings) if source is None else source
        machine = self.source.machine
        self._axes = len(machine.axes)
        self._batch = places_of(
            machine, places, threads_for(places) if threads is None else threads, self.source.engine
        )
        self._ahead = DrawnAhead(self.source) if ahead else None
        if self._ahead is not None:
            # not earlier: a thread that draws holds Python's lock, for which this one would have to wait
            self._batch.beside = self._ahead.start
        field = self._batch.field  # live views
        self._gains = field("gains")
        self._ticks = field("tick")
        self._sent = field("index")
        self._faults = field("fault")
        self._steps = field("steps")
        self._observer_step = field("observer_step")
        self._peak = np.array([axis.peak_torque for axis in machine.axes])
        self.entries = self._entries()
        self.actions = self._actions()
        self.observation_space = _space(self.entries)
        self.action_space = _space(self.actions)
        self.episodes: list[Episode | None] = [None] * places
        self._action = np.zeros((places, len(self.actions)))
        self._of_path = np.zeros(places, PATH_VALUES)
        self._of_axes = np.zeros((places, self._axes), AXIS_VALUES)
        self._spans = np.zeros(places, MEASURED_SPAN)
        self._spans["peak"] = self._peak.ctypes.data
        self._spans["path_values"] = addresses_of(self._of_path)
        self._spans["axis_values"] = addresses_of(self._of_axes)
        self._progress = self._spans["before"]
        self._foot = self._progress["foot"]
        self._measured = self._progress["tick"]
        self._measured_next = self._spans["after"]["tick"]
        self._setpoints = np.ones(places, np.int64)
        self.measured = IntervalValues.of(self._of_path, self._of_axes)

    @abstractmethod
    def _entries(self) -> list[Entry]:
        """Return the entries of the observation."""

    @abstractmethod
    def _actions(self) -> list[Entry]:
        """Return the entries of the action of a place, each from -1 to 1."""

    @abstractmethod
    def _act(self, places: Sequence[int]) -> None:
        """Apply the actions of places, before their episodes advance."""

    @abstractmethod
    def observations(self) -> NDArray[np.float32]:
        """Return the observations of all places, (places, entries)."""

    @abstractmethod
    def _outcome(self, advanced: NDArray[np.bool_]) -> Outcome:
        """Return the outcome of a decision at the places that have advanced."""

    def _ends(self, advanced: NDArray[np.bool_]) -> Ends:
        """Return how the episodes stand at the places that have advanced."""
        remaining = self._setpoints - self._sent
        faulty = advanced & (self._faults != 0)
        undone = np.ones_like(remaining) if self.source.ticks is None else 1 + remaining // self.source.ticks
        return Ends(faulty, advanced & (remaining <= 0) & ~faulty, undone)

    @property
    def longest(self) -> int:
        """Largest number of decisions in an episode."""
        return 1 if self.source.ticks is None else -(-self.source.most_ticks // self.source.ticks)

    def begin(
        self, randoms: Mapping[int, np.random.Generator], chosen: Mapping[int, Chosen] | None = None
    ) -> dict[int, dict[str, float]]:
        """Begin new episodes, by place, and return the values drawn for each.

        Args:
            randoms: random numbers of the places.
            chosen: values of an episode that are not drawn.
        """
        if chosen or self._ahead is None:
            drawn = {place: self.source.draw(random, (chosen or {}).get(place)) for place, random in randoms.items()}
        else:
            drawn = self._ahead.take(randoms)
            self._ahead.free(self.episodes[place] for place in drawn)
        self._batch.load({place: drawn[place].simulation for place in sorted(drawn)})
        for place, episode in drawn.items():
            self._reset(place, episode)
        self._measure(np.array(list(drawn), np.intp))
        if self._ahead is not None:
            self._ahead.prepare(randoms)
        return {place: episode.drawn for place, episode in drawn.items()}

    def _reset(self, place: int, episode: Episode) -> None:
        """Begin an episode at a place."""
        self.episodes[place] = episode
        self._action[place] = 0.0
        # all of it; the values are written by `measure`
        self._progress[place] = 0
        span = self._spans[place]
        self._measured_next[place] = NOT_MEASURED
        self._batch.observe(place, self._stage(), self._stage_argument(place))
        dispense = episode.simulation.setpoints.dispense
        self._setpoints[place] = span["count"] = len(episode.simulation.position)
        span["dispense"] = dispense.ctypes.data
        span["progress"] = episode.progress.ctypes.data
        span["points"] = episode.table.points.ctypes.data
        span["s"] = episode.table.s.ctypes.data
        span["entries"] = len(episode.table.s)
        span["widest"] = episode.table.widest

    def save(self, place: int, random: np.random.Generator) -> EpisodeState:
        """Return the present state of the episode at a place."""
        drawn = self._episode(place).drawn
        # by a list of places, as NumPy's copy of a single record is a view
        values = {name: getattr(self, name)[[place]] for name in self.saved}
        return EpisodeState(self.settings, drawn, self._batch.moment(place), values, random.bit_generator.state)

    def restore(self, place: int, state: EpisodeState, random: np.random.Generator) -> None:
        """Put an episode into a place as it was when it was saved, and the random numbers.

        Raises:
            InputError: a state of an environment with other settings.
        """
        if state.settings != self.settings:
            raise InputError("this state belongs to an environment with other settings: use one with the same settings")
        episode = self.source.episode(state.drawn)
        self._batch.resume(place, episode.simulation, state.moment)
        self._reset(place, episode)
        for name, value in state.values.items():
            getattr(self, name)[[place]] = value
        random.bit_generator.state = state.random

    def advance(self, actions: ArrayLike, mask: NDArray[np.bool_]) -> Outcome:
        """Apply actions, run until the next decision, and return the outcome.

        Args:
            actions: of all places, (places, actions), clipped to -1 to 1.
            mask: of the places that are to advance, (places,).

        Raises:
            InputError: an action that is not finite, or of another shape.
        """
        actions = np.asarray(actions, float)
        stepped = np.flatnonzero(mask)
        if actions.shape != self._action.shape:
            size = self._action.shape[1]
            shape = actions.shape[1:]
            raise InputError(f"{len(actions)} actions of shape {shape}: must be {len(mask)} of shape ({size},)")
        taken = actions[stepped]
        is_finite = np.isfinite(taken)
        if not is_finite.all():
            wrong = taken[~is_finite.all(axis=1)][0]
            raise InputError(f"action {wrong.tolist()}: must be finite")
        self._action[stepped] = np.clip(taken, -1.0, 1.0)
        if stepped.size:
            self._act(stepped.tolist())
            self._run(stepped)
            self._measure(stepped)
        return self._outcome(mask)

    def close(self) -> None:
        """Draw no more episodes, and end the threads."""
        if self._ahead is not None:
            self._batch.beside = None
            self._ahead.close()
            self._ahead = None

    def record(self, place: int) -> Run:
        """Return the record of the episode at a place so far.

        Raises:
            GantryError: no tick of it has been run yet.
        """
        self._episode(place)
        if not self._measured[place]:
            raise GantryError("this episode has not been stepped yet: take a step first")
        return self._batch.runs[place].record(partial=True)

    def film(self, place: int, file: str | os.PathLike[str], **options: Any) -> int:
        """Write a film of the episode at a place so far, see `gantrysim.render.save_video`."""
        # slow to import
        from gantrysim.render import save_video

        run = self.record(place)
        return save_video(self._episode(place).simulation.machine, run, file, **options)

    def scene(self, place: int) -> tuple[Machine, Run, int]:
        """Return machine, record and tick of the present moment, to be drawn."""
        machine = self._episode(place).simulation.machine
        if self._measured[place] < 2:  # not begun yet
            return machine, self.follower(place), 0
        run = self.record(place)
        return machine, run, len(run.time) - 1

    def follower(self, place: int) -> Run:
        """Return the record of the whole episode without following error."""
        simulation = self._episode(place).simulation
        return perfect_follower(simulation.machine, simulation.setpoints, dispenser=simulation.dispenser)

    def _run(self, stepped: NDArray[np.intp]) -> None:
        """Step until the next decision, or the end of the longest episode where that comes first, and measure."""
        substeps = self._episode(int(stepped[0])).simulation.substeps
        # tick, if no stream waits at a gate
        last = self._ticks - self._sent + self._spans["count"] - 1
        end = last * substeps + 1  # its first step
        steps = None
        if self.source.ticks is not None:
            steps_left = int((end - self._steps)[stepped].max())
            steps = min(self.source.ticks, -(-steps_left // substeps)) * substeps  # decisions fall on ticks
        self._measured_next[:] = NOT_MEASURED
        self._observer_step[:] = end if steps is None else self._steps + steps
        self._batch.advance(stepped, steps)

    def _measure(self, stepped: NDArray[np.intp]) -> None:
        """Take the measurements since the last decision.

        The threads that step make them, but at places where a run has ended before the decision or waits at a gate.
        """
        for place in stepped[(self._measured_next != self._ticks)[stepped]].tolist():
            measure(self._batch.address(place), self._stage_argument(place), self._stage())
        firsts = self._measured[stepped]
        self._spans["before"][stepped] = self._spans["after"][stepped]
        self._follow(stepped, firsts, self._measured[stepped])

    def _stage(self) -> int:
        """Return the address of the C function that measures an interval, see `measuring_stage`."""
        return measuring_stage()

    def _stage_argument(self, place: int) -> int:
        """Return its argument at a place."""
        return int(addresses_of(self._spans)[place])

    def _follow(  # noqa: B027  most tasks have nothing of the kind
        self, places: NDArray[np.intp], firsts: NDArray[np.int64], lasts: NDArray[np.int64]
    ) -> None:
        """Update what the task measures at places beside the machine, each from one tick to before another."""

    def _fault_texts(self, faulty: NDArray[np.bool_]) -> NDArray[Any]:
        """Return the faults of the places that have one as texts, None elsewhere, (places,)."""
        faults = np.full(len(self.episodes), None, object)
        for place in np.flatnonzero(faulty).tolist():
            faults[place] = str(self._batch.runs[place].fault)
        return faults

    def _contour_values(self) -> dict[str, NDArray[Any]]:
        """Return the contour errors of whole episodes so far, 0 without dispensing, (places,) each [mm]."""
        progress = self._progress
        rms = np.sqrt(progress["square"] / np.maximum(progress["laid"], 1))
        return {"episode_contour_rms": rms, "episode_contour_max": progress["largest"].copy()}

    def _episode(self, place: int) -> Episode:
        episode = self.episodes[place]
        if episode is None:
            raise GantryError("no episode has begun: reset comes first")
        return episode
