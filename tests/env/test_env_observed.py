"""Observations against the episode's own record and the closed form of its spiral."""

import numpy as np
import pytest

from gantrysim.env import BeadWidthEnv, ServoTorqueEnv, SpeedOverrideEnv, SpiralTuningEnv

from support.episodes import seen

DIAMETER, THICKNESS, TURNS = 30.0, 4.0, 3
A, RADIUS = THICKNESS / (2 * np.pi), 0.5 * DIAMETER
AHEAD = np.array([0.0, 2.0, 5.0, 10.0])  # [mm]
TABLE = 0.05  # distance of the points at which the environments know the path [mm]
SPIRAL = {"diameter": DIAMETER, "turns": TURNS, "thickness": THICKNESS}


def angle(s):
    """Angle by which the involute has turned after an arc length: s = R phi - a phi² / 2."""
    return (RADIUS - np.sqrt(RADIUS**2 - 2 * A * s)) / A


def way(phi):
    return RADIUS * phi - 0.5 * A * phi**2


PHI = np.linspace(0, 2 * np.pi * TURNS, 40_001)
RHO = RADIUS - A * PHI
CURVE = np.stack([RADIUS - A * np.sin(PHI) - RHO * np.cos(PHI), A - A * np.cos(PHI) + RHO * np.sin(PHI)], axis=1)


def foot(nozzle, start):
    """Arc length at the point of the involute nearest to the nozzle, and the distance, positive to the left."""
    away = nozzle[:2] - start[:2] - CURVE
    k = int((away**2).sum(axis=1).argmin())
    left = np.array([-np.cos(PHI[k]), np.sin(PHI[k])])  # of the heading (sin phi, cos phi)
    return way(PHI[k]), float(away[k] @ left)


def stepped(env, count):
    env.reset(seed=2)
    observations = [env.step(np.zeros(env.action_space.shape, np.float32))[0] for _ in range(count)]
    return [seen(env, observation) for observation in observations]


