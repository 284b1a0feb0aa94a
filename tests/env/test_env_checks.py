"""The environments pass the checkers of Gymnasium and stable-baselines3.

Every warning is an error in these tests, also those of Gymnasium's logger.
"""

import gymnasium
import numpy as np
import pytest
from gymnasium import logger
from gymnasium.utils.env_checker import check_env

import gantrysim.env

from support.episodes import BANDIT, BEAD, BOLD, MEEK, SHORT, SPEED, TORQUE, TUNING, episode
from support.soaked import suite_runs

IDS = [TUNING, BANDIT]

pytestmark = pytest.mark.first


@pytest.fixture(autouse=True)
def logger_speaks():
    assert logger.min_level <= logger.WARN


@pytest.mark.parametrize(
    ("name", "settings"),
    suite_runs(
        [
            (TUNING, {}),
            (TUNING, {"job": "an225", "spread": None}),
            (BANDIT, SHORT),
            (BANDIT, {"job": "fanuc-spiral"}),  # random gains end in a fault before any glue
            (BEAD, SHORT),
            (BEAD, {"job": "softmc-arc"}),
            (SPEED, SHORT),
            (SPEED, {"job": "an225", "slowest": 0.2}),
            (TORQUE, SHORT),
            (TORQUE, {"job": "softmc-arc"}),
            (BANDIT, {"per_axis": True, "machine": "xyz", **SHORT}),
        ],
        0,
        4,
        8,
    ),
)
def test_the_checkers_pass(name, settings):
    from stable_baselines3.common.env_checker import check_env as check_env_of_baselines

    env = gymnasium.make(name, **settings)
    check_env(env.unwrapped, skip_render_check=True)
    check_env_of_baselines(env.unwrapped)
    env.close()


@pytest.mark.parametrize("name", suite_runs([*IDS, BEAD, SPEED, TORQUE], 2))
def test_gymnasiums_checker_passes_with_pictures(name):
    env = gymnasium.make(name, render_mode="rgb_array", size=(64, 48), **SHORT)
    check_env(env.unwrapped)
    env.close()


@pytest.mark.parametrize("name", suite_runs(IDS, 1))
def test_stable_baselines_checker_passes(name):
    from stable_baselines3.common.env_checker import check_env as check_env_of_baselines

    env = gymnasium.make(name, render_mode="rgb_array", size=(64, 48), **SHORT)
    check_env_of_baselines(env.unwrapped, skip_render_check=False)
    check_env_of_baselines(env)
    env.close()


def test_a_checkers_warning_fails_the_test():
    class Boundless(gantrysim.env.GainBanditEnv):
        def __init__(self):
            super().__init__(**SHORT)
            self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, self.observation_space.shape, np.float32)

    with pytest.raises(UserWarning, match="observation space minimum value is -infinity"):
        check_env(Boundless(), skip_render_check=True)


@pytest.mark.parametrize("name", IDS)
def test_the_passive_checker_passes_for_whole_episodes(name):
    env = gymnasium.make(name, **SHORT)
    assert "PassiveEnvChecker" in str(env)
    for seed, scale in enumerate((BOLD, MEEK)):
        episode(env, seed, np.random.default_rng(seed), scale)
    env.close()
