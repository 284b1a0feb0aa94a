"""FANUC's feed along the path: constant, clamped, with limited acceleration, in dry run, with stops and glue."""

import math
import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gantrysim.base.errors import InputError
from gantrysim.controllers.fanuc import Arc, Clamp, Dwell, Line, Program, Rapid, Spiral

from support.soaked import examples

FEED = 1e-6  # relative, of a constant feed
STEEP = 1e-5  # the same of cones of a few mm that rise as much, where F counts in the plane
CLAMPED = 1e-4  # relative, of one that follows the radius
ACCELERATION = 2e-3  # relative, by which a second difference may pass a limit between the places looked at
RAMPS = 2e-3  # relative, by which what is kept in hand of an acceleration lengthens a ramp
SPIRAL = "G02 X0 Y-30 I0 J-100 Q-20 F{}"
CONE = "G02 X0 Y-37.5 Z62.5 I0 J-100 Q-25 F{}"


def program(text, **parameters):
    return Program(text, start=(0, 100, 0), **parameters)


def way(position, growth, climb=0.0):
    """Arc length of points of a spiral about the origin, from their angles alone; the radius falls by `growth`."""
    place = position[:, 0] + 1j * position[:, 1]
    phi = np.abs(np.unwrap(np.angle(place)) - np.angle(place[0]))
    rho, c = 100 - growth * phi, math.hypot(growth, climb)
    value = 0.5 * (rho * np.hypot(rho, c) + c**2 * np.arcsinh(rho / c))
    return (value[0] - value) / growth


def second_differences(setpoints):
    padded = np.pad(setpoints.position, ((2, 2), (0, 0)), mode="edge")
    return np.diff(padded, 2, axis=0) / setpoints.period**2


def test_the_oracle_spiral_takes_its_time_at_constant_feed():
    made = program(SPIRAL.format(300))
    assert made.duration == pytest.approx(286.268, abs=5e-4)
    setpoints = made.setpoints(0.05)
    speed = np.diff(way(setpoints.position, 20 / (2 * math.pi))) / 0.05
    assert speed[:-1] == pytest.approx(np.full(speed.size - 1, 5.0), rel=FEED)
    assert setpoints.position[-1] == pytest.approx([0, -30], abs=1e-9)


def test_setpoints_are_the_path_at_whole_periods():
    made = program(SPIRAL.format(6000))
    setpoints = made.setpoints(0.01)
    s = np.minimum(np.arange(len(setpoints.position)) * 1.0, made.requested.length)
    assert setpoints.position == pytest.approx(made.requested.position(s)[:, :2], abs=1e-7)


def test_feed_of_a_cone_includes_the_height_with_feed_in_space():
    made = program(CONE.format(6000), feed_in_space=True)
    assert made.duration == pytest.approx(1083.816 / 100, abs=1e-5)
    position = made.setpoints(0.01).position
    speed = np.diff(way(position, 25 / (2 * math.pi), 25 / (2 * math.pi))) / 0.01
    assert speed[:-1] == pytest.approx(np.full(speed.size - 1, 100.0), rel=FEED)


def test_feed_of_a_cone_counts_in_the_plane_by_default():
    made = program(CONE.format(6000))
    assert made.duration == pytest.approx(1081.871 / 100, abs=1e-5)
    speed = np.diff(way(made.setpoints(0.01).position, 25 / (2 * math.pi))) / 0.01
    assert speed[:-1] == pytest.approx(np.full(speed.size - 1, 100.0), rel=FEED)


def test_feed_of_a_helix_counts_in_the_plane_by_default():
    text = "G02 X0 Y100 Z30 I0 J-100 F6000"
    assert program(text).duration == pytest.approx(2 * math.pi)
    assert program(text, feed_in_space=True).duration == pytest.approx(math.hypot(2 * math.pi, 0.3))


