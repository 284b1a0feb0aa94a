"""Base class of the environments, one episode at a time, and what Gymnasium knows of it."""

from __future__ import annotations

import math
import os
from abc import ABC, abstractmethod
from dataclasses import replace
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium.envs.registration import EnvSpec
from gymnasium.error import ResetNeeded
from gymnasium.utils import EzPickle
from numpy.typing import NDArray

from gantrysim.base.errors import GantryError, InputError, unknown
from gantrysim.env.decision import EpisodeState
from gantrysim.env.episode_batch import EpisodeBatch
from gantrysim.env.episodes import Chosen
from gantrysim.env.frames import Frames
from gantrysim.env.settings import PathSettings
from gantrysim.job.job import Job
from gantrysim.record.run import Run

Observation = NDArray[np.float32]

OPTIONS = ("spiral", "machine", "task")


def with_bound(spec: EnvSpec, longest: int) -> EnvSpec:
    """Return a specification with the largest number of decisions in an episode, and a job as JSON can hold it."""
    job = spec.kwargs.get("job")
    kwargs = {**spec.kwargs, "job": job.model_dump(exclude_none=True)} if isinstance(job, Job) else spec.kwargs
    return replace(spec, max_episode_steps=spec.max_episode_steps or longest, kwargs=kwargs)


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
        # no thread: an agent may run many environments
        self._episodes = self.batch(self.settings, 1, 1, False)
        self.observation_space = self._episodes.observation_space
        self.action_space = self._episodes.action_space
        self.render_mode = render_mode
        self._frames = Frames(render_mode, size)
        if self.settings.decision_interval < math.inf:
            self.metadata = {**self.metadata, "render_fps": max(round(1 / self.settings.decision_interval), 1)}
        self._over = True
        self._spec: EnvSpec | None = None

    @property
    def observation_names(self) -> tuple[str, ...]:
        """Names of the entries of the observation, in order; docs/environments.md has unit and meaning."""
        return tuple(entry.name for entry in self._episodes.entries)

    @property
    def action_names(self) -> tuple[str, ...]:
        """Names of the entries of the action, in order."""
        return tuple(entry.name for entry in self._episodes.actions)

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
        # until all of the state is restored
        self._over = True
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

    def film(self, file: str | os.PathLike[str], **options: Any) -> int:
        """Write a film of the episode so far, MP4 or GIF, and return its number of frames; no render mode is needed.

        Unlike `gymnasium.wrappers.RecordVideo` it needs no moviepy, and shows every instant, not one per decision.

        Args:
            file: to be written.
            options: keywords of `gantrysim.render.save_video`, such as fps, speed, size and colour.

        Raises:
            GantryError: no step has been taken yet.
            InputError: the file cannot be written, or the encoder is not installed (`pip install "gantrysim[film]"`).
            NoOpenGLError: OpenGL cannot draw without a display.
        """
        return self._episodes.film(0, file, **options)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        super().reset(seed=seed)
        chosen = chosen_in(options or {})
        # until the next episode has begun
        self._over = True
        drawn = self._episodes.begin({0: self.np_random}, chosen and {0: chosen})[0]
        self._over = False
        return self._episodes.observations()[0], dict(drawn)

    def step(self, action: Observation) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        if self._over:
            raise ResetNeeded("no episode is running: call reset")
        outcome = self._episodes.advance(np.asarray(action)[None], np.ones(1, bool))
        terminated = bool(outcome.terminated[0])
        truncated = bool(outcome.truncated[0])
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
    """Return the values of an episode that the options of a reset fix, None where they fix none.

    Raises:
        InputError: an unknown option, or one that is no dict.
    """
    for name, value in options.items():
        if name not in OPTIONS:
            raise unknown("option", name, OPTIONS)
        if not isinstance(value, dict):
            raise InputError(f"option {name} = {value!r}: must be a dict of names and values")
    return Chosen(*(options.get(name, {}) for name in OPTIONS)) if options else None
