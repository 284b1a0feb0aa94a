"""The environments against the engine and the analysis: runs, observations and rewards."""

import copy
import math
import pickle
import re
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from hypothesis import given
from hypothesis import strategies as st

from gantrysim import InputError, Job, simulate
from gantrysim.base.errors import GantryError
from gantrysim.engine.started import Started
from gantrysim.env import GainBanditEnv, GainBanditSettings, GainBanditVectorEnv
from gantrysim.env.episodes import TUNED_GAINS
from gantrysim.env.settings import PathSettings
from gantrysim.machine.tolerances import Tolerances
from gantrysim.metrics.analysis import Analysis, path_speed, torque_ripple

from support.episodes import stepwise, stepwise_vector
from support.soaked import examples, suite_runs

SHORT = {"diameter": 48.0, "turns": 1, "thickness": 8.0, "speed": 100.0}
FAULTY = np.array([1, -1, 0, 0], np.float32)  # high stiffness, low damping

ROUNDING = 1e-6  # of single precision
CONTOUR = 5e-5  # [mm], deviation of 0.05 mm chords from a curve of 8 mm radius
RIPPLE = 1e-12


def whole_episode(env, action=None, seed=1):
    """Run an episode with one action; return the result of the last step and all infos."""
    env.reset(seed=seed)
    infos, over = [], False
    while not over:
        last = env.step(np.zeros(env.action_space.shape) if action is None else action)
        infos.append(last[-1])
        over = last[2] or last[3]
    return last, infos


@pytest.fixture
def env():
    made = stepwise(**SHORT)
    yield made
    made.close()


def test_all_numbers_of_turns_between_the_bounds_are_drawn():
    env = stepwise(**{**SHORT, "turns": (1, 2), "diameter": 60.0})
    env.reset(seed=1)
    assert {env.reset()[1]["turns"] for _ in range(8)} == {1, 2}


def test_an_episode_with_constant_gains_equals_a_run_of_the_engine():
    env = stepwise(**SHORT, gain_range=4.0)
    action = np.array([0.5, 0.25, -0.5, 1.0])
    (_, _, terminated, truncated, _), _ = whole_episode(env, action)
    assert (terminated, truncated) == (False, True)
    simulation = env._episodes.episodes[0].simulation
    factors = 4.0**action
    gains = {
        name: tuple(f * g for g in simulation.servo.per_axis(name))
        for f, name in zip(factors, TUNED_GAINS, strict=True)
    }
    gains["ki"] = tuple(factors[0] * ki for ki in simulation.servo.per_axis("ki"))
    servo = simulation.servo.with_values(**gains)
    run = simulate(simulation.machine, servo, simulation.setpoints, dispenser=simulation.dispenser, engine="loop")
    for name in ("encoder", "nozzle", "demand", "motor", "flow"):
        assert np.array_equal(getattr(env.run, name), getattr(run, name)), name


def test_a_bandit_with_a_decision_interval_decides_several_times_in_the_same_run():
    once = GainBanditEnv(**SHORT)
    often = GainBanditEnv(**SHORT, decision_interval=0.1)
    for env, decided_once in ((once, True), (often, False)):
        (_, _, terminated, truncated, _), infos = whole_episode(env, np.array([0.3, 0.1, -0.2, 0.4]))
        assert (terminated, truncated) == (decided_once, not decided_once)
        assert len(infos) == (1 if decided_once else math.ceil(len(env.run.time) / 100))
    assert np.array_equal(often.run.demand, once.run.demand)


def test_gains_hold_until_the_next_decision(env):
    env.reset(seed=1)
    env.step(np.zeros(4))
    before = env.run
    env.step(np.array([0.3, 0.0, 0.0, 0.0]))
    after = env.run
    assert len(before.time) == 100
    assert len(after.time) == 200
    assert np.array_equal(after.demand[:100], before.demand)
    env.reset(seed=1)
    env.step(np.zeros(4))
    env.step(np.zeros(4))
    assert not np.array_equal(env.run.demand[100], after.demand[100])


