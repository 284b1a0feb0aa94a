"""ServoTorque-v1: the torque that acts, the friction that is fitted, and what adapting saves."""

import math
from types import SimpleNamespace

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import SyncVectorEnv
from hypothesis import given
from hypothesis import strategies as st

from gantrysim import InputError, Job, Machine
from gantrysim.env import ServoTorqueEnv, SpiralTuningEnv, friction_compensation
from gantrysim.env.friction import SUMS, fit, model_torques
from gantrysim.machine.row import Log

from support.episodes import TORQUE, returned, same, seen
from support.soaked import examples

BRIEF = {"diameter": 36.0, "turns": 1, "thickness": 9.0, "speed": 100.0}
NOMINAL = {"spread": None, "task": {"friction_change": 1.0, "friction_time": 0.6}}
PERIOD = 1e-3


def test_the_demand_is_the_servos_law_and_the_level_times_the_friction():
    servo = {"frequency": 30.0, "integral_time": 0.03, "notch_frequency": 0.0}
    env = ServoTorqueEnv(**BRIEF, servo=servo, step=0.5, highest=1.5)
    env.reset(seed=3)
    random, level, levels = np.random.default_rng(0), np.ones(2), []
    for _ in range(60):
        action = random.uniform(-1, 1, 2).astype(np.float32)
        observation = seen(env, env.step(action)[0])
        level = np.clip(level + 0.5 * action, 0.0, 1.5)
        assert [observation["level_x"], observation["level_y"]] == pytest.approx(level, rel=1e-6)
        levels += [level] * 10
    assert np.min(levels) == 0.0
    assert np.max(levels) == 1.5
    run = env.run
    own = SimpleNamespace(**env._episodes.source.servo.values())
    setpoints = env._episodes._episode(0).simulation.position
    friction = model_torques(env._episodes.source.machine.axes, setpoints, PERIOD)[0]
    added = levels * friction[: len(levels)]
    error = run.commanded - run.encoder
    changes = [np.diff(x, axis=0, prepend=x[:1]) / PERIOD for x in (error, run.commanded)]
    acceleration = np.diff(changes[1], axis=0, prepend=changes[1][:1]) / PERIOD
    law = own.kp * error + own.ki * np.cumsum(error, axis=0) * PERIOD + own.kd * changes[0]
    law += own.velocity_ff * changes[1] + own.acceleration_ff * acceleration
    assert run.demand == pytest.approx(law + added[: len(run.time)], abs=1e-9)


def test_the_model_of_friction_turns_as_bristles_do():
    machine = Machine("xy")
    speed, n = 200.0, 400  # mm/s, far beyond the Stribeck speed
    there = np.arange(n) * speed * PERIOD
    position = np.column_stack([np.concatenate([there, there[-1] - there[1:]]), np.zeros(2 * n - 1)])
    sliding, moving = model_torques(machine.axes, position, PERIOD)
    axis = machine.axes[0]
    coulomb, travel = axis.friction.coulomb, (there[-1] - position[n:, 0])
    assert sliding[n - 1, 0] == pytest.approx(coulomb, rel=1e-6)
    bent = -coulomb * (1 - 2 * np.exp(-axis.friction.stiffness * travel / coulomb))
    assert sliding[n:, 0] == pytest.approx(bent, abs=1e-6 * coulomb)
    assert moving[2 : n - 1, 0] == pytest.approx(axis.viscous * speed)
    assert moving[n, 0] == pytest.approx(-axis.viscous * speed - 2 * axis.inertia * speed / PERIOD)
    assert not sliding[:, 1].any()


@given(levels=st.tuples(*[st.floats(0.1, 4.0)] * 2), tau=st.floats(0.01, 0.5), count=st.integers(1, 200))
@examples(20)
def test_the_level_is_that_of_weighted_least_squares(levels, tau, count):
    random = np.random.default_rng(count)
    log = Log.of(count, 2)
    log.tick["setpoint"] = np.arange(count)
    sliding, moving, noise = random.normal(size=(3, count, 2))
    log.axis["demand"] = levels * sliding + moving + 0.1 * noise
    forget = math.exp(-PERIOD / tau)
    sums = np.full(2, 0.3, SUMS)
    half = count // 2
    for first, last in ((0, half), (half, count)):
        fit(log, (first, last), sliding, moving, forget, sums)
    for a in range(2):  # the prior is one more equation, level 1
        weight = np.sqrt(forget ** np.arange(count, -1, -1.0))
        matrix = weight * np.append(np.sqrt(0.3), sliding[:, a])
        wanted = weight * np.append(np.sqrt(0.3), (log.axis["demand"] - moving)[:, a])
        level = np.linalg.lstsq(matrix[:, None], wanted, rcond=None)[0][0]
        assert sums[a]["numerator"] / sums[a]["denominator"] == pytest.approx(level, rel=1e-6, abs=1e-9)


