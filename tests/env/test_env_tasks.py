"""The tasks in which adapting pays: what they compute against closed forms and records, and what adapting saves."""

import math

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import SyncVectorEnv
from hypothesis import given
from hypothesis import strategies as st

from gantrysim import InputError
from gantrysim.env import BeadWidthEnv, SpeedOverrideEnv
from gantrysim.env.baselines import CLASSICAL
from gantrysim.env.look_ahead import LimitedSpeed, LookAhead, PathsAhead
from gantrysim.metrics.analysis import Analysis
from gantrysim.paths.profile import PointToPoint
from gantrysim.paths.spirals import Involute

from support.episodes import BEAD, SHORT, SPEED, TORQUE, actions_of, returned, same
from support.soaked import examples, suite_runs

TASKS = [BEAD, SPEED, TORQUE]
STEADY = {"warming": 1.0, "clog": 1.0, "dip": 0.0, "lag": 0.05}
SPACING = 0.03  # of the points along a path, between which a reversal lies [mm]
BRIEF = {"diameter": 36.0, "turns": 1, "thickness": 9.0, "speed": (80.0, 100.0)}  # of many short decisions
SAVED = 0.2  # least share of the loss that adapting saves


def still(_observation):
    return np.zeros(1, np.float32)


def test_reversals_of_a_spiral_lie_where_its_tangent_is_along_an_axis():
    path = Involute(30.0, 8.0, 2, start=(-30.0, 0.0))
    s, points, *_ = path.table
    look = LookAhead(points)
    expected = np.interp(0.5 * np.pi * np.arange(1, 8), path.phi(s), s)
    assert look.reversals == pytest.approx(expected, abs=SPACING)
    to, since = look.to_reversal(expected[2] + 1.0)
    assert float(to) == pytest.approx(expected[3] - expected[2] - 1.0, abs=2 * SPACING)
    assert float(since) == pytest.approx(1.0, abs=SPACING)
    assert np.isinf(look.to_reversal(0.0)[1])
    inside = look.s[20:-20]
    assert look.curvature(inside) == pytest.approx(path.curvature(inside), abs=1e-5)


@pytest.mark.parametrize("name", ["gantrysim/SpiralTuning-v0", "gantrysim/GainBandit-v0"])
def test_chords_of_drawn_spirals_are_within_20_nm_of_them(name):
    """To which contour errors are measured: half as many as an analysis takes, each off by half of that or more."""
    env = gymnasium.make(name).unwrapped
    for seed in range(3):
        env.reset(seed=seed)
        episode = env._episodes.episodes[0]
        path = episode.simulation.setpoints.requested
        s = episode.table.s
        points = episode.table.points
        assert s[0] == 0.0
        assert s[-1] == path.length
        sagitta = np.linalg.norm(path.position((s[1:] + s[:-1]) / 2) - (points[1:] + points[:-1]) / 2, axis=1)
        assert 1e-5 < sagitta.min() < sagitta.max() < 2e-5 * (1 + 1e-3)
        assert len(s) < len(path.table.s) / 2


def test_several_paths_ahead_are_each_as_if_alone():
    """Longer and shorter paths one after another in the same place; a place without a path has zeros."""
    random = np.random.default_rng(4)
    looks = [LookAhead(Involute(radius, 6.0, 2, start=(-radius, 0.0)).table.points) for radius in (30.0, 16.0, 22.0)]
    ahead = PathsAhead(3)
    for place, look in ((0, looks[0]), (2, looks[0]), (2, looks[1]), (0, looks[2])):
        ahead.put(place, look)
    for _ in range(20):
        s = random.uniform(0.0, 120.0, 3)
        speeds = random.uniform(0.0, 300.0, (2, 3))
        values = ahead.values(s, speeds)
        assert not values[1].any()
        for place, look in ((0, looks[2]), (2, looks[1])):
            curvature = look.curvature(s[place] + np.array([0.0, 2.0, 5.0, 10.0]))
            to, since = look.to_reversal(s[place])
            expected = [*speeds[:, place] / 100, *curvature / 0.1, min(to / 10, 1.0), min(since / 10, 1.0)]
            assert values[place] == pytest.approx(expected, rel=1e-12)
        feet = random.integers(0, 900, 3)
        assert ahead.s(feet)[[0, 2]].tolist() == [looks[2].s[feet[0]], looks[1].s[feet[2]]]