def test_observation_and_info_agree_with_the_analysis(env):
    names = env.observation_names
    env.reset(seed=2)
    for _ in range(5):
        observation, *_, info = env.step(np.zeros(4))
    run, tolerance = env.run, env.settings.tolerance
    last = slice(400, 500)
    observed = dict(zip(names, observation.tolist(), strict=True))
    contour = Analysis(run).nozzle
    lateral, distance = contour.lateral[last], contour.distance[last]
    assert info["contour_rms"] == pytest.approx(math.sqrt(np.mean(distance**2)), abs=CONTOUR)
    assert info["contour_max"] == pytest.approx(distance.max(), abs=CONTOUR)
    assert 10 ** observed["contour_rms"] * tolerance == pytest.approx(info["contour_rms"], rel=1e-5)
    assert 10 ** observed["contour_max"] * tolerance == pytest.approx(info["contour_max"], rel=1e-5)
    assert observed["contour_mean"] * tolerance == pytest.approx(lateral.mean(), abs=CONTOUR)
    peak = [axis.peak_torque for axis in env._episodes.source.machine.axes]
    shares = []
    for a, axis in enumerate("xy"):
        error = (run.commanded - run.encoder)[last, a]
        assert 10 ** observed[f"following_rms_{axis}"] * tolerance == pytest.approx(
            np.sqrt(np.mean(error**2)), rel=1e-5
        )
        assert 10 ** observed[f"following_max_{axis}"] * tolerance == pytest.approx(np.abs(error).max(), rel=1e-5)
        assert observed[f"following_mean_{axis}"] * tolerance == pytest.approx(error.mean(), abs=1e-6)
        assert observed[f"torque_{axis}"] == pytest.approx(np.abs(run.demand[last, a]).max() / peak[a], rel=1e-6)
        change = np.diff(run.demand[399:500, a])
        shares.append(np.sqrt(0.5 * np.mean(change**2)) / peak[a])
        assert 10 ** observed[f"ripple_{axis}"] * env.settings.ripple_limit == pytest.approx(shares[-1], rel=1e-5)
    assert info["ripple"] == pytest.approx(max(shares), rel=1e-12)
    local = run.requested.local(contour.s[[499]])
    assert observed["curvature"] * 0.1 == pytest.approx(float(local.turning[0]), rel=0.02)
    assert observed["cos_heading"] == pytest.approx(float(local.tangent[0, 0]), abs=0.01)
    assert observed["sin_heading"] == pytest.approx(float(local.tangent[0, 1]), abs=0.01)
    assert observed["speed"] * 100 == pytest.approx(path_speed(run)[last].mean(), rel=0.01)
    assert observed["progress"] == pytest.approx(500 / len(env._episodes.episodes[0].simulation.position), rel=1e-6)


def test_the_ripple_of_an_episode_is_that_of_the_metrics():
    env = GainBanditEnv(**SHORT)
    env.reset(seed=3)
    *_, info = env.step(np.zeros(4))
    peak = np.array([axis.peak_torque for axis in env._episodes.source.machine.axes])
    run = env.run
    assert run.dispense.all()
    assert info["ripple"] == pytest.approx((torque_ripple(run) / peak).max(), rel=RIPPLE)


@pytest.mark.parametrize("name", suite_runs(["softmc-arc", "fanuc-conical", "stage-outline"], 0))
def test_the_ripple_of_an_episode_with_pauses_is_that_of_the_metrics(name):
    env = GainBanditEnv(job=name, spread=None)
    env.reset(seed=1)
    *_, info = env.step(np.zeros(4))
    peak = np.array([axis.peak_torque for axis in env._episodes.source.machine.axes])
    assert not env.run.dispense.all()
    assert info["ripple"] == pytest.approx((torque_ripple(env.run) / peak).max(), rel=RIPPLE)


def test_the_last_info_holds_the_episodes_contour_error(env):
    (*_, info), infos = whole_episode(env)
    values = Analysis(env.run).values
    assert info["episode_contour_rms"] == pytest.approx(values.contour.rms, abs=CONTOUR)
    assert info["episode_contour_max"] == pytest.approx(values.contour.max, abs=CONTOUR)
    assert all("episode_contour_rms" not in info for info in infos[:-1])


def test_the_reward_is_the_sum_of_its_terms_in_closed_form(env):
    env.reset(seed=1)
    ended = False
    for action in ([0, 0, 0, 0], [0.4, 0.9, 0, 0], FAULTY):
        while not ended:
            _, reward, terminated, truncated, info = env.step(np.asarray(action, np.float32))
            ended = terminated or truncated
            assert reward == sum(info[f"reward_{term}"] for term in ("contour", "ripple", "fault"))
            assert info["reward_contour"] == pytest.approx(-min(math.log1p(info["contour_rms"] / 0.05), 6), rel=1e-12)
            ripple = max(info["ripple"] / env.settings.ripple_limit, 1)
            assert info["reward_ripple"] == pytest.approx(-min(math.log(ripple), 4), abs=1e-12)
            if not terminated:
                assert info["reward_fault"] == 0
                break
    assert terminated