@pytest.mark.parametrize(("radius", "limit"), [(100, 8944.27), (20, 4000), (5, 2000), (0.001, 100)])
def test_values_of_the_clamp(radius, limit):
    assert Clamp(5, 2000, 100).limit(radius) == pytest.approx(limit, abs=5e-3)


@pytest.mark.parametrize("clamp", [None, Clamp(40, 6000, 1200), Clamp(40, 6000, 7000)])
def test_the_clamp_slows_a_spiral_with_its_radius(clamp):
    made = program(SPIRAL.format(9000), clamp=clamp)
    position = made.setpoints(0.001).position
    speed = np.diff(way(position, 20 / (2 * math.pi)))[:-1] / 0.001
    radius = np.linalg.norm(0.5 * (position[1:] + position[:-1]), axis=1)[:-1]
    expected = np.full(speed.size, 150.0)
    if clamp is not None:
        expected = np.minimum(expected, np.maximum(6000 * np.sqrt(radius / 40), clamp.floor) / 60)
        assert expected.min() < 120  # it bites
    assert speed == pytest.approx(expected, rel=CLAMPED)


def test_the_clamp_leaves_lines_alone():
    assert program("G01 X50 F9000", clamp=Clamp(5, 100, 10)).duration == pytest.approx(math.hypot(50, 0) / 150)
    # before an arc that it slows: 20 mm of radius at a limit of 1,000 mm/min for 5 mm
    both = program("G01 X50 F9000\nG03 X50 Y140 J20", clamp=Clamp(5, 1000, 10))
    assert both.duration == pytest.approx(50 / 150 + 20 * math.pi / (2000 / 60))


@pytest.mark.parametrize("acceleration", [math.inf, 5000, 500])
def test_limited_acceleration_ramps_up_and_down(acceleration):
    made = program("G01 X300 F6000", acceleration=acceleration)
    ideal = 3.0 + 100 / acceleration
    assert made.duration - 3.0 == pytest.approx(ideal - 3.0, rel=RAMPS)
    assert np.abs(second_differences(made.setpoints(0.001))).max() <= 100 / 0.001 + 1e-3
    if math.isfinite(acceleration):
        most = np.abs(second_differences(made.setpoints(0.001))).max()
        assert 0.8 * acceleration < most <= acceleration * (1 + ACCELERATION)


def slowest_near(made, place, period=1e-4):
    """Speed where the setpoints come nearest to a place [mm/s]."""
    position = made.setpoints(period).position
    k = int(np.argmin(np.linalg.norm(position[:, :2] - place, axis=1)))
    steps = np.linalg.norm(np.diff(position, axis=0), axis=1)
    return steps[max(k - 1, 0) : k + 1].max() / period


@pytest.mark.parametrize(
    ("text", "place", "stops"),
    [
        ("G01 X10 F6000\nX50", (10, 100), False),
        ("G61 G01 X10 F6000\nX50", (10, 100), True),
        ("G61 G01 X10 F6000\nG64\nX50", (10, 100), True),
        ("G01 X50 F6000\nY150", (50, 100), True),  # a corner
        ("G01 X50 F6000\nG02 X70 Y80 J-20", (50, 100), False),  # a tangent
        ("G01 X50 F6000\nG00 X90", (50, 100), True),
        ("G02 X0 Y-30 I0 J-100 Q-20 F6000\nG02 X0 Y-30 J40", (0, -30), True),
    ],
)
def test_stops_between_blocks(text, place, stops):
    slow = slowest_near(program(text, acceleration=3000), place)
    assert (slow < 2.0) == stops
    assert slow < 2.0 or slow == pytest.approx(100, rel=0.02)


def test_without_a_limit_nothing_stops():
    made = program("G01 X50 F6000\nY150\nG02 X50 Y200 J50 L2", acceleration=math.inf)
    steps = np.linalg.norm(np.diff(made.setpoints(0.001).position, axis=0), axis=1) / 0.001
    assert np.median(steps) == pytest.approx(100, rel=1e-4)
    assert made.duration == pytest.approx(made.requested.length / 100)


