"""SpiralTuning-v0: the gains that act, the payload that changes, the inertia fitted, and what adapting saves."""

import copy
import math
from types import SimpleNamespace

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import SyncVectorEnv
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import lfilter

from gantrysim import InputError, Machine
from gantrysim.env import SpiralTuningEnv, gain_schedule
from gantrysim.env.baselines import _stiffest
from gantrysim.env.inertia import SUMS, Decay, Motion, Nominal, fit, ratios
from gantrysim.env.sensitivity import SensitivityTable
from gantrysim.machine.perturbation import Perturbation
from gantrysim.machine.row import Log
from gantrysim.servo.servo import Servo

from support.costs import expected_cost
from support.episodes import returned, same, seen
from support.soaked import examples, suite_runs

TASK = "gantrysim/SpiralTuning-v0"
BRIEF = {"diameter": 28.0, "turns": 4, "thickness": 2.0, "speed": 300.0}
ALIKE = {f"{name}_{axis}": 1.0 for name in ("friction", "viscous", "stiffness", "motor_constant") for axis in "xy"}
PERIOD, RANGE = 1e-3, 3.0
HOLD = np.zeros(4, np.float32)


def hold(_observation):
    return HOLD


@pytest.fixture(scope="module")
def machine():
    return Machine("xy")


@pytest.fixture(scope="module")
def servo(machine):
    return Servo.derive(machine.axes, integral_time=0.03)


@pytest.fixture(scope="module")
def table(machine, servo):
    return SensitivityTable(machine, servo, RANGE)


@pytest.mark.soak
@given(kp=st.integers(-16, 16), kd=st.integers(-16, 16), eighths=st.integers(0, 32), off=st.floats(-0.06, 0.06))
@examples(20)
def test_the_cost_is_that_of_the_loops_with_the_payload_in_eighths_of_a_kilogram(
    machine, servo, table, kp, kd, eighths, off
):
    actions = [[[kp / 16], [kd / 16], [0.0], [0.0]]] * 2
    payloads = [max(eighths / 8 + off, 0.0), 0.0]
    exact = [expected_cost(machine, servo, RANGE ** (kp / 16), RANGE ** (kd / 16), load) for load in (eighths / 8, 0.0)]
    assert table.cost(actions, payloads) == pytest.approx(exact, abs=1e-3)


@pytest.mark.soak
def test_the_gains_that_keep_the_limit_with_each_payload_exceed_it_little_within_a_step_of_the_table(
    machine, servo, table
):
    payloads = np.arange(0.0, 4.01, 0.5)
    for payload, actions in zip(payloads, _stiffest(table, payloads), strict=True):
        kp, kd = RANGE**actions
        assert expected_cost(machine, servo, kp, kd, payload) <= 1e-3
        for off in (-0.06, 0.06):
            assert expected_cost(machine, servo, kp, kd, max(payload + off, 0.0)) < 0.15


@pytest.mark.soak
def test_the_heaviest_payload_asks_for_a_third_of_kp_and_more_feedforward(machine, table):
    kp = RANGE ** _stiffest(table, np.array([0.0, 4.0]))[:, 0]
    assert kp[1] / kp[0] == pytest.approx(0.3, abs=0.03)
    loaded = machine.perturbed(Perturbation(payload=4.0))
    more = [one.inertia / axis.inertia for one, axis in zip(loaded.axes, machine.axes, strict=True)]
    assert more == pytest.approx([1.37, 1.27], abs=0.005)


def test_the_demand_is_that_of_the_gains_that_the_actions_have_set():
    servo = {"frequency": 30.0, "integral_time": 0.03, "notch_frequency": 0.0}
    env = SpiralTuningEnv(**BRIEF, servo=servo, start=(0.5, 0.8, 1.0, 1.2))
    env.reset(seed=3, options={"machine": {"payload_kg": 0.2}, "task": {"payload_later": 0.5}})
    random, logs, rows = np.random.default_rng(0), np.log([0.5, 0.8, 1.0, 1.2]), []
    for _ in range(30):
        action = random.uniform(-0.5, 0.5, 4).astype(np.float32)
        env.step(action)
        logs = np.clip(logs + [0.2, 0.2, 0.2, 0.05] * action.astype(float), -math.log(RANGE), math.log(RANGE))
        rows += [np.exp(logs)] * 20
    run = env.run
    own = SimpleNamespace(**env._episodes.source.servo.values())
    kp, kd, velocity_ff, acceleration_ff = np.array(rows)[: len(run.time)].T[..., None]
    error = run.commanded - run.encoder
    changes = [np.diff(x, axis=0, prepend=x[:1]) / PERIOD for x in (error, run.commanded)]
    acceleration = np.diff(changes[1], axis=0, prepend=changes[1][:1]) / PERIOD
    law = kp * (own.kp * error + own.ki * np.cumsum(error, axis=0) * PERIOD) + kd * own.kd * changes[0]
    law += velocity_ff * own.velocity_ff * changes[1] + acceleration_ff * own.acceleration_ff * acceleration
    assert np.abs(law).max() < min(axis.peak_torque for axis in env._episodes.source.machine.axes)
    assert run.demand == pytest.approx(law, abs=1e-9)


