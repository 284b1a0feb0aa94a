"""The Gymnasium environment: one episode at a time."""

from __future__ import annotations

import math
from typing import Any

import gymnasium
import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.utils import EzPickle
from numpy.typing import NDArray

from gantrysim.env.episode_batch import EpisodeBatch
from gantrysim.env.frames import Frames
from gantrysim.env.settings import Settings
from gantrysim.errors import InputError
from gantrysim.run import Run

Observation = NDArray[np.float32]


class SpiralTuningEnv(gymnasium.Env[Observation, Observation], EzPickle):
    """Tune the servo while the nozzle runs along a path.

    An episode is one spiral, with its diameter, turns, thickness and speed fixed or drawn at random, on a machine that
    is drawn around the nominal one; or a job's path. Everything drawn follows from the seed of `reset`. At every
    decision the agent sets gains, which hold until the next.

    Action: kp, kd, velocity_ff and acceleration_ff, each from -1 to 1, for all axes or, `per_axis`, for one axis after
    the other: with an action a the gain is the derived one (or the job's) / detune * gain_range^a. ki keeps its time
    constant kp / ki.

    Observation, of a machine with the axes x and y and gains that they share; what was measured is of the last
    interval, and nothing before the first. Tolerances of a rotary axis are in degrees where they are in mm of others.

    =====  ====================  =========  ===================  ====================================================
    index  name                  range      unit                 meaning
    =====  ====================  =========  ===================  ====================================================
    0      tracking_rms_x        -3 to 3    log10 of tolerances  rms following error of x
    1      tracking_max_x        -3 to 3    log10 of tolerances  largest following error of x
    2      tracking_mean_x       -10 to 10  tolerances           mean following error of x, signed
    3      tracking_rms_y        -3 to 3    log10 of tolerances  rms following error of y
    4      tracking_max_y        -3 to 3    log10 of tolerances  largest following error of y
    5      tracking_mean_y       -10 to 10  tolerances           mean following error of y, signed
    6      contour_rms           -3 to 3    log10 of tolerances  rms contour error while the dispenser is on
    7      contour_max           -3 to 3    log10 of tolerances  largest contour error of the same
    8      contour_mean          -10 to 10  tolerances           mean contour error, positive to the left of the path
    9      speed                 0 to 10    100 mm/s             path speed of the nozzle
    10     curvature             -10 to 10  0.1/mm               of the path at the nozzle, positive to the left
    11     cos_heading           -1 to 1    1                    of the path there, from +x
    12     sin_heading           -1 to 1    1                    of the same
    13     torque_x              0 to 1     peak torques         largest torque demand of x
    14     ripple_x              -3 to 3    log10 of limits      torque ripple of x
    15     torque_y              0 to 1     peak torques         largest torque demand of y
    16     ripple_y              -3 to 3    log10 of limits      torque ripple of y
    17     gain_kp               -1 to 1    1                    present kp, as the action has it
    18     gain_kd               -1 to 1    1                    present kd, as the action has it
    19     gain_velocity_ff      -1 to 1    1                    present velocity_ff, as the action has it
    20     gain_acceleration_ff  -1 to 1    1                    present acceleration_ff, as the action has it
    21     progress              0 to 1     1                    share of the setpoints that are sent
    =====  ====================  =========  ===================  ====================================================

    Reward: the sum of three terms, which stand in `info`,

        reward_contour = -min(log(1 + contour_rms / tolerance), 6), while the dispenser is on,
        reward_ripple = -min(log(max(ripple / ripple_limit, 1)), 4), of the axis with the most,
        reward_fault = -12 for the interval of a fault and for each that it leaves undone,

    so that no fault pays; one can cost some thousand times what a good interval does. Stability is rewarded only
    through the ripple: check what was learnt with `gantrysim.stability.margins`. `info` also holds contour_rms and contour_max
    [mm], 0 in an interval without glue; ripple, the torque ripple while the dispenser is on as a share of the nominal
    drive's peak torque (`gantrysim.metrics.torque_ripple`); fault, as text or None; and, when an episode is over,
    episode_contour_rms and episode_contour_max [mm] of the part that was run, nan where it had no glue. The `info` of
    `reset` describes what was drawn.

    A fault terminates the episode; the end of the setpoints truncates it.

    Args:
        render_mode: None or "rgb_array".
        size: width and height of the pictures [pixels].
        settings: what `Settings` lists.

    Raises:
        InputError: a setting out of its bounds.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 10}  # noqa: RUF012

    def __init__(self, *, render_mode: str | None = None, size: tuple[int, int] = (640, 480), **settings: Any) -> None:
        EzPickle.__init__(self, render_mode=render_mode, size=size, **settings)
        self.settings = Settings.of(settings)
        self._episodes = EpisodeBatch(self.settings, 1, 1)
        self.observation_space, self.action_space = self._episodes.observation_space, self._episodes.action_space
        self.render_mode = render_mode
        self._frames = Frames(render_mode, size)
        if self.settings.decision_interval < math.inf:
            self.metadata = {**self.metadata, "render_fps": max(round(1 / self.settings.decision_interval), 1)}
        self._over = True

    @property
    def observation_names(self) -> tuple[str, ...]:
        """Names of the observation's entries, in order."""
        return tuple(entry.name for entry in self._episodes.entries)

    @property
    def run(self) -> Run:
        """The record of the episode so far, at least one tick of it."""
        return self._episodes.record(0)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        super().reset(seed=seed)
        if options:
            raise InputError(f"options {', '.join(options)}: reset takes none; what is fixed or drawn are settings")
        self._over = True  # until the next episode has begun
        drawn = self._episodes.begin({0: self.np_random})[0]
        self._over = False
        return self._episodes.observations()[0], dict(drawn)

    def step(self, action: Observation) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        if self._over:
            raise ResetNeeded("the episode is over, or none has begun: call reset")
        outcome = self._episodes.advance(np.asarray(action)[None], np.ones(1, bool))
        terminated, truncated = bool(outcome.terminated[0]), bool(outcome.truncated[0])
        self._over = terminated or truncated
        told = {**outcome.info, **outcome.final} if self._over else outcome.info
        info = {name: values[:1].tolist()[0] for name, values in told.items()}
        return self._episodes.observations()[0], float(outcome.reward[0]), terminated, truncated, info

    def render(self) -> NDArray[np.uint8] | None:
        """Return the picture of the machine and the bead laid so far, (height, width, 3); None without a render mode.

        Raises:
            NoOpenGLError: no OpenGL that needs no display.
        """
        return self._frames.picture(lambda: self._episodes.scene(0), lambda: self._episodes.follower(0))

    def close(self) -> None:
        """Free what pictures were drawn with."""
        self._frames.close()


class GainBanditEnv(SpiralTuningEnv):
    """One decision per episode: the gains with which the whole path is run, for black-box optimisers.

    Everything else is as in `SpiralTuningEnv`, the settings too; the decision interval is the episode. The end of the
    setpoints terminates it as a fault does, for there is no later decision; `info["fault"]` tells them apart.
    """

    def __init__(self, *, render_mode: str | None = None, size: tuple[int, int] = (640, 480), **settings: Any) -> None:
        super().__init__(render_mode=render_mode, size=size, **{**settings, "decision_interval": math.inf})