@st.composite
def programs(draw):
    """Blocks of any kind, with feeds, in the XY plane and out of it."""
    blocks, here = [], complex(0, 0)
    for _ in range(draw(st.integers(1, 5))):
        feed = draw(st.floats(600, 9000))
        kind = draw(st.sampled_from(["line", "rapid", "arc", "spiral", "cone"]))
        angle, sense = draw(st.floats(-3.1, 3.1)), draw(st.booleans())
        way = complex(draw(st.floats(5, 60)) * math.cos(angle), draw(st.floats(5, 60)) * math.sin(angle))
        if kind in ("line", "rapid"):
            here += way
            end = (here.real, here.imag)
            blocks.append(Rapid(end=end) if kind == "rapid" else Line(end=end, feed=feed))
            continue
        centre = here + way
        radius = abs(way) * (1 if kind == "arc" else draw(st.floats(0.3, 2)))
        turned = draw(st.floats(0.1, 6.2))
        here = centre + radius * np.exp(1j * (np.angle(-way) + turned))
        end, vector = (here.real, here.imag), (way.real, way.imag)
        if kind == "arc":
            blocks.append(Arc(end=end, centre=vector, clockwise=sense, feed=feed))
        else:
            end += (draw(st.floats(-20, 20)),) if kind == "cone" else ()
            turns = draw(st.integers(1, 3))
            blocks.append(Spiral(end=end, centre=vector, clockwise=sense, turns=turns, feed=feed))
    return tuple(blocks)


@given(programs(), st.booleans())
@examples(60)
def test_no_setpoint_is_ahead_of_the_feed(blocks, in_space):
    made = Program(blocks, feed_in_space=in_space, rapid=9000)
    steps = np.linalg.norm(np.diff(made.setpoints(0.002).position[:, :2], axis=0), axis=1) / 0.002
    most = max(getattr(block, "feed", None) or 9000 for block in blocks) / 60
    assert steps.max() <= most * (1 + (FEED if in_space else STEEP))


@given(programs(), st.floats(200, 5000))
@examples(60)
def test_axes_keep_to_their_accelerations(blocks, acceleration):
    """Stops and ramps keep every axis within it; a tangent joint, as an arc's, does too."""
    made = Program(blocks, acceleration=acceleration, rapid=9000)
    if made.duration > 100:
        return
    most = np.abs(second_differences(made.setpoints(0.004))).max()
    assert most <= acceleration * (1 + ACCELERATION)


@pytest.mark.parametrize("switched", [False, True])
def test_dry_run_changes_the_feed_at_once(switched):
    parameters = {"dry_run_from": 2.0, "dry_run_until": 5.0} if switched else {}
    made = program("G01 X300 F3000", dry_run=6000, **parameters)
    speed = np.diff(made.setpoints(0.01).position[:, 0]) / 0.01
    ticks = np.arange(speed.size) * 0.01
    on = (ticks >= 2 - 1e-9) & (ticks < 5 - 1e-9) if switched else np.full(ticks.shape, True)
    assert speed[:-1] == pytest.approx(np.where(on, 100.0, 50.0)[:-1], rel=1e-6)


def test_dry_run_does_not_stop_to_change_with_limited_acceleration():
    made = program("G01 X300 F3000", dry_run=6000, dry_run_from=2.0, dry_run_until=3.0, acceleration=500)
    speed = np.diff(made.setpoints(0.001).position[:, 0]) / 0.001
    middle = speed[200:-200]
    assert middle.min() == pytest.approx(50, rel=1e-3)
    assert middle.max() == pytest.approx(100, rel=1e-3)
    assert np.abs(np.diff(middle)).max() / 0.001 <= 500 * (1 + ACCELERATION)


