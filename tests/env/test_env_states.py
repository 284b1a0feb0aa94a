"""Episodes chosen at a reset, saved and restored states, copies in the middle of an episode, specifications."""

import copy
import pickle

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec

from gantrysim import GantryError, InputError, Job
from gantrysim.env import GainBanditEnv
from gantrysim.machine.tolerances import Tolerances

from support.episodes import BANDIT, MEEK, SHORT, TUNING, actions_of, stepwise, stepwise_vector
from support.soaked import suite_runs

COPIES = [copy.copy, copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))]


def integral(tick, state, torque):
    """A law that keeps a state."""
    state[: tick.axes] += tick.error * tick.period
    torque[:] = tick.gains[:, 0] * tick.error - tick.gains[:, 2] * tick.measured_velocity + state[: tick.axes]


OWN = {**SHORT, "servo": {"law": f"{__name__}:integral"}}
LAWS = {**SHORT, "servo": {"law": ["p-pi", "friction", "observer"], "integral_time": 0.03}}  # laws with a state


def steps(env, random, count=6):
    """Everything that some steps of random actions return."""
    return [env.step((MEEK * random.uniform(-1, 1, env.action_space.shape)).astype(np.float32)) for _ in range(count)]


def assert_same(one, other):
    assert len(one) == len(other)
    for (seen, *rest), (expected, *others) in zip(one, other, strict=True):
        assert seen.tobytes() == expected.tobytes()
        assert str(rest) == str(others)  # infos of a vector environment hold arrays


@pytest.mark.parametrize(
    "settings", suite_runs([SHORT, {"job": "softmc-arc", "spread": None}, {"machine": "xyz", **SHORT}, LAWS, OWN], 0, 1)
)
def test_a_branch_from_a_saved_state_equals_the_first_branch(settings):
    env = stepwise(**settings)
    env.reset(seed=3)
    steps(env, np.random.default_rng(0))
    state = pickle.loads(pickle.dumps(env.save()))
    first = steps(env, np.random.default_rng(1))
    after = env.reset()
    seen = env.restore(state)
    steps(env, np.random.default_rng(2))  # another branch, which writes over the log of the first
    elsewhere = stepwise(**settings)
    assert np.array_equal(elsewhere.restore(state), seen)
    env.restore(state)
    for branched in (env, elsewhere):
        assert_same(steps(branched, np.random.default_rng(1)), first)
    assert np.array_equal(env.run.nozzle, elsewhere.run.nozzle)
    again = env.reset()  # the random numbers are those of the saved state too
    assert np.array_equal(again[0], after[0])
    assert again[1] == after[1]


@pytest.mark.parametrize("again", suite_runs(COPIES, 0))
def test_a_copy_in_the_middle_of_an_episode_goes_on_from_there(again):
    one, several = gymnasium.make(TUNING, **SHORT), gymnasium.make_vec(TUNING, num_envs=3, threads=1, **SHORT)
    for env, count in ((one, 3), (several, 25)):
        env.reset(seed=3)
        steps(env, np.random.default_rng(0))
        other = again(env.unwrapped)
        assert_same(steps(other, np.random.default_rng(1), count), steps(env, np.random.default_rng(1), count))
        assert other.spec == env.unwrapped.spec


def test_one_state_branches_into_every_place_of_a_vector_environment():
    env, envs = stepwise(**SHORT), stepwise_vector(3, **SHORT)
    env.reset(seed=3)
    steps(env, np.random.default_rng(0))
    state = env.save()
    seen = envs.restore(dict.fromkeys(range(3), state))
    assert (seen == seen[0]).all()
    actions = actions_of(envs, np.random.default_rng(4))
    together = envs.step(actions)
    for place, action in enumerate(actions):
        env.restore(state)
        alone = env.step(action)
        assert np.array_equal(together[0][place], alone[0])
        assert together[1][place] == alone[1]
    assert np.array_equal(env.restore(envs.save(1)), together[0][1])


def test_a_state_of_other_settings_or_of_no_episode_is_rejected():
    env = stepwise(**SHORT)
    with pytest.raises(GantryError, match="no episode is running that could be saved"):
        env.save()
    with pytest.raises(GantryError, match="no episode is running in environment 0"):
        stepwise_vector(2).save(0)
    env.reset(seed=1)
    with pytest.raises(InputError, match="environment with other settings"):
        stepwise().restore(env.save())


def test_what_was_drawn_can_be_chosen_at_a_reset():
    env, other = stepwise(**SHORT), stepwise(**SHORT)
    _, drawn = env.reset(seed=5)
    spiral = {name: drawn[name] for name in ("diameter", "thickness", "speed", "turns")}
    machine = {name: drawn[name] for name in drawn if name not in spiral}
    assert set(machine) == set(Tolerances().columns(env._episodes.source.machine))
    _, chosen = other.reset(seed=6, options={"spiral": spiral, "machine": machine})
    assert chosen == drawn
    assert_same(steps(other, np.random.default_rng(1)), steps(env, np.random.default_rng(1)))


