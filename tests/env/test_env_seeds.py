"""Seeds: scalar and vector environments return the same values to the last bit."""

import threading
import weakref
from types import SimpleNamespace

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from gantrysim.env.vector import PathVectorEnv

from support.episodes import BANDIT, MEEK, SHORT, TUNING, actions_of, episode, same
from support.soaked import suite_runs

NEXT, SAME = AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP


@pytest.mark.parametrize("name", [TUNING, BANDIT])
def test_the_seed_determines_the_episode(name):
    env, again = gymnasium.make(name, **SHORT), gymnasium.make(name, **SHORT)
    for seed in (0, 12345):
        first = episode(env, seed, np.random.default_rng(seed), MEEK)
        assert same(first, episode(again, seed, np.random.default_rng(seed), MEEK))
        assert same(first, episode(env, seed, np.random.default_rng(seed), MEEK))  # whatever was before
    zero, one = (episode(env, seed, np.random.default_rng(0), MEEK) for seed in (0, 1))
    assert zero[0][1] != one[0][1]  # what was drawn
    assert not same(zero[1][:2], one[1][:2])


def test_the_seed_determines_the_series_of_episodes():
    first, second = (gymnasium.make(TUNING, **SHORT) for _ in range(2))
    drawn = []
    for env in (first, second):
        env.reset(seed=3)
        drawn.append([env.reset()[1] for _ in range(5)])
    assert same(*drawn)
    assert len({own["diameter"] for own in drawn[0]}) == 5


@pytest.mark.parametrize("name", [TUNING, BANDIT])
def test_without_a_seed_episodes_differ(name):
    drawn = [gymnasium.make(name, **SHORT).reset()[1]["diameter"] for _ in range(2)]
    assert drawn[0] != drawn[1]


def both(mode, count, threads, name=TUNING, **settings):
    """Gymnasium's vector environment of scalar ones as the oracle, and the native one."""
    settings = {**SHORT, **settings}
    scalar = SyncVectorEnv([lambda: gymnasium.make(name, **settings) for _ in range(count)], autoreset_mode=mode)
    native = gymnasium.make_vec(name, num_envs=count, threads=threads, autoreset_mode=mode, **settings)
    return scalar, native


@pytest.mark.parametrize(("mode", "threads"), suite_runs([(NEXT, 1), (NEXT, 3), (SAME, None)], 1, 2))
def test_the_native_vector_environment_equals_gymnasiums(mode, threads):
    scalar, native = both(mode, 5, threads)
    random = np.random.default_rng(7)
    assert same(scalar.reset(seed=11), native.reset(seed=11))
    ends = np.zeros(2, int)
    for step in range(40):
        actions = actions_of(native, random)
        expected, got = scalar.step(actions), native.step(actions)
        assert same(expected, got), step
        ends += [got[2].sum(), got[3].sum()]
    assert (ends > 3).all()  # faults, and ends of paths


@pytest.mark.parametrize("threads", suite_runs([1, 2], 1))
def test_without_autoreset_it_equals_gymnasiums(threads):
    scalar, native = both(AutoresetMode.DISABLED, 4, threads)
    random = np.random.default_rng(5)
    assert same(scalar.reset(seed=[4, 3, 2, 1]), native.reset(seed=[4, 3, 2, 1]))
    resets = 0
    for _ in range(30):
        actions = actions_of(native, random)
        expected, got = scalar.step(actions), native.step(actions)
        assert same(expected, got)
        over = got[2] | got[3]
        if over.any():
            resets += over.sum()
            options = {"reset_mask": over}
            assert same(scalar.reset(options=dict(options)), native.reset(options=dict(options)))
    assert resets > 3


@pytest.mark.soak
@pytest.mark.parametrize("mode", [NEXT, SAME])
def test_the_bandits_with_gains_per_axis_equal_gymnasiums(mode):
    scalar, native = both(mode, 3, 2, BANDIT, per_axis=True, detune=3.0)
    random = np.random.default_rng(5)
    assert same(scalar.reset(seed=0), native.reset(seed=0))
    for _ in range(6):
        actions = actions_of(native, random)
        assert same(scalar.step(actions), native.step(actions))