@given(
    speed=st.floats(5.0, 200.0),
    acceleration=st.floats(100.0, 5000.0),
    depth=st.floats(0.0, 0.9),
    waves=st.floats(0.5, 8.0),
)
@examples(20)
def test_a_limited_speed_keeps_its_limits_and_comes_to_rest(speed, acceleration, depth, waves):
    s = np.linspace(0.0, 100.0, 401)
    limit = speed * (1 - depth * np.sin(waves * s / 30) ** 2)
    profile = LimitedSpeed(s, limit, acceleration)
    t = np.linspace(0.0, profile.duration, 2000)
    way, v = profile.position(t), profile.velocity(t)
    assert way[[0, -1]] == pytest.approx([0.0, 100.0])
    assert v[[0, -1]] == pytest.approx([0.0, 0.0], abs=1e-6 * speed)
    at = np.clip(np.searchsorted(s, way, "right"), 1, 400)
    assert (v <= np.maximum(limit[at - 1], limit[at]) * (1 + 1e-9)).all()
    assert (np.abs(np.diff(v)) <= acceleration * np.diff(t) * (1 + 1e-6) + 1e-9).all()
    assert np.trapezoid(v, t) == pytest.approx(100.0, rel=1e-3)
    constant = LimitedSpeed(s, np.full(401, speed), acceleration)
    least = PointToPoint(100.0, speed, acceleration).duration
    assert least - 1e-9 <= constant.duration <= least + 2 * 0.25 / speed + 1e-9  # a ramp ends at a point


@pytest.mark.parametrize("override", [0.8, 1.25])
def test_a_steady_bead_is_as_wide_as_the_law_of_the_needle_says(override):
    env = BeadWidthEnv(override=override, camera_noise=0.0, speed=60.0)
    env.reset(seed=1, options={"task": {**STEADY, "viscosity": 1.2}})
    for _ in range(12):
        observation, *_, info = env.step(still(None))
    error = (override / 1.2) ** (1 / (2 * 0.6)) - 1
    assert info["width_rms"] == pytest.approx(abs(error), rel=5e-3)
    seen = dict(zip(env.observation_names, observation.tolist(), strict=True))
    assert seen["width_error"] == pytest.approx(error / 0.05, rel=5e-3)
    assert info["cost"] == float(abs(error) > 0.05)
    # the record, and films of it, have the agent's flow, not the program's
    assert env.run.flow[-2] == pytest.approx(env.run.flow_demand[-2] * (1 + error) ** 2, rel=5e-3)
    assert seen["speed"] == pytest.approx(0.6, rel=1e-3)


def test_the_camera_sees_the_bead_where_it_is_behind_the_nozzle():
    env = BeadWidthEnv(camera_noise=0.0, speed=50.0, decision_interval=0.01, behind=10.0)
    observation, _ = env.reset(seed=1, options={"task": {**STEADY, "viscosity": 1.0}})
    at = env.observation_names.index("width_seen")
    first = 0
    while not observation[at]:
        observation, *_ = env.step(still(None))
        first += 1
    run = env.run
    way = np.linalg.norm(np.diff(run.nozzle, axis=0), axis=1).sum()
    assert 10.0 <= way <= 10.0 + 20 * 0.05 + 0.55 + 0.5  # pieces end at ticks; the one being laid; one interval


def test_the_bead_of_an_episode_is_that_of_an_independent_integration():
    env = BeadWidthEnv()
    _, drawn = env.reset(seed=4, options={"task": {"clog": 0.7, "clog_time": 2.0}})
    random, overrides, over = np.random.default_rng(0), [], False
    while not over:
        *_, over, info = env.step(random.uniform(-1, 1, 1).astype(np.float32))
        overrides.append(info["override"])
    run, n = env.run, 0.6
    commanded = np.linalg.norm(np.diff(env._episodes.episodes[0].simulation.position, axis=0), axis=1) / 1e-3
    override = np.repeat(overrides, 100)[: len(run.time)]
    time, pressure, flows = run.time, 0.0, np.zeros(len(run.time))
    for k in range(1, len(time)):
        wanted = override[k] * (commanded[k - 1] / commanded.max()) ** n
        pressure = wanted + (pressure - wanted) * math.exp(-1e-3 / drawn["lag"])
        thickness = drawn["viscosity"] * drawn["warming"] ** (1 - math.exp(-time[k] / drawn["warming_time"]))
        flows[k] = (drawn["clog"] if time[k] >= drawn["clog_time"] else 1.0) * (pressure / thickness) ** (1 / n)
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(run.nozzle, axis=0), axis=1))])
    volume = np.cumsum(flows * commanded.max() * 1e-3)
    ends = [0]
    for k in range(1, len(way)):
        if way[k] - way[ends[-1]] >= 0.5 - 1e-12:
            ends.append(k)
    errors = np.sqrt(np.diff(volume[ends]) / np.diff(way[ends])) - 1
    assert info["episode_width_rms"] == pytest.approx(math.sqrt(np.mean(errors**2)), rel=1e-6)
    assert info["episode_width_max"] == pytest.approx(np.abs(errors).max(), rel=1e-6)
    assert info["episode_cost"] == pytest.approx(np.mean(np.abs(errors) > 0.05), abs=1e-9)