def test_the_nominal_machine_is_remembered_at_the_start_as_met_for_a_two_hundredth_of_the_memory():
    """At an acceleration of 1 m/s², and sliding: the weight of inertia and friction in the fit."""
    env = SpiralTuningEnv(**BRIEF, memory=0.08)
    env.reset(seed=1)
    ticks = 0.005 * 0.08 / PERIOD
    axes = env._episodes.source.machine.axes
    inertia = ticks * np.array([1000 * axis.inertia for axis in axes]) ** 2
    friction = ticks * np.array([axis.friction.coulomb for axis in axes]) ** 2
    sums = env._episodes._sums[0]
    for name, expected in {
        "JJ": inertia,
        "JD": inertia,
        "FF": friction,
        "FD": friction,
        **dict.fromkeys(("JF", "J", "F", "D"), 0.0),
    }.items():
        np.testing.assert_allclose(sums[name], np.broadcast_to(expected, sums[name].shape), rtol=1e-12)
    np.testing.assert_allclose(ratios(sums)[0], 1.0, rtol=1e-12)


def test_gains_stay_within_their_range():
    env = SpiralTuningEnv(**BRIEF, gain_range=1.5, start=(1.0,) * 4, step=(0.3,) * 4)
    env.reset(seed=1)
    nominal = env._episodes.source.servo
    for action in (np.ones(4), -np.ones(4)):
        for _ in range(4):
            observation, *_ = env.step(action.astype(np.float32))
        assert [seen(env, observation)[f"gain_{name}"] for name in ("kp", "kd", "velocity_ff", "acceleration_ff")] == (
            pytest.approx(action)
        )
        acts = dict(zip(("kp", "ki", "kd"), env._episodes._gains[0, :2, :3].T, strict=True))
        for name, gains in acts.items():
            assert gains == pytest.approx(np.array(nominal.per_axis(name)) * 1.5 ** action[0])