def test_dry_run_down_from_a_higher_feed_slows_without_stopping():
    made = program(SPIRAL.format(9000), dry_run=1200, dry_run_from=3.0, acceleration=1000)
    steps = np.linalg.norm(np.diff(made.setpoints(0.001).position, axis=0), axis=1) / 0.001
    assert steps[2990] > 140
    assert steps[3500:-500] == pytest.approx(np.full(steps.size - 4000, 20.0), rel=1e-3)
    assert steps[2990:3500].min() > 19


@given(st.floats(0.05, 2.5), st.sampled_from([200.0, 5000.0, 30000.0]), st.sampled_from([0.0, 0.02]))
@examples(60)
def test_dry_run_switched_on_at_any_moment_keeps_the_stops_and_the_acceleration(moment, feed, blend):
    text = "G01 X40 Y140 F20000\nG02 X80 Y100 I0 J-40\nG01 X0 Y100\nG02 X0 Y60 I0 J-60 L2\nG01 X5"
    made = program(
        text, dry_run=feed, dry_run_from=moment, dry_run_until=moment + 0.4, acceleration=1000, blend_time=blend
    )
    setpoints = made.setpoints(0.001)
    assert np.abs(second_differences(setpoints)).max() <= 1000 * (1 + ACCELERATION)
    assert setpoints.position[-1] == pytest.approx([5, 60], abs=1e-9)


def test_dry_run_may_be_switched_while_the_motion_brakes_for_its_end():
    plain = program("G01 X300 F3000", acceleration=500)
    braking = {"dry_run": 6000, "dry_run_from": plain.duration - 0.05}
    assert program("G01 X300 F3000", acceleration=500, **braking).duration == pytest.approx(plain.duration, abs=1e-6)


@pytest.mark.parametrize("feed", [50.0, 20.0])
def test_a_lower_feed_is_reached_with_nearly_the_whole_acceleration(feed):
    """After a second with a dry run at 100 mm/s; 0.99 of the acceleration brakes, all of it starts and stops."""
    made = program(f"G01 X300 F{60 * feed}", acceleration=500, dry_run=6000, dry_run_until=1.0)
    start, stop, slower = 100**2 / 500 / 2, feed**2 / 500 / 2, (100**2 - feed**2) / (2 * 0.99 * 500)
    steady = 300 - start - 100 * (1 - 100 / 500) - slower - stop
    expected = 1 + (100 - feed) / (0.99 * 500) + steady / feed + feed / 500
    assert made.duration == pytest.approx(expected, abs=0.01)


def test_dry_run_that_ends_before_a_motion_begins_leaves_it_its_feed():
    made = program("G01 X100 F3000\nG04 P10\nX200", dry_run=6000, dry_run_until=0.5)
    assert made.duration == pytest.approx(0.5 + 1 + 0.01 + 2)


def test_rapid_moves_run_at_the_rapid_feed():
    assert program("G00 X300", rapid=6000).duration == pytest.approx(3.0)
    assert program("G00 X300", rapid=6000, dry_run=1200).duration == pytest.approx(3.0)


def test_the_motion_stops_before_and_after_a_spiral_that_its_neighbours_touch():
    line, spiral, on = "G01 X50 Y100 F6000", "G02 Y99.99 J-100 Q-0.01 F6000", "G01 X100 F6000"
    starts = [(0, 100, 0), (50, 100, 0), (50, 99.99, 0)]
    parts = [Program(text, start=at, acceleration=1000) for text, at in zip([line, spiral, on], starts, strict=True)]
    whole = program("\n".join([line, spiral, on]), acceleration=1000)
    assert whole.duration == pytest.approx(sum(part.duration for part in parts), abs=1e-6)
    circle = program("\n".join([line, "G02 J-100", on]), acceleration=1000)
    assert circle.duration < whole.duration - 0.15