def test_an_episode_at_the_programs_speed_takes_the_time_of_its_profile_on_its_path():
    env = SpeedOverrideEnv(diameter=40.0, turns=1, thickness=8.0, speed=100.0)
    _, info = returned(env, 2, still)
    path = env._episodes.episodes[0].simulation.setpoints.requested
    expected = PointToPoint(path.length, 100.0, 2000.0).duration
    assert info["episode_time"] == pytest.approx(expected, abs=0.01)
    assert info["episode_time_ratio"] == pytest.approx(info["episode_time"] * 100 / path.length)
    run = env.run
    way = path.follow(np.column_stack([run.commanded, np.zeros(len(run.time))]))
    assert np.abs(way.lateral).max() < 1e-9
    assert np.array_equal(run.commanded[-1], path.position(path.length)[0, :2])
    values = Analysis(run).values.contour
    assert info["episode_contour_max"] == pytest.approx(values.max, abs=1e-4)


@given(actions=st.lists(st.floats(-1, 1), min_size=8, max_size=8))
@examples(5)
def test_the_commanded_speed_keeps_the_acceleration_and_the_override(actions):
    env = SpeedOverrideEnv(diameter=40.0, turns=1, thickness=8.0, speed=100.0)
    overrides = []
    for seed in (1,):
        env.reset(seed=seed)
        for action in actions * 2:
            *_, terminated, truncated, info = env.step(np.array([action], np.float32))
            overrides.append(info["override"])
            if terminated or truncated:
                break
    speed = np.linalg.norm(np.diff(env.run.commanded, axis=0), axis=1) / 1e-3
    assert (np.abs(np.diff(speed)) <= 2000.0 * 1e-3 * 1.02 + 1e-6).all()  # chords, not arcs
    assert (speed <= 100.0 * np.maximum.accumulate(np.repeat(overrides, 20))[1 : len(speed) + 1] + 1e-6).all()


@pytest.mark.parametrize("progress", [0.0, 6.0])
def test_progress_pays_the_same_for_a_whole_path_however_it_is_followed(progress):
    env = SpeedOverrideEnv(diameter=40.0, turns=1, thickness=8.0, speed=100.0, slowest=0.2, progress=progress)
    random = np.random.default_rng(0)
    for policy in (still, lambda _: random.uniform(-1, 1, 1).astype(np.float32)):
        env.reset(seed=1)
        names, infos, rewards, over = ("reward_progress", "reward_time", "reward_contour"), [], [], False
        while not over:
            _, reward, terminated, over, info = env.step(policy(None))
            assert not terminated
            infos.append(info)
            rewards.append(reward)
        paid, time, contour = (np.array([one[name] for one in infos]) for name in names)
        assert rewards == pytest.approx(paid + time + contour)
        assert paid.sum() == pytest.approx(progress)
        assert time.sum() == pytest.approx(-info["episode_time_ratio"])
        assert (paid >= 0).all()
        assert (contour[[one["cost"] == 0 for one in infos]] == 0).all()


@pytest.mark.parametrize(("progress", "crawling_pays"), [(0.0, True), (6.0, False)])
def test_crawling_pays_for_an_agent_that_discounts_only_without_progress(progress, crawling_pays):
    env = SpeedOverrideEnv(progress=progress)
    returns = []
    for policy in (lambda _: -np.ones(1, np.float32), CLASSICAL["SpeedOverride"](env, 6.0)):
        total = 0.0
        for seed in (500, 501):
            observation, _ = env.reset(seed=seed)
            for k in range(150):
                observation, reward, _, truncated, _ = env.step(policy(observation))
                total += 0.99**k * reward
                if truncated:
                    break
        returns.append(total)
    crawling, classical = returns
    assert (crawling > classical) is crawling_pays


