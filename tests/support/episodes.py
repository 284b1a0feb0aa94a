"""Short episodes of the environments, and actions for them, that several test files ask for."""

from functools import partial

import gymnasium
import numpy as np

from gantrysim.env import GainBanditEnv, GainBanditVectorEnv

INTERVAL = {"decision_interval": 0.1}
# the bandit with gains set every 0.1 s instead of once, registered here for the tests of what all tasks share
TUNING, BANDIT = "gantrysim/GainSteps-v0", "gantrysim/GainBandit-v0"
gymnasium.register(
    TUNING,
    entry_point="gantrysim.env:GainBanditEnv",
    vector_entry_point="gantrysim.env:GainBanditVectorEnv",
    kwargs=INTERVAL,
)
stepwise = partial(GainBanditEnv, **INTERVAL)
stepwise_vector = partial(GainBanditVectorEnv, **INTERVAL)

BEAD, SPEED = "gantrysim/BeadWidth-v1", "gantrysim/SpeedOverride-v1"
TORQUE = "gantrysim/ServoTorque-v1"

SHORT = {"diameter": (40.0, 60.0), "turns": (1, 2), "thickness": (6.0, 8.0), "speed": (80.0, 150.0)}
MOST = 1000  # decisions of an episode
BOLD, MEEK = 1.0, 0.2  # of the action space: the one ends in faults, the other at the end of the path


def episode(env, seed, actions, scale=BOLD):
    """Everything that one seeded episode returns."""
    returns = [env.reset(seed=seed)]
    over = False
    while not over:
        returns.append(env.step((scale * actions.uniform(-1, 1, env.action_space.shape)).astype(np.float32)))
        over = returns[-1][2] or returns[-1][3]
        assert len(returns) < MOST
    return returns


def returned(env, seed, policy, options=None):
    """Return of an episode of a policy, without what progress pays, and its last info."""
    observation, _ = env.reset(seed=seed, options=options)
    total, over = 0.0, False
    while not over:
        observation, reward, terminated, truncated, info = env.step(policy(observation))
        assert env.observation_space.contains(observation)
        total, over = total + reward - info.get("reward_progress", 0.0), terminated or truncated
    return total, info


def seen(env, observation):
    """The entries of an observation by name."""
    return dict(zip(env.observation_names, observation.tolist(), strict=True))


def actions_of(envs, random):
    """Random actions, the first half of the environments bold."""
    scale = np.where(np.arange(envs.num_envs) < envs.num_envs / 2, BOLD, MEEK)[:, None]
    return (scale * random.uniform(-1, 1, envs.action_space.shape)).astype(np.float32)


def same(one, other):
    """Whether two results are the same to the last bit, with all entries of infos."""
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(same(one[name], other[name]) for name in one)
    if isinstance(one, tuple | list):
        return len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, np.ndarray):
        alike = isinstance(other, np.ndarray) and one.dtype == other.dtype and one.shape == other.shape
        if alike and one.dtype == object:
            return all(map(same, one.ravel(), other.ravel()))
        return alike and one.tobytes() == other.tobytes()
    return type(one) is type(other) and one == other
