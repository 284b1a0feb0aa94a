"""BeadWidth-v1: keep the width of a bead while viscosity and speed change.

The program asks for the pressure that would lay an even bead of the nominal glue; the agent changes it by a factor, the
override. `gantrysim.env.glue` lays the bead piece by piece, and a camera some way behind the nozzle measures them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError, at_least, positive
from gantrysim.env.decision import Entry, EpisodeState, Outcome
from gantrysim.env.episode_batch import EpisodeBatch, addresses_of
from gantrysim.env.episodes import Episode, Source
from gantrysim.env.glue import LAYING, NOISES, PIECE, PIECES, WIDTHS, laying_stage
from gantrysim.env.look_ahead import LimitedSpeed, PathsAhead, Rows, ahead_entries
from gantrysim.env.ranges import NOT_NEGATIVE, POSITIVE_VALUES, RandomValue
from gantrysim.env.scalar import PathEnv
from gantrysim.env.settings import Bounds, PathSettings
from gantrysim.env.vector import PathVectorEnv
from gantrysim.machine.tolerances import Tolerances
from gantrysim.paths.path import Path
from gantrysim.paths.profile import Profile
from gantrysim.record.run import Run

# Values that are drawn for an episode: nominal value, range in training, shifted range, limits, unit, meaning.

# of the glue and its needle
GLUE = {
    "viscosity": RandomValue(
        1.0, (0.7, 1.4), (1.4, 2.0), POSITIVE_VALUES, "1", "viscosity over the nominal one at the start"
    ),
    "warming": RandomValue(1.0, (0.6, 1.6), (1.6, 2.2), POSITIVE_VALUES, "1", "factor on it after a long time"),
    "warming_time": RandomValue(5.0, (2.0, 8.0), (1.0, 2.0), POSITIVE_VALUES, "s", "time constant of this change"),
    "clog": RandomValue(1.0, (0.7, 1.0), (0.5, 0.7), (1e-3, 1.0), "1", "factor on the flow of a clogged needle"),
    "clog_time": RandomValue(6.0, (2.0, 10.0), (1.0, 5.0), NOT_NEGATIVE, "s", "time of the clog"),
    "lag": RandomValue(0.1, (0.05, 0.15), (0.15, 0.25), POSITIVE_VALUES, "s", "time constant of the pressure"),
}
_TURN = 2 * math.pi
# of the places in which the program slows down
SPEED = {
    "dip": RandomValue(0.0, (0.0, 0.6), (0.6, 0.8), (0.0, 0.95), "1", "share by which the program slows down"),
    "dip_length": RandomValue(
        60.0, (30.0, 90.0), (15.0, 30.0), POSITIVE_VALUES, "mm", "distance between two such places"
    ),
    "dip_phase": RandomValue(0.0, (0.0, _TURN), (0.0, _TURN), (0.0, _TURN), "rad", "phase of them at the start"),
}
_SEED = {"camera": RandomValue(0.0, (0.0, 1.0), (0.0, 1.0), (0.0, 1.0), "1", "seed of the camera's noise")}
# a seed from 0 to 1 has as many values as a float resolves there
_SEEDS = 2**53

# width error above which none is observed as larger, or costs more [tolerances]
_WORST_ERROR = 10.0
# penalty of an interval lost by a fault; the largest of one without is 1
_FAULT = 2.0
# what the agent knows of the width, from the camera
_SEEN_WIDTH = np.dtype(
    [
        # mean of the last interval in which it saw the bead [tolerances]
        ("error", np.float64),
        # since the measurement before [tolerances]
        ("change", np.float64),
        # 1 where it has seen the bead
        ("is_seen", np.float64),
    ]
)
# speeds that the agent knows ahead, one decision after the other
_SPEEDS = {
    "speed": "commanded path speed",
    "speed_1": "commanded path speed one decision ahead",
    "speed_2": "commanded path speed two decisions ahead",
}


class BeadWidthSettings(PathSettings):
    """Settings of `BeadWidthEnv`: those of `PathSettings`, and of glue, camera and action.

    Attributes:
        tolerance: tolerance of the bead's width, relative.
        override: override of the pressure at the start of an episode.
        step: largest change of the logarithm of the override at a decision.
        override_range: largest factor by which the override raises or lowers the pressure.
        index: flow index n of the glue.
        behind: distance along the path from the nozzle to the camera that follows it, rounded to pieces of the bead,
            which are 0.5 mm long and end at the next servo tick [mm].
        camera_noise: standard deviation of the measured width, relative, for each 0.5 mm of the bead.

    Raises:
        InputError: a value out of bounds.
    """

    diameter: Bounds = (40.0, 80.0)
    turns: Bounds = (1, 3)
    thickness: Bounds = (6.0, 9.0)
    speed: Bounds = (40.0, 80.0)
    acceleration: float = 500.0
    spread: Tolerances | None = Tolerances()
    tolerance: float = 0.05
    override: float = 1.0
    step: float = 0.1
    override_range: float = 4.0
    index: float = 0.6
    behind: float = 10.0
    camera_noise: float = 0.02

    def model_post_init(self, context: Any) -> None:
        """Raise InputError for values out of bounds."""
        super().model_post_init(context)
        if self.decision_interval == math.inf:
            raise InputError("decision_interval = inf s: must be finite, for the glue changes within an episode")
        for name in ("override", "step", "index"):
            positive(name, getattr(self, name))
        if self.override_range <= 1 or not 1 / self.override_range <= self.override <= self.override_range:
            raise InputError(
                f"override_range = {self.override_range:g}: must be greater than 1, and override = "
                f"{self.override:g} within"
            )
        at_least("behind", self.behind, PIECE, "mm", PIECE * (PIECES - 1))
        at_least("camera_noise", self.camera_noise, 0)


@dataclass(frozen=True, eq=False)
class BeadEpisode(Episode):
    """An episode with glue.

    Attributes:
        speeds: commanded path speed after each setpoint, 0 after the last, where the path ends, (n,) [mm/s].
        noise: of the camera, relative, which it takes in turns, (NOISES,).
        flow: at each tick, over the nominal one, to be written, (log's entries,).
    """

    speeds: Floats
    noise: Floats
    flow: Floats


class BeadWidthSource(Source):
    """Source of episodes with glue; on spirals the program slows down in places."""

    settings: BeadWidthSettings
    values: ClassVar = {**GLUE, **SPEED, **_SEED}
    looks_ahead: ClassVar[bool] = True

    def episode(self, drawn: Mapping[str, float]) -> BeadEpisode:
        episode = super().episode(drawn)
        simulation = episode.simulation
        # column by column: a norm of each row takes three times as long
        x, y, z = np.diff(simulation.machine.tip(simulation.position), axis=0).T
        speeds = np.sqrt(x * x + y * y + z * z) / simulation.setpoints.period
        random = np.random.default_rng(int(drawn["camera"] * _SEEDS))
        noise = self.settings.camera_noise * random.standard_normal(NOISES)
        flow = np.zeros(len(simulation.log.tick))
        return BeadEpisode(**episode.parts(), speeds=np.append(speeds, 0.0), noise=noise, flow=flow)

    @property
    def slowest(self) -> float:
        return 1 - self.task["dip"][1]

    def _profile(self, path: Path, speed: float, **task: float) -> Profile:
        """Return the profile of a speed that falls and rises along the path as a sine does."""
        s = np.linspace(0.0, path.length, max(math.ceil(path.length), 2))
        # from 0, where the program runs at its speed, to 1, where it is slowest
        wave = 0.5 * (1 + np.sin(2 * math.pi * s / task["dip_length"] + task["dip_phase"]))
        return LimitedSpeed(s, speed * (1 - task["dip"] * wave), self.settings.acceleration)


class BeadWidthBatch(EpisodeBatch):
    """Places in which episodes run whose pressure the agent sets; arguments as of `EpisodeBatch`."""

    settings: BeadWidthSettings
    saved: ClassVar[tuple[str, ...]] = (
        *EpisodeBatch.saved,
        "_override",
        "_bead",
        "_widths",
        "_sight",
        "_seen",
        "_episode_widths",
    )

    def __init__(self, settings: BeadWidthSettings, places: int, threads: int | None, ahead: bool) -> None:
        super().__init__(settings, places, threads, ahead, BeadWidthSource(settings))
        # logarithm of the override of the pressure
        self._override = np.zeros(places)

        # what is laid, with the bead at the nozzle, and what was laid and seen since the last decision
        self._laying = np.zeros(places, LAYING)
        self._laying["span"] = addresses_of(self._spans)
        self._laying["flow_index"] = settings.index
        self._laying["behind"] = round(settings.behind / PIECE)
        self._laying["tolerance"] = settings.tolerance
        self._bead = self._laying["before"]
        self._widths = self._laying["widths"]
        self._sight = self._laying["sight"]

        # what follows from it: what the agent knows of the width, and the widths of an episode
        self._seen = np.zeros(places, _SEEN_WIDTH)
        self._episode_widths = np.zeros(places, WIDTHS)

        # commanded speeds after each setpoint of an episode, zero behind the last
        self._speed_rows = Rows(places)
        self._paths_ahead = PathsAhead(places)

    def _entries(self) -> list[Entry]:
        return [
            Entry(
                "width_error",
                -_WORST_ERROR,
                _WORST_ERROR,
                "tolerances",
                "mean width error that the camera measured last",
            ),
            Entry("width_change", -_WORST_ERROR, _WORST_ERROR, "tolerances", "its change since the measurement before"),
            Entry("width_seen", 0.0, 1.0, "1", "whether the camera has seen the bead"),
            Entry("override", -1.0, 1.0, "log of range", "override of the pressure"),
            Entry("action", -1.0, 1.0, "1", "last action"),
            *ahead_entries(_SPEEDS),
            Entry("progress", 0.0, 1.0, "1", "share of the setpoints sent"),
        ]

    def _actions(self) -> list[Entry]:
        return [Entry("override", -1.0, 1.0, "`step`", "change of the logarithm of the pressure's override")]

    def _reset(self, place: int, episode: Episode) -> None:
        assert isinstance(episode, BeadEpisode)
        super()._reset(place, episode)
        settings = self.settings
        self._override[place] = math.log(settings.override)
        for array in (self._bead, self._widths, self._sight, self._seen, self._episode_widths):
            array[place] = 0
        self._speed_rows.put(place, episode.speeds)
        laying = self._laying[place]
        laying["flow"] = episode.flow.ctypes.data
        laying["noise"] = episode.noise.ctypes.data
        laying["speeds"] = episode.speeds.ctypes.data
        laying["reference"] = episode.speeds.max()
        self._paths_ahead.put(place, episode.look)

        for name in GLUE:
            laying[name] = episode.drawn[name]

    def _act(self, places: Sequence[int]) -> None:
        """Move the logarithm of the override by the action, within its range."""
        largest = math.log(self.settings.override_range)
        moved = self._override[places] + self.settings.step * self._action[places, 0]
        moved = np.clip(moved, -largest, largest)
        self._override[places] = moved
        self._laying["override"][places] = [math.exp(logarithm) for logarithm in moved.tolist()]

    def _stage(self) -> int:
        return laying_stage()

    def _stage_argument(self, place: int) -> int:
        return int(addresses_of(self._laying)[place])

    def _follow(self, places: NDArray[np.intp], firsts: NDArray[np.int64], lasts: NDArray[np.int64]) -> None:
        """Take the bead that is laid; count it for the episode, and look at it."""
        self._bead[places] = self._laying["after"][places]
        self._count_widths(places)
        self._look_at_bead(places)

    def save(self, place: int, random: np.random.Generator) -> EpisodeState:
        state = super().save(place, random)
        return replace(state, values={**state.values, "flow": self._flow(place).copy()})

    def restore(self, place: int, state: EpisodeState, random: np.random.Generator) -> None:
        values = {**state.values}
        flow = values.pop("flow")
        super().restore(place, replace(state, values=values), random)
        self._flow(place)[:] = flow

    def _flow(self, place: int) -> Floats:
        """Return the flow at each tick of the episode at a place, as `gantrysim.env.glue.lay` writes it."""
        episode = self._episode(place)
        assert isinstance(episode, BeadEpisode)
        return episode.flow

    def record(self, place: int) -> Run:
        """Return the record of the episode at a place so far, with the flow of the agent's pressure."""
        run = super().record(place)
        dispenser = self._episode(place).simulation.dispenser
        # a dispenser whose flow is proportional to the speed has an area, another one a flow
        nominal = dispenser.area * self._laying["reference"][place] if dispenser.area else dispenser.flow
        return run.replaced(flow=np.where(run.dispense, nominal * self._flow(place)[: len(run)], 0.0))

    def _count_widths(self, stepped: NDArray[np.intp]) -> None:
        """Add the widths since the last decision to those of the episode."""
        widths = self._widths[stepped]
        episode_widths = self._episode_widths
        for name in ("pieces", "square", "outside"):
            episode_widths[name][stepped] += widths[name]
        episode_widths["largest"][stepped] = np.maximum(episode_widths["largest"][stepped], widths["largest"])

    def _look_at_bead(self, stepped: NDArray[np.intp]) -> None:
        """Take what the camera saw since the last decision; where it saw nothing, what it saw last remains."""
        seeing = stepped[self._sight["pieces"][stepped] > 0]
        sight = self._sight[seeing]
        error = sight["error"] / sight["pieces"] / self.settings.tolerance
        seen = self._seen
        # a first measurement is no change
        seen["change"][seeing] = np.where(seen["is_seen"][seeing] > 0, error - seen["error"][seeing], 0.0)
        seen["error"][seeing] = error
        seen["is_seen"][seeing] = 1.0

    def observations(self) -> NDArray[np.float32]:
        interval = self.source.ticks or 1
        speeds = [self._speed_rows.at(self._sent + k * interval) for k in range(len(_SPEEDS))]
        # in the order of `_entries`
        parts = [
            np.clip(self._seen["error"], -_WORST_ERROR, _WORST_ERROR)[:, None],
            np.clip(self._seen["change"], -_WORST_ERROR, _WORST_ERROR)[:, None],
            self._seen["is_seen"][:, None],
            self._override[:, None] / math.log(self.settings.override_range),
            self._action,
            self._paths_ahead.values(self._paths_ahead.s(self._foot), speeds),
            np.minimum(self._sent / self._setpoints, 1.0)[:, None],
        ]
        return np.concatenate(parts, 1, dtype=np.float32)

    def _outcome(self, advanced: NDArray[np.bool_]) -> Outcome:
        widths = self._widths
        episode_widths = self._episode_widths
        # an interval may end before its first piece does
        pieces = np.maximum(widths["pieces"], 1)
        episode_pieces = np.maximum(episode_widths["pieces"], 1)
        rms = np.sqrt(widths["square"] / pieces)
        faulty, ended, undone = self._ends(advanced)
        reward: Floats = -np.minimum(rms / self.settings.tolerance, _WORST_ERROR) / _WORST_ERROR
        return Outcome(
            reward=reward - np.where(faulty, _FAULT * undone, 0.0),
            terminated=faulty,
            truncated=ended,
            info={
                "cost": widths["outside"] / pieces,
                "width_rms": rms,
                "width_max": widths["largest"].copy(),
                "override": np.exp(self._override),
                "fault": self._fault_texts(faulty),
            },
            final={
                "episode_width_rms": np.sqrt(episode_widths["square"] / episode_pieces),
                "episode_width_max": episode_widths["largest"].copy(),
                "episode_cost": episode_widths["outside"] / episode_pieces,
            },
        )


class BeadWidthEnv(PathEnv):
    """Keep the width of the bead while viscosity and speed change, with a camera that follows the nozzle.

    An episode is a spiral, or the path of a job, on a machine drawn from tolerances. On a spiral the program slows
    down in places. The program requests the pressure that would lay an even bead of the nominal glue. The pressure
    follows with a lag, the viscosity is random and drifts, and at some moment the needle clogs in part: see
    `gantrysim.env.glue.lay`.

    Action: one number from -1 to 1, which changes the logarithm of the override of the pressure by up to `step`.

    Observation, with the tables of docs/environments.md: the latest width error measured by the camera, its change, the
    override, commanded speed now and one and two decisions ahead, curvature here and ahead, distances to the next and
    since the last reversal of an axis, and progress.

    Reward: -min(e / tolerance, 10) / 10 for the RMS relative width error e of the bead laid since the last decision;
    minus 2 for the interval of a fault and for each interval that the fault prevents.

    `info` contains cost, the fraction of this bead out of tolerance; width_rms and width_max, relative; override;
    fault, a text or None; and at the end of an episode episode_width_rms, episode_width_max and episode_cost. The
    `info` of `reset` contains the random values; its options "spiral", "machine" and "task" replace some of them.

    A fault terminates the episode; the end of the setpoints truncates it.
    """

    settings_type = BeadWidthSettings
    settings: BeadWidthSettings

    @staticmethod
    def batch(settings: BeadWidthSettings, places: int, threads: int | None, ahead: bool) -> EpisodeBatch:
        return BeadWidthBatch(settings, places, threads, ahead)


class BeadWidthVectorEnv(PathVectorEnv):
    """Several `BeadWidthEnv` in one."""

    single = BeadWidthEnv
