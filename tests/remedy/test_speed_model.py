"""Speeds of stretches from shares of limits in closed form, and speeds as people would write them."""

import numpy as np
import pytest

from gantrysim.controllers.speeds import Stretches
from gantrysim.remedy.by_place import _Search
from gantrysim.remedy.speed_model import (
    ENDS,
    LARGEST_ERROR,
    LEVEL,
    TARGET,
    WIDTH,
    LocalUsage,
    SpeedModel,
    _merged_speeds,
    few_speeds,
)

BANDWIDTH = 150.0  # k of a first-order axis [rad/s]
TOLERANCE = 0.02  # [mm]
FRICTION = 0.012  # error at every reversal [mm]
DELAY = 0.01  # of the valve [s]
STOP = 2.0  # allowed excess at a stop [mm]
PROGRAMMED = 100.0  # [mm/s]
# straight, arc, straight, arc, straight
LENGTHS = np.array([150.0, 15.0, 150.0, 40.0, 150.0])  # [mm]
RADII = np.array([np.inf, 10.0, np.inf, 25.0, np.inf])  # [mm]


def path():
    return Stretches.of(LENGTHS.tolist(), [1, 2, 3, 4, 5], [PROGRAMMED] * 5)


def usage(speeds, steps=0.0):
    """What first-order axes, friction and a late valve use of their limits; steps of the speed add to the contour."""
    shares = np.zeros((4, 5, 2))
    lag = speeds**2 / (RADII * BANDWIDTH**2)
    shares[LARGEST_ERROR] = np.repeat(lag, 2).reshape(-1, 2) / TOLERANCE
    shares[LEVEL] = shares[LARGEST_ERROR]
    shares[LARGEST_ERROR, 4, 0] = FRICTION / TOLERANCE
    shares[ENDS, 4, 1] = DELAY * speeds[4] / STOP
    change = np.abs(np.diff(speeds)) / np.minimum(speeds[1:], speeds[:-1])
    shares[WIDTH, 1:, 0] = 0.01 + steps * change
    return LocalUsage(shares, speeds)


def model_of_two_runs(factor=0.7):
    model = SpeedModel(path())
    even = np.full(5, PROGRAMMED)
    model.add_even_run(usage(even), 1.0)
    model.add_even_run(usage(factor * even), factor)
    return model


def allowed(radius):
    """The speed at which v² / (R k²) is its share of the tolerance [mm/s]."""
    return BANDWIDTH * np.sqrt(TARGET * TOLERANCE * radius)


@pytest.mark.parametrize("factor", [0.5, 0.7, 0.85])
def test_the_arcs_alone_are_slowed_to_their_closed_form(factor):
    speeds = model_of_two_runs(factor).speeds(0.05, 1.0)
    assert speeds[1] == pytest.approx(allowed(10.0))
    assert speeds[3] == pytest.approx(allowed(25.0))
    assert allowed(10.0) < allowed(25.0) < PROGRAMMED
    assert speeds[[0, 2, 4]] == pytest.approx(PROGRAMMED)


def test_an_error_of_friction_does_not_slow_its_stretch_and_a_late_valve_does():
    # FRICTION is more than half of the tolerance at any speed; the valve is late by DELAY v
    speeds = model_of_two_runs(1.4).speeds(0.05, 4.0)
    assert speeds[4] == pytest.approx(TARGET * STOP / DELAY)


def test_steps_of_the_speed_become_as_small_as_the_bead_admits():
    model = model_of_two_runs()
    speeds = model.speeds(0.05, 1.0)
    for _ in range(6):
        model.add_run(usage(speeds, steps=3.0), speeds, 0.5)
        speeds = model.speeds(0.05, 1.0)
    change = np.abs(np.diff(speeds)) / np.minimum(speeds[1:], speeds[:-1])
    # 0.01 + 3 change = TARGET
    assert change.max() <= (TARGET - 0.01) / 3.0 * 1.02
    assert speeds[0] > speeds[1]
    assert usage(speeds, steps=3.0).shares.max() <= max(TARGET * 1.02, FRICTION / TOLERANCE)


def test_the_level_follows_what_the_whole_path_uses_of_its_limit():
    model = model_of_two_runs()
    before = model.speeds(0.05, 1.0)
    model.add_run(usage(before), before, 0.5)
    assert model.level == pytest.approx(TARGET / 0.5)
    model.add_run(usage(before), before, 1.2)
    assert model.level == pytest.approx(TARGET**2 / 0.6)


