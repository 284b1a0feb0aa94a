"""SpeedOverride-v1 on the paths of jobs: it rests at corners, and all axes and the dispenser follow the program."""

import numpy as np
import pytest

from gantrysim import InputError, Job
from gantrysim.env import SpeedOverrideEnv, SpeedOverrideVectorEnv
from gantrysim.faults import EncoderSlip
from gantrysim.paths.profile import PointToPoint

from support.episodes import same
from support.soaked import suite_runs

ACCELERATION = 2000.0  # of the environment [mm/s²]
# longest change of the way in a tick: the last ticks before a stop are whole ones [mm]
CHANGE = 1.2 * ACCELERATION * 1e-3**2
LEGS = {
    "name": "legs",
    "machine": "xyz",
    "program": {
        "controller": "fanuc.Program",
        "start": [0.0, 0.0, 0.0],
        "acceleration": 3000.0,
        "program": "%\nO0001\nG21 G90\nG01 X40 F6000\nG00 Y30\nG01 X20 F6000\nM30\n%\n",
    },
    "dispenser": {"area": 2.0},
}


def still(env):
    """Run an episode at the program's speed and return its record and last info."""
    over = False
    while not over:
        *_, terminated, truncated, info = env.step(np.zeros(1, np.float32))
        over = terminated or truncated
    assert truncated
    return env.run, info


def test_each_leg_takes_the_time_of_a_motion_from_rest_to_rest():
    env = SpeedOverrideEnv(job=Job.model_validate(LEGS), spread=None)
    env.reset(seed=1)
    run, info = still(env)
    assert env._episodes.source.program_speed({}) == pytest.approx(100.0)
    assert run.requested.corners.tolist() == pytest.approx([40.0, 70.0])
    expected = sum(PointToPoint(leg, 100.0, ACCELERATION).duration for leg in (40.0, 30.0, 20.0))
    # a tick for each leg, as speeds change in ticks
    assert info["episode_time"] == pytest.approx(expected, abs=3 * run.period)
    # the program switches it off at the first corner, on at the second, and off at the end
    switched = 1 + np.flatnonzero(np.diff(run.dispense.astype(int)))
    assert run.progress[switched] == pytest.approx([40.0, 70.0, 90.0], abs=0.01)
    assert run.dispense[0]
    assert run.commanded[-1] == pytest.approx([20.0, 30.0, 0.0], abs=1e-9)


@pytest.mark.parametrize(
    "name", suite_runs(["softmc-arc", "fanuc-conical", "slicer-square", "svg-gasket", "delta-arc"], 0, 4)
)
def test_a_job_is_followed_exactly_and_rests_at_its_corners(name):
    env = SpeedOverrideEnv(job=name, spread=None)
    env.reset(seed=1)
    run, _ = still(env)
    job = Job.load(name)
    path = run.requested
    asked = job.setpoints
    away = run.commanded_tip - path.position(run.progress)
    assert np.abs(away).max() < 1e-9
    assert run.progress[-1] == path.length
    way = np.diff(run.progress)
    assert (np.abs(np.diff(way)) <= CHANGE).all()
    for corner in path.corners:
        reached = np.flatnonzero(run.progress == corner)
        assert reached.size
        assert run.progress[reached[0]] - run.progress[reached[0] - 1] <= CHANGE
    # at the same place of the path the dispenser is as the program has it, but for a tick at each switch
    program = asked.dispense[np.searchsorted(asked.progress, run.progress, "right") - 1]
    assert np.count_nonzero(program != run.dispense) == 0
    for axis in set(asked.axes) - set("xyz"):
        turned = np.interp(run.progress, asked.progress, asked.position[:, asked.axes.index(axis)])
        # cubics through the program's ticks, which lines join
        assert run.commanded[:, run.axes.index(axis)] == pytest.approx(turned, abs=0.05)


def test_an_episode_on_a_job_goes_on_from_a_saved_moment():
    env, other = (SpeedOverrideEnv(job=Job.model_validate(LEGS)) for _ in range(2))
    env.reset(seed=3)
    for _ in range(12):
        env.step(np.full(1, 0.1, np.float32))
    assert same(other.restore(env.save()), env.restore(env.save()))
    (run, info), (again, others) = still(env), still(other)
    assert info == others
    for name in ("commanded", "progress", "dispense", "nozzle"):
        assert np.array_equal(getattr(run, name), getattr(again, name))


def test_deliberate_faults_of_a_job_act():
    """An encoder that slips by 50 counts of 1 µm moves the nozzle by 50 µm off a path without corners there."""
    slip = EncoderSlip(time=0.2, axis="y", counts=50)
    job = Job.model_validate(LEGS).model_copy(update={"faults": (slip,)})
    env = SpeedOverrideEnv(job=job, spread=None)
    env.reset(seed=1)
    run, info = still(env)
    assert run.injected == (slip,)
    assert info["episode_contour_max"] == pytest.approx(0.05, rel=0.2)


def test_places_with_paths_of_different_lengths_do_not_disturb_one_another():
    settings = {"diameter": (36.0, 60.0), "turns": 1, "spread": None}
    envs = SpeedOverrideVectorEnv(3, **settings)
    envs.reset(seed=5)
    alone = [SpeedOverrideEnv(**settings) for _ in range(3)]
    for k, env in enumerate(alone):
        env.reset(seed=5 + k)
    actions = np.linspace(-1, 1, 8)[:, None, None] * np.array([[1.0], [-0.5], [0.2]])
    for action in actions:
        seen, rewards, *_ = envs.step(action.astype(np.float32))
        for k, env in enumerate(alone):
            one, reward, *_ = env.step(action[k].astype(np.float32))
            assert np.array_equal(seen[k], one)
            assert rewards[k] == reward


@pytest.mark.parametrize(
    ("settings", "text"),
    [
        (
            {"job": "stage-outline"},
            "machine stage turns its work: SpeedOverride-v1 needs a job whose program moves the ",
        ),
        (
            {"job": "fanuc-conical", "fastest": 3.0},
            r"fastest = 3: z of job fanuc-conical would exceed its limit of 250 mm/s; use at most 2\.08",
        ),
    ],
)
def test_jobs_whose_axes_bound_the_speed_are_refused(settings, text):
    with pytest.raises(InputError, match=text):
        SpeedOverrideEnv(**settings)
