"""SpeedOverride-v1: follow a path as fast as its tolerance allows."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from gantrysim.base import memory
from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError, at_least, positive
from gantrysim.base.jit import jit
from gantrysim.engine.positions import axis_positions
from gantrysim.engine.recording import LogBook
from gantrysim.engine.simulate import perfect_follower
from gantrysim.engine.simulation import Simulation
from gantrysim.env.episode_batch import EpisodeBatch
from gantrysim.env.episodes import Episode, Plan
from gantrysim.env.friction import ChangingFriction
from gantrysim.env.look_ahead import LookAhead, ahead_entries, look_ahead
from gantrysim.env.observation import Entry
from gantrysim.env.outcome import EpisodeState, Outcome
from gantrysim.env.scalar import PathEnv
from gantrysim.env.settings import Bounds, PathSettings
from gantrysim.env.vector import PathVectorEnv
from gantrysim.glue.dispenser.dispenser import Dispenser
from gantrysim.machine.machine import Machine
from gantrysim.record.run import Run
from gantrysim.record.setpoints import Setpoints

# Settings and episodes of SpeedOverride-v1: setpoints that are written while an episode goes on.

_BEAD = 2.0  # cross-section of the bead [mm²]


class SpeedOverrideSettings(PathSettings):
    """Settings of `SpeedOverrideEnv`: those of `PathSettings`, and of action and reward.

    Attributes:
        override: override of the speed at the start of an episode.
        step: largest change of the logarithm of the override at a decision.
        slowest: smallest override.
        fastest: largest override.
        weight: loss of a bead that exceeds the tolerance by one tolerance everywhere, in nominal durations.
        worst: largest excess over the tolerance that counts [tolerances].
        progress: reward of the whole path, paid in proportion to the path commanded, in nominal durations.

    Raises:
        InputError: a value out of bounds.
    """

    diameter: Bounds = (36.0, 60.0)
    turns: Bounds = (1, 2)
    thickness: Bounds = (6.0, 9.0)
    speed: Bounds = (60.0, 120.0)
    acceleration: float = 2000.0
    decision_interval: float = 0.02
    tolerance: float = 0.01
    override: float = 1.0
    step: float = 0.5
    slowest: float = 0.03
    fastest: float = 2.0
    weight: float = 10.0
    worst: float = 5.0
    progress: float = 6.0

    def model_post_init(self, context: Any) -> None:
        """Raise InputError for values out of bounds."""
        super().model_post_init(context)
        if self.decision_interval == math.inf:
            raise InputError("decision_interval = inf s: must be finite, for the speed changes within an episode")
        for name in ("override", "step", "slowest", "fastest", "weight", "worst"):
            positive(name, getattr(self, name))
        at_least("progress", self.progress, 0)
        if not self.slowest <= self.override <= self.fastest:
            raise InputError(f"override = {self.override:g}: must be from {self.slowest:g} to {self.fastest:g}")


class SpeedOverrideSource(ChangingFriction):
    """Source of episodes whose setpoints are still to be written, and whose friction changes at some moment."""

    settings: SpeedOverrideSettings

    def _simulation(self, machine: Machine, plan: Plan) -> Simulation:
        """Return a simulation that rests at the start of the path, with room for the setpoints of an episode."""
        asked = plan.setpoints
        if self._job is not None and (asked.requested.corners.size or not set(asked.axes) <= set("xyz")):
            raise InputError(
                f"the path of job {self._job.name} has {asked.requested.corners.size} corners and the axes "
                f"{', '.join(asked.axes)}: must have no corners, and axes of x, y and z alone, for its speed to change"
            )
        # checks travel, and the speed of the program
        super()._simulation(machine, plan)
        count = self._room(asked.requested.length, self.program_speed(plan.drawn))
        position = np.repeat(asked.requested.position(0.0)[:, : len(asked.axes)], count, axis=0)
        setpoints = Setpoints(
            period=self.servo.period,
            axes=asked.axes,
            position=position,
            dispense=np.ones(count, bool),
            requested=asked.requested,
            progress=np.zeros(count),
        )
        simulation = Simulation.of(machine, self.servo, setpoints, dispenser=Dispenser(area=_BEAD))
        # to be written as the episode goes on
        position = simulation.position.copy()
        book = LogBook(machine, setpoints, position, simulation.dispenser, drives=simulation.drives)
        return replace(simulation, position=position, book=book)

    def _room(self, length: float, speed: float) -> int:
        """Return the number of setpoints of the slowest episode, a multiple of those of an interval."""
        settings = self.settings
        interval = self.ticks or 1
        ramps = 2 * settings.fastest * speed / settings.acceleration
        longest = length / (settings.slowest * speed) + ramps
        count = math.ceil(longest / self.servo.period / interval + 1) * interval
        if count > memory.LONG_RUN:
            raise InputError(
                f"slowest = {settings.slowest:g}: {length:.4g} mm at {settings.slowest * speed:.4g} mm/s take {count} "
                f"servo ticks, at most {memory.LONG_RUN}; use a larger value"
            )
        return count

    @cached_property
    def most_ticks(self) -> int:
        if self._fixed is not None:
            return self._room(self._fixed.setpoints.requested.length, self.program_speed({}))
        slowest = self.settings.between("speed")[0]
        plan = self._spiral(
            diameter=self.settings.between("diameter")[1],
            thickness=self.settings.between("thickness")[0],
            speed=slowest,
            turns=int(self.settings.between("turns")[1]),
        )
        return self._room(plan.setpoints.requested.length, slowest)

    def program_speed(self, drawn: Mapping[str, float]) -> float:
        """Return the program's speed in an episode with these values [mm/s]."""
        if self._fixed is None:
            return drawn["speed"]
        asked = self._fixed.setpoints
        steps = np.linalg.norm(np.diff(asked.position, axis=0), axis=1)
        return float(np.median(steps[asked.dispense[:-1]])) / asked.period


