"""Setpoints on the requested path, and finely sampled ones: what changes, and what must not."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline

from gantrysim import Job, Machine, Servo, perfect_follower
from gantrysim.job.ideal import FINE_PERIOD, finely_sampled, on_the_path, spline_through, unhurried_feet
from gantrysim.job.loading import builtin_jobs
from gantrysim.metrics.analysis import Analysis
from gantrysim.paths.arcs import ArcChain
from gantrysim.record.setpoints import Setpoints, Supervision

from support.runs import PERIOD, ramp
from support.soaked import examples

ON_THE_PATH = 1e-9  # [mm]
PROGRESS = 1e-6  # of a foot where it does not jump [mm]
FINER = 16  # ticks in one of the program's, of 62.5 µs in 1 ms
MACHINE = Machine("xy")
SERVO = Servo.derive(MACHINE.axes)
SPLINE = 0.003  # w^4 T^4 R of the greatest departure of a cubic spline from a circle: 1 / 384

CORNERS = """
N10 G17 G21 G90
N20 G01 X40 Y0 F7200
N30 G01 X40 Y30
N40 G01 X0 Y0
"""


def rounded(blend_time):
    return Job.load("fanuc-spiral", (f"blend_time={blend_time}",)).changed({"program.program": CORNERS})


def foot(machine, setpoints):
    return Analysis(perfect_follower(machine, setpoints)).commanded


ROUNDING = ("fanuc-conical", "linuxcnc-flanges", "slicer-square")  # jobs that round corners


@pytest.mark.parametrize("name", builtin_jobs())
def test_every_job_s_command_can_be_moved_onto_its_path_at_the_same_progress(name):
    job = Job.load(name)
    machine, before = job.built_machine, foot(job.built_machine, job.setpoints)
    moved = on_the_path(machine, job.setpoints)
    after = foot(machine, moved)
    assert after.distance.max() < ON_THE_PATH
    assert np.abs(after.s - before.s).max() < (0.1 if name in ROUNDING else PROGRESS)
    assert (moved is job.setpoints) == (before.distance.max() < ON_THE_PATH)
    for field in ("period", "axes", "requested", "supervision"):
        assert getattr(moved, field) == getattr(job.setpoints, field)
    assert moved.dispense.tolist() == job.setpoints.dispense.tolist()
    assert moved.gates.tolist() == job.setpoints.gates.tolist()
    # rotary axes keep their angles, and nothing jumps where the dispenser is switched
    kept = [column for column, axis in enumerate(job.setpoints.axes) if axis in ("r", "th")]
    assert np.array_equal(moved.position[:, kept], job.setpoints.position[:, kept])
    steps, own = (np.abs(np.diff(one.position, axis=0)).max() for one in (moved, job.setpoints))
    assert steps < 1.1 * own


@pytest.mark.parametrize("blend_time", [0.005, 0.02, 0.05])
def test_a_rounded_corner_is_taken_sharp_without_a_jump(blend_time):
    job = rounded(blend_time)
    before = foot(job.built_machine, job.setpoints)
    after = foot(job.built_machine, on_the_path(job.built_machine, job.setpoints))
    assert after.distance.max() < ON_THE_PATH
    assert np.diff(after.s).min() > -PROGRESS
    tip = perfect_follower(job.built_machine, job.setpoints).commanded_tip[job.setpoints.dispense]
    steps = np.linalg.norm(np.diff(tip, axis=0), axis=1)
    assert np.all(np.diff(after.s) <= 1.5 * steps + PROGRESS)
    far = np.abs(before.s[:, None] - job.setpoints.requested.corners).min(axis=1) > 8 * blend_time * 120
    assert after.s[far] == pytest.approx(before.s[far], abs=PROGRESS)
    if blend_time == 0.05:  # the nearest point itself does jump
        assert np.diff(before.s).max() > 4 * steps.max()


@pytest.mark.parametrize("name", ["stage-outline", "fanuc-conical"])
def test_the_slides_bring_the_nozzle_back_whatever_the_rotary_axes_do(name):
    """The linear axes are displaced by a tenth of a millimetre that turns round, at any angle of the rotary ones."""
    job = Job.load(name)
    setpoints, t = job.setpoints, np.arange(len(job.setpoints.position)) * 1e-3
    position = setpoints.position.copy()
    for k, column in enumerate(column for column, axis in enumerate(setpoints.axes) if axis in "xyz"):
        position[:, column] += 0.1 * np.sin(2 * np.pi * t + 2 * k)
    displaced = replace(setpoints, position=position)
    assert foot(job.built_machine, displaced).distance.max() > 0.05
    moved = on_the_path(job.built_machine, displaced)
    assert foot(job.built_machine, moved).distance.max() < ON_THE_PATH


@given(st.lists(st.tuples(st.floats(0, 1), st.floats(-0.5, 8)), min_size=1, max_size=60))
@examples(100)
def test_feet_are_spread_where_they_hurry_and_nowhere_else(moves):
    """Moves: steps of a command along a line, and those of its foot in units of them."""
    steps = np.array([step for step, _ in moves])
    tip = np.append(0.0, np.cumsum(steps))[:, None] * np.eye(3)[0]
    s = np.append(0.0, np.cumsum([step * haste for step, haste in moves]))
    spread = unhurried_feet(s, tip)
    assert np.all(np.diff(spread) <= 1.5 * steps + 1e-12 * (1 + np.abs(s).max()))
    if max(haste for _, haste in moves) <= 1.5:
        assert spread == pytest.approx(s, abs=1e-12 * (1 + np.abs(s).max()))
    assert spread.min() >= s.min() - 1e-9
    assert spread.max() <= s.max() + 1e-9


def test_the_correction_is_carried_on_while_the_dispenser_is_off(xy):
    """A command beside a line by a different amount in each of two stretches of dispensing."""
    along = np.arange(301) * 0.1
    beside = np.interp(along, [0, 10, 20, 30], [0.2, 0.2, -0.1, -0.1])
    dispense = (along < 10) | (along > 20)
    line = ArcChain((0.0, 0.0), 0.0, [0.0], [30.0])
    setpoints = Setpoints(PERIOD, ("x", "y"), np.column_stack([along, beside]), dispense, line)
    moved = on_the_path(xy, setpoints).position
    assert moved == pytest.approx(np.column_stack([along, np.zeros(301)]), abs=3e-3)  # one tick of the slope
    assert np.abs(moved[dispense, 1]).max() < ON_THE_PATH


CIRCLE = ArcChain((40.0, 0.0), math.pi / 2, [1 / 40], [2 * math.pi * 40])


def test_a_finely_sampled_circle_is_the_circle(xy):
    setpoints = Setpoints.along(CIRCLE, 200.0, PERIOD)
    servo, fine = finely_sampled(xy, Servo.derive(xy.axes, delay=PERIOD), setpoints)
    assert (servo.period, servo.delay, fine.period) == (PERIOD / FINER, 0.0, PERIOD / FINER)
    assert servo.period == FINE_PERIOD
    assert servo.with_values(period=PERIOD, delay=PERIOD) == Servo.derive(xy.axes, delay=PERIOD)
    assert np.array_equal(fine.position[::FINER], setpoints.position)
    angle = np.arange(len(fine.position)) * fine.period * 200.0 / 40.0
    exact = 40 * np.column_stack([np.cos(angle), np.sin(angle)])
    steady = slice(20 * FINER, -20 * FINER)  # a circle at once is at no rest before its start
    assert np.abs(fine.position - exact)[steady].max() < SPLINE * 40 * (200 / 40 * PERIOD) ** 4 + 1e-12
    acceleration = np.diff(fine.position[steady], 2, axis=0) / fine.period**2
    assert np.linalg.norm(acceleration, axis=1) == pytest.approx(np.full(len(acceleration), 200**2 / 40), rel=1e-4)


def test_a_command_that_starts_from_rest_has_no_pulse_of_acceleration(xy):
    t = np.arange(201) * PERIOD
    way = 0.5 * 2000 * t**2
    line = ArcChain((0.0, 0.0), 0.0, [0.0], [float(way[-1])])
    setpoints = Setpoints(PERIOD, ("x",), way[:, None], np.ones(201, bool), line)
    _, fine = finely_sampled(xy, Servo.derive(xy.axes), setpoints)
    acceleration = np.diff(fine.position[: -20 * FINER, 0], 2) / fine.period**2
    assert acceleration == pytest.approx(np.full(acceleration.size, 2000.0), rel=1e-3)


@given(st.lists(st.floats(-1, 1), min_size=3, max_size=40), st.floats(0.1, 20))
@examples(60)
def test_finely_sampled_setpoints_keep_to_the_machine_s_travel_and_speed(moves, size):
    step = np.clip(np.array(moves) * size, -1.0, 1.0)  # [mm], at the limit of 1000 mm/s in a tick of 1 ms
    x = np.clip(np.cumsum(step), -150, 150)
    line = ArcChain((-150.0, 0.0), 0.0, [0.0], [300.0])
    setpoints = Setpoints(PERIOD, ("x",), x[:, None], np.ones(x.size, bool), line)
    _, fine = finely_sampled(MACHINE, SERVO, setpoints)
    assert np.abs(fine.position).max() <= 150.0
    assert np.abs(np.diff(fine.position, axis=0)).max() <= 1000.0 * fine.period * (1 + 1e-9)
    assert np.array_equal(fine.position[::FINER], setpoints.position)
    perfect_follower(MACHINE, fine)  # which checks them


def test_the_dispenser_is_on_between_ticks_at_which_it_is(xy):
    dispense = np.array([False, True, True, False, True, False, False])
    setpoints = Setpoints(
        PERIOD,
        ("x",),
        np.zeros((7, 1)),
        dispense,
        ramp(10.0).requested,
        Supervision(position_error=1.0, position_error_delay=3, settle_error=0.1),
        np.array([2, 5]),
    )
    _, fine = finely_sampled(xy, SERVO, setpoints)
    on = np.zeros(6 * FINER + 1, bool)
    on[FINER : 2 * FINER + 1] = on[4 * FINER] = True
    assert fine.dispense.tolist() == on.tolist()
    assert fine.gates.tolist() == [2 * FINER, 5 * FINER]
    assert fine.supervision == replace(setpoints.supervision, position_error_delay=3 * FINER)
    assert fine.duration == pytest.approx(setpoints.duration)


@pytest.mark.parametrize("count", [2, 3, 4, 200])
def test_the_spline_is_scipys_clamped_one(count):
    knots = np.cumsum(np.random.default_rng(count).normal(size=(count, 3)), axis=0)
    points = np.arange((count - 1) * 16 + 1) / 16
    expected = CubicSpline(np.arange(count), knots, bc_type="clamped")(points)
    np.testing.assert_allclose(spline_through(knots, 16), expected, rtol=0, atol=1e-12)
