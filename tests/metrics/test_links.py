"""Links of the error budget at corners: displacements, whatever the path, the order of its legs and the step.

The oracle is the distance of the two points that a link lies between: no link moves the nozzle off the path by more.
"""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gantrysim import Budget, Machine, Servo, perfect_follower, simulate
from gantrysim.controllers.fanuc import Program as Fanuc
from gantrysim.controllers.gcode import linuxcnc
from gantrysim.controllers.softmc import Group, Program
from gantrysim.paths.chain import Chain
from gantrysim.paths.pieces import Line

from support.corners import CORNERED_SEEDS, cornered_run
from support.jobs import job_run
from support.links import distances, excess, record
from support.soaked import examples

SUM = 1e-11  # of the parts against the whole [mm]
STEP = 0.01  # of a link, between two physics steps, relative
LEAST_STEP = 3e-4  # the same [mm]


def sums(budget):
    parts = [*budget.parts.values(), *([] if budget.corner is None else [budget.corner])]
    return [
        np.abs(sum(getattr(part, name) for part in parts) - getattr(budget.contour, name)).max()
        for name in ("lateral", "vertical", "beyond")
    ]


def test_the_links_of_a_stop_at_a_sharp_corner_are_no_larger_than_what_they_span(xy):
    """An overshoot beyond a corner of 120 degrees, where the feet of the traces lie on both its legs."""
    program = Program(program="Move G1 {30,0}\nMove G1 {15,25.980762}", group=Group(velocity=40.0, acceleration=3000.0))
    servo = Servo.derive(xy.axes, 0.001, integral_time=0.03)
    budget = Budget(simulate(xy, servo, program.setpoints(servo.period)))
    spans = distances(budget)
    assert budget.contour.size.max() > 0.02  # it overshoots
    for link in ("servo", "encoder", "structure"):
        assert budget.parts[link].size.max() <= spans[link].max() + 1e-9
    assert budget.parts["encoder"].size.max() < 0.75e-3  # half a count of 1 µm on each axis
    assert max(sums(budget)) < SUM


def steps_apart(seed):
    """Check the links of a random program, and return whether its maxima differ between two physics steps."""
    coarse, fine = (Budget(cornered_run(seed, step)) for step in (None, 12.5e-6))
    for budget in (coarse, fine):
        assert max(excess(budget).values()) <= 1e-6
        assert max(sums(budget)) < SUM
        assert np.abs(budget.lag).max() <= 1.02 * distances(budget)["lag"].max()
    differ = False
    for link in ("encoder", "structure"):
        parts = [budget.values.parts[link] for budget in (coarse, fine)]
        tolerance = max(LEAST_STEP, STEP * parts[1].max)
        assert abs(parts[0].rms - parts[1].rms) < tolerance
        assert abs(parts[0].p95 - parts[1].p95) < tolerance
        differ |= abs(parts[0].max - parts[1].max) > tolerance
    return differ


@pytest.mark.validates(
    "a link of the budget at corners of random programs",
    "distance of its two points: never larger",
    "1e-6 mm",
)
@pytest.mark.parametrize("seed", CORNERED_SEEDS)
def test_links_of_random_programs_are_displacements_at_any_step(seed):
    """Polylines, arcs, rests and reversals on three controllers, without friction, which alone scatters."""
    assert not steps_apart(seed)


@pytest.mark.soak
def test_links_of_two_hundred_random_programs_are_displacements_at_any_step(record_property):
    """The maximum of a link between the legs of a corner depends on where a tick falls there, by its displacement."""
    assert sum(steps_apart(seed) for seed in range(200)) <= 6
    record_property("attack", "error budget: links at corners of random programs, at the default step and at 12.5 µs")
    record_property("tries", 200)


@given(st.integers(0, 10**6), st.floats(0.0, 0.3), st.floats(0.0, 0.05))
@examples(25)
def test_links_of_any_traces_about_a_bent_path_are_displacements(seed, rounding, link):
    """Traces that round corners, overshoot and lag, each with a small displacement from the one before."""
    rng = np.random.default_rng(seed)
    points = np.cumsum(rng.uniform(-12, 12, (5, 3)) * (1, 1, rng.integers(2)), axis=0)
    path = Chain([Line(tuple(a), tuple(b)) for a, b in itertools.pairwise(points)])
    s = np.linspace(0, path.length, 1500)
    rounded = np.stack(
        [
            np.interp(s[:, None] + rounding * np.linspace(-3, 3, 9), s, path.position(s)[:, i]).mean(axis=1)
            for i in range(3)
        ],
        axis=1,
    )
    lagged = np.stack([np.interp(s - 0.2, s, rounded[:, i]) for i in range(3)], axis=1)
    wave = np.stack([link * np.sin(s / rng.uniform(1, 9) + rng.uniform(0, 6)) for _ in range(3)], axis=1)
    on = path.position(s)
    run = record(path, s, commanded=rounded - on, encoder=lagged - rounded, motor=wave, nozzle=-0.5 * wave)
    budget = Budget(run)
    spans = distances(budget)
    for name in ("servo", "encoder", "structure"):
        assert np.all(budget.parts[name].size <= spans[name] + 2e-9)
    assert max(sums(budget)) < SUM
    program = budget.parts["program"].size
    assert program == pytest.approx(budget.analysis.commanded.distance, abs=1e-9)