def test_a_stretch_may_use_its_level_of_the_limit_of_95_percent():
    """With twice the room to the largest error, v² / (R k²) of the arcs is the level times its share."""

    def level_alone(speeds):
        shares = usage(speeds).shares
        shares[[LARGEST_ERROR, WIDTH, ENDS]] *= 0.5
        return LocalUsage(shares, speeds)

    model = SpeedModel(path())
    even = np.full(5, 50.0)
    model.add_even_run(level_alone(2 * even), 1.0)
    model.add_even_run(level_alone(even), 0.5)
    assert model.speeds(0.05, 1.0)[1] == pytest.approx(allowed(10.0))
    model.add_run(level_alone(even), even, TARGET / 1.44)
    assert model.speeds(0.05, 1.0)[1] == pytest.approx(1.2 * allowed(10.0))


def test_starts_and_stops_are_slow_and_the_way_between_is_not():
    stretches = Stretches.of([10.0] * 20, list(range(20)), [PROGRAMMED] * 20)
    model = SpeedModel(stretches)
    model.add_even_run(LocalUsage(np.full((4, 20, 2), 0.1), np.full(20, PROGRAMMED)), 1.0)
    speeds = model.slow_ends()
    assert speeds[[0, -1]] == pytest.approx(0.3 * PROGRAMMED)
    assert speeds[6:14] == pytest.approx(PROGRAMMED)
    assert (np.maximum(speeds[1:], speeds[:-1]) / np.minimum(speeds[1:], speeds[:-1])).max() <= 1.25 * (1 + 1e-9)


def test_written_speeds_are_few_never_above_those_wanted_and_cost_one_percent():
    rng = np.random.default_rng(3)
    count = 200
    lengths = rng.uniform(1.0, 20.0, count)
    wanted = dict(enumerate((60 + 30 * np.sin(np.arange(count) / 80) + rng.uniform(-0.3, 0.3, count)).tolist()))
    stretches = Stretches.of(lengths.tolist(), list(range(count)), [50.0] * count)
    few = few_speeds(wanted, stretches)
    assert all(few[place] <= wanted[place] for place in wanted)
    assert all(float(f"{speed:.3g}") == speed for speed in few.values())
    changes = sum(few[k] != few[k - 1] for k in range(1, count))
    assert changes < count / 4
    time = sum(length / few[k] for k, length in enumerate(lengths))
    rounded = sum(length / (np.floor(10 * wanted[k]) / 10) for k, length in enumerate(lengths))
    assert time <= 1.011 * rounded


def test_a_speed_just_below_the_one_wanted_stays():
    stretches = Stretches.of([10.0, 10.0], [1, 2], [123.45, 123.45])
    assert few_speeds({1: 125.0, 2: 200.0}, stretches) == {1: 123.45, 2: 200.0}


def test_a_line_that_runs_twice_is_as_fast_as_its_slowest_pass():
    """As one in a loop: whichever pass comes last."""
    for speeds in ([90.0, 50.0, 30.0], [30.0, 50.0, 90.0]):
        search = _Search(None, Stretches.of([10.0] * 3, [1, 2, 1], [PROGRAMMED] * 3), [{}], None)
        search._model.add_even_run(LocalUsage(np.zeros((4, 3, 2)), np.full(3, PROGRAMMED)), 1.0)
        assert search._written_speeds(np.array(speeds)) == {1: 30.0, 2: 50.0}


@pytest.mark.parametrize(
    ("speeds", "merged"),
    [
        # 70 lies within a fifth of its neighbour, but not of the fastest of the group
        ([100.0, 85.0, 82.0, 70.0], [82.0, 82.0, 82.0, 70.0]),
        ([70.0, 82.0, 85.0, 100.0], [70.0, 70.0, 70.0, 100.0]),
        ([80.0, 100.0, 81.0], [80.0, 80.0, 80.0]),
        ([50.0], [50.0]),
        ([], []),
    ],
)
def test_neighbours_within_a_fifth_of_the_fastest_are_joined_at_the_slowest(speeds, merged):
    assert _merged_speeds(speeds, 0.2) == merged
