"""SpeedOverride-v1: follow a path as fast as its tolerance allows."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from gantrysim.base import memory
from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError, at_least, positive
from gantrysim.engine.positions import axis_positions
from gantrysim.engine.recording import LogBook
from gantrysim.engine.simulate import perfect_follower
from gantrysim.engine.simulation import Simulation
from gantrysim.env.decision import Entry, EpisodeState, Outcome
from gantrysim.env.episode_batch import EpisodeBatch
from gantrysim.env.episodes import Episode, Plan
from gantrysim.env.friction import ChangingFriction
from gantrysim.env.look_ahead import PathsAhead, ahead_entries
from gantrysim.env.scalar import PathEnv
from gantrysim.env.settings import Bounds, PathSettings
from gantrysim.env.track import Commanded, Track, Tracks, command, write_setpoints
from gantrysim.env.vector import PathVectorEnv
from gantrysim.glue.dispenser.dispenser import Dispenser
from gantrysim.machine.machine import Machine
from gantrysim.paths.feet import assigned_progress
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


@dataclass(frozen=True, eq=False)
class TrackedEpisode(Episode):
    """An episode with the way along its path."""

    track: Track


class SpeedOverrideSource(ChangingFriction):
    """Source of episodes whose setpoints are still to be written, and whose friction changes at some moment."""

    settings: SpeedOverrideSettings
    looks_ahead: ClassVar[bool] = True

    def __init__(self, settings: SpeedOverrideSettings) -> None:
        super().__init__(settings)
        if self._job is None:
            return
        for axis, steepest in zip(self.machine.plain_axes, self._job_track.steepest().tolist(), strict=True):
            most = axis.speed_limit / (steepest * self.program_speed({})) if steepest else math.inf
            if settings.fastest > most:
                raise InputError(
                    f"fastest = {settings.fastest:g}: {axis.name} of job {self._job.name} would exceed its limit of "
                    f"{axis.speed_limit:g} {axis.unit}/s; use at most {most:.3g}"
                )

    def episode(self, drawn: Mapping[str, float]) -> TrackedEpisode:
        episode = super().episode(drawn)
        if self._job is None:
            asked = episode.plan.setpoints
            assert asked.progress is not None
            track = Track.of(self.machine, asked, asked.progress)
        else:
            track = self._job_track
        return TrackedEpisode(**episode.parts(), track=track)

    def _simulation(self, machine: Machine, plan: Plan) -> Simulation:
        """Return a simulation that rests at the start of the path, with room for the setpoints of an episode."""
        asked = plan.setpoints
        if machine.turns_work:
            raise InputError(
                f"machine {machine.name} turns its work: SpeedOverride-v1 needs a job whose program moves the nozzle "
                "in x, y and z, as the speed along its path must not be bound by axes that turn the work"
            )
        # checks travel, and the speed of the program
        checked = super()._simulation(machine, plan)
        count = self._room(asked.requested.length, self.program_speed(plan.drawn))
        setpoints = Setpoints.unwritten(asked, count)
        same_axes = setpoints.axes == machine.axis_names
        position = setpoints.position if same_axes else np.zeros((count, checked.position.shape[1]))
        position[0] = checked.position[0]
        dispenser = Dispenser(area=_BEAD)
        return replace(
            checked,
            setpoints=setpoints,
            dispenser=dispenser,
            position=position,
            book=LogBook(machine, setpoints, position, dispenser, checked.faults, checked.drives),
            # a machine at rest needs none
            torque=None if checked.torque is None else np.zeros_like(position),
        )

    def _room(self, length: float, speed: float) -> int:
        """Return the number of setpoints of the longest episode, a multiple of those of an interval."""
        settings = self.settings
        interval = self.ticks or 1
        ramps = 2 * settings.fastest * speed / settings.acceleration
        longest = length / (settings.slowest * speed) + ramps
        # a long path at the slowest speed is cut off there
        intervals = min(math.ceil(longest / self.servo.period / interval + 1), memory.LONG_RUN // interval)
        return intervals * interval

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

    @cached_property
    def _job_progress(self) -> Floats:
        """Arc length of the requested path for which each setpoint of the job stands, (n,) [mm]."""
        assert self._fixed is not None
        asked = self._fixed.setpoints
        if asked.progress is not None:
            return asked.progress
        return assigned_progress(asked.requested, self.machine.tip(axis_positions(self.machine, asked)))

    @cached_property
    def _job_track(self) -> Track:
        assert self._fixed is not None
        return Track.of(self.machine, self._fixed.setpoints, self._job_progress)

    def program_speed(self, drawn: Mapping[str, float]) -> float:
        """Return the program's speed in an episode with these values, of a job the median of its bead [mm/s]."""
        return drawn["speed"] if self._fixed is None else self._job_speed

    @cached_property
    def _job_speed(self) -> float:
        assert self._fixed is not None
        asked = self._fixed.setpoints
        steps = np.diff(self._job_progress)
        return float(np.median(steps[asked.dispense[:-1] & (steps > 0)])) / asked.period

    def follower(self, setpoints: Setpoints, speed: float) -> Setpoints:
        """Return the setpoints of a whole episode at the program's speed."""
        if self._fixed is not None:
            return self._fixed.setpoints
        return Setpoints.along(setpoints.requested, speed, setpoints.period, axes=setpoints.axes)


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
        ticks = self.source.ticks or 1
        self._commanded = Commanded(
            s=np.zeros(places),
            speed=np.zeros(places),
            way=np.zeros((places, ticks)),
            position=np.zeros((places, ticks, self._axes)),
            dispense=np.zeros((places, ticks), bool),
        )
        self._commanded_s = self._commanded.s
        self._commanded_speed = self._commanded.speed
        self._tracks = Tracks.empty(places, self._axes)
        self._rows = np.array([self._batch.address(place) for place in range(places)])
        self._written = np.zeros(places, np.int64)  # setpoints
        self._time = np.zeros(places)  # of the episode [s]
        # share of the path out of tolerance
        self._outside = np.zeros(places)
        # commanded in the last interval [mm]
        self._way = np.zeros(places)
        self._speed = np.ones(places)
        self._length = np.ones(places)
        self._paths_ahead = PathsAhead(places)

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
        assert isinstance(episode, TrackedEpisode)
        self._tracks = self._tracks.with_track(place, episode.track)
        super()._reset(place, episode)
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
        self._paths_ahead.put(place, episode.look)

    def _act(self, places: Sequence[int]) -> None:
        settings = self.settings
        interval = self.source.ticks or 1
        moved = self._override[places] + settings.step * self._action[places, 0]
        self._override[places] = np.clip(moved, math.log(settings.slowest), math.log(settings.fastest))
        stepped = np.array(places)
        commanded = self._commanded
        before = commanded.s[stepped]
        limits = (settings.acceleration, self.source.servo.period)
        targets = np.exp(self._override) * self._speed
        command(self._tracks, stepped, self._written == 0, targets, limits, commanded)
        write_setpoints(stepped, self._rows, self._spans, self._written, commanded)
        for place in stepped[commanded.way[stepped, -1] >= self._length[stepped]].tolist():
            last = np.searchsorted(commanded.way[place], self._length[place])
            self._setpoints[place] = self._written[place] + int(last) + 1
        self._written[stepped] += interval
        self._way[stepped] = commanded.s[stepped] - before

    def save(self, place: int, random: np.random.Generator) -> EpisodeState:
        state = super().save(place, random)
        episode = self._episode(place)
        written = slice(0, int(self._written[place]))
        columns = {
            "position": episode.simulation.position[written].copy(),
            "dispense": episode.simulation.setpoints.dispense[written].copy(),
            "progress": episode.progress[written].copy(),
        }
        return replace(state, values={**state.values, **columns})

    def restore(self, place: int, state: EpisodeState, random: np.random.Generator) -> None:
        values = {**state.values}
        position = values.pop("position")
        dispense = values.pop("dispense")
        progress = values.pop("progress")
        super().restore(place, replace(state, values=values), random)
        episode = self._episode(place)
        episode.simulation.position[: len(position)] = position
        episode.simulation.setpoints.dispense[: len(dispense)] = dispense
        episode.progress[: len(progress)] = progress

    def record(self, place: int) -> Run:
        run = super().record(place)
        # the record is read-only down to the memory of the setpoints, of which the next are still to be written
        simulation = self._episode(place).simulation
        setpoints = simulation.setpoints
        for array in (simulation.position, setpoints.position, setpoints.dispense, self._episode(place).progress):
            array.flags.writeable = True
        return run

    def follower(self, place: int) -> Run:
        """Return the record of the whole episode at the program's speed without following error."""
        simulation = self._episode(place).simulation
        setpoints = self.source.follower(simulation.setpoints, float(self._speed[place]))
        return perfect_follower(simulation.machine, setpoints, dispenser=simulation.dispenser)

    def observations(self) -> NDArray[np.float32]:
        settings = self.settings
        measured = self.measured
        s = self._commanded_s
        ahead = self._paths_ahead.values(s, (self._commanded_speed, self._speed))
        low = math.log(settings.slowest)
        high = math.log(settings.fastest)
        errors = np.column_stack([measured.contour_max, measured.following_rms]) / settings.tolerance
        parts = [
            np.clip(errors, 0.0, _ERRORS),
            2 * (self._override[:, None] - low) / (high - low) - 1,
            self._action,
            ahead,
            np.minimum(self._paths_ahead.to_reversal(s) / _NEAR_REVERSAL, 1.0),
            (s / self._length)[:, None],
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
    rest at each corner and at the end. When an axis reverses, friction pushes the nozzle off the path, less so at a
    lower speed.

    On a job, axes besides x, y and z follow the program's, the dispenser is switched where the program does, and the
    program's speed is the median of its bead. The job's machine must not turn its work.

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

    A fault terminates the episode; the end of the path truncates it, or 250,000 servo ticks.
    """

    settings_type = SpeedOverrideSettings
    settings: SpeedOverrideSettings

    @staticmethod
    def batch(settings: SpeedOverrideSettings, places: int, threads: int | None, ahead: bool) -> EpisodeBatch:
        return SpeedOverrideBatch(settings, places, threads, ahead)


class SpeedOverrideVectorEnv(PathVectorEnv):
    """Several `SpeedOverrideEnv` in one."""

    single = SpeedOverrideEnv