@jit
def move(
    state: tuple[float, float], target: float, length: float, acceleration: float, period: float, way: Floats
) -> tuple[float, float]:
    """Move along a path towards a speed, with limited acceleration, such that the path ends at rest.

    Args:
        state: arc length [mm] and speed [mm/s].
        target: speed wanted [mm/s].
        length: of the path [mm].
        acceleration: limit, in both directions [mm/s²].
        period: servo period [s].
        way: arc lengths after each period, (n,), to be written.

    Returns:
        Arc length and speed after the last period.
    """
    s, v = state
    most = acceleration * period
    for k in range(way.size):
        # after this period at v, what remains must suffice to stop: v period + v² / 2a <= length - s
        stop = most * (np.sqrt(0.25 + 2 * (length - s) / (most * period)) - 0.5)
        v = max(min(min(max(target, v - most), v + most), stop), 0.0)
        s = min(s + v * period, length)
        if length - s < 1e-6 * length:
            s = length
            v = 0.0
        way[k] = s
    return s, v


_SPEEDS = {"speed": "commanded path speed", "program_speed": "path speed of the program"}
_NEAR_REVERSAL = 1.0  # range of the distances to reversals that are observed a second time [mm]
_ERRORS = 10.0  # range of errors [tolerances]


class SpeedOverrideBatch(EpisodeBatch):
    """Places in which episodes run whose speed the agent sets; arguments as of `EpisodeBatch`."""

    settings: SpeedOverrideSettings
    source: SpeedOverrideSource
    saved: ClassVar[tuple[str, ...]] = (
        *EpisodeBatch.saved,
        "_override",
        "_commanded_s",
        "_commanded_speed",
        "_setpoints",
        "_written",
        "_time",
        "_outside",
        "_way",
    )

    def __init__(self, settings: SpeedOverrideSettings, places: int, threads: int | None, ahead: bool) -> None:
        super().__init__(settings, places, threads, ahead, SpeedOverrideSource(settings))
        self._override = np.zeros(places)  # logarithm
        self._commanded_s = np.zeros(places)  # arc length [mm]
        self._commanded_speed = np.zeros(places)  # [mm/s]
        self._written = np.zeros(places, np.int64)  # setpoints
        self._time = np.zeros(places)  # of the episode [s]
        # share of the path out of tolerance
        self._outside = np.zeros(places)
        # commanded in the last interval [mm]
        self._way = np.zeros(places)
        self._speed = np.ones(places)
        self._length = np.ones(places)
        self._look: list[LookAhead | None] = [None] * places
        self._ahead_values = np.zeros((places, len(ahead_entries(_SPEEDS))))
        # distance to the next reversal of an axis [mm]
        self._to_reversal = np.ones(places)
        self._since_reversal = np.ones(places)  # and since the last

    def _entries(self) -> list[Entry]:
        axes = self.source.machine.axis_names
        return [
            Entry("contour_max", 0.0, _ERRORS, "tolerances", "largest contour error of the last interval"),
            *(
                Entry(f"following_rms_{axis}", 0.0, _ERRORS, "tolerances", f"RMS following error of {axis}")
                for axis in axes
            ),
            Entry("override", -1.0, 1.0, "log of range", "override of the speed, from slowest to fastest"),
            Entry("action", -1.0, 1.0, "1", "last action"),
            *ahead_entries(_SPEEDS),
            Entry("to_reversal_near", 0.0, 1.0, "1 mm", "distance to the next reversal of an axis, at most 1 mm"),
            Entry("since_reversal_near", 0.0, 1.0, "1 mm", "distance since the last reversal of an axis, at most 1 mm"),
            Entry("progress", 0.0, 1.0, "1", "share of the path commanded"),
        ]

    def _actions(self) -> list[Entry]:
        return [Entry("override", -1.0, 1.0, "`step`", "change of the logarithm of the speed's override")]

    @property
    def longest(self) -> int:
        return self.source.most_ticks // (self.source.ticks or 1)

    def _reset(self, place: int, episode: Episode) -> None:
        # to be written as the episode goes on, as its positions are
        super()._reset(place, replace(episode, progress=np.zeros(len(episode.progress))))
        self._override[place] = math.log(self.settings.override)
        self._commanded_s[place] = 0.0
        self._commanded_speed[place] = 0.0
        self._time[place] = 0.0
        self._outside[place] = 0.0
        self._way[place] = 0.0
        self._written[place] = 0
        setpoints = episode.simulation.setpoints
        self._length[place] = setpoints.requested.length
        self._speed[place] = self.source.program_speed(episode.drawn)
        self._look[place] = LookAhead(episode.table.points)

    def _act(self, places: Sequence[int]) -> None:
        settings = self.settings
        interval = self.source.ticks or 1
        moved = self._override[places] + settings.step * self._action[places, 0]
        self._override[places] = np.clip(moved, math.log(settings.slowest), math.log(settings.fastest))
        for place in places:
            self._write(place, interval)

    def _write(self, place: int, interval: int) -> None:
        """Write the setpoints of the next interval."""
        simulation = self._episode(place).simulation
        begin = int(self._written[place])
        path = simulation.setpoints.requested
        before = self._commanded_s[place]
        start = (before, self._commanded_speed[place])
        target = math.exp(self._override[place]) * self._speed[place]
        way = np.zeros(interval)
        settings = self.settings
        period = self.source.servo.period
        # the path begins at its start
        first = 1 if not begin else 0
        s, speed = move(start, target, path.length, settings.acceleration, period, way[first:])
        self._commanded_s[place] = s
        self._commanded_speed[place] = speed
        axes = simulation.setpoints.axes
        sent = Setpoints(period, axes, path.position(way)[:, : len(axes)], np.ones(interval, bool), path)
        simulation.position[begin : begin + interval] = axis_positions(simulation.machine, sent)
        self._episode(place).progress[begin : begin + interval] = way
        self._written[place] = begin + interval
        self._way[place] = s - before
        if way[-1] >= path.length:
            self._setpoints[place] = begin + int(np.searchsorted(way, path.length)) + 1

    def save(self, place: int, random: np.random.Generator) -> EpisodeState:
        state = super().save(place, random)
        episode = self._episode(place)
        written = slice(0, int(self._written[place]))
        columns = {
            "position": episode.simulation.position[written].copy(),
            "progress": episode.progress[written].copy(),
        }
        return replace(state, values={**state.values, **columns})

    def restore(self, place: int, state: EpisodeState, random: np.random.Generator) -> None:
        values = {**state.values}
        position = values.pop("position")
        progress = values.pop("progress")
        super().restore(place, replace(state, values=values), random)
        episode = self._episode(place)
        episode.simulation.position[: len(position)] = position
        episode.progress[: len(progress)] = progress

    def record(self, place: int) -> Run:
        run = super().record(place)
        # the record is read-only down to the memory of the setpoints, of which the next are still to be written
        episode = self._episode(place)
        episode.simulation.position.flags.writeable = True
        return run.replaced(progress=episode.progress[: len(run)])

    def follower(self, place: int) -> Run:
        """Return the record of the whole episode at the program's speed without following error."""
        simulation = self._episode(place).simulation
        asked = simulation.setpoints
        speed = float(self._speed[place])
        setpoints = Setpoints.along(asked.requested, speed, asked.period, axes=asked.axes)
        return perfect_follower(simulation.machine, setpoints, dispenser=simulation.dispenser)

    def observations(self) -> NDArray[np.float32]:
        settings = self.settings
        measured = self.measured
        for place, look in enumerate(self._look):
            if look is not None:
                s = float(self._commanded_s[place])
                speeds = [self._commanded_speed[place], self._speed[place]]
                self._ahead_values[place] = look_ahead(look, s, speeds)
                self._to_reversal[place], self._since_reversal[place] = look.to_reversal(s)
        low = math.log(settings.slowest)
        high = math.log(settings.fastest)
        errors = np.column_stack([measured.contour_max, measured.following_rms]) / settings.tolerance
        parts = [
            np.clip(errors, 0.0, _ERRORS),
            2 * (self._override[:, None] - low) / (high - low) - 1,
            self._action,
            self._ahead_values,
            np.minimum(self._to_reversal / _NEAR_REVERSAL, 1.0)[:, None],
            np.minimum(self._since_reversal / _NEAR_REVERSAL, 1.0)[:, None],
            (self._commanded_s / self._length)[:, None],
        ]
        return np.concatenate(parts, 1, dtype=np.float32)

    def _outcome(self, advanced: NDArray[np.bool_]) -> Outcome:
        settings = self.settings
        measured = self.measured
        faulty, ended, _ = self._ends(advanced)
        reference = self._length / self._speed  # nominal duration [s]
        # ticks after the end of the path
        late = np.maximum(self._sent - self._setpoints, 0)
        time = ((self.source.ticks or 1) - late) * self.source.servo.period
        beyond = np.clip(measured.contour_max / settings.tolerance - 1, 0.0, settings.worst)
        share = self._way / self._length
        remaining = 1 - self._commanded_s / self._length
        # largest loss of the whole path
        worst = 1 / settings.slowest + settings.weight * settings.worst
        terms = {
            "reward_progress": settings.progress * share,
            "reward_time": -time / reference,
            "reward_contour": -settings.weight * beyond * share,
            "reward_fault": np.where(faulty, -(remaining + share) * worst, 0.0),
        }
        self._time[advanced] += time[advanced]
        self._outside[advanced] += np.where(beyond > 0, share, 0.0)[advanced]
        return Outcome(
            reward=sum(terms.values(), np.zeros(len(self.episodes))),
            terminated=faulty,
            truncated=ended,
            info={
                **terms,
                "cost": (beyond > 0).astype(float),
                "contour_rms": measured.contour_rms,
                "contour_max": measured.contour_max,
                "override": np.exp(self._override),
                "fault": self._fault_texts(faulty),
            },
            final={
                **self._contour_values(),
                "episode_time": self._time.copy(),
                "episode_time_ratio": self._time / reference,
                "episode_cost": self._outside.copy(),
            },
        )