def test_a_fault_costs_more_than_the_worst_episode_without_one():
    settings = dict(SHORT, spread=None)
    env = stepwise(**settings, detune=10.0, gain_range=100.0)
    env.reset(seed=1)
    worst = 0.0
    over = False
    while not over:  # the worst without a fault
        _, reward, terminated, truncated, _ = env.step(np.zeros(4))
        over, worst = terminated or truncated, worst + reward
    assert truncated
    env.reset(seed=1)
    total, over = 0.0, False
    while not over:
        _, reward, terminated, truncated, info = env.step(FAULTY)
        over, total = terminated or truncated, total + reward
    assert terminated
    assert total < worst
    assert re.match(r"(oscillation|overspeed|following error) on axis [xy] at t = 0\.\d+ s: ", info["fault"])
    assert env.run.fault is not None
    assert str(env.run.fault) == info["fault"]
    left = len(env._episodes.episodes[0].simulation.position) - len(env.run.time)
    assert info["reward_fault"] == -12.0 * (1 + left // 100)


def test_an_episode_that_is_over_must_be_reset(env):
    with pytest.raises(ResetNeeded):
        env.step(np.zeros(4))
    whole_episode(env)
    with pytest.raises(ResetNeeded):
        env.step(np.zeros(4))
    env.reset()
    env.step(np.zeros(4))


def test_episodes_after_a_seed_are_repeatable_and_differ():
    env = stepwise()
    first = [env.reset(seed=5)[1], env.reset()[1], env.reset()[1]]
    second = [env.reset(seed=5)[1], env.reset()[1], env.reset()[1]]
    assert first == second
    assert len({info["diameter"] for info in first}) == 3
    low, high = env.settings.between("diameter")
    assert all(low <= info["diameter"] <= high for info in first)


def test_a_fixed_spiral_still_draws_its_machine(env):
    nominal = stepwise(**SHORT, spread=None)
    runs = []
    for one in (env, env, nominal, nominal):
        one.reset(seed=None if runs else 7)
        one.step(np.zeros(4))
        runs.append(one.run)
    assert np.array_equal(runs[0].commanded, runs[1].commanded)
    assert not np.array_equal(runs[0].demand, runs[1].demand)
    assert np.array_equal(runs[2].demand, runs[3].demand)


@examples(20)
@given(seed=st.integers(0, 2**31), thickness=st.floats(6, 12))
def test_a_random_spiral_leaves_room_inside(seed, thickness):
    env = _room(thickness)
    _, info = env.reset(seed=seed)
    path = env._episodes.episodes[0].simulation.setpoints.requested
    assert info["turns"] >= 1
    assert path.radius - path.pitch * path.turns >= path.pitch - 1e-9
    assert isinstance(info["turns"], int)


ENVS = {}


def _room(thickness):
    key = round(thickness)
    if key not in ENVS:
        ENVS[key] = stepwise(diameter=(48, 140), turns=(1, 9), thickness=(3, key), speed=80.0, spread=None)
    return ENVS[key]


def test_a_job_gives_path_machine_servo_and_dispenser():
    job = Job.load("softmc-arc")
    env = GainBanditEnv(job="softmc-arc", spread=None)
    env.reset(seed=1)
    *_, terminated, truncated, info = env.step(np.zeros(4))
    run = job.run(engine="loop")
    assert (terminated, truncated, info["fault"]) == (True, False, None)
    assert np.array_equal(env.run.nozzle, run.nozzle)
    assert np.array_equal(env.run.flow, run.flow)
    contour = Analysis(run).values.contour
    assert info["episode_contour_rms"] == pytest.approx(contour.rms, abs=CONTOUR)
    assert info["episode_contour_max"] == pytest.approx(contour.max, abs=CONTOUR)


@pytest.mark.parametrize("name", suite_runs(["stage-outline", "fanuc-conical", "fanuc-spiral"], 0))
def test_every_kind_of_machine_and_path_has_its_contour_error(name):
    env = GainBanditEnv(job=Job.load(name), spread=None)
    observation, _ = env.reset(seed=1)
    assert env.observation_space.contains(observation)
    *_, info = env.step(np.zeros(4))
    contour = Analysis(env.run).values.contour
    assert info["episode_contour_rms"] == pytest.approx(contour.rms, abs=CONTOUR)
    assert info["episode_contour_max"] == pytest.approx(contour.max, abs=CONTOUR)


def test_an_action_of_zero_gives_the_detuned_gains():
    plain, detuned = (stepwise(**SHORT, spread=None, detune=d, gain_range=10.0) for d in (1.0, 10.0))
    for env, action in ((plain, -np.ones(4)), (detuned, np.zeros(4))):
        env.reset(seed=1)
        env.step(action)
    assert np.allclose(plain.run.demand, detuned.run.demand, rtol=1e-9, atol=1e-12)


def test_every_axis_can_have_gains_of_its_own():
    shared, own = (stepwise(**SHORT, spread=None, per_axis=p) for p in (False, True))
    assert own.action_space.shape == (8,)
    for env, action in ((shared, [0.2, 0.1, 0, 0]), (own, [0.2, 0.2, 0.1, 0.1, 0, 0, 0, 0])):
        env.reset(seed=1)
        env.step(np.array(action))
    assert np.array_equal(shared.run.demand, own.run.demand)
    own.reset(seed=1)
    observation, *_ = own.step(np.array([0.2, -0.3, 0.1, 0.1, 0, 0, 0, 0.4]))
    assert np.array_equal(own.run.demand[:, 0], shared.run.demand[:, 0])
    assert not np.array_equal(own.run.demand[:, 1], shared.run.demand[:, 1])
    observed = dict(zip(own.observation_names, observation.tolist(), strict=True))
    assert [observed[f"gain_{name}"] for name in ("kp_x", "kp_y", "acceleration_ff_y")] == pytest.approx(
        [0.2, -0.3, 0.4]
    )


def test_actions_are_clipped_to_their_space(env):
    for action in (np.ones(4) * 0.5, np.array([0.5, 0.5, 0.5, 0.5])):
        env.reset(seed=1)
        env.step(action)
    edge = []
    for action in (np.array([1, 1, 1, 1]), np.array([3, 3, 3, 3])):
        env.reset(seed=1)
        observation, *_ = env.step(action)
        edge.append(env.run.demand)
        assert env.observation_space.contains(observation)
    assert np.array_equal(*edge)


@pytest.mark.parametrize(
    ("action", "text"),
    [
        (np.full(4, np.nan), "action [nan, nan, nan, nan]: must be finite"),
        (np.array([0, 0, np.inf, 0]), "action [0.0, 0.0, inf, 0.0]: must be finite"),
        (np.zeros(3), "1 actions of shape (3,): must be 1 of shape (4,)"),
    ],
)
def test_invalid_actions_are_rejected(env, action, text):
    env.reset(seed=1)
    with pytest.raises(InputError) as refused:
        env.step(action)
    assert str(refused.value) == text


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"gain_range": 1.0}, "gain_range = 1: must be greater than 1"),
        (
            {"decision_interval": 0.0015},
            "decision_interval = 0.0015 s: must be a multiple of the servo period, 0.001 s",
        ),
        ({"decision_interval": 0.0}, "decision_interval = 0 s: must be greater than 0 s"),
        ({"diameter": (120.0, 80.0)}, "diameter = (120, 80) mm: must be the lowest, then the highest"),
        ({"diameter": (1, 2, 3)}, "diameter = (1, 2, 3): must be one number, or the lowest and the highest"),
        ({"diameter": 20.0}, "diameter = 20 mm: must be at least 4 times the thickness, 48 mm, for one turn to fit in"),
        ({"turns": 2.5}, "turns = 2.5: must be a whole number"),
        ({"speed": 0}, "speed = 0 mm/s: must be greater than 0 mm/s"),
        ({"tolerance": -1}, "tolerance = -1 mm: must be greater than 0 mm"),
        ({"job": "none-such"}, "unknown job 'none-such'"),
        ({"job": 3}, "job = 3: must be text"),
        ({"spread": 0.3}, "spread = 0.3: must be a table"),
        ({"spread": "payload=a"}, "tolerance payload=a: must be payload= and a number"),
        ({"servo": {"bandwidth": 30}}, "unknown key servo.bandwidth"),
        ({"speeed": 100.0}, "unknown setting 'speeed': did you mean speed? known: speed, "),
        ({"per_axis": "maybe"}, "per_axis = 'maybe': must be true or false"),
        ({"tolerance": math.nan}, "tolerance = nan mm: must be finite"),
        ({"size": (0, 480)}, "width of the picture = 0: must be at least 1"),
        ({"size": 3}, "size = 3: must be width and height [pixels]"),
        (
            {"machine": "stage"},
            "machine = 'stage': turns its work, but spirals need a work that does not turn; use a job of this machine, "
            "such as job = 'stage-outline', or machine = 'xy', 'xyz' or 'xyzr'",
        ),
        (
            {"machine": "delta"},
            "machine = 'delta': has its nozzle at z = 426 mm with all axes at zero, but spirals are drawn at z = 0 mm; "
            "use a job of this machine, such as job = 'delta-arc', or machine = 'xy', 'xyz' or 'xyzr'",
        ),
        (
            {"diameter": (80.0, 340.0)},
            "the largest and fastest spiral, diameter = 340 mm, speed = 150 mm/s, does not fit the machine: x = -170 "
            "mm at t = 0 s: must lie in the travel -150 to 150 mm",
        ),
        (
            {"speed": (50.0, 5000.0), "acceleration": 1e6},
            "the largest and fastest spiral, diameter = 140 mm, speed = 5000 mm/s, does not fit the machine: speed of ",
        ),
        ({"render_mode": "human"}, "render_mode = 'human': must be None or 'rgb_array'"),
    ],
)
@pytest.mark.parametrize("kind", suite_runs([GainBanditEnv, GainBanditVectorEnv], 0))
def test_settings_out_of_bounds_are_rejected(kind, change, text):
    with pytest.raises(InputError) as refused:
        kind(**change)
    assert str(refused.value).startswith(text)


