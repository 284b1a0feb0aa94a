"""FANUC's high-precision contour control: corners rounded by a moving average, within the acceleration."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gantrysim.controllers.fanuc import Arc, Line, Program, Spiral

from support.soaked import examples

PERIOD = 1e-3
OVER = 5e-3  # relative, by which a second difference may pass the limit between the places looked at
SPEED = 1e-6  # relative


def second_differences(setpoints):
    padded = np.pad(setpoints.position, ((2, 2), (0, 0)), mode="edge")
    return np.diff(padded, 2, axis=0) / setpoints.period**2


def steps(setpoints):
    return np.linalg.norm(np.diff(setpoints.position, axis=0), axis=1) / setpoints.period


SQUARE = "G01 X40 F3000\nY40\nX0\nY0"
MIXED = "G02 X0 Y-30 I0 J-100 Q-20 F6000\nG01 X40\nG03 X60 Y-10 I0 J20\nG00 X0 Y0"


@pytest.mark.parametrize(("text", "start"), [(SQUARE, (0, 0, 0)), (MIXED, (0, 100, 0))])
@pytest.mark.parametrize("acceleration", [300, 2000])
@pytest.mark.parametrize("blend_time", [0.01, 0.05, 0.0104])
def test_commanded_acceleration_stays_within_the_limit(text, start, acceleration, blend_time):
    made = Program(text, start=start, acceleration=acceleration, blend_time=blend_time, rapid=6000)
    most = np.abs(second_differences(made.setpoints(PERIOD))).max()
    assert most <= acceleration * (1 + OVER)
    assert most > 0.3 * acceleration


def test_without_blending_the_corner_is_a_stop_and_with_it_is_not():
    def slowest(**parameters):
        setpoints = Program(SQUARE, acceleration=2000, **parameters).setpoints(PERIOD)
        middle = steps(setpoints)[300:-300]
        return middle.min()

    assert slowest() < 1
    assert slowest(blend_time=0.02) > 5


def test_a_blended_corner_is_rounded_and_an_exact_stop_is_not():
    def nearest(text):
        position = Program(text, acceleration=2000, blend_time=0.05).setpoints(PERIOD).position
        return np.linalg.norm(position - [40, 0], axis=1).min()

    assert 0.05 < nearest(SQUARE) < 2
    assert nearest(SQUARE.replace("G01 X40", "G61 G01 X40")) < 1e-6


def test_the_corner_is_passed_at_the_speed_whose_jump_takes_half_the_acceleration():
    """sqrt(2) v = A tau / 2 for a right angle; the ramps take the other half, on 40 mm up to 100 mm/s and down to v."""
    made = Program("G01 X40 F6000\nY40", acceleration=1000, blend_time=0.05)
    a, v = 500.0, 500 * 0.05 / math.sqrt(2)
    ramps = (100 / a, (100 - v) / a)
    covered = 100**2 / (2 * a) + (100**2 - v**2) / (2 * a)
    assert made.duration == pytest.approx(2 * (sum(ramps) + (40 - covered) / 100) + 0.05, rel=2e-3)


def test_a_dwell_rests_for_its_time_in_blended_motion_too():
    made = Program("G01 X40 F3000\nG04 X0.3\nY40", acceleration=2000, blend_time=0.05)
    position = made.setpoints(PERIOD).position
    assert np.sum(np.linalg.norm(position - [40, 0], axis=1) < 1e-9) == pytest.approx(300, abs=2)


def test_without_a_limit_the_feed_is_constant_throughout():
    made = Program(MIXED, start=(0, 100, 0), blend_time=0.02, rapid=6000)
    assert made.duration == pytest.approx(made.requested.length / 100 + 0.02)
    setpoints = made.setpoints(PERIOD)
    middle = steps(setpoints)[100:14000]
    assert middle == pytest.approx(np.full(middle.size, 100.0), rel=1e-3)
    assert setpoints.position[-1] == pytest.approx([0, 0], abs=1e-9)


@pytest.mark.parametrize("blend_time", [0.0, 0.02])
def test_blended_motion_starts_and_ends_where_the_program_does(blend_time):
    position = Program(SQUARE, acceleration=1000, blend_time=blend_time).setpoints(PERIOD).position
    assert position[0] == pytest.approx([0, 0], abs=1e-12)
    assert position[-1] == pytest.approx([0, 0], abs=1e-9)


def test_glue_is_switched_where_the_average_is():
    made = Program("G00 X50\nG01 X100 F3000\nG00 X150", rapid=3000, blend_time=0.1)
    setpoints = made.setpoints(PERIOD)
    x = setpoints.position[setpoints.dispense, 0]
    assert (x[0], x[-1]) == pytest.approx((50, 100), abs=0.2)


@st.composite
def contours(draw):
    """Lines, short ones too, arcs and spirals in any order."""
    blocks, here = [], 0j
    for _ in range(draw(st.integers(1, 10))):
        angle = draw(st.floats(-3.1, 3.1))
        way = draw(st.sampled_from([0.1, 0.5, 2.0, 15.0])) * complex(math.cos(angle), math.sin(angle))
        kind = draw(st.sampled_from(["line", "line", "line", "arc", "spiral"]))
        if kind == "line":
            here += way
            blocks.append(Line(end=(here.real, here.imag), feed=draw(st.floats(600, 6000))))
            continue
        way *= 10 / abs(way)
        centre = here + way
        radius = 10.0 if kind == "arc" else draw(st.floats(3, 20))
        turned = draw(st.floats(0.3, 6.0))
        here = centre + radius * np.exp(1j * (np.angle(-way) + turned))
        end, vector = (here.real, here.imag), (way.real, way.imag)
        clockwise, feed = draw(st.booleans()), draw(st.floats(600, 6000))
        if kind == "arc":
            blocks.append(Arc(end=end, centre=vector, clockwise=clockwise, feed=feed))
        else:
            blocks.append(Spiral(end=end, centre=vector, clockwise=clockwise, turns=1, feed=feed))
    return tuple(blocks)


@pytest.mark.validates(
    "acceleration of the axes over random programs",
    "the declared limits",
    "5e-3 relative",
)
@given(contours(), st.floats(200, 5000), st.integers(2, 60))
@examples(80)
def test_axes_keep_to_their_limits_over_random_contours(blocks, acceleration, window):
    made = Program(blocks, acceleration=acceleration, blend_time=window * PERIOD)
    if made.duration > 60:
        return
    setpoints = made.setpoints(PERIOD)
    assert np.abs(second_differences(setpoints)).max() <= acceleration * (1 + OVER)
    assert steps(setpoints).max() <= max(block.feed for block in blocks) / 60 * (1 + SPEED)
    assert setpoints.position[-1] == pytest.approx(blocks[-1].end[:2], abs=1e-9)


@pytest.mark.parametrize("sides", [12, 200, 2000])
def test_a_circle_of_chords_is_no_slower_than_its_corners_require(sides):
    """However fine the chords, their corners within one window turn by no more than the circle does."""
    angle = np.linspace(0, 2 * math.pi, sides + 1)[1:]
    blocks = tuple(Line(end=(20 * math.cos(a) - 20, 20 * math.sin(a)), feed=1200) for a in angle)
    made = Program(blocks, acceleration=500, blend_time=0.05)
    assert np.abs(second_differences(made.setpoints(PERIOD))).max() <= 500 * (1 + OVER)
    if sides >= 200:
        assert made.duration < 1.5 * made.requested.length / 20


def test_dry_run_in_blended_motion_keeps_the_limit():
    made = Program(
        MIXED, start=(0, 100, 0), rapid=6000, acceleration=1000, blend_time=0.02, dry_run=1200,
        dry_run_from=3.0, dry_run_until=6.0,
    )  # fmt: skip
    setpoints = made.setpoints(PERIOD)
    assert np.abs(second_differences(setpoints)).max() <= 1000 * (1 + OVER)
    assert steps(setpoints)[4500] == pytest.approx(20, rel=1e-3)


@pytest.mark.parametrize(("code", "stops"), [("M08", True), ("M64 P1", True), ("M98 P2", False), ("F3000", False)])
def test_a_motion_comes_to_rest_before_a_block_of_m_codes_alone(code, stops):
    """On a straight line of 20 mm and 40 mm at 50 mm/s, where nothing else slows it."""
    text = f"G01 X20 F3000\n{code}\nX60\nM30\nO2\nM99"
    ramp = 50 / 500
    expected = 60 / 50 + (2 if stops else 1) * ramp
    # the planner ramps with a thousandth less than the acceleration
    assert Program(program=text, acceleration=500).duration == pytest.approx(expected, rel=1e-3)


def test_a_dwell_before_a_block_of_m_codes_takes_its_time_once():
    text = "G01 X20 F3000\nG04 X0.25\nM08\nX60\nM30"
    expected = 60 / 50 + 2 * 50 / 500 + 0.25
    assert Program(program=text, acceleration=500).duration == pytest.approx(expected, rel=1e-3)
