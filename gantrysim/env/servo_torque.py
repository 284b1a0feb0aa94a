"""ServoTorque-v1: torque against friction, sent with every setpoint, while the friction differs and changes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError, finite, positive
from gantrysim.engine.simulation import Simulation
from gantrysim.env.decision import Entry, Outcome, following_entries
from gantrysim.env.episode_batch import EpisodeBatch
from gantrysim.env.episodes import Episode, Plan
from gantrysim.env.friction import (
    SUMS,
    TORQUES,
    ChangingFriction,
    fit_at_places,
    model_torques,
    next_means_at_places,
    send_torques,
)
from gantrysim.env.scalar import PathEnv
from gantrysim.env.settings import Bounds, PathSettings
from gantrysim.env.vector import PathVectorEnv
from gantrysim.machine.machine import Machine

_WORST_ERROR = 10.0  # tolerances: the largest penalty of an interval, and range of errors
_FAULT = 2.0  # penalty of an interval lost by a fault; the largest of one without is 1
_SPEED_UNIT = 100.0  # [mm/s or deg/s]
_SPEED_RANGE = 10.0  # of these units
_FRICTION_RANGE = 5.0  # range of friction, in that of the nominal machine
_LEVEL_RANGE = 10.0  # range of the level that is missing
_PRIOR = 0.05  # share of the memory for which the level 1 is remembered at the start


class ServoTorqueSettings(PathSettings):
    """Settings of `ServoTorqueEnv`: those of `PathSettings`, and of action and observation.

    Attributes:
        level: level of the torque at the start, 1 for the nominal friction.
        highest: largest level.
        step: largest change of the level at a decision.
        memory: time constant of the exponential forgetting in the fit of the friction level [s].

    Raises:
        InputError: a value out of bounds.
    """

    diameter: Bounds = (36.0, 60.0)
    turns: Bounds = (1, 2)
    thickness: Bounds = (6.0, 9.0)
    speed: Bounds = (40.0, 100.0)
    acceleration: float = 2000.0
    decision_interval: float = 0.01
    tolerance: float = 0.005
    level: float = 1.0
    highest: float = 3.0
    step: float = 0.1
    memory: float = 0.1

    def model_post_init(self, context: object) -> None:
        """Raise InputError for values out of bounds."""
        super().model_post_init(context)
        if self.decision_interval == math.inf:
            raise InputError("decision_interval = inf s: must be finite, for the level changes within an episode")
        if not 0 <= finite("level", self.level) <= positive("highest", self.highest):
            raise InputError(f"level = {self.level:g}: must be at least 0 and at most highest = {self.highest:g}")
        positive("step", self.step)
        positive("memory", self.memory, "s")


class ServoTorqueSource(ChangingFriction):
    """Source of episodes with torques sent with the setpoints, which are still to be written."""

    def _simulation(self, machine: Machine, plan: Plan) -> Simulation:
        simulation = super()._simulation(machine, plan)
        torque = np.zeros(simulation.position.shape) if simulation.torque is None else simulation.torque.copy()
        return replace(simulation, torque=torque)


class ServoTorqueBatch(EpisodeBatch):
    """Places in which episodes run whose torque against friction the agent sets; arguments as of `EpisodeBatch`."""

    settings: ServoTorqueSettings
    source: ServoTorqueSource
    saved: ClassVar[tuple[str, ...]] = (
        *EpisodeBatch.saved,
        "_level",
        "_sums",
        "_error",
        "_next_step",
        "_next_sliding",
        "_decisions",
        "_outside",
    )

    def __init__(self, settings: ServoTorqueSettings, places: int, threads: int | None, ahead: bool) -> None:
        super().__init__(settings, places, threads, ahead, ServoTorqueSource(settings))
        axes = self.source.machine.axes
        period = self.source.servo.period
        self._forget = math.exp(-period / settings.memory)
        self._coulomb = np.maximum([axis.friction.coulomb for axis in axes], np.finfo(float).tiny)
        self._prior = np.maximum(_PRIOR * settings.memory / period * self._coulomb**2, np.finfo(float).tiny)
        self._level = np.zeros((places, len(axes)))
        self._sums = np.ones((places, len(axes)), SUMS)
        # following error of the interval before the last [mm or deg]
        self._error = np.zeros((places, len(axes)))
        self._decisions = np.zeros(places)  # of the episode
        # of these, those after which the nozzle was out of tolerance
        self._outside = np.zeros(places)
        # torques by their addresses, and the arrays, kept alive: of friction, of motion, and given
        self._torques = np.zeros(places, TORQUES)
        self._torques["row"] = [self._batch.address(place) for place in range(places)]
        self._arrays: list[tuple[Floats, ...]] = [()] * places
        # means until the next decision: of the motion in a tick [mm or deg], and of the nominal friction torque [N·m]
        self._next_step = np.zeros((places, len(axes)))
        self._next_sliding = np.zeros((places, len(axes)))

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
                    f"friction_{axis}",
                    -_FRICTION_RANGE,
                    _FRICTION_RANGE,
                    "Coulomb",
                    f"nominal friction torque of {axis} until then",
                ),
                Entry(
                    f"missing_{axis}",
                    -_LEVEL_RANGE,
                    _LEVEL_RANGE,
                    "steps",
                    f"friction of {axis} as fitted, less the level",
                ),
                Entry(f"level_{axis}", 0.0, self.settings.highest, "1", f"level of the torque of {axis}"),
                Entry(f"action_{axis}", -1.0, 1.0, "1", f"last action of {axis}"),
            ]
        return [
            *entries,
            Entry(
                "contour_mean", -_WORST_ERROR, _WORST_ERROR, "tolerances", "mean contour error, positive to the left"
            ),
            Entry("progress", 0.0, 1.0, "1", "share of the setpoints sent"),
        ]

    def _actions(self) -> list[Entry]:
        return [
            Entry(f"level_{axis}", -1.0, 1.0, "`step`", f"change of the level of the torque of {axis}")
            for axis in self.source.machine.axis_names
        ]

    def _reset(self, place: int, episode: Episode) -> None:
        super()._reset(place, episode)
        simulation = episode.simulation
        axes = self.source.machine.axes
        period = self.source.servo.period
        sliding, moving = model_torques(axes, simulation.position, period)
        self._sums["numerator"][place] = self._prior
        self._sums["denominator"][place] = self._prior
        self._error[place] = 0.0
        self._decisions[place] = 0.0
        self._outside[place] = 0.0
        self._level[place] = self.settings.level
        assert simulation.torque is not None
        given = simulation.torque.copy()
        self._arrays[place] = sliding, moving, given
        torques = self._torques[place]
        torques["sliding"] = sliding.ctypes.data
        torques["moving"] = moving.ctypes.data
        torques["given"] = given.ctypes.data
        torques["sent"] = simulation.torque.ctypes.data

    def _act(self, places: Sequence[int]) -> None:
        settings = self.settings
        interval = self.source.ticks or 1
        moved = self._level[places] + settings.step * self._action[places]
        self._level[places] = np.clip(moved, 0.0, settings.highest)
        send_torques(np.array(places), self._torques, self._sent, interval, self._level)

    def _follow(self, places: NDArray[np.intp], firsts: NDArray[np.int64], lasts: NDArray[np.int64]) -> None:
        """Fit the friction to some ticks, and look ahead to the next decision."""
        torques = self._torques
        fit_at_places(places, (firsts, lasts), torques, self._forget, self._sums)
        count = self.source.ticks or 1
        next_means_at_places(places, self._sent, count, torques, self._next_step, self._next_sliding)

    def advance(self, actions: ArrayLike, mask: NDArray[np.bool_]) -> Outcome:
        self._error[mask] = self.measured.following_mean[mask]
        return super().advance(actions, mask)

    def observations(self) -> NDArray[np.float32]:
        measured = self.measured
        tolerance = self.settings.tolerance
        n = len(self.episodes)
        change = measured.following_mean - self._error
        total = self._sums["numerator"]
        squares = self._sums["denominator"]
        # all may be forgotten at rest
        fitted = np.divide(total, squares, out=np.ones(total.shape), where=squares > 0)
        velocity = self._next_step / self.source.servo.period / _SPEED_UNIT
        missing = np.clip((fitted - self._level) / self.settings.step, -_LEVEL_RANGE, _LEVEL_RANGE)
        by_axis = [
            np.clip(measured.following_mean / tolerance, -_WORST_ERROR, _WORST_ERROR),
            np.clip(change / tolerance, -_WORST_ERROR, _WORST_ERROR),
            np.clip(velocity, -_SPEED_RANGE, _SPEED_RANGE),
            np.clip(self._next_sliding / self._coulomb, -_FRICTION_RANGE, _FRICTION_RANGE),
            missing,
            self._level,
            self._action,
        ]
        shared = [
            np.clip(measured.lateral / tolerance, -_WORST_ERROR, _WORST_ERROR)[:, None],
            np.minimum(self._sent / self._setpoints, 1.0)[:, None],
        ]
        return np.concatenate([np.stack(by_axis, 2).reshape(n, -1), *shared], 1, dtype=np.float32)

    def _outcome(self, advanced: NDArray[np.bool_]) -> Outcome:
        measured = self.measured
        tolerance = self.settings.tolerance
        faulty, ended, undone = self._ends(advanced)
        outside = (measured.contour_max > tolerance).astype(float)
        self._decisions[advanced] += 1.0
        self._outside[advanced] += outside[advanced]
        terms = {
            "reward_contour": -np.minimum(measured.contour_rms / tolerance, _WORST_ERROR) / _WORST_ERROR,
            "reward_fault": np.where(faulty, -_FAULT * undone, 0.0),
        }
        return Outcome(
            reward=sum(terms.values(), np.zeros(len(self.episodes))),
            terminated=faulty,
            truncated=ended,
            info={
                **terms,
                "cost": outside,
                "contour_rms": measured.contour_rms,
                "contour_max": measured.contour_max,
                "fault": self._fault_texts(faulty),
            },
            final={
                **self._contour_values(),
                "episode_cost": self._outside / np.maximum(self._decisions, 1),
            },
        )


class ServoTorqueEnv(PathEnv):
    """Set the level of a torque against friction that differs between machines and changes.

    An episode is a spiral, or the path of a job, on a machine drawn from tolerances whose friction changes at some
    moment. When an axis reverses, friction pushes the nozzle off the path until the servo's integral term compensates
    it; a torque sent with the setpoints prevents that. At every servo tick it is

        torque = level * friction torque of the nominal machine's model at the setpoints,

    added to the servo's torque. The drive's limit applies to the sum.

    Action: a number from -1 to 1 for each axis, the change of its level in units of `step`; the level stays between 0
    and `highest`.

    Observation, with the tables of docs/environments.md: for each axis the mean following error of the last interval
    and its change; the velocity demanded until the next decision, and the nominal friction torque then
    (`gantrysim.servo.laws.friction`), relative to Coulomb friction; the missing level, from the friction fitted to the
    servo's torque demands (`gantrysim.env.friction.fit`); the level; and the last action; then the mean contour error,
    and progress.

    Reward: the sum of two terms; `info` contains them too.

    | term | value |
    | --- | --- |
    | reward_contour | -min(e / tolerance, 10) / 10 for the RMS contour error e since the last decision |
    | reward_fault | -2 for the interval of a fault and for each interval that the fault prevents |

    `info` also contains cost, 1 if the largest error since the last decision exceeds the tolerance and 0 otherwise;
    contour_rms and contour_max [mm]; fault, a text or None; and at the end of an episode episode_cost, the fraction of
    such decisions, episode_contour_rms and episode_contour_max [mm]. The `info` of `reset` contains the random values;
    its options "spiral", "machine" and "task" replace some of them.

    A fault terminates the episode; the end of the setpoints truncates it.
    """

    settings_type = ServoTorqueSettings
    settings: ServoTorqueSettings

    @staticmethod
    def batch(settings: ServoTorqueSettings, places: int, threads: int | None, ahead: bool) -> EpisodeBatch:
        return ServoTorqueBatch(settings, places, threads, ahead)


class ServoTorqueVectorEnv(PathVectorEnv):
    """Several `ServoTorqueEnv` in one."""

    single = ServoTorqueEnv
