"""A batch of episodes: the common part of the scalar and the vector environments of every task."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, ClassVar

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import ArrayLike, NDArray

from gantrysim.base.errors import GantryError, InputError
from gantrysim.engine.batch import Batch
from gantrysim.engine.simulate import perfect_follower
from gantrysim.env.ahead import DrawnAhead
from gantrysim.env.episode_state import EpisodeState
from gantrysim.env.episodes import Chosen, Episode, Source
from gantrysim.env.interval import PER_AXIS, SHARED, SPAN, TOTAL, measure
from gantrysim.env.observation import Entry, IntervalValues
from gantrysim.env.outcome import Ends, Outcome
from gantrysim.env.settings import PathSettings
from gantrysim.machine.machine import Machine
from gantrysim.record.run import Run

_SHARED = 16  # places from which on threads share the measurements


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
        threads: number of threads; by default all cores.
        ahead: whether the next episodes are drawn on a thread while these run.
        source: of the episodes, by default of spirals and machines alone.

    Attributes:
        source: of the episodes.
        entries: of the observation.
        observation_space, action_space: of one place.
        measured: measurements of the last interval at every place, live views.
    """

    # attributes with one row per place, which a saved state holds
    saved: ClassVar[tuple[str, ...]] = ("_action", "_rows", "_foot", "_measured", "_total")

    def __init__(
        self, settings: PathSettings, places: int, threads: int | None, ahead: bool, source: Source | None = None
    ) -> None:
        self.settings = settings
        self.source = Source(settings) if source is None else source
        machine = self.source.machine
        self._axes = len(machine.axes)
        self._batch = Batch(machine, places, threads)
        self._ahead = DrawnAhead(self.source) if ahead else None
        if self._ahead is not None:
            # not earlier: a thread that draws holds Python's lock, for which this one would have to wait
            self._batch.beside = self._ahead.start
        self._parts = min(places, os.cpu_count() or 1 if threads is None else threads)
        self._threads = ThreadPoolExecutor(self._parts, "measurements")  # they begin when they are first needed
        field = self._batch.field  # live views
        self._gains = field("gains")
        self._ticks = field("tick")
        self._sent = field("index")
        self._faults = field("fault")
        self._steps = field("steps")
        self._addresses = {name: field(name) for name in ("log", "axis_log", "setpoints")}
        self._peak = np.array([axis.peak_torque for axis in machine.axes])
        self.entries = self._entries()
        low = np.array([entry.low for entry in self.entries], np.float32)
        high = np.array([entry.high for entry in self.entries], np.float32)
        self.observation_space = Box(low, high, dtype=np.float32)
        self.action_space = Box(-1.0, 1.0, (self._action_size(),), np.float32)
        self.episodes: list[Episode | None] = [None] * places
        self._action = np.zeros((places, self._action_size()))
        self._rows = np.zeros((places, len(SHARED) + len(PER_AXIS) * self._axes))
        self._spans = np.zeros(places, SPAN)
        self._spans["foot"] = -1
        self._foot = self._spans["foot"]
        self._measured = np.zeros(places, np.int64)  # ticks
        self._setpoints = np.ones(places, np.int64)
        self._total = np.zeros((places, TOTAL))
        self.measured = IntervalValues.of(self._rows)

    @abstractmethod
    def _entries(self) -> list[Entry]:
        """Return the entries of the observation."""

    @abstractmethod
    def _action_size(self) -> int:
        """Return the number of actions of a place."""

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
        self._measure(list(drawn))
        if self._ahead is not None:
            self._ahead.prepare(randoms)
        return {place: episode.drawn for place, episode in drawn.items()}

    def _reset(self, place: int, episode: Episode) -> None:
        """Begin an episode at a place."""
        self.episodes[place] = episode
        self._action[place] = 0.0
        self._total[place] = 0.0  # the rows are written by `measure`
        self._foot[place] = -1
        self._measured[place] = 0
        span = self._spans[place]
        dispense = episode.simulation.setpoints.dispense
        self._setpoints[place] = span["count"] = len(episode.simulation.position)
        span["dispense"] = dispense.ctypes.data
        span["points"] = episode.points.ctypes.data
        span["entries"] = len(episode.points)
        span["spacing"] = episode.spacing

    def save(self, place: int, random: np.random.Generator) -> EpisodeState:
        """Return the present state of the episode at a place."""
        drawn = self._episode(place).drawn
        values = {name: np.copy(getattr(self, name)[place]) for name in self.saved}
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
            getattr(self, name)[place] = value
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
        places = np.flatnonzero(mask).tolist()
        if actions.shape != self._action.shape:
            size = self._action.shape[1]
            shape = actions.shape[1:]
            raise InputError(f"{len(actions)} actions of shape {shape}: must be {len(mask)} of shape ({size},)")
        if not np.isfinite(actions[places]).all():
            place = next(place for place in places if not np.isfinite(actions[place]).all())
            raise InputError(f"action {actions[place].tolist()}: must be finite")
        self._action[places] = np.clip(actions[places], -1.0, 1.0)
        if not places:
            return self._outcome(mask)
        self._act(places)
        self._run(places)
        self._measure(places)
        return self._outcome(mask)

    def close(self) -> None:
        """Draw no more episodes, and end the threads."""
        if self._ahead is not None:
            self._batch.beside = None
            self._ahead.close()
            self._ahead = None
        self._parts = 1
        self._threads.shutdown(wait=False)

    def record(self, place: int) -> Run:
        """Return the record of the episode at a place so far.

        Raises:
            GantryError: no tick of it has been run yet.
        """
        self._episode(place)
        if not self._measured[place]:
            raise GantryError("this episode has not been stepped yet: take a step first")
        return self._batch.runs[place].record(partial=True)

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

    def _run(self, places: Sequence[int]) -> None:
        """Step until the next decision, or the end of the longest episode where that comes first."""
        steps = None
        if self.source.ticks is not None:
            substeps = self._episode(places[0]).simulation.substeps
            last = self._ticks - self._sent + self._spans["count"] - 1  # tick, if no stream waits at a gate
            steps_left = int((last * substeps + 1 - self._steps)[places].max())
            steps = min(self.source.ticks, -(-steps_left // substeps)) * substeps  # decisions fall on ticks
        self._batch.advance(places, steps)

    def _measure(self, places: Sequence[int]) -> None:
        """Measure the ticks since the last decision."""
        spans = self._spans
        measured_places = np.array(places, np.int64)
        for name, address in self._addresses.items():
            spans[name] = address
        spans["first"] = self._measured
        spans["last"] = self._ticks
        parts = np.array_split(measured_places, self._parts if len(measured_places) >= _SHARED else 1)
        common = self.source.servo.period, self._peak, self._rows, self._total
        others = [self._threads.submit(measure, spans, part, *common) for part in parts[1:]]
        measure(spans, parts[0], *common)  # type: ignore[no-untyped-call]
        for other in others:
            other.result()
        self._measured[measured_places] = self._ticks[measured_places]
        if type(self)._follow is not EpisodeBatch._follow:
            firsts = spans["first"][measured_places].tolist()
            lasts = spans["last"][measured_places].tolist()
            for place, first, last in zip(places, firsts, lasts, strict=True):
                self._follow(place, first, last)

    def _follow(self, place: int, first: int, last: int) -> None:  # noqa: B027  most tasks have nothing of the kind
        """Update what the task measures at a place beside the machine, from one tick to before another."""

    def _fault_texts(self, faulty: NDArray[np.bool_]) -> NDArray[Any]:
        """Return the faults of the places that have one as texts, None elsewhere, (places,)."""
        faults = np.full(len(self.episodes), None, object)
        for place in np.flatnonzero(faulty).tolist():
            faults[place] = str(self._batch.runs[place].fault)
        return faults

    def _contour_values(self) -> dict[str, NDArray[Any]]:
        """Return the contour errors of whole episodes so far, 0 without dispensing, (places,) each [mm]."""
        ticks, square, largest = self._total.T
        return {"episode_contour_rms": np.sqrt(square / np.maximum(ticks, 1)), "episode_contour_max": largest.copy()}

    def _episode(self, place: int) -> Episode:
        episode = self.episodes[place]
        if episode is None:
            raise GantryError("no episode has begun: reset comes first")
        return episode