def test_friction_changes_when_it_is_said_to():
    options = {"machine": {"friction_x": 1.0, "friction_y": 1.0}}
    runs = []
    for change in (1.0, 1.6):
        env = SpeedOverrideEnv(spread=None)
        task = {"friction_change": change, "friction_time": 0.6}
        returned(env, 1, still, {"task": task, **options})
        runs.append(env.run)
    before = np.arange(len(runs[0].time)) < 600
    assert np.array_equal(runs[0].nozzle[before], runs[1].nozzle[before])
    assert not np.array_equal(runs[0].nozzle[600:700], runs[1].nozzle[600:700])
    demand = [np.abs(run.demand[700:1000]).mean() for run in runs]
    assert demand[1] > 1.2 * demand[0]


@pytest.mark.parametrize(
    ("name", "parameter", "constants"), suite_runs([(BEAD, 0.15, (1.0, 1.1)), (SPEED, 6.0, (0.4, 1.0))], 0)
)
def test_adapting_beats_constants(name, parameter, constants):
    seeds = range(500, 503)
    env = gymnasium.make(name).unwrapped
    policy = CLASSICAL[name.removeprefix("gantrysim/").removesuffix("-v1")](env, parameter)
    adaptive = sum(returned(env, seed, policy)[0] for seed in seeds)
    for override in constants:
        fixed = gymnasium.make(name, override=override).unwrapped
        assert -adaptive < (1 - SAVED) * -sum(returned(fixed, seed, still)[0] for seed in seeds)


@pytest.mark.parametrize("name", TASKS)
def test_random_actions_do_not_end_in_a_fault(name):
    random = np.random.default_rng(0)
    env = gymnasium.make(name, **(BRIEF if name == TORQUE else {}))
    for seed in range(3):
        _, info = returned(env, seed, lambda _: random.uniform(-1, 1, env.action_space.shape).astype(np.float32))
        assert info["fault"] is None
        assert np.isfinite([value for value in info.values() if isinstance(value, float)]).all()


@pytest.mark.parametrize("name", TASKS)
def test_the_vector_environment_equals_the_scalar_one(name):
    short = {**SHORT, "speed": (100.0, 150.0)}
    scalar = SyncVectorEnv([lambda: gymnasium.make(name, **short) for _ in range(3)])
    native = gymnasium.make_vec(name, num_envs=3, threads=2, **short)
    (one, info), (other, infos) = scalar.reset(seed=3), native.reset(seed=3)
    assert one.tobytes() == other.tobytes()
    assert same(info, infos)
    random = np.random.default_rng(1)
    for _ in range(40):
        actions = actions_of(native, random)
        assert same(native.step(actions), scalar.step(actions))


@pytest.mark.parametrize("name", TASKS)
def test_a_task_goes_on_from_a_saved_state(name):
    env, other = gymnasium.make(name, **SHORT).unwrapped, gymnasium.make(name, **SHORT).unwrapped
    env.reset(seed=3)
    actions = np.random.default_rng(0).uniform(-1, 1, (10, *env.action_space.shape)).astype(np.float32)
    for action in actions[:5]:
        env.step(action)
    state = env.save()
    other.restore(state)
    for action in actions[5:8]:
        one, two = env.step(action), other.step(action)
        assert one[0].tobytes() == two[0].tobytes()
        assert str(one[1:]) == str(two[1:])
    assert np.array_equal(env.run.commanded, other.run.commanded)
    assert np.array_equal(env.run.nozzle, other.run.nozzle)