def test_an_episode_does_not_depend_on_its_neighbours():
    alone, among = (gymnasium.make_vec(TUNING, num_envs=count, **SHORT) for count in (1, 4))
    first, fourth = alone.reset(seed=[9]), among.reset(seed=[1, 2, 3, 9])
    assert np.array_equal(first[0][0], fourth[0][3])
    random = np.random.default_rng(1)
    for _ in range(20):
        actions = actions_of(among, random)
        own, others = alone.step(actions[3:]), among.step(actions)
        assert all(np.array_equal(one[0], other[3]) for one, other in zip(own[:4], others[:4], strict=True))


@pytest.mark.soak
def test_many_places_on_any_number_of_threads_equal_one_another():
    together, alone = (gymnasium.make_vec(TUNING, num_envs=18, threads=threads, **SHORT) for threads in (3, 1))
    assert same(together.reset(seed=5), alone.reset(seed=5))
    random = np.random.default_rng(0)
    for _ in range(12):
        actions = actions_of(alone, random)
        assert same(together.step(actions), alone.step(actions))
    together.close()
    assert same(together.step(actions), alone.step(actions))  # after its threads have ended


def test_the_next_episodes_are_drawn_while_others_run():
    envs = gymnasium.make_vec(TUNING, num_envs=2, threads=1, **SHORT)
    batch, drawn = envs.unwrapped._episodes, []
    draw = batch.source.draw
    batch.source.draw = lambda *given: drawn.append(threading.current_thread().name) or draw(*given)
    envs.reset(seed=1)
    batch._ahead._thread.submit(int).result()  # after all that is asked of the thread
    assert len(drawn) == 2
    envs.step(np.zeros(envs.action_space.shape, np.float32))
    batch._ahead._thread.submit(int).result()
    assert len(drawn) == 4
    envs.reset()
    assert len(drawn) == 4
    assert threading.current_thread().name not in drawn


def test_episodes_that_are_over_are_freed_on_the_thread_that_draws():
    envs = gymnasium.make_vec(TUNING, num_envs=2, threads=1, **SHORT)
    batch, freed = envs.unwrapped._episodes, []
    for k in range(4):
        envs.reset(seed=k)
        for running in batch.episodes:
            weakref.finalize(running, lambda: freed.append(threading.current_thread().name))
        del running
        envs.step(np.zeros(envs.action_space.shape, np.float32))
        batch._ahead._thread.submit(int).result()  # after all that is asked of the thread
        assert len(freed) == 2 * k
    assert threading.current_thread().name not in freed


def vector(count):
    """As much of a vector environment as its seeds and its end need."""
    env = object.__new__(PathVectorEnv)
    env.num_envs = count
    return env


def test_one_seed_counts_up_and_several_are_taken_as_they_are():
    env = vector(3)
    assert env._seeds(None) == [None, None, None]
    assert env._seeds(7) == [7, 8, 9]
    assert env._seeds([4, None, 4]) == [4, None, 4]
    assert env._seeds(np.array([4, 5, 6])) == [4, 5, 6]
    for seeds, text in (([1, 2], "2 seeds: must be one, or 3"), (-1, "seed = -1: must be"), ([0, -1, 0], "seed = -1")):
        with pytest.raises(ValueError, match=text):
            env._seeds(seeds)


def test_an_environment_is_closed_with_its_renderer_and_its_episodes():
    env = vector(1)
    # its constructor has refused its arguments: nothing to free
    env.close_extras()
    closed = []
    env._frames = SimpleNamespace(close=lambda: closed.append("frames"))
    env._episodes = SimpleNamespace(close=lambda: closed.append("episodes"))
    env.close_extras(terminate=True)
    assert closed == ["frames", "episodes"]