def test_the_rotary_axis_alone_takes_its_feed_and_lays_no_glue():
    made = program("G01 X10 F600\nC90\nX20")
    setpoints = made.setpoints(0.1)
    assert made.duration == pytest.approx(1 + 9 + 1)
    assert setpoints.dispense.tolist() == [True] * 10 + [False] * 90 + [True] * 11


def test_increments_of_the_rotary_axis_add_up():
    setpoints = program("G91 G01 X10 C30 F600\nX10 C30\nG90 X50 C15").setpoints(0.1)
    assert setpoints.position[[10, 20, -1], -1] == pytest.approx([30, 60, 15])


@pytest.mark.parametrize("word", ["P1500", "X1.5"])
def test_a_dwell_holds_the_position(word):
    made = program(f"G01 X10 F600\nG04 {word}\nX20")
    position = made.setpoints(0.01).position[:, 0]
    assert made.duration == pytest.approx(3.5)
    assert position[100:251] == pytest.approx(np.full(151, 10.0), abs=1e-9)
    assert np.array_equal(
        Program((Line(end=(10, 100), feed=600), Dwell(time=1.5), Line(end=(20, 100))), start=(0, 100, 0))
        .setpoints(0.01)
        .position[:, 0],
        position,
    )


def glue(text):
    dispense = program(text, rapid=600).setpoints(0.1).dispense
    return [bool(dispense[10 * k + 5]) for k in range(len(dispense) // 10)]


@pytest.mark.parametrize(
    ("text", "on"),
    [
        ("G00 X10\nG01 X20 F600\nG04 X1\nX30\nG00 X40", [False, True, False, True, False]),
        ("G01 X10 F600\nM03\nX20\nG04 X1\nG00 X30\nM05\nG01 X40", [False, True, True, False, False]),
        ("G01 X10 F600 M03\nG01 X20 M05", [True, False]),
    ],
)
def test_glue_is_laid_at_feed_or_as_switched(text, on):
    assert glue(text) == on


def test_the_rotary_axis_turns_with_the_angle_of_a_spiral_and_the_way_of_a_line():
    made = program("G02 X0 Y-30 I0 J-100 Q-20 C700 F6000\nG01 X50 C0")
    setpoints = made.setpoints(0.01)
    assert setpoints.axes == ("x", "y", "r")
    x, y, r = setpoints.position.T
    curved = r.argmax()
    angle = np.unwrap(np.angle(x[:curved] + 1j * y[:curved]))
    assert r[:curved] == pytest.approx((angle[0] - angle) / (3.5 * 2 * math.pi) * 700, abs=1e-6)
    line = slice(int(curved) + 1, -1)
    assert r[line] == pytest.approx(700 * (1 - x[line] / 50), abs=1e-6)


def test_the_rotary_axis_alone_turns_at_the_feed():
    made = program("G01 X10 F600\nC90", rotary_axis="th")
    assert made.axes == ("x", "y", "th")
    assert made.duration == pytest.approx(1 + 9)


@pytest.mark.soak
def test_the_time_to_make_setpoints_grows_with_the_program_alone():
    def seconds(n):
        text = "F6000\n" + "\n".join(f"G01 X{k % 7} Y{k % 5}" for k in range(1, n + 1))
        begun = time.process_time()
        Program(text).setpoints(0.01)
        return time.process_time() - begun

    seconds(100)
    assert min(seconds(8000) for _ in range(2)) < 0.5 * 8**2 * min(seconds(1000) for _ in range(3))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((-3, 2000, 100), "clamp radius = -3 mm: must be greater than 0 mm"),
        ((5, 0, 100), "clamp feed = 0 mm/min: must be greater than 0 mm/min"),
        ((5, 2000, 0), "clamp floor = 0 mm/min: must be greater than 0 mm/min"),
        ((5, 2000, math.nan), "clamp floor = nan mm/min: must be finite"),
    ],
)
def test_a_clamp_out_of_its_bounds_is_named(arguments, message):
    with pytest.raises(InputError, match=f"^{message}$"):
        Clamp(*arguments)