def test_a_value_chosen_leaves_the_others_drawn():
    env, envs = stepwise(**SHORT), stepwise_vector(2, **SHORT)
    _, drawn = env.reset(seed=5)
    _, info = env.reset(seed=5, options={"machine": {"friction_x": 2.0}, "spiral": {"speed": 42}})
    assert info == {**drawn, "friction_x": 2.0, "speed": 42.0}
    assert env._episodes.episodes[0].simulation.machine.perturbations[0].friction[0] == 2.0
    options = {"spiral": [{}, {"diameter": 55}]}
    _, infos = envs.reset(seed=[5, 5], options=options)
    assert infos["diameter"].tolist() == [drawn["diameter"], 55.0]


def test_a_reset_with_another_seed_takes_nothing_that_was_drawn_ahead():
    env, envs = stepwise(**SHORT), stepwise_vector(2, **SHORT)
    for seed in (1, 2, 1):
        drawn = envs.reset(seed=seed)[1]["diameter"]
        assert drawn[0] == env.reset(seed=seed)[1]["diameter"]
    assert envs.reset()[1]["diameter"][0] == env.reset()[1]["diameter"]


def test_a_nominal_machine_can_be_given_values_in_one_environment_alone():
    envs = stepwise_vector(2, **SHORT, spread=None)
    _, infos = envs.reset(seed=1, options={"machine": [{}, {"payload_kg": 0.2}]})
    assert infos["payload_kg"].tolist() == [0.0, 0.2]
    assert infos["_payload_kg"].tolist() == [False, True]


@pytest.mark.parametrize(
    ("options", "text"),
    suite_runs(
        [
            ({"spiral": {"pitch": 3}}, "unknown value of the spiral 'pitch'"),
            ({"spiral": {"turns": 1.5}}, "turns = 1.5"),
            (
                {"spiral": {"diameter": 10.0, "thickness": 6.0}},
                "diameter = 10 mm: must be at least 4 times the thickness",
            ),
            ({"spiral": 3}, "option spiral = 3: must be a dict"),
            ({"machine": {"friction": 2.0}}, "unknown value of the machine 'friction'"),
            ({"machine": {"friction_x": -1.0}}, "factor of friction = -1"),
            ({"machine": {"payload_kg": float("nan")}}, "payload_kg = nan"),
        ],
        0,
        3,
    ),
)
def test_a_choice_out_of_bounds_is_rejected(options, text):
    for env in (stepwise(**SHORT), stepwise_vector(2, **SHORT)):
        env.reset(seed=1)
        with pytest.raises(InputError, match=text):
            env.reset(options=options)


def test_a_job_has_no_spiral_to_choose():
    with pytest.raises(InputError, match="option spiral: the path comes from the job"):
        GainBanditEnv(job="softmc-arc").reset(seed=1, options={"spiral": {"diameter": 50}})
    with pytest.raises(InputError, match="option spiral of 1 dicts: must be one, or 2"):
        stepwise_vector(2).reset(options={"spiral": [{}]})


@pytest.mark.parametrize("name", [TUNING, BANDIT])
@pytest.mark.parametrize(
    "settings", [{}, {**SHORT, "spread": Tolerances(payload=0.5)}, {"job": Job.load("softmc-arc")}]
)
def test_a_specification_goes_through_json(name, settings):
    env = gymnasium.make(name, **settings)
    again = gymnasium.make(EnvSpec.from_json(env.spec.to_json()))
    assert again.unwrapped.settings == env.unwrapped.settings
    assert np.array_equal(again.reset(seed=2)[0], env.reset(seed=2)[0])


@pytest.mark.parametrize("settings", [SHORT, {"job": "softmc-arc", "spread": None}])
def test_the_longest_episode_takes_as_many_decisions_as_the_specification_says(settings):
    env = gymnasium.make(TUNING, **settings)
    options = {"spiral": {"diameter": 60.0, "turns": 2, "thickness": 6.0, "speed": 80.0}}
    env.reset(seed=1, options=None if "job" in settings else options)
    count, over = 0, False
    while not over:
        *_, terminated, truncated, _ = env.step(np.zeros(4, np.float32))
        count, over = count + 1, terminated or truncated
    assert truncated
    assert count == env.spec.max_episode_steps
    assert gymnasium.make_vec(TUNING, **settings).spec.max_episode_steps == count
    assert gymnasium.make(BANDIT, **settings).spec.max_episode_steps == 1
