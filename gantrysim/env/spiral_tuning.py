"""SpiralTuning-v0: gains for a payload that differs from episode to episode and changes within one."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gantrysim.base.errors import InputError, between, finite, positive
from gantrysim.env.decision import Entry, Outcome, following_entries
from gantrysim.env.episode_batch import EpisodeBatch
from gantrysim.env.episodes import SCALED, TUNED_GAINS, Episode, gain_factors
from gantrysim.env.inertia import (
    MOST_PAYLOAD,
    MOTIONS,
    SUMS,
    ChangingPayload,
    Decay,
    Nominal,
    PayloadEpisode,
    fit_at_places,
    next_motion_at_places,
    ratios,
)
from gantrysim.env.look_ahead import PathsAhead, ahead_entries
from gantrysim.env.scalar import PathEnv
from gantrysim.env.sensitivity import SensitivityTable
from gantrysim.env.settings import Bounds, PathSettings
from gantrysim.env.vector import PathVectorEnv
from gantrysim.job.settings import ServoSettings
from gantrysim.machine.tolerances import Tolerances
from gantrysim.servo.gains import GAIN_NAMES

_WORST_ERROR = 10.0  # tolerances: the largest penalty of an interval, and range of errors
_SPEED_UNIT = 100.0  # [mm/s or deg/s]
_SPEED_RANGE = 10.0  # of these units
_ACCELERATION_UNIT = 1000.0  # [mm/s² or deg/s²]
_ACCELERATION_RANGE = 30.0  # of these units
_RATIOS = 5.0  # range of the ratio of inertia, to either side
_PRIOR = 0.005  # share of the memory for which the nominal machine is remembered at the start
_STEADY_ACCELERATION = 1000.0  # acceleration taken for that [mm/s² or deg/s²]
_FILTER_TIME = 0.01  # time constant of the low pass before the fit [s]
_SPEED_OF = {"speed": "path speed of the nozzle"}

FourGains = tuple[float, float, float, float]


class SpiralTuningSettings(PathSettings):
    """Settings of `SpiralTuningEnv`: those of `PathSettings`, and of action and reward.

    Attributes:
        start: factors on the nominal kp, kd, velocity_ff and acceleration_ff at the start of an episode.
        gain_range: largest factor by which the agent raises or lowers a nominal gain.
        step: largest changes of the logarithms of these gains at a decision.
        weight: loss of an interval whose max |S| is 4 or more.
        memory: time constant of the exponential forgetting in the fit of the inertia [s].

    Raises:
        InputError: a value out of bounds.
    """

    servo: ServoSettings = ServoSettings(integral_time=0.03, law=["pid", "friction"])
    diameter: Bounds = (28.0, 36.0)
    turns: Bounds = (4, 5)
    thickness: Bounds = (1.5, 2.0)
    speed: Bounds = (220.0, 300.0)
    acceleration: float = 5000.0
    spread: Tolerances | None = Tolerances(payload=MOST_PAYLOAD, motor_constant=0.03)
    decision_interval: float = 0.02
    tolerance: float = 0.01
    start: FourGains = (0.5, 0.4, 1.0, 1.15)
    gain_range: float = 3.0
    step: FourGains = (0.2, 0.2, 0.2, 0.05)
    weight: float = 1.0
    memory: float = 0.06

    def model_post_init(self, context: object) -> None:
        """Raise InputError for values out of bounds."""
        super().model_post_init(context)
        if self.decision_interval == math.inf:
            raise InputError("decision_interval = inf s: must be finite, for the gains change within an episode")
        if finite("gain_range", self.gain_range) <= 1:
            raise InputError(f"gain_range = {self.gain_range:g}: must be greater than 1")
        for name, factor in zip(TUNED_GAINS, self.start, strict=True):
            between(f"start of {name}", factor, 1 / self.gain_range, self.gain_range)
        for name, step in zip(TUNED_GAINS, self.step, strict=True):
            positive(f"step of {name}", step)
        positive("weight", self.weight)
        positive("memory", self.memory, "s")


class SpiralTuningBatch(EpisodeBatch):
    """Places in which episodes run whose gains the agent changes; arguments as of `EpisodeBatch`."""

    settings: SpiralTuningSettings
    source: ChangingPayload
    saved: ClassVar[tuple[str, ...]] = (
        *EpisodeBatch.saved,
        "_log",
        "_sums",
        "_error",
        "_next_velocity",
        "_next_acceleration",
        "_decisions",
        "_costs",
        "_payload",
    )

    def __init__(self, settings: SpiralTuningSettings, places: int, threads: int | None, ahead: bool) -> None:
        super().__init__(settings, places, threads, ahead, ChangingPayload(settings))
        axes = self.source.machine.axes
        servo = self.source.servo
        self._centre = {name: np.array(servo.per_axis(name)) for name in SCALED}
        self.sensitivity = SensitivityTable(self.source.machine, servo, settings.gain_range, varies=True)
        self._start_log = np.log(settings.start) / math.log(settings.gain_range)
        self._decay = Decay(math.exp(-servo.period / _FILTER_TIME), math.exp(-servo.period / settings.memory))
        self._nominal = Nominal(
            inertia=np.array([axis.inertia / servo.period**2 for axis in axes]),
            viscous=np.array([axis.viscous / servo.period for axis in axes]),
        )
        # r = 1 and h = 1 are remembered as if met with this weight
        # an axis without friction has no equation for h, but must not divide by 0
        least = np.finfo(float).tiny ** 0.5
        j = np.maximum(np.array([_STEADY_ACCELERATION * axis.inertia for axis in axes]) ** 2, least)
        f = np.maximum(np.array([axis.friction.coulomb for axis in axes]) ** 2, least)
        weight = _PRIOR * settings.memory / servo.period
        self._prior = np.zeros(len(axes), SUMS)
        self._prior["JJ"] = weight * j
        self._prior["FF"] = weight * f
        self._prior["JD"] = weight * j
        self._prior["FD"] = weight * f
        # of the gains, share of the range
        self._log = np.zeros((places, len(TUNED_GAINS)))
        self._sums = np.zeros((places, len(axes)), SUMS)
        self._sums[...] = self._prior
        # following error of the interval before the last [mm or deg]
        self._error = np.zeros((places, len(axes)))
        # until the next decision [mm/s and mm/s², or deg]
        self._next_velocity = np.zeros((places, len(axes)))
        self._next_acceleration = np.zeros((places, len(axes)))
        self._decisions = np.zeros(places)  # of the episode
        self._costs = np.zeros(places)  # their sum
        # of the last interval [kg]
        self._payload = np.zeros(places)
        # tick from which the payload is another one, and its mass [kg]
        self._change = np.zeros(places, np.int64)
        self._payload_later = np.zeros(places)
        # motion for the fit, by the addresses of its arrays
        self._motions = np.zeros(places, MOTIONS)
        self._motions["row"] = [self._batch.address(place) for place in range(places)]
        self._paths_ahead = PathsAhead(places)

    def _entries(self) -> list[Entry]:
        entries = []
        for axis in self.source.machine.axis_names:
            entries += [
                *following_entries(axis, _WORST_ERROR),
                Entry(
                    f"velocity_{axis}",
                    -_SPEED_RANGE,
                    _SPEED_RANGE,
                    "100 mm/s",
                    f"demanded velocity of {axis} until the next",
                ),
                Entry(
                    f"acceleration_{axis}", -_ACCELERATION_RANGE, _ACCELERATION_RANGE, "1 m/s²", "demanded acceleration"
                ),
                Entry(f"inertia_{axis}", -_RATIOS, _RATIOS, "1", f"inertia of {axis} over the nominal one, as fitted"),
            ]
        return [
            *entries,
            Entry("inertia", -_RATIOS, _RATIOS, "1", "inertia over the nominal one, fitted to all axes together"),
            *(Entry(f"gain_{name}", -1.0, 1.0, "log of range", f"present factor on {name}") for name in TUNED_GAINS),
            *ahead_entries(_SPEED_OF),
            Entry("contour_rms", 0.0, _WORST_ERROR, "tolerances", "RMS contour error of the last interval"),
            Entry(
                "contour_mean", -_WORST_ERROR, _WORST_ERROR, "tolerances", "mean contour error, positive to the left"
            ),
            Entry("progress", 0.0, 1.0, "1", "share of the setpoints sent"),
        ]

    def _actions(self) -> list[Entry]:
        return [Entry(name, -1.0, 1.0, "`step`", f"change of the logarithm of {name}") for name in TUNED_GAINS]

    def _reset(self, place: int, episode: Episode) -> None:
        assert isinstance(episode, PayloadEpisode)
        super()._reset(place, episode)
        motion = self._motions[place]
        motion["sliding"] = episode.motion.sliding.ctypes.data
        motion["moved"] = episode.motion.moved.ctypes.data
        simulation = episode.simulation
        self._change[place] = -(-simulation.later[0].step // simulation.substeps)
        self._payload_later[place] = episode.drawn["payload_later"]
        self._paths_ahead.put(place, episode.look)
        self._log[place] = self._start_log
        self._sums[place] = self._prior
        self._error[place] = 0.0
        self._decisions[place] = 0.0
        self._costs[place] = 0.0
        self._payload[place] = episode.drawn.get("payload_kg", 0.0)

    def _act(self, places: Sequence[int]) -> None:
        settings = self.settings
        step = np.array(settings.step) / math.log(settings.gain_range) * self._action[places]
        self._log[places] = np.clip(self._log[places] + step, -1.0, 1.0)
        for name, factor in gain_factors(self._log[places].T[..., None], settings.gain_range).items():
            self._gains[places, : self._axes, GAIN_NAMES.index(name)] = self._centre[name] * factor

    def _follow(self, places: NDArray[np.intp], firsts: NDArray[np.int64], lasts: NDArray[np.int64]) -> None:
        """Fit the inertia to some ticks, and look ahead to the next decision."""
        fit_at_places(places, (firsts, lasts), self._motions, self._nominal, self._decay, self._sums)
        changed = places[firsts >= self._change[places]]
        self._payload[changed] = self._payload_later[changed]
        interval = (self.source.ticks or 1, self.source.servo.period)
        next_motion_at_places(places, self._sent, interval, self._motions, self._next_velocity, self._next_acceleration)

    def advance(self, actions: ArrayLike, mask: NDArray[np.bool_]) -> Outcome:
        self._error[mask] = self.measured.following_mean[mask]
        return super().advance(actions, mask)

    def observations(self) -> NDArray[np.float32]:
        measured = self.measured
        tolerance = self.settings.tolerance
        n = len(self.episodes)
        ratio, common = ratios(self._sums)
        axes = [
            np.clip(measured.following_mean / tolerance, -_WORST_ERROR, _WORST_ERROR),
            np.clip((measured.following_mean - self._error) / tolerance, -_WORST_ERROR, _WORST_ERROR),
            np.clip(self._next_velocity / _SPEED_UNIT, -_SPEED_RANGE, _SPEED_RANGE),
            np.clip(self._next_acceleration / _ACCELERATION_UNIT, -_ACCELERATION_RANGE, _ACCELERATION_RANGE),
            np.clip(ratio, -_RATIOS, _RATIOS),
        ]
        ahead = self._paths_ahead.values(self._paths_ahead.s(self._foot), [measured.speed])
        shared = [
            np.clip(common, -_RATIOS, _RATIOS)[:, None],
            self._log,
            ahead,
            np.clip(measured.contour_rms / tolerance, 0.0, _WORST_ERROR)[:, None],
            np.clip(measured.lateral / tolerance, -_WORST_ERROR, _WORST_ERROR)[:, None],
            np.minimum(self._sent / self._setpoints, 1.0)[:, None],
        ]
        return np.concatenate([np.stack(axes, 2).reshape(n, -1), *shared], 1, dtype=np.float32)

    def _outcome(self, advanced: NDArray[np.bool_]) -> Outcome:
        measured = self.measured
        settings = self.settings
        faulty, ended, undone = self._ends(advanced)
        cost = self.sensitivity.cost(self._log[:, :, None], self._payload)
        cost[faulty] = 1.0
        self._decisions[advanced] += 1.0
        self._costs[advanced] += cost[advanced]
        terms = {
            "reward_contour": -np.minimum(measured.contour_rms / settings.tolerance, _WORST_ERROR) / _WORST_ERROR,
            "reward_stability": -settings.weight * cost,
            "reward_fault": np.where(faulty, -(1 + settings.weight) * undone, 0.0),
        }
        return Outcome(
            reward=sum(terms.values(), np.zeros(len(self.episodes))),
            terminated=faulty,
            truncated=ended,
            info={
                **terms,
                "cost": cost,
                "contour_rms": measured.contour_rms,
                "contour_max": measured.contour_max,
                "fault": self._fault_texts(faulty),
            },
            final={**self._contour_values(), "episode_cost": self._costs / np.maximum(self._decisions, 1)},
        )


class SpiralTuningEnv(PathEnv):
    """Tune the servo while the nozzle follows a path with a payload that varies and changes.

    An episode is a fast, small spiral, or the path of a job, on a machine drawn from tolerances. The machine carries a
    tool, a cartridge or a fixture, of any mass within the tolerances, and at some moment another one, of up to 4 kg,
    which joins at the speed of the nozzle. The payload acts through the compliance of the drive trains: a larger one
    slows down their mode, so that the same |S| needs lower gains, but a higher acceleration feed-forward.

    Action: kp, kd, velocity_ff and acceleration_ff, each from -1 to 1, which changes the logarithm of the gain by up to
    `step`, equally for all axes. ki changes with kp. A gain stays between 1 / `gain_range` and `gain_range` times the
    nominal one.

    Observation, with the tables of docs/environments.md: for each axis the mean following error of the last interval
    and its change, the velocity and the acceleration demanded until the next decision, and the inertia over the nominal
    one, fitted to the servo's torque demands (`gantrysim.env.inertia.fit`); that of all axes together; the present
    gains; path speed, curvature here and ahead, distances to the next and since the last reversal; contour error;
    progress.

    Reward: the sum of three terms; `info` contains them too.

    | term | value |
    | --- | --- |
    | reward_contour | -min(e / tolerance, 10) / 10 for the RMS contour error e since the last decision |
    | reward_stability | -weight cost |
    | reward_fault | -(1 + weight) for the interval of a fault and for each interval that the fault prevents |

    `info` also contains cost, how far the gains exceed |S| = 2 on the nominal machine with the current payload:
    0 up to 2, then max |S| / 2 - 1, and 1 from 4 on, where the loop is unstable or for a fault
    (`gantrysim.env.sensitivity.SensitivityTable`); contour_rms and contour_max [mm]; fault, a text or None; and at the
    end of an episode episode_cost, its mean, episode_contour_rms and episode_contour_max [mm]. The `info` of `reset`
    contains the random values, such as payload_kg, payload_later and payload_time; its options "spiral", "machine" and
    "task" replace some of them.

    A fault terminates the episode; the end of the setpoints truncates it.
    """

    settings_type = SpiralTuningSettings
    settings: SpiralTuningSettings

    @staticmethod
    def batch(settings: SpiralTuningSettings, places: int, threads: int | None, ahead: bool) -> EpisodeBatch:
        return SpiralTuningBatch(settings, places, threads, ahead)


class SpiralTuningVectorEnv(PathVectorEnv):
    """Several `SpiralTuningEnv` in one."""

    single = SpiralTuningEnv