def test_the_environments_are_registered():
    for name, module in (("SpiralTuning", "spiral_tuning"), ("GainBandit", "gain_bandit")):
        spec = gymnasium.spec(f"gantrysim/{name}-v0")
        assert spec.entry_point == f"gantrysim.env.{module}:{name}Env"
        assert spec.vector_entry_point == f"gantrysim.env.{module}:{name}VectorEnv"


def test_the_settings_are_those_that_the_docstring_lists():
    of_path, own = (
        re.findall(r"^        (\w+): ", kind.__doc__, re.MULTILINE) for kind in (PathSettings, GainBanditSettings)
    )
    assert [*of_path[:-1], *own[:-1]] == list(GainBanditSettings.model_fields)  # the last is the error raised


def test_wider_tolerances_change_the_machine(env):
    wide = stepwise(**SHORT, spread=Tolerances(payload=3.0))
    for one in (env, wide):
        one.reset(seed=1)
        one.step(np.zeros(4))
    assert not np.array_equal(env.run.demand, wide.run.demand)


def test_a_job_object_can_be_pickled_and_copied_by_gymnasium():
    job = Job.load("softmc-arc")
    _ = job.built_machine, job.setpoints
    env = gymnasium.make("gantrysim/GainBandit-v0", job=job)
    assert Job.model_validate(env.spec.kwargs["job"]) == job
    again = pickle.loads(pickle.dumps(job))
    assert again == job
    assert again.run().nozzle.shape == job.run().nozzle.shape
    vector = gymnasium.make_vec("gantrysim/GainBandit-v0", num_envs=2, job=job)
    assert vector.reset(seed=1)[0].shape == (2, *env.observation_space.shape)