def test_servo_by_axis_adds_up_across_corners_too(xy):
    program = Fanuc("G1 X30 Y5 F4000\nX5 Y9\nX30 Y20\nX0 Y20\nM02", acceleration=2000.0)
    servo = Servo.derive(xy.axes, 0.001)
    budget = Budget(simulate(xy, servo, program.setpoints(servo.period)))
    by_axis = budget.servo_by_axis(xy).values()
    for component in ("lateral", "vertical", "beyond"):
        whole = getattr(budget.parts["servo"], component)
        assert sum(getattr(part, component) for part in by_axis) == pytest.approx(whole, abs=1e-5)


UP_AND_OVER = {
    "up, over, down, then a rectangle": "G0 Z10\nG0 X6 Y11\nG0 Z1\nG1 X15 Y11 F655\nX15 Y40\nX6 Y40\nX6 Y11\nG1 Z10",
    "two rectangles": (
        "G0 Z10\nG0 X17 Y22\nG1 Z2 F2619\nG1 X34 Y43 F1002\nX34 Y22\nX17 Y22\nX17 Y43\nG0 Z10\nG0 Z2\n"
        "G1 X-1 Y21 F4788\nX8 Y21\nX8 Y31\nX-1 Y31\nX-1 Y21\nG1 Z10"
    ),
    "over its own start again": "G0 X-2 Y0 Z10\nG0 Z0.5\nG1 X6 Y0 F5681\nX6 Y22\nX-2 Y22\nX-2 Y0\nX6 Y0\nG0 Z10",
    "the same place twice": "G0 Z5\nG0 X5 Y5\nG0 Z1\nG1 X20 F1200\nG0 Z9\nG0 X5\nG0 Z1\nG1 X20 F1200\nG0 Z9\nM2",
}


@pytest.mark.parametrize("name", UP_AND_OVER)
def test_glue_that_begins_after_moves_without_glue_is_measured_where_it_is(name, xyz: Machine):
    """The way to the glue is longer than twice the distance to it, and there are such ways between beads, too."""
    program = linuxcnc.Program(text=f"G21 G17 G90 G94\nG64 P0.05\n{UP_AND_OVER[name]}\nM2")
    run = perfect_follower(xyz, program.setpoints(0.001))
    budget = Budget(run)
    assert budget.contour.size.max() < 0.06  # the corners' tolerance, where they were millimetres
    assert budget.contour.size == pytest.approx(budget.parts["program"].size, abs=1e-12)
    # the oracle: every commanded position lies at the length that the command has travelled
    travelled = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(run.commanded_tip, axis=0), axis=1))])
    cut = 8 * 0.06 * len(run.requested.corners)  # by which rounded corners shorten the way
    assert np.abs(budget.analysis.nozzle.s - travelled[budget.analysis.ticks]).max() < cut


def test_the_error_along_a_path_with_corners_is_no_more_than_the_following_error(xyz: Machine):
    """At rounded corners the feet of command and nozzle lie on both legs, 0.2 mm apart for 0.05 mm."""
    program = linuxcnc.Program(text=f"G21 G17 G90 G94\nG64 P0.05\n{UP_AND_OVER['two rectangles']}\nM2")
    servo = Servo.derive(xyz.axes, 0.001, integral_time=0.03)
    run = simulate(xyz, servo, program.setpoints(servo.period))
    budget = Budget(run)
    following = np.linalg.norm(run.commanded_tip - run.nozzle, axis=1)[budget.analysis.ticks]
    assert np.all(np.abs(budget.lag) <= 1.01 * following + 1e-6)
    assert budget.values.lag.max < 1.0  # [mm], not the millimetres of the feet


def test_stretches_cover_the_path_and_hold_the_largest_error():
    for name in ("fanuc-conical", "softmc-helical", "an225"):
        budget = Budget(job_run(name))
        stretches = [stretch.ticks for stretch in budget.stretches]
        assert stretches[0].start == 0
        assert stretches[-1].stop == budget.analysis.ticks.size
        assert all(a.stop == b.start for a, b in itertools.pairwise(stretches))
        values = budget.values
        sizes = [stretch.ticks.stop - stretch.ticks.start for stretch in budget.stretches]
        squares = [turn.parts["contour"].rms ** 2 for turn in values.turns]
        assert math.sqrt(np.average(squares, weights=sizes)) == pytest.approx(values.contour.rms)
        assert max(turn.parts["contour"].max for turn in values.turns) == values.contour.max
        assert any(turn.s[0] <= values.contour.s <= turn.s[1] for turn in values.turns)


@pytest.mark.parametrize("name", ["trio-basic", "svg-gasket", "linuxcnc-flanges"])
def test_a_path_that_is_no_spiral_has_no_turns(name):
    assert Budget(job_run(name)).values.turns == ()