@given(
    level=st.tuples(*[st.floats(0.5, 2.0)] * 2),
    friction=st.floats(0.1, 2.0),
    tau=st.floats(0.02, 0.3),
    count=st.integers(20, 300),
)
@examples(20)
def test_the_ratio_is_that_of_weighted_least_squares_of_filtered_torques(level, friction, tau, count):
    random = np.random.default_rng(count)
    nominal = Nominal(inertia=np.array([17.0, 24.0]), viscous=np.array([0.02, 0.03]))
    sliding, moved = random.normal(size=(2, count, 2))
    moved[count // 3 : count // 3 + 5] = 0.0  # at rest
    encoder = np.cumsum(np.cumsum(1e-3 * random.normal(size=(count, 2)), axis=0), axis=0)
    inertia = nominal.inertia * np.diff(encoder, 2, axis=0)
    log = Log.of(count, 2)
    log.tick["setpoint"], log.axis["encoder"] = np.arange(count), encoder
    about = slice(1, count - 1)
    demand = level * inertia + friction * sliding[about] + nominal.viscous * moved[about]
    demand += 0.01 * random.normal(size=demand.shape)
    log.axis["demand"][:-2] = demand
    smooth = 0.9
    forget = math.exp(-PERIOD / tau)
    sums = np.zeros(2, SUMS)
    for name, prior in (("JJ", 0.5), ("FF", 0.3), ("JD", 0.5), ("FD", 0.3)):
        sums[name] = prior
    half = count // 2
    for first, last in ((0, half), (half, count)):
        fit(log, (first, last), Motion(sliding, moved), nominal, Decay(smooth, forget), sums)
    each, common = ratios(sums)
    rows, right = [], []
    for a in range(2):
        on = moved[about][:, a] != 0
        j, f, d = (
            lfilter([1 - smooth], [1, -smooth], x[on, a])
            for x in (inertia, sliding[about], demand - nominal.viscous * moved[about])
        )
        weight = np.sqrt(forget ** np.arange(len(j) - 1, -1, -1.0))
        before = np.sqrt(forget ** len(j)) * np.sqrt([0.5, 0.3])
        matrix = np.vstack([weight[:, None] * np.column_stack([j, f]), np.diag(before)])
        wanted = np.append(weight * d, before)
        assert each[a] == pytest.approx(np.linalg.lstsq(matrix, wanted, rcond=None)[0][0], rel=1e-6)
        rows.append(matrix)
        right.append(wanted)
    lone = [np.zeros((len(rows[0]), 1)), np.zeros((len(rows[1]), 1))]
    both = np.vstack([np.hstack([rows[0], lone[0]]), np.hstack([rows[1][:, :1], lone[1], rows[1][:, 1:]])])
    wanted = np.concatenate(right)
    assert common == pytest.approx(np.linalg.lstsq(both, wanted, rcond=None)[0][0], rel=1e-6)


def test_the_inertia_seen_is_that_of_the_screw_and_the_payload_before_and_after_it_changes(machine):
    env = SpiralTuningEnv(**{**BRIEF, "diameter": 36.0, "turns": 5, "thickness": 1.5, "speed": 250.0})
    own = {**ALIKE, "motor_constant_x": 0.95, "motor_constant_y": 1.05, "payload_kg": 3.0}
    env.reset(seed=1, options={"machine": own, "task": {"payload_later": 1.0, "payload_time": 0.8}})
    rows, over = [], False
    while not over:
        observation, _, _, over, _ = env.step(HOLD)
        one = seen(env, observation)
        rows.append((one["inertia_x"], one["inertia_y"]))
    for payload, at in ((3.0, slice(15, 40)), (1.0, slice(60, -4))):
        # a mass behind a screw needs m a scale [kg mm/s² mm/rad]; a weaker motor is told a larger torque
        expected = [(1 + payload * axis.scale * 1e-6 / axis.inertia) for axis in machine.axes] / np.array([0.95, 1.05])
        assert np.median(rows[at], axis=0) == pytest.approx(expected, rel=0.02)


def test_a_payload_changes_at_its_moment_and_not_before():
    runs = []
    for later in (0.5, 3.0):
        env = SpiralTuningEnv(**BRIEF, start=(1.2, 0.8, 1.0, 1.0))
        env.reset(
            seed=4, options={"machine": {"payload_kg": 0.5}, "task": {"payload_later": later, "payload_time": 0.4}}
        )
        costs = [env.step(HOLD)[4]["cost"] for _ in range(22)]
        runs.append((env.run.encoder, np.array(costs)))
    (one, steady), (other, changed) = runs
    differs = np.flatnonzero((one != other).any(axis=1))
    assert 400 < differs[0] < 405  # ticks; counts are 1 um
    assert np.array_equal(steady[:20], changed[:20])
    assert (changed[20:] > steady[20:] + 0.5).all()


def test_values_of_an_episode_are_those_of_its_decisions():
    env = SpiralTuningEnv(**BRIEF, weight=0.7, start=(1.1, 0.6, 1.0, 1.1))
    env.reset(seed=2)
    infos, rewards, over = [], [], False
    while not over:
        _, reward, terminated, over, info = env.step(HOLD)
        assert not terminated
        infos.append(info)
        rewards.append(reward)
    rms, largest, cost = (np.array([one[name] for one in infos]) for name in ("contour_rms", "contour_max", "cost"))
    assert rewards == pytest.approx(-np.minimum(rms / 0.01, 10) / 10 - 0.7 * cost)
    assert 0 == cost.min() < cost.max() < 1
    assert info["episode_cost"] == pytest.approx(cost.mean())
    assert info["episode_contour_max"] == largest.max()


def test_a_fault_costs_the_most_that_it_prevents():
    env = SpiralTuningEnv(**BRIEF, servo={"following_error_limit": 0.02}, weight=0.5)
    _, info = returned(env, 2, hold)
    assert info["fault"] is not None
    assert info["cost"] == 1.0
    sent, setpoints = int(env._episodes._sent[0]), int(env._episodes._setpoints[0])
    assert info["reward_fault"] == -1.5 * (1 + (setpoints - sent) // 20)


@pytest.mark.soak
def test_a_schedule_beats_fixed_gains():
    env = SpiralTuningEnv(**BRIEF)
    seeds, schedule = range(500, 505), gain_schedule(env, 0.2)
    adaptive = -sum(returned(env, seed, schedule)[0] for seed in seeds)
    for start in ((1.0, 1.0, 1.0, 1.0), (0.84, 0.5, 1.0, 1.15), (0.59, 0.42, 1.0, 1.15)):
        fixed = SpiralTuningEnv(**BRIEF, start=start)
        assert adaptive < 0.8 * -sum(returned(fixed, seed, hold)[0] for seed in seeds)


@pytest.mark.soak
def test_the_vector_environment_equals_the_scalar_one_past_the_change_and_the_end():
    scalar = SyncVectorEnv([lambda: gymnasium.make(TASK, **BRIEF) for _ in range(3)])
    native = gymnasium.make_vec(TASK, num_envs=3, threads=2, **BRIEF)
    (one, info), (other, infos) = scalar.reset(seed=3), native.reset(seed=3)
    assert one.tobytes() == other.tobytes()
    assert same(info, infos)
    random, ended = np.random.default_rng(1), 0
    for _ in range(60):
        actions = (0.3 * random.uniform(-1, 1, (3, 4))).astype(np.float32)
        step = native.step(actions)
        assert same(step, scalar.step(actions))
        ended += step[3].sum() + step[2].sum()
    assert ended >= 3


def test_an_episode_goes_on_from_a_saved_state_and_in_a_copy():
    env, other = SpiralTuningEnv(**BRIEF), SpiralTuningEnv(**BRIEF)
    env.reset(seed=3, options={"task": {"payload_time": 0.4}})
    actions = np.random.default_rng(0).uniform(-0.3, 0.3, (40, 4)).astype(np.float32)
    for action in actions[:25]:
        env.step(action)
    assert other.restore(env.save()).tobytes() == env._episodes.observations()[0].tobytes()
    third = copy.deepcopy(env)
    for action in actions[25:]:
        one, two, three = env.step(action), other.step(action), third.step(action)
        assert one[0].tobytes() == two[0].tobytes() == three[0].tobytes()
        assert str(one[1:]) == str(two[1:]) == str(three[1:])


@pytest.mark.parametrize(
    "own",
    [BRIEF, {"job": "softmc-arc"}, {**BRIEF, "spread": None, "machine": "xyz"}],
    ids=["spirals", "job", "three axes"],
)
def test_the_checkers_pass(own):
    from stable_baselines3.common.env_checker import check_env as check_env_of_baselines

    env = gymnasium.make(TASK, **own)
    check_env(env.unwrapped, skip_render_check=True)
    check_env_of_baselines(env.unwrapped)
    env.close()


@pytest.mark.parametrize("seed", suite_runs(range(3), 0))
def test_bold_actions_stay_in_the_spaces_and_end(seed):
    env = gymnasium.make(TASK, max_episode_steps=10_000)
    random, bound = np.random.default_rng(seed), env.unwrapped.spec.max_episode_steps
    observation, _ = env.reset(seed=seed)
    count, over = 0, False
    while not over:
        assert env.observation_space.contains(observation)
        observation, reward, terminated, truncated, _ = env.step(random.uniform(-1, 1, 4).astype(np.float32))
        assert math.isfinite(reward)
        count, over = count + 1, terminated or truncated
    assert count <= env.unwrapped._episodes.longest <= bound


def test_an_episode_follows_from_its_seed_and_from_what_is_chosen():
    env = SpiralTuningEnv()
    (one, drawn), (two, again) = env.reset(seed=5), env.reset(seed=5)
    assert one.tobytes() == two.tobytes()
    assert drawn == again
    assert 0 <= drawn["payload_kg"] <= 4
    assert 0 <= drawn["payload_later"] <= 4
    _, chosen = env.reset(seed=5, options={"task": {"payload_later": 2.5}})
    assert chosen == {**drawn, "payload_later": 2.5}
    with pytest.raises(InputError, match="payload_later = 19: must be at most 10"):
        env.reset(seed=5, options={"task": {"payload_later": 19.0}})


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ({"decision_interval": math.inf}, "decision_interval = inf s: must be finite"),
        ({"gain_range": 1.0}, "gain_range = 1: must be greater than 1"),
        ({"start": (1.0, 5.0, 1.0, 1.0)}, "start of kd = 5: must be 0.333333 to 3"),
        ({"start": (1.0, 1.0, 1.0)}, "start"),
        ({"step": (0.1, 0.1, 0.0, 0.1)}, "step of velocity_ff = 0: must be greater than 0"),
        ({"memory": -1.0}, "memory = -1 s: must be greater than 0"),
        ({"weight": math.nan}, "weight = nan: must be finite"),
    ],
)
def test_settings_out_of_bounds_are_rejected(given, text):
    with pytest.raises(InputError, match=text):
        SpiralTuningEnv(**given)
