"""A batch of episodes: the common part of the scalar and the vector environment."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import ArrayLike, NDArray

from gantrysim.arrays import Floats
from gantrysim.controllers.law import GAIN_NAMES
from gantrysim.engine.batch import Batch
from gantrysim.engine.simulate import perfect_follower
from gantrysim.env.episodes import SCALED, TUNED_GAINS, Episode, Source, gain_factors
from gantrysim.env.interval import PER_AXIS, SHARED, measure
from gantrysim.env.observation import IntervalValues, entries, observe
from gantrysim.env.settings import Settings
from gantrysim.errors import GantryError, InputError
from gantrysim.machine.machine import Machine
from gantrysim.run import Run

# Largest penalties of an interval, and that of one lost by a fault, which is the larger so that no fault pays.
_CONTOUR, _RIPPLE, _FAULT = 6.0, 4.0, 12.0

_DISPENSING, _SQUARE, _LARGEST = (SHARED.index(name) for name in ("dispensing", "contour_square", "contour_max"))


class Outcome(NamedTuple):
    """Outcome of a decision at every place; meaningless where none was taken.

    Attributes:
        reward: sum of its terms, (places,).
        terminated: whether a fault has ended the episode, or its only decision is taken, (places,).
        truncated: whether the path is at its end, in an episode of several decisions, (places,).
        info: values by name, (places,) each.
        final: values at an episode's end by name, (places,) each.
    """

    reward: Floats
    terminated: NDArray[np.bool_]
    truncated: NDArray[np.bool_]
    info: dict[str, NDArray[Any]]
    final: dict[str, NDArray[Any]]


class EpisodeBatch:
    """Places in which episodes run; all advance in one native call.

    Args:
        settings: of the environment.
        places: number of places.
        threads: number of threads; by default all cores.

    Attributes:
        source: of the episodes.
        entries: of the observation.
        observation_space, action_space: of one place.
        measured: measurements of the last interval at every place.
    """

    def __init__(self, settings: Settings, places: int, threads: int | None) -> None:
        self.settings, self.source = settings, Source(settings)
        machine, servo = self.source.machine, self.source.servo
        self._axes = len(machine.axes)
        self._batch = Batch(machine, places, threads)
        fields = ("gains", "tick", "index", "fault")
        self._gains, self._ticks, self._sent, self._faults = (self._batch.field(name) for name in fields)  # live
        self._peak = np.array([axis.peak_torque for axis in machine.axes])
        self._centre = {name: np.array(getattr(servo, name)) for name in SCALED}
        self.entries = entries(machine.axis_names, settings.per_axis)
        low, high = (np.array([getattr(entry, end) for entry in self.entries], np.float32) for end in ("low", "high"))
        self.observation_space = Box(low, high, dtype=np.float32)
        gains = len(TUNED_GAINS) * (self._axes if settings.per_axis else 1)
        self.action_space = Box(-1.0, 1.0, (gains,), np.float32)

        self.episodes: list[Episode | None] = [None] * places
        self._action = np.zeros((places, gains))
        self._rows = np.zeros((places, len(SHARED) + len(PER_AXIS) * self._axes))
        self._foot = np.full(places, -1)
        self._measured = np.zeros(places, np.int64)  # ticks measured
        self._setpoints = np.ones(places, np.int64)
        self._total = np.zeros((places, 3))  # dispensing ticks, sum of squared contour errors, largest
        self.measured = self._interval()

    def begin(self, randoms: Mapping[int, np.random.Generator]) -> dict[int, dict[str, float]]:
        """Begin new episodes, by place, and return the values drawn for each."""
        drawn = {place: self.source.draw(random) for place, random in randoms.items()}
        self._batch.load({place: drawn[place].simulation for place in sorted(drawn)})
        for place, episode in drawn.items():
            self.episodes[place] = episode
            self._action[place], self._rows[place], self._total[place] = 0.0, 0.0, 0.0
            self._foot[place], self._measured[place] = -1, 0
            self._setpoints[place] = len(episode.simulation.position)
            self._measure(place, 0)
        self.measured = self._interval()
        return {place: episode.drawn for place, episode in drawn.items()}

    def advance(self, actions: ArrayLike, mask: NDArray[np.bool_]) -> Outcome:
        """Set gains, run until the next decision, and return the outcome.

        Args:
            actions: of all places, (places, gains), clipped to -1 to 1.
            mask: of the places that are to advance, (places,).

        Raises:
            InputError: an action that is not finite, or of another shape.
        """
        actions, places = np.asarray(actions, float), np.flatnonzero(mask).tolist()
        if actions.shape != self._action.shape:
            gains, shape = self._action.shape[1], actions.shape[1:]
            raise InputError(f"{len(actions)} actions of shape {shape}: must be {len(mask)} of shape ({gains},)")
        if not np.isfinite(actions[places]).all():
            place = next(place for place in places if not np.isfinite(actions[place]).all())
            raise InputError(f"action {actions[place].tolist()}: must be finite")
        self._action[places] = np.clip(actions[places], -1.0, 1.0)
        if not places:
            return self._outcome(mask)
        self._set_gains(places)
        self._run(places)
        for place in places:
            self._measure(place, int(self._ticks[place]))
        self.measured = self._interval()
        return self._outcome(mask)

    def observations(self) -> NDArray[np.float32]:
        """Return the observations of all places, (places, entries)."""
        progress = np.minimum(self._sent / self._setpoints, 1.0)
        return observe(self.measured, self._action, progress, self.settings.tolerance, self.settings.ripple_limit)

    def _interval(self) -> IntervalValues:
        return IntervalValues.of(self._rows, self.source.servo.period, self._peak)

    def record(self, place: int) -> Run:
        """Return the record of the episode at a place so far.

        Raises:
            GantryError: no tick of it has been run yet.
        """
        self._episode(place)
        if not self._measured[place]:
            raise GantryError("nothing has been run of this episode yet: take a step first")
        return self._batch.runs[place].record(partial=True)

    def scene(self, place: int) -> tuple[Machine, Run, int]:
        """Return machine, record and tick of the present moment, to be drawn."""
        machine = self._episode(place).simulation.machine
        if self._measured[place] < 2:  # not begun yet
            return machine, self.follower(place), 0
        run = self.record(place)
        return machine, run, len(run.time) - 1

    def follower(self, place: int) -> Run:
        """Return the record of the whole episode without tracking error."""
        simulation = self._episode(place).simulation
        return perfect_follower(simulation.machine, simulation.setpoints, dispenser=simulation.dispenser)

    def _run(self, places: Sequence[int]) -> None:
        """Step until the next decision, or the end of the longest episode where that comes first."""
        steps = None
        if self.source.ticks is not None:
            runs = [self._batch.runs[place] for place in places]
            substeps = runs[0].simulation.substeps
            left = max(run.steps_left for run in runs)
            steps = min(self.source.ticks, -(-left // substeps)) * substeps  # decisions fall on ticks
        self._batch.advance(places, steps)

    def _set_gains(self, places: Sequence[int]) -> None:
        chosen = self._action[places].reshape(len(places), len(TUNED_GAINS), -1)
        for name, factor in gain_factors(np.moveaxis(chosen, 1, 0), self.settings.gain_range).items():
            self._gains[places, : self._axes, GAIN_NAMES.index(name)] = self._centre[name] * factor

    def _measure(self, place: int, last: int) -> None:
        """Measure the ticks since the last decision."""
        episode, row = self._episode(place), self._rows[place]
        simulation = episode.simulation
        self._foot[place] = measure(  # type: ignore[no-untyped-call]
            simulation.log,
            int(self._measured[place]),
            last,
            simulation.position,
            simulation.setpoints.dispense,
            episode.points,
            episode.spacing,
            int(self._foot[place]),
            row,
        )
        self._measured[place] = last
        total = self._total[place]
        total[0] += row[_DISPENSING]
        total[1] += row[_SQUARE]
        total[2] = max(total[2], row[_LARGEST])

    def _outcome(self, advanced: NDArray[np.bool_]) -> Outcome:
        settings, measured = self.settings, self.measured
        left = self._setpoints - self._sent
        faulty = advanced & (self._faults != 0)
        ended = advanced & (left <= 0) & ~faulty
        alone = self.source.ticks is None  # the episode has one decision
        ripple = measured.ripple.max(axis=1)
        undone = 1 if alone else 1 + left // self.source.ticks
        terms = {
            "reward_contour": -np.minimum(np.log1p(measured.contour_rms / settings.tolerance), _CONTOUR),
            "reward_ripple": -np.clip(np.log(np.maximum(ripple / settings.ripple_limit, 1.0)), 0.0, _RIPPLE),
            "reward_fault": np.where(faulty, -_FAULT * undone, 0.0),
        }
        faults = np.full(len(self.episodes), None, object)
        for place in np.flatnonzero(faulty).tolist():
            faults[place] = str(self._batch.runs[place].fault)
        ticks, square, largest = self._total.T
        return Outcome(
            reward=sum(terms.values(), np.zeros(len(self.episodes))),
            terminated=faulty | ended if alone else faulty,
            truncated=np.zeros_like(ended) if alone else ended,
            info={
                **terms,
                "contour_rms": measured.contour_rms,
                "contour_max": measured.contour_max,
                "ripple": ripple,
                "fault": faults,
            },
            final={
                "episode_contour_rms": np.where(ticks > 0, np.sqrt(square / np.maximum(ticks, 1)), np.nan),
                "episode_contour_max": np.where(ticks > 0, largest, np.nan),
            },
        )

    def _episode(self, place: int) -> Episode:
        episode = self.episodes[place]
        if episode is None:
            raise GantryError("no episode has begun: reset comes first")
        return episode