def test_the_level_fitted_is_the_friction_of_the_machine_before_and_after_it_changes():
    env = ServoTorqueEnv(**{**BRIEF, "diameter": 60.0, "thickness": 6.0, "turns": 2, "memory": 0.05})
    factors = {"friction_x": 1.4, "friction_y": 0.8, "motor_constant_x": 0.95, "motor_constant_y": 1.05}
    still = {"payload_kg": 0.0, "viscous_x": 1.0, "viscous_y": 1.0}
    task = {"friction_change": 1.5, "friction_time": 1.0}
    policy = friction_compensation(env, 1.0)
    observation, _ = env.reset(seed=1, options={"machine": {**factors, **still}, "task": task})
    levels = []
    for _ in range(200):
        observation, *_ = env.step(policy(observation))
        one = seen(env, observation)
        levels.append([one[f"level_{a}"] + env.settings.step * one[f"missing_{a}"] for a in "xy"])
    expected = np.array([1.4 / 0.95, 0.8 / 1.05])  # the servo demands what a weaker motor needs more
    assert np.median(levels[40:100], axis=0) == pytest.approx(expected, rel=0.05)
    assert np.median(levels[130:], axis=0) == pytest.approx(1.5 * expected, rel=0.05)


def test_adapting_beats_every_fixed_compensation():
    seeds = range(500, 503)
    loss = {}
    for level in (0.0, 1.0):
        env = ServoTorqueEnv(**BRIEF, level=level)
        loss[level] = -sum(returned(env, seed, lambda _: np.zeros(2, np.float32))[0] for seed in seeds)
    adaptive = -sum(returned(env, seed, friction_compensation(env, 1.0))[0] for seed in seeds)
    assert loss[1.0] < 0.6 * loss[0.0]
    assert adaptive < 0.8 * min(loss.values())


def test_values_of_an_episode_are_those_of_its_decisions():
    env = ServoTorqueEnv(**BRIEF)
    env.reset(seed=2)
    infos, rewards, over = [], [], False
    while not over:
        _, reward, _, over, info = env.step(np.zeros(2, np.float32))
        infos.append(info)
        rewards.append(reward)
    rms, largest, cost = (np.array([one[name] for one in infos]) for name in ("contour_rms", "contour_max", "cost"))
    assert rewards == pytest.approx(-np.minimum(rms / 0.005, 10) / 10)
    assert np.array_equal(cost, largest > 0.005)
    assert info["episode_cost"] == pytest.approx(cost.mean())
    assert 0 < cost.mean() < 1
    assert info["episode_contour_max"] == largest.max()


def test_a_fault_costs_twice_what_it_prevents():
    env = ServoTorqueEnv(**BRIEF, level=100.0, highest=100.0, servo={"following_error_limit": 0.1})
    _, info = returned(env, 2, lambda _: np.ones(2, np.float32))
    assert info["fault"] is not None
    sent, setpoints = int(env._episodes._sent[0]), int(env._episodes._setpoints[0])
    assert info["reward_fault"] == -2.0 * (1 + (setpoints - sent) // 10)


def test_the_vector_environment_equals_the_scalar_one_past_the_change_and_the_end():
    own = {**BRIEF, "decision_interval": 0.02}
    scalar = SyncVectorEnv([lambda: gymnasium.make(TORQUE, **own) for _ in range(3)])
    native = gymnasium.make_vec(TORQUE, num_envs=3, threads=2, **own)
    (one, info), (other, infos) = scalar.reset(seed=3), native.reset(seed=3)
    assert one.tobytes() == other.tobytes()
    assert same(info, infos)
    random, ended = np.random.default_rng(1), 0
    for _ in range(60):
        actions = random.uniform(-1, 1, (3, 2)).astype(np.float32)
        step = native.step(actions)
        assert same(step, scalar.step(actions))
        ended += step[3].sum()
    assert ended >= 3


def test_an_episode_goes_on_from_a_state_saved_late():
    env, other = ServoTorqueEnv(**BRIEF), ServoTorqueEnv(**BRIEF)
    env.reset(seed=3)
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (64, 2)).astype(np.float32)
    for action in actions[:48]:
        env.step(action)
    assert other.restore(env.save()).tobytes() == env._episodes.observations()[0].tobytes()
    for action in actions[48:]:
        one, two = env.step(action), other.step(action)
        assert one[0].tobytes() == two[0].tobytes()
        assert str(one[1:]) == str(two[1:])


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ({"decision_interval": math.inf}, "decision_interval = inf s: must be finite"),
        ({"level": 3.5}, "level = 3.5: must be at least 0 and at most highest = 3"),
        ({"step": 0.0}, "step = 0: must be greater than 0"),
        ({"memory": 0.0}, "memory = 0 s: must be greater than 0"),
        ({"decision_interval": 0.0005}, "decision_interval = 0.0005 s: must be a multiple"),
    ],
)
def test_settings_out_of_bounds_are_rejected(given, text):
    with pytest.raises(InputError, match=text):
        ServoTorqueEnv(**given)


@pytest.mark.parametrize("kind", [ServoTorqueEnv, SpiralTuningEnv])
def test_a_job_with_a_stuck_axis_is_refused(kind):
    job = Job.load("an225").changed({"faults": [{"kind": "stuck axis", "axis": "x", "time": 0.5, "friction": 5.0}]})
    with pytest.raises(InputError, match="the job has a stuck axis"):
        kind(job=job)


def test_friction_that_is_forgotten_at_rest_is_taken_for_the_nominal_one():
    env = ServoTorqueEnv(**BRIEF, level=0.7)
    env.reset(seed=1)
    env._episodes._sums[...] = 0.0
    observation = seen(env, env._episodes.observations()[0])
    assert [observation["missing_x"], observation["missing_y"]] == pytest.approx([3.0, 3.0])  # steps of 0.1
