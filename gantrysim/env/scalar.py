"""The Gymnasium environments of the first version, and what all environments share: one episode at a time."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium.envs.registration import EnvSpec
from gymnasium.error import ResetNeeded
from gymnasium.utils import EzPickle
from numpy.typing import NDArray

from gantrysim.base.errors import GantryError, InputError, unknown
from gantrysim.env.episode_batch import EpisodeBatch, EpisodeState
from gantrysim.env.episodes import Chosen
from gantrysim.env.frames import Frames
from gantrysim.env.gains import GainBatch
from gantrysim.env.settings import PathSettings, Settings
from gantrysim.env.spec import with_bound
from gantrysim.record.run import Run

Observation = NDArray[np.float32]

OPTIONS = ("spiral", "machine", "task")


class PathEnv(gymnasium.Env[Observation, Observation], EzPickle, ABC):
    """An agent acts while the nozzle follows a path; a task derives from it.

    `save` returns the state of a running episode, `restore` goes on from it. A copy, by `copy` or `pickle`, goes on
    from the moment at which it was taken.

    Args:
        render_mode: None or "rgb_array".
        size: width and height of the pictures [pixels].
        settings: the fields of the task's settings.

    Raises:
        InputError: a setting out of bounds.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 10}  # noqa: RUF012
    settings_type: ClassVar[type[PathSettings]]

    @staticmethod
    @abstractmethod
    def batch(settings: Any, places: int, threads: int | None, ahead: bool) -> EpisodeBatch:
        """Return the places in which the task's episodes run."""

    def __init__(self, *, render_mode: str | None = None, size: tuple[int, int] = (640, 480), **settings: Any) -> None:
        EzPickle.__init__(self, render_mode=render_mode, size=size, **settings)
        self.settings = self.settings_type.of(settings)
        self._episodes = self.batch(self.settings, 1, 1, False)
        self.observation_space, self.action_space = self._episodes.observation_space, self._episodes.action_space
        self.render_mode = render_mode
        self._frames = Frames(render_mode, size)
        if self.settings.decision_interval < math.inf:
            self.metadata = {**self.metadata, "render_fps": max(round(1 / self.settings.decision_interval), 1)}
        self._over = True
        self._spec: EnvSpec | None = None

    @property
    def observation_names(self) -> tuple[str, ...]:
        """Names of the entries of the observation, in order."""
        return tuple(entry.name for entry in self._episodes.entries)

    @property
    def spec(self) -> EnvSpec | None:
        """Of Gymnasium's registry, with the largest number of decisions in an episode of these very settings."""
        return self._spec

    @spec.setter
    def spec(self, value: EnvSpec | None) -> None:
        self._spec = None if value is None else with_bound(value, self._episodes.longest)

    def save(self) -> EpisodeState:
        """Return the state of the running episode.

        Raises:
            GantryError: no episode is running.
        """
        if self._over:
            raise GantryError("no episode is running that could be saved: call reset")
        return self._episodes.save(0, self.np_random)

    def restore(self, state: EpisodeState) -> Observation:
        """Go on from a saved state, and return its observation.

        Raises:
            InputError: a state of an environment with other settings.
        """
        self._over = True  # until all of the state is restored
        self._episodes.restore(0, state, self.np_random)
        self._over = False
        return self._episodes.observations()[0]

    def __getstate__(self) -> dict[str, Any]:
        return {**super().__getstate__(), "spec": self._spec, "state": None if self._over else self.save()}

    def __setstate__(self, content: dict[str, Any]) -> None:
        super().__setstate__(content)
        self._spec = content["spec"]
        if content["state"] is not None:
            self.restore(content["state"])

    @property
    def run(self) -> Run:
        """The record of the episode so far, after at least one step."""
        return self._episodes.record(0)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        super().reset(seed=seed)
        chosen = chosen_in(options or {})
        self._over = True  # until the next episode has begun
        drawn = self._episodes.begin({0: self.np_random}, chosen and {0: chosen})[0]
        self._over = False
        return self._episodes.observations()[0], dict(drawn)

    def step(self, action: Observation) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        if self._over:
            raise ResetNeeded("no episode is running: call reset")
        outcome = self._episodes.advance(np.asarray(action)[None], np.ones(1, bool))
        terminated, truncated = bool(outcome.terminated[0]), bool(outcome.truncated[0])
        self._over = terminated or truncated
        values = {**outcome.info, **outcome.final} if self._over else outcome.info
        info = {name: array[:1].tolist()[0] for name, array in values.items()}
        return self._episodes.observations()[0], float(outcome.reward[0]), terminated, truncated, info

    def render(self) -> NDArray[np.uint8] | None:
        """Return a picture of the machine and the bead so far, (height, width, 3), or None without a render mode.

        Raises:
            NoOpenGLError: OpenGL cannot draw without a display.
        """
        return None if self.render_mode is None else self._frames.picture(self._episodes, 0)

    def close(self) -> None:
        """Free the renderer."""
        self._frames.close()


def chosen_in(options: dict[str, Any]) -> Chosen | None:
    """Return what the options of a reset choose of the episode, None where they choose nothing.

    Raises:
        InputError: an unknown option, or one that is no dict.
    """
    for name, value in options.items():
        if name not in OPTIONS:
            raise unknown("option", name, OPTIONS)
        if not isinstance(value, dict):
            raise InputError(f"option {name} = {value!r}: must be a dict of names and values")
    return Chosen(*(options.get(name, {}) for name in OPTIONS)) if options else None


