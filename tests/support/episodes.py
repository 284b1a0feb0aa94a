"""Short episodes of the environments, and actions for them, that several test files ask for."""

import numpy as np

TUNING, BANDIT = "gantrysim/SpiralTuning-v0", "gantrysim/GainBandit-v0"

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


def actions_of(envs, random):
    """Random actions, the first half of the environments bold."""
    scale = np.where(np.arange(envs.num_envs) < envs.num_envs / 2, BOLD, MEEK)[:, None]
    return (scale * random.uniform(-1, 1, envs.action_space.shape)).astype(np.float32)
