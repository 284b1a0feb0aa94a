"""The vector environments: all episodes advance in one native call."""

from __future__ import annotations

import copy
import os
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
from gymnasium.envs.registration import EnvSpec
from gymnasium.error import ResetNeeded
from gymnasium.utils import EzPickle, seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from gantrysim.base.errors import GantryError, InputError, unknown, whole_number
from gantrysim.env.decision import EpisodeState
from gantrysim.env.episodes import Chosen
from gantrysim.env.frames import Frames
from gantrysim.env.scalar import OPTIONS, PathEnv, chosen_in, with_bound
from gantrysim.record.run import Run

Observations = NDArray[np.float32]
Numbers = NDArray[np.float64]
Flags = NDArray[np.bool_]


class PathVectorEnv(VectorEnv[Observations, Observations, Any], EzPickle):
    """Several of a task's environments in one, equal to them step by step for any number of threads.

    The next episodes are drawn on a thread while these run.

    Args:
        num_envs: number of environments.
        threads: number of threads that step them; by default one for each core, two where a core has few places.
        autoreset_mode: one of Gymnasium's modes: when the next episode follows one that has ended.
        render_mode: None or "rgb_array".
        size: width and height of the pictures [pixels].
        settings: the fields of the task's settings.

    Raises:
        InputError: a value out of bounds.
    """

    single: ClassVar[type[PathEnv]]
    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "autoreset_mode": AutoresetMode.NEXT_STEP}  # noqa: RUF012

    def __init__(
        self,
        num_envs: int = 1,
        *,
        threads: int | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        render_mode: str | None = None,
        size: tuple[int, int] = (640, 480),
        **settings: Any,
    ) -> None:
        self.num_envs = whole_number("num_envs", num_envs, 1)
        modes = {mode.value: mode for mode in AutoresetMode}
        if not isinstance(autoreset_mode, AutoresetMode) and autoreset_mode not in modes:
            raise unknown("autoreset_mode", str(autoreset_mode), modes)
        self.autoreset_mode = AutoresetMode(autoreset_mode)
        self.metadata = {**self.metadata, "autoreset_mode": self.autoreset_mode}
        arguments = {"threads": threads, "autoreset_mode": autoreset_mode, "render_mode": render_mode, "size": size}
        EzPickle.__init__(self, num_envs, **arguments, **settings)
        self.settings = self.single.settings_type.of(settings)
        self._episodes = self.single.batch(self.settings, self.num_envs, threads, True)
        self.single_observation_space = self._episodes.observation_space
        self.single_action_space = self._episodes.action_space
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self.render_mode = render_mode
        self._frames = Frames(render_mode, size)
        self._randoms: dict[int, np.random.Generator] = {}
        self._over = np.zeros(self.num_envs, bool)
        self._spec: EnvSpec | None = None

    @property
    def observation_names(self) -> tuple[str, ...]:
        """Names of the entries of the observation, in order; docs/environments.md has unit and meaning."""
        return tuple(entry.name for entry in self._episodes.entries)

    @property
    def action_names(self) -> tuple[str, ...]:
        """Names of the entries of the action, in order."""
        return tuple(entry.name for entry in self._episodes.actions)

    def run(self, place: int) -> Run:
        """Return the record of one environment's episode so far, after at least one step."""
        return self._episodes.record(place)

    def film(self, place: int, file: str | os.PathLike[str], **options: Any) -> int:
        """Write a film of one environment's episode so far, as `PathEnv.film`."""
        return self._episodes.film(place, file, **options)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observations, dict[str, Any]]:
        """Begin new episodes and return their observations and the values drawn for their paths.

        Args:
            seed: one seed, to which the index of the environment is added, or one per environment; by default the
                random numbers continue, or start from a random seed.
            options: "reset_mask", a boolean array of the environments to reset, by default all; "spiral" and
                "machine", each a dict of values that replace those drawn, or a list with a dict for each environment.

        Raises:
            InputError: seeds or a mask for another number of environments.
        """
        mask = self._mask(options)
        chosen = self._chosen_by_place(options or {})
        seeds = self._seeds(seed)
        for place in np.flatnonzero(mask).tolist():
            if seeds[place] is not None or place not in self._randoms:
                self._randoms[place] = seeding.np_random(seeds[place])[0]
        info = self._begin(mask, chosen)
        return self._episodes.observations(), info

    def step(self, actions: Observations) -> tuple[Observations, Numbers, Flags, Flags, dict[str, Any]]:
        """Apply an action in every environment and return the outcome.

        Raises:
            ResetNeeded: before the first reset, or when an episode is over that the mode does not reset.
            InputError: actions that are not finite, or of another shape.
        """
        resting = self._over.copy()
        stuck = self.autoreset_mode is not AutoresetMode.NEXT_STEP and resting.any()
        if len(self._randoms) < self.num_envs or stuck:
            raise ResetNeeded("not all environments run an episode: call reset")
        # with NEXT_STEP, an ended episode waits for this step
        outcome = self._episodes.advance(actions, ~resting)
        over = outcome.terminated | outcome.truncated
        # until the next episodes have begun
        self._over = over | resting
        if self.autoreset_mode is AutoresetMode.SAME_STEP and over.any():
            # the last observations and infos move aside for those of the next episodes
            final = self._episodes.observations()
            info = _masked_infos(outcome.info, ~over)
            info |= {"final_obs": np.full(self.num_envs, None, object), "_final_obs": over}
            for place in np.flatnonzero(over):
                info["final_obs"][place] = final[place]
            info |= {"final_info": _masked_infos({**outcome.info, **outcome.final}, over), "_final_info": over.copy()}
            info |= self._begin(over)
        else:
            info = _masked_infos(outcome.info, ~resting) | _masked_infos(outcome.final, over)
            info |= self._begin(resting) if resting.any() else {}
        reward = np.where(resting, 0.0, outcome.reward)
        return self._episodes.observations(), reward, outcome.terminated, outcome.truncated, info

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """Return a picture of every environment, (height, width, 3) each, or None without a render mode.

        Raises:
            NoOpenGLError: OpenGL cannot draw without a display.
        """
        if self.render_mode is None:
            return None
        return tuple(self._frames.picture(self._episodes, place) for place in range(self.num_envs))

    def close_extras(self, **_kwargs: Any) -> None:
        """Free the renderer, and draw no more episodes."""
        # Gymnasium before 1.4 also closes what its constructor has refused
        if hasattr(self, "_frames"):
            self._frames.close()
            self._episodes.close()

    def _seeds(self, seed: int | Sequence[int | None] | None) -> list[int | None]:
        if seed is None:
            return [None] * self.num_envs
        if not isinstance(seed, Sequence | np.ndarray):
            return [whole_number("seed", seed, 0) + i for i in range(self.num_envs)]
        if len(seed) != self.num_envs:
            raise InputError(f"{len(seed)} seeds: must be one, or {self.num_envs}, one for each environment")
        return [None if value is None else whole_number("seed", value, 0) for value in seed]

    def _mask(self, options: dict[str, Any] | None) -> Flags:
        mask = (options or {}).get("reset_mask")
        if mask is None:
            return np.ones(self.num_envs, bool)
        mask = np.asarray(mask)
        if mask.dtype != np.bool_ or mask.shape != (self.num_envs,) or not mask.any():
            raise InputError(f"reset_mask = {mask}: must be {self.num_envs} booleans, at least one of them true")
        return mask

    def _chosen_by_place(self, options: dict[str, Any]) -> dict[int, Chosen]:
        """Return what options choose of the episodes, by place."""
        several: dict[str, list[Any]] = {}
        for name, value in options.items():
            if name == "reset_mask":
                continue
            if name not in OPTIONS:
                raise unknown("option", name, ("reset_mask", *OPTIONS))
            several[name] = list(value) if isinstance(value, list | tuple) else [value] * self.num_envs
            if len(several[name]) != self.num_envs:
                raise InputError(f"option {name} of {len(several[name])} dicts: must be one, or {self.num_envs}")
        chosen = {}
        for place in range(self.num_envs):
            of_place = chosen_in({name: values[place] for name, values in several.items()})
            if of_place is not None:
                chosen[place] = of_place
        return chosen

    def _begin(self, mask: Flags, chosen: dict[int, Chosen] | None = None) -> dict[str, Any]:
        """Begin new episodes and return the values drawn for them as infos."""
        self._over[mask] = True
        drawn = self._episodes.begin({place: self._randoms[place] for place in np.flatnonzero(mask).tolist()}, chosen)
        self._over[mask] = False
        infos: dict[str, Any] = {}
        for place, values in drawn.items():
            for name, value in values.items():
                if name not in infos:
                    infos[name] = np.zeros(self.num_envs, type(value))
                    infos[f"_{name}"] = np.zeros(self.num_envs, bool)
                infos[name][place] = value
                infos[f"_{name}"][place] = True
        return infos

    def save(self, place: int) -> EpisodeState:
        """Return the state of one environment's running episode.

        Raises:
            GantryError: no episode is running there.
        """
        if place not in self._randoms or self._over[place]:
            raise GantryError(f"no episode is running in environment {place} that could be saved: call reset")
        return self._episodes.save(place, self._randoms[place])

    def restore(self, states: Mapping[int, EpisodeState]) -> Observations:
        """Go on from saved states, by environment, and return the observations of all.

        Raises:
            InputError: a state of an environment with other settings.
        """
        for place, state in states.items():
            # until all of the state is restored
            self._over[place] = True
            random = self._randoms.setdefault(place, seeding.np_random()[0])
            self._episodes.restore(place, state, random)
            self._over[place] = False
        return self._episodes.observations()

    def __getstate__(self) -> dict[str, Any]:
        running = [place for place in self._randoms if not self._over[place]]
        content = {"randoms": self._randoms, "over": self._over, "spec": self._spec}
        return {**super().__getstate__(), **content, "states": {place: self.save(place) for place in running}}

    def __setstate__(self, content: dict[str, Any]) -> None:
        super().__setstate__(content)
        # a shallow copy shares the content: without copies of its own, the two would draw from one stream
        self._randoms = copy.deepcopy(content["randoms"])
        self._over = content["over"].copy()
        self._spec = content["spec"]
        self.restore(content["states"])

    @property
    def spec(self) -> EnvSpec | None:
        """Of Gymnasium's registry, with the largest number of decisions in an episode of these very settings."""
        return self._spec

    @spec.setter
    def spec(self, value: EnvSpec | None) -> None:
        self._spec = None if value is None else with_bound(value, self._episodes.longest)


def _masked_infos(values: dict[str, NDArray[Any]], mask: Flags) -> dict[str, Any]:
    """Return infos in Gymnasium's format: every array with a mask of the environments for which it holds values."""
    if not mask.any():
        return {}
    without = np.flatnonzero(~mask)
    infos: dict[str, Any] = {}
    for name, array in values.items():
        infos[name] = array.copy()
        infos[name][without] = None if array.dtype == object else 0
        infos[f"_{name}"] = mask.copy()
    return infos