class SpiralTuningEnv(PathEnv):
    """Tune the servo while the nozzle follows a path.

    An episode is one spiral, with fixed or random diameter, turns, thickness and speed, or the path of a job. Its
    machine is drawn from tolerances. All random values follow from the seed of `reset`. At each decision the agent sets
    gains, which hold until the next.

    Action: kp, kd, velocity_ff and acceleration_ff, each from -1 to 1, common to all axes or, with `per_axis`, one per
    axis. An action a sets a gain to nominal gain / detune * gain_range^a, where the nominal gain is derived, or that of
    the job. ki changes with kp, so the integral time kp / ki stays.

    Observation, for a machine with the axes x and y and common gains. Measured values are those of the last interval,
    and nothing is measured before the first. For a rotary axis the tolerance counts in degrees.

    =====  ====================  =========  ===================  ====================================================
    index  name                  range      unit                 meaning
    =====  ====================  =========  ===================  ====================================================
    0      tracking_rms_x        -3 to 3    log10 of tolerances  RMS following error of x
    1      tracking_max_x        -3 to 3    log10 of tolerances  largest following error of x
    2      tracking_mean_x       -10 to 10  tolerances           mean following error of x, signed
    3      tracking_rms_y        -3 to 3    log10 of tolerances  RMS following error of y
    4      tracking_max_y        -3 to 3    log10 of tolerances  largest following error of y
    5      tracking_mean_y       -10 to 10  tolerances           mean following error of y, signed
    6      contour_rms           -3 to 3    log10 of tolerances  RMS contour error while dispensing
    7      contour_max           -3 to 3    log10 of tolerances  largest contour error while dispensing
    8      contour_mean          -10 to 10  tolerances           mean contour error, positive to the left of the path
    9      speed                 0 to 10    100 mm/s             path speed of the nozzle
    10     curvature             -10 to 10  0.1/mm               path curvature at the nozzle, positive to the left
    11     cos_heading           -1 to 1    1                    path direction at the nozzle, from +x
    12     sin_heading           -1 to 1    1                    path direction at the nozzle, from +x
    13     torque_x              0 to 1     peak torques         largest torque demand of x
    14     ripple_x              -3 to 3    log10 of limits      torque ripple of x
    15     torque_y              0 to 1     peak torques         largest torque demand of y
    16     ripple_y              -3 to 3    log10 of limits      torque ripple of y
    17     gain_kp               -1 to 1    1                    action that sets kp
    18     gain_kd               -1 to 1    1                    action that sets kd
    19     gain_velocity_ff      -1 to 1    1                    action that sets velocity_ff
    20     gain_acceleration_ff  -1 to 1    1                    action that sets acceleration_ff
    21     progress              0 to 1     1                    share of the setpoints sent
    =====  ====================  =========  ===================  ====================================================

    Reward: the sum of three terms, which `info` holds too.

    ==============  =========================================================================================
    term            value
    ==============  =========================================================================================
    reward_contour  -min(log(1 + contour_rms / tolerance), 6), while dispensing
    reward_ripple   -min(log(max(ripple / ripple_limit, 1)), 4), of the axis with the largest ripple
    reward_fault    -12 for the interval of a fault and for each interval that the fault prevents
    ==============  =========================================================================================

    An interval without a fault costs at most 10, so a fault never pays. Stability affects the reward only through the
    ripple; `info["cost"]` tells how far the gains are beyond the tuner's limit |S| = 2 on the nominal machine: 0 up to
    2, then max |S| / 2 - 1, and 1 from 4 on, where the loop is unstable or for a fault
    (`gantrysim.env.sensitivity.SensitivityTable`).

    `info` also holds contour_rms and contour_max [mm], 0 in an interval without dispensing; ripple, the torque ripple
    while dispensing as a share of the nominal drive's peak torque (`gantrysim.metrics.torque_ripple`); fault, a text or
    None; and at the end of an episode episode_contour_rms and episode_contour_max [mm], 0 without dispensing. The
    `info` of `reset` holds the values drawn for the path and the machine. Its options "spiral" and "machine" are dicts
    with some of these values, which replace those drawn.

    A fault terminates the episode; the end of the setpoints truncates it.

    Args:
        render_mode: None or "rgb_array".
        size: width and height of the pictures [pixels].
        settings: the fields of `Settings`.

    Raises:
        InputError: a setting out of bounds.
    """

    settings_type = Settings

    @staticmethod
    def batch(settings: Settings, places: int, threads: int | None, ahead: bool) -> EpisodeBatch:
        return GainBatch(settings, places, threads, ahead)


class GainBanditEnv(SpiralTuningEnv):
    """One decision per episode: constant gains for the whole path, for black-box optimisers.

    Everything else is as in `SpiralTuningEnv`; the decision interval is the episode. The end of the setpoints
    terminates the episode, as a fault does; `info["fault"]` distinguishes them.
    """

    def __init__(self, **settings: Any) -> None:
        super().__init__(**{**settings, "decision_interval": math.inf})