class SpeedOverrideEnv(PathEnv):
    """Follow a path as fast as its tolerance allows, with an override of the program's speed.

    An episode is a spiral, or the path of a job, on a machine drawn from tolerances whose friction changes at some
    moment. The commanded speed follows the program's speed times the override with limited acceleration, and comes to
    rest at the end. When an axis reverses, friction pushes the nozzle off the path, less so at a lower speed.

    Action: one number from -1 to 1, which changes the logarithm of the override by up to `step`.

    Observation, with the tables of docs/environments.md: errors of the last interval, override, commanded speed, the
    program's speed, curvature here and ahead, distances to the next and since the last reversal of an axis, progress.

    Reward: the sum of four terms, in nominal durations, length / program speed; `info` contains them too.

    | term | value |
    | --- | --- |
    | reward_progress | progress * share, with the share of the path commanded since the last decision |
    | reward_time | -time / nominal duration |
    | reward_contour | -weight * e * share |
    | reward_fault | for a fault, the largest loss of the remaining path: -rest * (1 / slowest + weight * worst) |

    Here e is the excess of the largest contour error since the last decision over the tolerance, in tolerances, at most
    `worst`.

    Every policy that reaches the end is paid `progress` in total, so this term does not change their ranking. An agent
    that discounts needs it: every decision costs it the same time, and a slower one fewer tolerances.

    `info` also contains cost, 1 if this error exceeds the tolerance and 0 otherwise; contour_rms and contour_max [mm];
    override; fault, a text or None; and at the end of an episode episode_time [s], episode_time_ratio, relative to the
    nominal duration, episode_cost, the fraction of the path out of tolerance, episode_contour_rms and
    episode_contour_max [mm]. The `info` of `reset` contains the random values; its options "spiral", "machine" and
    "task" replace some of them.

    A fault terminates the episode; the end of the path truncates it.
    """

    settings_type = SpeedOverrideSettings
    settings: SpeedOverrideSettings

    @staticmethod
    def batch(settings: SpeedOverrideSettings, places: int, threads: int | None, ahead: bool) -> EpisodeBatch:
        return SpeedOverrideBatch(settings, places, threads, ahead)


class SpeedOverrideVectorEnv(PathVectorEnv):
    """Several `SpeedOverrideEnv` in one."""

    single = SpeedOverrideEnv