@pytest.mark.parametrize("seed", [5, np.int64(5), [5, 6, 7], np.array([5, 6, 7])])
def test_seeds_are_one_or_one_for_each_environment(seed):
    vector = stepwise_vector(3, spread=None)
    _, drawn = vector.reset(seed=seed)
    for place in range(3):
        alone = stepwise(spread=None)
        assert alone.reset(seed=5 + place)[1]["diameter"] == drawn["diameter"][place]


def test_seeds_and_masks_of_wrong_size_are_rejected():
    vector = stepwise_vector(3)
    with pytest.raises(InputError, match="2 seeds: must be one, or 3, one for each environment"):
        vector.reset(seed=[1, 2])
    for mask in (np.zeros(3, bool), np.ones(2, bool), np.ones(3)):
        with pytest.raises(InputError, match="must be 3 booleans, at least one of them true"):
            vector.reset(options={"reset_mask": mask})
    with pytest.raises(ResetNeeded):
        vector.step(np.zeros((3, 4)))


def test_without_autoreset_a_finished_episode_must_be_reset():
    vector = stepwise_vector(3, **SHORT, decision_interval=1.0, autoreset_mode="Disabled")
    vector.reset(seed=1)
    over = np.zeros(3, bool)
    while not over.any():
        _, _, terminated, truncated, _ = vector.step(np.zeros((3, 4)))
        over = terminated | truncated
    assert over.all()
    vector.reset(options={"reset_mask": np.array([True, False, True])})
    with pytest.raises(ResetNeeded):
        vector.step(np.zeros((3, 4)))
    vector.reset(options={"reset_mask": np.array([False, True, False])})
    vector.step(np.zeros((3, 4)))