@pytest.mark.parametrize(
    "build",
    [
        lambda: SpiralTuningEnv(**SPIRAL, speed=200.0),
        lambda: BeadWidthEnv(**SPIRAL, speed=60.0, decision_interval=0.05),
        lambda: SpeedOverrideEnv(**SPIRAL),
    ],
    ids=["gain schedule", "bead width", "speed override"],
)
def test_what_lies_ahead_is_that_of_the_involute(build):
    env = build()
    values = stepped(env, 17)[-1]
    s, _ = foot(env.run.nozzle[-1], env._episodes.episodes[0].table.points[0])
    assert s > 15  # the nozzle is under way
    curvature = -1 / (RADIUS - A * angle(s + AHEAD))  # clockwise
    found = [values[name] for name in ("curvature", "curvature_2", "curvature_5", "curvature_10")]
    assert found == pytest.approx(curvature / 0.1, rel=2e-3)
    # an axis reverses at every quarter of the heading
    quarter = int(angle(s) // (np.pi / 2))
    to, since = way((quarter + 1) * np.pi / 2) - s, s - way(quarter * np.pi / 2)
    assert quarter >= 1
    assert values["to_reversal"] == pytest.approx(min(to / 10, 1), abs=2 * TABLE / 10)
    assert values["since_reversal"] == pytest.approx(min(since / 10, 1), abs=2 * TABLE / 10)


def test_the_gain_schedule_observes_the_last_interval_and_the_next_demand():
    env, ticks, period = SpiralTuningEnv(**SPIRAL, speed=200.0), 20, 1e-3
    values = stepped(env, 14)[-1]
    run, simulation = env.run, env._episodes.episodes[0].simulation
    errors = (run.commanded - run.encoder)[-2 * ticks :].reshape(2, ticks, 2).mean(axis=1)
    sent = int(env._episodes._sent[0])
    demand = simulation.position[sent - 1 : sent + ticks]
    for a, axis in enumerate("xy"):
        assert values[f"following_{axis}"] == pytest.approx(errors[1, a] / 0.01, rel=1e-5)
        assert values[f"following_change_{axis}"] == pytest.approx((errors[1, a] - errors[0, a]) / 0.01, rel=1e-4)
        velocity = (demand[-1, a] - demand[0, a]) / (ticks * period)
        assert values[f"velocity_{axis}"] == pytest.approx(velocity / 100, rel=1e-5)
    step = np.diff(simulation.position, axis=0) / period
    change = (step[sent + ticks - 2] - step[sent - 2]) / (ticks * period)
    assert [values["acceleration_x"], values["acceleration_y"]] == pytest.approx(change / 1000, rel=1e-4)
    start = env._episodes.episodes[0].table.points[0]
    distance = np.array([foot(nozzle, start)[1] for nozzle in run.nozzle[-ticks:]])
    assert values["contour_mean"] == pytest.approx(distance.mean() / 0.01, abs=0.01)
    assert values["contour_rms"] == pytest.approx(np.sqrt((distance**2).mean()) / 0.01, abs=0.01)
    length = np.linalg.norm(np.diff(run.nozzle[-ticks - 1 :], axis=0), axis=1).sum()
    assert values["speed"] == pytest.approx(length / (ticks * period) / 100, rel=1e-3)
    assert values["progress"] == pytest.approx(sent / len(simulation.position), rel=1e-6)


def test_the_servo_torque_observes_the_last_interval_and_the_next_demand():
    env = ServoTorqueEnv(**SPIRAL)
    ticks, period = env._episodes.source.ticks, 1e-3
    values = stepped(env, 14)[-1]
    tolerance = env._episodes.settings.tolerance
    run, simulation = env.run, env._episodes.episodes[0].simulation
    errors = (run.commanded - run.encoder)[-2 * ticks :].reshape(2, ticks, 2).mean(axis=1)
    sent = int(env._episodes._sent[0])
    demand = simulation.position[sent - 1 : sent + ticks]
    for a, axis in enumerate("xy"):
        assert values[f"following_{axis}"] == pytest.approx(errors[1, a] / tolerance, rel=1e-5)
        assert values[f"following_change_{axis}"] == pytest.approx((errors[1, a] - errors[0, a]) / tolerance, rel=1e-4)
        velocity = (demand[-1, a] - demand[0, a]) / (ticks * period)
        assert values[f"velocity_{axis}"] == pytest.approx(velocity / 100, rel=1e-5)
    start = env._episodes.episodes[0].table.points[0]
    distance = np.array([foot(nozzle, start)[1] for nozzle in run.nozzle[-ticks:]])
    assert values["contour_mean"] == pytest.approx(distance.mean() / tolerance, abs=0.02)
    assert 0 < values["progress"] < 1
    assert values["progress"] == pytest.approx(sent / len(simulation.position), rel=1e-6)


@pytest.mark.parametrize("kind", [SpiralTuningEnv, ServoTorqueEnv, BeadWidthEnv, SpeedOverrideEnv])
def test_a_new_episode_has_measured_nothing_whatever_was_before(kind):
    env = kind(**SPIRAL)
    first = env.reset(seed=2)[0]
    for _ in range(6):
        env.step(0.3 * np.ones(env.action_space.shape, np.float32))
    again = env.reset(seed=2)[0]
    assert again.tobytes() == first.tobytes()
    values = seen(env, again)
    measured = [name for name in values if name.startswith(("following", "contour", "action", "width"))]
    assert measured
    assert [values[name] for name in measured] == [0.0] * len(measured)
    assert values["progress"] == pytest.approx(0.0, abs=1e-3)


def test_values_of_an_episode_do_not_depend_on_those_before():
    env, fresh = SpiralTuningEnv(**SPIRAL), SpiralTuningEnv(**SPIRAL)
    hold = np.zeros(4, np.float32)
    env.reset(seed=4)
    for _ in range(9):
        env.step(hold)
    ends = []
    for one in (env, fresh):
        one.reset(seed=5)
        over = False
        while not over:
            *_, over, info = one.step(hold)
        ends.append(info)
    assert ends[0]["episode_contour_rms"] == ends[1]["episode_contour_rms"]
    laid = fresh.run.dispense
    start = fresh._episodes.episodes[0].table.points[0]
    distance = np.array([foot(nozzle, start)[1] for nozzle in fresh.run.nozzle[laid][::10]])
    assert ends[0]["episode_contour_rms"] == pytest.approx(np.sqrt((distance**2).mean()), rel=0.03)
    assert ends[0]["episode_contour_max"] >= np.abs(distance).max() - 1e-3
    assert ends[0]["episode_contour_max"] == pytest.approx(np.abs(distance).max(), rel=0.1)


@pytest.mark.parametrize("kind", [BeadWidthEnv, ServoTorqueEnv, SpeedOverrideEnv, SpiralTuningEnv])
def test_an_episode_goes_on_after_a_look_at_its_record(kind):
    looked_at, other = kind(), kind()
    for env in (looked_at, other):
        env.reset(seed=5)
    action = np.full(other.action_space.shape, 0.3, np.float32)
    records = []
    for _ in range(3):
        (observation, reward, *_), (unseen, reward_unseen, *_) = looked_at.step(action), other.step(action)
        assert np.array_equal(observation, unseen)
        assert reward == reward_unseen
        records.append(looked_at.run)
    first, *_, last = records
    assert not first.commanded.flags.writeable
    assert np.array_equal(first.commanded, last.commanded[: len(first.time)])
    assert np.array_equal(last.commanded, other.run.commanded)