@pytest.mark.parametrize("engine", ["loop", "mujoco"])
@pytest.mark.parametrize("name", [*TASKS, "gantrysim/SpiralTuning-v0"])
def test_steps_that_are_taken_back_and_made_again_count_once(name, engine, monkeypatch):
    """As where an axis reaches a stop that the model lacks: errors, what is fitted and the bead are of the second."""
    env, other = (gymnasium.make(name, **SHORT, engine=engine).unwrapped for _ in range(2))
    places = env._episodes._batch
    step = places.step

    def stepped_twice(steps, numbers):
        states = places.states(numbers)
        step(steps, numbers)
        places.set_states(states, numbers)
        step(steps, numbers)

    monkeypatch.setattr(places, "step", stepped_twice)
    assert np.array_equal(env.reset(seed=3)[0], other.reset(seed=3)[0])
    for action in np.random.default_rng(0).uniform(-1, 1, (12, *env.action_space.shape)).astype(np.float32):
        one = env.step(action)
        two = other.step(action)
        assert one[0].tobytes() == two[0].tobytes()
        assert str(one[1:]) == str(two[1:])


@pytest.mark.parametrize(
    ("kind", "given", "text"),
    [
        (BeadWidthEnv, {"decision_interval": math.inf}, "decision_interval = inf s: must be finite"),
        (BeadWidthEnv, {"override": 9.0}, "override = 9 within"),
        (BeadWidthEnv, {"behind": 50.0}, "behind = 50 mm"),
        (SpeedOverrideEnv, {"override": 9.0}, "override = 9: must be from 0.03 to 2"),
    ],
)
def test_settings_out_of_bounds_are_rejected(kind, given, text):
    with pytest.raises(InputError, match=text):
        kind(**given).reset(seed=1)


@pytest.mark.parametrize("name", TASKS)
def test_the_longest_episode_is_bounded(name):
    own = {SPEED: {"slowest": 0.3}, TORQUE: {"decision_interval": 0.02}}
    env = gymnasium.make(name, **SHORT, **own.get(name, {}))
    env.reset(seed=1, options={"spiral": {"diameter": 60.0, "turns": 2, "thickness": 6.0, "speed": 80.0}})
    count, over = 0, False
    while not over:
        *_, over, _ = env.step(-np.ones(env.action_space.shape, np.float32))
        count += 1
    assert count <= env.spec.max_episode_steps


def test_the_log_of_an_override_knows_the_drives():
    """Voltages of a record follow from the lead of a current loop."""
    env = SpeedOverrideEnv(servo={"current_bandwidth": 1000.0})
    env.reset(seed=1)
    for _ in range(10):
        env.step(np.zeros(1, np.float32))
    (batch,) = (own for own in vars(env).values() if hasattr(own, "episodes"))
    simulation = batch.episodes[0].simulation
    assert (simulation.drives["current"]["lead"] > 0).all()
    np.testing.assert_array_equal(simulation.book._drives[:, 0], simulation.drives["current"]["lead"])


def test_the_camera_sees_a_clog_once_it_has_come_to_it():
    """10 mm behind the nozzle, at 50 mm/s."""
    env = BeadWidthEnv(camera_noise=0.0, speed=50.0, decision_interval=0.01, behind=10.0)
    observation, _ = env.reset(seed=1, options={"task": {**STEADY, "viscosity": 1.0, "clog": 0.5, "clog_time": 1.0}})
    at = env.observation_names.index("width_error")
    # from after the start, where the pressure rises
    for _ in range(95):
        observation, *_ = env.step(still(None))
    assert abs(observation[at]) < 0.1
    while observation[at] > -2.0:
        observation, *_ = env.step(still(None))
    seen = env.run.time[-1] - 1.0
    # pieces of the bead, and the interval
    assert 10.0 / 50.0 <= seen <= (10.0 + 2 * 0.55) / 50.0 + 0.02


def test_a_fault_loses_all_of_the_path_from_the_interval_on_in_which_it_happens(monkeypatch):
    """The largest loss of its length: as slow as can be, and as far from the path as counts."""
    env = SpeedOverrideEnv(diameter=40.0, turns=1, thickness=8.0, speed=100.0, slowest=0.2)
    env.reset(seed=1)
    for _ in range(5):
        _, _, _, _, info = env.step(still(None))
        assert info["reward_fault"] == 0
    batch = env._episodes
    settings = batch.settings
    left = 1 - batch._commanded_s[0] / batch._length[0]
    assert 0.1 < left < 0.99
    ends = batch._ends
    monkeypatch.setattr(batch, "_ends", lambda advanced: ends(advanced)._replace(faulty=advanced.copy()))
    *_, info = env.step(still(None))
    assert info["reward_fault"] == pytest.approx(-left * (1 / settings.slowest + settings.weight * settings.worst))