def test_settings_may_be_numpy_numbers_and_texts():
    plain = GainBanditSettings.of(
        {"diameter": 100.0, "thickness": (6.0, 8.0), "spread": Tolerances(payload=1.0), "acceleration": 500.0}
    )
    other = {"diameter": np.float32(100), "thickness": ["6", 8], "spread": "payload=1", "acceleration": "500"}
    assert GainBanditSettings.of(other) == plain
    assert GainBanditSettings.of({"job": Path("out") / "job.toml"}).job == str(Path("out") / "job.toml")


def test_an_interval_costs_less_than_a_fault():
    """The worst case: an axis at rest without a following error limit, at a tiny tolerance."""
    gains = {"kp": [0.0, 0.7], "kd": [0.0, 0.008], "velocity_ff": [0.0, 0.0], "acceleration_ff": [0.0, 0.0]}
    servo = {**gains, "following_error_limit": 1e9}
    env = stepwise(**SHORT, tolerance=1e-9, servo=servo, ripple_limit=1e-30)
    env.reset(seed=1)
    for _ in range(3):
        _, reward, terminated, _, info = env.step(np.zeros(4))
    assert not terminated
    assert info["reward_contour"] == -6
    assert reward > -12


def test_a_fault_before_dispensing_leaves_the_contour_error_0():
    env = GainBanditEnv(job="softmc-arc", gain_range=100.0, spread=None)
    env.reset(seed=1)
    *_, info = env.step(-np.ones(4))
    assert not env.run.dispense.any()
    assert info["fault"] is not None
    assert info["episode_contour_rms"] == info["episode_contour_max"] == 0


def test_nothing_is_stepped_after_the_end():
    env = stepwise(**SHORT, decision_interval=1e9)
    env.reset(seed=1)
    *_, truncated, _ = env.step(np.zeros(4))
    assert truncated
    row = env._episodes._batch.runs[0].row
    assert row["steps"] <= row["tick"] * row["substeps"]
    assert row["tick"] == len(env._episodes.episodes[0].simulation.position)


def test_there_is_no_record_before_the_first_step(env):
    env.reset(seed=1)
    with pytest.raises(GantryError, match="this episode has not been stepped yet"):
        _ = env.run


def test_unknown_options_of_reset_are_rejected(env):
    with pytest.raises(InputError, match="unknown option 'diameter': known: machine, spiral, task"):
        env.reset(options={"diameter": 100})
    with pytest.raises(InputError, match="unknown option 'mask'"):
        stepwise_vector(2).reset(options={"mask": np.ones(2, bool)})


@pytest.mark.parametrize(
    "again", suite_runs([copy.copy, copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))], 2)
)
def test_a_copy_is_a_new_environment_with_the_same_settings(again):
    for env in (stepwise(**SHORT), GainBanditEnv(**SHORT), stepwise_vector(2, **SHORT, threads=1)):
        other = again(env)
        assert other.settings == env.settings
        assert other._episodes is not env._episodes
        assert np.array_equal(env.reset(seed=3)[0], other.reset(seed=3)[0])


@pytest.mark.parametrize("kind", [GainBanditEnv, GainBanditVectorEnv])
def test_an_interrupted_reset_requires_another_reset(kind, monkeypatch):
    env = kind(**SHORT)
    env.reset(seed=1)
    start = Started.of.__func__

    def interrupted(cls, *state):
        start(cls, *state)
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(Started, "of", classmethod(interrupted))
        with pytest.raises(KeyboardInterrupt):
            env.reset()
    fleet = env._episodes._batch
    row = fleet.runs[0].row
    assert row["log"] == fleet._loaded[0].log.tick.ctypes.data  # what the armed row writes to is kept alive
    if kind is GainBanditEnv:
        with pytest.raises(ResetNeeded):
            env.step(np.zeros(4))
    else:
        *_, info = env.step(np.zeros((1, 4)))
        assert "reward_contour" not in info  # a reset came first


def test_an_environment_refuses_a_law_that_learns_over_whole_runs():
    with pytest.raises(InputError, match=r"^environment: servo law = pid, learning: leave out learning"):
        stepwise(job=Job.load("an225", ['servo.law=["pid", "learning"]']))
