"""Adapter of the vector environments to stable-baselines3, which must be installed (`pip install "gantrysim[rl]"`)."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.errors import InputError
from gantrysim.base.extras import extra

with extra("rl", "gantrysim.env.sb3"):
    import gymnasium
    from gymnasium.vector import AutoresetMode
    from stable_baselines3.common.monitor import Monitor
    from stable_baselines3.common.vec_env import VecEnv

    from gantrysim.env.vector import PathVectorEnv


class SB3VecEnv(VecEnv):
    """One of the vector environments as stable-baselines3 takes it, with the infos of its `Monitor`.

    At the end of an episode `infos[k]` holds "episode" with return r, length l and time since the start t [s],
    "terminal_observation" and "TimeLimit.truncated". `reset_infos[k]` holds the values drawn for the episode.

    Args:
        id: of the environment, such as "gantrysim/SpiralTuning-v0".
        num_envs: number of environments.
        settings: of the vector environment.

    Raises:
        InputError: an environment of another package, or what the vector environment refuses.
    """

    def __init__(self, id: str, num_envs: int = 1, **settings: Any) -> None:
        if not str(gymnasium.spec(id).vector_entry_point).startswith("gantrysim."):
            raise InputError(f"{id} is not an environment of gantrysim: use make_vec_env of stable-baselines3")
        vector_env = gymnasium.make_vec(id, num_envs=num_envs, autoreset_mode=AutoresetMode.SAME_STEP, **settings)
        self.envs = cast(PathVectorEnv, vector_env.unwrapped)
        self.render_mode = self.envs.render_mode
        self._start = time.monotonic()
        self._returns = np.zeros(num_envs)
        self._lengths = np.zeros(num_envs, int)
        super().__init__(num_envs, self.envs.single_observation_space, self.envs.single_action_space)
        self.metadata = self.envs.metadata

    def reset(self) -> NDArray[np.float32]:
        names = {name for options_of_env in self._options for name in options_of_env}
        options = {name: [options_of_env.get(name, {}) for options_of_env in self._options] for name in names}
        observations, infos = self.envs.reset(seed=self._seeds, options=options or None)
        self._returns[:] = 0.0
        self._lengths[:] = 0
        self.reset_infos = _each(infos, self.num_envs)
        self._reset_seeds()
        self._reset_options()
        return observations

    def step_async(self, actions: NDArray[Any]) -> None:
        self._actions = actions

    def step_wait(self) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]:
        observations, rewards, terminated, truncated, info = self.envs.step(self._actions)
        over = terminated | truncated
        self._returns += rewards
        self._lengths += 1
        final = _each(info.pop("final_info", {}), self.num_envs)
        last = info.pop("final_obs", None)
        drawn = _each({name: value for name, value in info.items() if "final" not in name}, self.num_envs)
        infos = drawn
        for k in np.flatnonzero(over).tolist():
            self.reset_infos[k] = drawn[k]
            infos[k] = final[k]
            infos[k]["episode"] = {
                "r": round(float(self._returns[k]), 6),
                "l": int(self._lengths[k]),
                "t": round(time.monotonic() - self._start, 6),
            }
            infos[k]["terminal_observation"] = last[k]
        for k in range(self.num_envs):
            # stable-baselines3 bootstraps the value of a truncated episode, not of a terminated one
            infos[k]["TimeLimit.truncated"] = bool(truncated[k] and not terminated[k])
        self._returns[over] = 0.0
        self._lengths[over] = 0
        return observations, rewards.astype(np.float32), over, infos

    def close(self) -> None:
        self.envs.close()

    def get_images(self) -> Sequence[NDArray[np.uint8] | None]:
        return self.envs.render() or [None] * self.num_envs

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        return [getattr(self.envs, attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Raise InputError: the environments share their attributes."""
        raise InputError(f"{attr_name} cannot be set: make another environment with the settings wanted")

    def env_method(self, method_name: str, *method_args: Any, indices: Any = None, **method_kwargs: Any) -> list[Any]:
        """Call `save`, `restore` or `run` of environments, of which the place is the first argument."""
        method = getattr(self.envs, method_name)
        return [method(place, *method_args, **method_kwargs) for place in self._get_indices(indices)]

    def env_is_wrapped(
        self, wrapper_class: type[gymnasium.Wrapper[Any, Any, Any, Any]], indices: Any = None
    ) -> list[bool]:
        """Return that the environments count as wrapped by `Monitor`, whose infos they give, and by nothing else."""
        return [wrapper_class is Monitor for _ in self._get_indices(indices)]


def _each(infos: dict[str, Any], count: int) -> list[dict[str, Any]]:
    """Return Gymnasium's infos of a vector environment as a dict for each environment."""
    infos_of_envs: list[dict[str, Any]] = [{} for _ in range(count)]
    for name, values in infos.items():
        if f"_{name}" in infos:
            for k in np.flatnonzero(infos[f"_{name}"]).tolist():
                infos_of_envs[k][name] = values[k].item() if isinstance(values[k], np.generic) else values[k]
    return infos_of_envs
