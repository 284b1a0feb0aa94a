"""The adapter to stable-baselines3 against its own Monitor and DummyVecEnv around scalar environments."""

import gymnasium
import numpy as np
import pytest

from gantrysim import InputError

from support.episodes import BANDIT, SHORT, TUNING, actions_of


@pytest.fixture(scope="module")
def sb3():
    """The library, which is not imported before a test needs it: PyTorch takes seconds in every process."""
    return pytest.importorskip("stable_baselines3")


@pytest.fixture(scope="module")
def adapter(sb3):
    from gantrysim.env.sb3 import SB3VecEnv

    return SB3VecEnv


@pytest.mark.soak
@pytest.mark.parametrize("name", [TUNING, pytest.param(BANDIT, marks=pytest.mark.soak)])
def test_it_equals_the_librarys_own_environments_with_their_monitor(name, adapter):
    from stable_baselines3.common.monitor import Monitor
    from stable_baselines3.common.vec_env import DummyVecEnv

    count = 3
    own = adapter(name, count, threads=1, **SHORT)
    other = DummyVecEnv([lambda: Monitor(gymnasium.make(name, **SHORT)) for _ in range(count)])
    own.seed(4), other.seed(4)
    assert np.array_equal(own.reset(), other.reset())
    assert own.reset_infos == other.reset_infos
    random, ended = np.random.default_rng(0), 0
    for _ in range(25):
        actions = actions_of(own.envs, random)
        (seen, rewards, over, infos), (expected, others, ends, expected_infos) = own.step(actions), other.step(actions)
        assert np.array_equal(seen, expected)
        assert np.array_equal(rewards, others)
        assert np.array_equal(over, ends)
        for info, wanted in zip(infos, expected_infos, strict=True):
            if "episode" in info:
                ended += 1
                assert (info["episode"]["l"], info["TimeLimit.truncated"]) == (
                    wanted["episode"]["l"],
                    wanted["TimeLimit.truncated"],
                )
                assert info["episode"]["r"] == pytest.approx(wanted["episode"]["r"], abs=1e-5)
                assert np.array_equal(info["terminal_observation"], wanted["terminal_observation"])
                assert info["episode_contour_rms"] == wanted["episode_contour_rms"]
    assert ended > 3
    assert own.reset_infos == other.reset_infos
    assert own.metadata == own.envs.metadata
    own.close()


def test_it_is_taken_for_monitored_and_learns_and_evaluates(sb3, adapter):
    from stable_baselines3.common.evaluation import evaluate_policy
    from stable_baselines3.common.monitor import Monitor

    envs = adapter(TUNING, 2, **SHORT)
    assert envs.env_is_wrapped(Monitor) == [True, True]
    agent = sb3.PPO("MlpPolicy", envs, n_steps=8, batch_size=16, device="cpu", seed=1).learn(32)
    assert agent.num_timesteps == 32
    returns, lengths = evaluate_policy(agent, envs, n_eval_episodes=3, return_episode_rewards=True)
    assert len(returns) == len(lengths) == 3
    envs.close()


def test_options_choose_episodes(adapter):
    envs = adapter(TUNING, 2, **SHORT)
    envs.seed(1)
    envs.set_options([{"spiral": {"diameter": 51}}, {}])
    envs.reset()
    assert envs.reset_infos[0]["diameter"] == 51
    assert envs.reset_infos[1]["diameter"] != 51
    state = envs.env_method("save", indices=0)[0]
    assert state.drawn["diameter"] == 51
    with pytest.raises(InputError, match="settings cannot be set"):
        envs.set_attr("settings", None)


def test_an_environment_of_another_package_is_rejected(adapter):
    with pytest.raises(InputError, match="CartPole-v1 is not an environment of gantrysim"):
        adapter("CartPole-v1")
