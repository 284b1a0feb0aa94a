"""Many episodes of random actions: no exception, all values in bounds, no leaks."""

import ctypes
import gc
import os
from concurrent.futures import wait
from pathlib import Path

import gymnasium
import numpy as np
import pytest

from gantrysim.env.episodes import Episode

from support.episodes import BANDIT, BOLD, MEEK, SHORT, TUNING, episode
from support.soaked import suite_runs

GROWTH = 16.0  # of the resident memory over hundreds of episodes [MB]


class Holdings:
    """Resources of this process: memory [MB], threads, open files, and episodes of the environments."""

    def __init__(self):
        gc.collect()
        library = ctypes.CDLL(None)
        if hasattr(library, "malloc_trim"):
            library.malloc_trim(0)  # do not count free memory kept for reuse
        status = Path("/proc/self/statm").read_text().split()
        self.memory = int(status[1]) * os.sysconf("SC_PAGE_SIZE") / 2**20
        self.threads = len(list(Path("/proc/self/task").iterdir()))
        self.files = len(list(Path("/proc/self/fd").iterdir()))
        self.episodes = sum(type(thing) is Episode for thing in gc.get_objects())

    def __repr__(self):
        return f"{self.memory:.1f} MB, {self.threads} threads, {self.files} files, {self.episodes} episodes"


def soak_alone(env, count, when):
    """Run episodes of random actions, every second one meek, and check all values.

    Returns:
        Number of episodes that ended in a fault, and number that completed their path.
    """
    random, ends = np.random.default_rng(0), [0, 0]
    for k in range(count):
        for observation, *rest in episode(env, None if k else 1, random, (BOLD, MEEK)[k % 2]):
            assert env.observation_space.contains(observation)
            numbers = [value for value in rest[-1].values() if isinstance(value, float | int)]
            assert np.isfinite([*rest[:-1], *numbers]).all()
        ends[rest[-1]["fault"] is None] += 1
        when(k + 1)
    return ends


def soak_vector(envs, count, when):
    """The same in a vector environment: each place alternates between bold and meek episodes."""
    random, ends = np.random.default_rng(0), [0, 0]
    scale = np.where(np.arange(envs.num_envs) % 2, BOLD, MEEK)[:, None]
    envs.reset(seed=1)
    while sum(ends) < count:
        actions = (scale * random.uniform(-1, 1, envs.action_space.shape)).astype(np.float32)
        observations, reward, terminated, truncated, info = envs.step(actions)
        assert envs.observation_space.contains(observations)
        assert np.isfinite(reward).all()
        for name, values in info.items():
            if values.dtype.kind == "f":
                assert np.isfinite(values).all(), name
        for place in np.flatnonzero(terminated | truncated):
            ends[info["fault"][place] is None] += 1
            scale[place] = BOLD + MEEK - scale[place]
            when(sum(ends))
    return ends


def soak(env, count, early):
    """Resources after `early` and after `count` episodes, and how these ended."""
    held = {}

    def look(done):
        if done in (early, count):
            if isinstance(env, gymnasium.vector.VectorEnv):
                ahead = env.unwrapped._episodes._ahead
                ahead.start()  # else it begins at the next step
                wait([drawn for _, drawn in ahead._next.values()])
            held[done] = Holdings()

    ends = (soak_vector if isinstance(env, gymnasium.vector.VectorEnv) else soak_alone)(env, count, look)
    env.close()
    return held[early], held[count], ends


linux = pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="memory and threads are read from /proc")


def environment(kind, **settings):
    if kind == "vector":
        return gymnasium.make_vec(TUNING, num_envs=16, threads=2, **settings)
    return gymnasium.make(TUNING if kind == "scalar" else BANDIT, **settings)


@linux
@pytest.mark.parametrize("kind", suite_runs(["scalar", "vector", "bandit"], 1))
def test_random_actions_give_finite_values_and_leak_nothing(kind):
    early, late, ends = soak(environment(kind, **SHORT), 24, 12)
    assert (late.threads, late.files, late.episodes) == (early.threads, early.files, early.episodes)
    assert min(ends) > 3


@linux
@pytest.mark.soak
@pytest.mark.parametrize(
    ("kind", "begin", "count"),
    # the heap of 32 episodes drawn by a thread of its own grows to its size in some hundred episodes
    [("scalar", 100, 1000), ("vector", 1000, 3000), ("bandit", 100, 1000)],
)
def test_a_thousand_episodes_give_finite_values_and_leak_nothing(kind, begin, count, capsys):
    early, late, ends = soak(environment(kind), count, begin)
    with capsys.disabled():
        print(f"\n{kind}: {begin} episodes: {early}; {count}: {late}; {ends[0]} faults, {ends[1]} whole paths")
    assert (late.threads, late.files, late.episodes) == (early.threads, early.files, early.episodes)
    assert late.memory - early.memory < GROWTH
    assert sum(ends) >= count
    assert min(ends) > 100
