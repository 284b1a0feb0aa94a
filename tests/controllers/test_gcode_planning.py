"""Look-ahead: closed forms of durations and rounded corners, limits of the axes, tracks from arrays."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gantrysim.base.errors import InputError
from gantrysim.controllers.gcode.linuxcnc import Program
from gantrysim.controllers.gcode.move_table import END, KIND, LINE, SOURCE
from gantrysim.controllers.gcode.slicer import Program as SlicerProgram
from gantrysim.controllers.placement import Placement
from gantrysim.paths.chain import Chain
from gantrysim.paths.kinds import path_of
from gantrysim.paths.pieces import XY, YZ, ZX, Coil, Line
from gantrysim.paths.track import Track

from support.soaked import examples, suite_runs

A = 500.0  # acceleration of every test [mm/s²]
PERIOD = 1e-3


def lines(points, head="G64 P0.05", feed=3000):
    rows = [f"G1 X{x:.6f} Y{y:.6f}" for x, y in points]
    return f"F{feed} {head}\n" + "\n".join(rows)


def program(text, **changes):
    return Program(text=text, **{"acceleration": A, **changes})


def samples(controller, period=PERIOD):
    """Positions at whole periods, without the last setpoint, which may be nearer."""
    return controller.setpoints(period).position[:-1]


def deviation(controller):
    s = samples(controller)
    return controller.requested.follow(np.column_stack([s, np.zeros((len(s), 3 - s.shape[1]))])).distance.max()


@pytest.mark.validates(
    "time of a line from rest to rest",
    "closed form",
    "1e-6 relative",
)
@pytest.mark.parametrize(("length", "feed"), [(100, 3000), (2, 3000), (0.01, 60000)])
def test_a_line_takes_the_time_of_a_trapezoid(length, feed):
    v = feed / 60
    expected = length / v + v / A if length > v**2 / A else 2 * math.sqrt(length / A)
    assert program(f"F{feed} G1 X{length}", rapid=1e6).duration == pytest.approx(expected)


def trapezoid(length, speed):
    """Time from rest to rest."""
    return length / speed + speed / A if length > speed**2 / A else 2 * math.sqrt(length / A)


@pytest.mark.parametrize(
    ("code", "stops"),
    [
        *(
            (code, True)
            for code in (
                *("M3 S9", "M5", "M7", "M8", "M9", "M64 P0", "M65 P0", "M68 E0 Q1", "M0", "M100", "S9"),
                *("G43", "G49", "G55", "G92 X20", "G92.1", "G52 X0", "G10 L2 P0 X0", "G10 L20 P1 X20"),
            )
        ),
        *((code, False) for code in ("M62 P0", "M63 P0", "M67 E0 Q1", "M48", "S0", "(a comment)")),
        *((code, False) for code in ("G54", "G10 L2 P2 X5", "G10 L1 P3 Z0")),
    ],
)
def test_the_motion_stops_for_the_codes_that_linuxcnc_carries_out_at_rest(code, stops):
    """Both on a straight line, where nothing else slows it, and at a corner, which then is not rounded."""
    straight = program(f"F3000 G64 P1\nG1 X20\n{code}\nX60", rapid=1e6)
    expected = trapezoid(20, 50) + trapezoid(40, 50) if stops else trapezoid(60, 50)
    assert straight.duration == pytest.approx(expected)
    corner = program(f"F3000 G64 P1\nG1 X20\n{code}\nY40")
    # of an arc that is 1 mm from the corner, from the legs that it joins
    rounded = (1 - math.cos(math.pi / 4)) / (math.sqrt(2) - 1)
    assert deviation(corner) == pytest.approx(0.0 if stops else rounded, abs=0.02)
    assert any("carry out" in note for note in corner.notes) == stops


@pytest.mark.parametrize(
    ("head", "stops"),
    [("M3 S1", 1), ("$32=1\nM3 S1", 0), ("M4 S1", 0), ("$32=0\nM4 S1", 1), ("M4 S1\nG64", 1), ("$32=1\nG64\nM3 S1", 0)],
)
def test_grbl_in_laser_mode_changes_the_power_of_a_move_in_motion(head, stops):
    """grbl: $32=1; M4 with S in moves is a laser's, unless the file has words that grbl lacks."""
    for word in ("", "G1 "):
        straight = program(f"G21\n{head}\nF3000\nG1 X20 S9\n{word}X60 S5", rapid=1e6)
        assert straight.duration == pytest.approx(trapezoid(20, 50) + trapezoid(40, 50) if stops else trapezoid(60, 50))
        assert sum("laser mode" in note for note in straight.notes) == stops
    # S alone waits in any mode, and S0 in a move closes the valve without a stop
    alone = program(f"{head}\nF3000\nG1 X20 S9\nS5\nX60", rapid=1e6)
    assert alone.duration == pytest.approx(trapezoid(20, 50) + trapezoid(40, 50))
    setpoints = program(f"{head}\nF3000\nG1 X20 S9\nX40 S0\nX60 S9", rapid=1e6).setpoints(PERIOD)
    assert setpoints.position[~setpoints.dispense, 0].max() >= 40 - 51 * PERIOD
    assert np.count_nonzero(setpoints.dispense[(setpoints.position[:, 0] > 21) & (setpoints.position[:, 0] < 39)]) == 0


@pytest.mark.parametrize("dwell", ["G4 P0", "G4 P0.5"])
def test_a_dwell_of_the_program_is_not_noted(dwell):
    """It stops the motion, as the program asks."""
    straight = program(f"F3000\nG1 X20\n{dwell}\nX60", rapid=1e6)
    assert straight.duration == pytest.approx(trapezoid(20, 50) + trapezoid(40, 50) + float(dwell.split("P")[1]))
    assert not any("carry out" in note for note in straight.notes)


def test_glue_ends_where_the_valve_closes_before_the_way_back():
    """A nearly reversed corner from feed to a rapid move, rounded if nothing stops the motion at M5."""
    controller = program("F1500\nM3\nG1 X20\nX40\nM5\nG0 X0 Y4")
    setpoints = controller.setpoints(PERIOD)
    assert setpoints.position[setpoints.dispense, 0].max() == pytest.approx(40, abs=25 * PERIOD)


@pytest.mark.parametrize("code", ["M400", "G4", "G4 P0", "M0"])
def test_printers_firmware_stops_where_it_waits_for_the_moves(code):
    controller = SlicerProgram(text=f"M204 S{A}\nG1 X20 F3000\n{code}\nG1 X60")
    assert controller.duration == pytest.approx(trapezoid(20, 50) + trapezoid(40, 50))


def test_a_rapid_move_uses_every_axis_to_its_limit():
    controller = program("G0 X300 Y300", rapid=6000)
    assert controller.duration == pytest.approx(300 / 100 + 100 / A)
    assert controller.setpoints(PERIOD).dispense.sum() == 0


def test_feeds_are_kept_within_the_axes():
    controller = program("F60000 G1 X300 Y400", axis_speeds=(1000.0, 100.0, 1000.0))
    v = np.abs(np.diff(samples(controller), axis=0)).max(axis=0) / PERIOD
    assert v[1] == pytest.approx(100, rel=1e-6)
    assert v[0] == pytest.approx(75, rel=1e-6)


@pytest.mark.parametrize("turn", [20, 60, 90, 150])
@pytest.mark.parametrize("tolerance", [0.01, 0.2])
def test_a_corner_is_passed_on_an_arc_of_the_tolerance(turn, tolerance):
    angle = math.radians(turn)
    points = [(50, 0), (50 + 50 * math.cos(angle), 50 * math.sin(angle))]
    controller = program(lines(points, f"G64 P{tolerance}", 60000), rapid=1e5)
    path = controller.plan.path
    # the arc's middle is r (1 / cos(angle / 2) - 1) from the corner; its speed needs sqrt(3) / 2 of the acceleration
    radius = tolerance / (1 / math.cos(angle / 2) - 1)
    assert path.radius == pytest.approx([radius])
    middle = path.position(np.array([path.ends[1] + 0.5 * path.lengths[1]]))[0]
    assert math.dist(middle, (50, 0, 0)) == pytest.approx(tolerance)
    at = controller.plan.profile.time_at(path.ends[1] + 0.5 * path.lengths[1])
    assert controller.plan.profile.velocity(at) == pytest.approx(math.sqrt(math.sqrt(0.75) * A * radius))
    assert deviation(controller) <= tolerance * 1.001


@pytest.mark.parametrize(("head", "stops"), [("G61.1", True), ("G61", True), ("G64", False), ("G64 P0.1", False)])
def test_modes_decide_whether_corners_stop(head, stops):
    controller = program(lines([(20, 0), (20, 20)], head))
    v = np.linalg.norm(np.diff(samples(controller), axis=0), axis=1) / PERIOD
    slowest = v[20:-20].min()
    assert (slowest < 2) == stops
    assert bool([note for note in controller.notes if "less than a tenth" in note]) == stops
    assert not stops or any("G64 P0.05" in note for note in controller.notes)


def test_corners_cut_without_a_tolerance_are_noted():
    v = 50.0
    controller = program(lines([(50, 0), (50, 50)], "G64", 60 * v))
    cut = v**2 / (math.sqrt(0.75) * A) * (math.sqrt(2) - 1)  # of the radius that keeps the feed
    assert controller.plan.corners.cut == pytest.approx(cut)
    remedy = "G64 P0.05, or program.corner_tolerance = 0.05, keeps within 0.05 mm of them."
    note = f"G64 without P cuts corners by up to {cut:.3g} mm; {remedy}"
    assert controller.notes == (note,)
    inside = controller.requested.project(np.pad(samples(controller), ((0, 0), (0, 1)))).distance.max()
    assert inside == pytest.approx(v**2 / (math.sqrt(0.75) * A) * (1 - math.sqrt(0.5)), rel=0.01)  # from the lines
    assert program(lines([(50, 0), (50, 50)], "G64 P0.5", 60 * v)).notes == ()


def test_exact_stops_take_the_time_of_their_pieces():
    points = [(0.1 * k, 0) for k in range(1, 201)]
    assert program(lines(points, "G61.1")).duration == pytest.approx(200 * 2 * math.sqrt(0.1 / A))


@pytest.mark.parametrize("head", suite_runs(["G64 P0.01", "G64"], 0))
def test_thousands_of_tenths_of_a_millimetre_keep_the_feed(head):
    angles = np.arange(1, 2001) * 0.1 / 60
    points = [(60 * math.sin(a), 60 - 60 * math.cos(a)) for a in angles]
    controller = program(lines(points, head, 3000))
    length = controller.requested.length
    assert controller.duration == pytest.approx(length / 50 + 50 / A, rel=1e-3)
    assert deviation(controller) < 0.01
    assert not controller.notes
    stopping = program(lines(points, "G61.1", 3000))
    assert stopping.duration > 2 * controller.duration
    assert "1999 corners" in stopping.notes[0]


@given(
    st.lists(st.tuples(st.floats(-20, 20), st.floats(-20, 20)), min_size=2, max_size=12),
    st.sampled_from(["G64 P0.02", "G64 P0.5", "G64"]),
    st.sampled_from([600, 6000, 60000]),
)
@examples(60)
def test_axes_keep_their_acceleration_where_corners_are_rounded(points, head, feed):
    points = [(round(x, 3), round(y, 3)) for x, y in points]
    try:
        controller = program(lines(points, head, feed), cycle=1e-9)
    except InputError:
        return
    if all(point == (0, 0) for point in points):
        return
    acceleration = np.diff(samples(controller, 1e-3), n=2, axis=0) / 1e-3**2
    assert np.abs(acceleration).max(initial=0) <= A * 1.001 + 1e-6 / 1e-3**2 * 1e-3
    velocity = np.diff(samples(controller), axis=0) / PERIOD
    assert np.linalg.norm(velocity, axis=1).max(initial=0) <= feed / 60 * (1 + 1e-9) + 1e-6


def test_axes_keep_their_acceleration_on_arcs():
    text = "F30000 G64 P0.1\nG2 X20 Y0 R10\nG3 X30 Y0 I5\nG1 X40 Y-5\nG2 I4"
    acceleration = np.diff(samples(program(text)), n=2, axis=0) / PERIOD**2
    inside = np.sort(np.abs(acceleration).max(axis=1))[:-12]  # but at the three corners with arcs
    assert inside.max() <= A * 1.001


@pytest.mark.parametrize("head", ["G61", "G64", "G64 P0.05"])
@pytest.mark.parametrize(
    ("plane", "text"),
    [
        ("G17", "X50\nG3 Y40 J20\nG1 X0"),
        ("G17", "X50\nG3 Y40 J20\nG2 X30 Y60 J20\nG1 Y80"),  # a quarter that turns the other way, and on upwards
        ("G18", "X50\nG2 Z40 K20\nG1 X0"),
        ("G19", "Y50\nG3 Z40 K20\nG1 Y0"),
    ],
)
def test_arcs_that_continue_lines_are_passed_at_the_feed(head, plane, text):
    """Tangents agree at every joint, so nothing slows the motion down: l / v + v / a, in every mode but exact stop."""
    controller = program(f"F1200 {plane} {head}\nG1 {text}")
    length = controller.requested.length
    arcs = 20 * math.pi + (10 * math.pi if "Y60" in text else 0)
    assert length == pytest.approx((50 + 20 if "Y60" in text else 100) + arcs, abs=1e-9)
    assert controller.duration == pytest.approx(length / 20 + 20 / A, rel=1e-9)
    assert not controller.notes
    stopping = program(f"F1200 {plane} G61.1\nG1 {text}")
    # with a stop at every joint; on arcs, half of the acceleration is for the ramps
    ramps = 2 * 20 / A + (2 if "Y60" in text else 1) * 20 / (0.5 * A)
    assert stopping.duration == pytest.approx(length / 20 + ramps, rel=1e-9)


@pytest.mark.parametrize("degrees", [10, 45, 90])
def test_the_corner_between_a_line_and_an_arc_is_that_of_their_tangents(degrees):
    """Where it is not rounded the velocity may jump by a T: v = a T / (2 sin(theta / 2))."""
    turn, cycle = math.radians(degrees), 0.004
    centre = 20 * 1j * np.exp(1j * turn)  # the arc sets out at an angle to the line
    end = 50 + 2 * centre
    half_circle = f"G3 X{end.real:.9f} Y{end.imag:.9f} I{centre.real:.9f} J{centre.imag:.9f}"
    controller = program(f"F2400 G61\nG1 X50\n{half_circle}", cycle=cycle)
    profile = controller.plan.profile
    at_corner = float(profile.velocity(profile.time_at(50.0)))
    assert at_corner == pytest.approx(min(A * cycle / (2 * math.sin(turn / 2)), 40), rel=1e-6)


def test_lines_within_q_are_merged():
    rng = np.random.default_rng(3)
    points = [(0.1 * k, 0.002 * rng.uniform(-1, 1)) for k in range(1, 501)]
    merged, apart = program(lines(points, "G64 P0.01 Q0.01")), program(lines(points, "G64 P0.01 Q0"))
    assert merged.plan.path.base.ends.size < 10 < apart.plan.path.base.ends.size == 500
    assert deviation(merged) <= 0.01
    np.testing.assert_allclose(merged.requested.position(1e9), apart.requested.position(1e9))


def test_a_dwell_holds_its_time_at_its_place():
    controller = program("F3000 G1 X10\nG4 P0.5\nX20\nG4 P0.25\nG0 X0")
    plain = program("F3000 G61.1 G1 X10\nX20\nG0 X0")
    assert controller.duration == pytest.approx(plain.duration + 0.75)
    points = controller.setpoints(PERIOD)
    for place, time in ((10, 0.5), (20, 0.25)):
        assert np.sum(np.abs(points.position[:, 0] - place) < 1e-9) * PERIOD == pytest.approx(time, abs=3 * PERIOD)
        assert not points.dispense[np.abs(points.position[:, 0] - place) < 1e-9][2:-2].any()
    assert [controller.line_at(t) for t in (0.01, 0.4, 0.9)] == [1, 2, 3]
    assert controller.line_at(controller.duration - 0.01) == 5
    at = controller.lines(PERIOD)
    assert at.size == len(points.position)
    assert (np.diff(at) >= 0).all()


def test_dwells_at_both_ends_belong_to_the_duration():
    controller = program("G4 P1\nF600 G1 X1\nG4 P2\nG4 P3")
    assert controller.duration == pytest.approx(program("F600 G1 X1").duration + 6)
    position = controller.setpoints(PERIOD).position[:, 0]
    assert np.sum(position == 0) * PERIOD == pytest.approx(1, abs=2 * PERIOD)
    assert np.sum(position > 1 - 1e-12) * PERIOD == pytest.approx(5, abs=2 * PERIOD)


def test_the_override_changes_feeds_but_not_rapid_moves():
    controller = program("F600 G1 X100\nF300 X0\nG0 X50")
    changed = controller.with_speeds(lambda speed: 2 * speed)
    assert changed == {"feed_override": 2.0}
    assert controller.programmed_speed == pytest.approx(10)
    fast = program(controller.text, **changed)
    assert fast.programmed_speed == pytest.approx(20)
    rapid = program("G0 X50").duration
    assert fast.duration - rapid == pytest.approx((controller.duration - rapid) / 2, rel=0.02)


@given(
    st.floats(-180, 180),
    st.floats(0.1, 3),
    st.sampled_from(["G17 G2 X9 Y9 R20 Z3", "G18 G3 X9 Z4 R20", "G19 G2 Y9 R9"]),
)
@examples(30)
def test_a_placed_program_is_the_program_placed(turn, scale, arc):
    text = f"F600 G1 X1 Y2\n{arc}\nG17 G1 X0 Y0 Z0"
    placement = Placement(x=3.0, y=-4.0, rotate=turn, scale=scale)
    plain, placed = program(text).requested, program(text, placement=placement).requested
    s = np.linspace(0, plain.length, 60)
    np.testing.assert_allclose(placed.position(scale * s), placement.point(plain.position(s)), atol=1e-8)


def test_a_track_is_the_chain_of_its_pieces():
    frames = {0: XY, 1: ZX, 2: YZ}
    pieces = [
        Line((0, 0, 0), (3, 4, 1)),
        Line((3, 4, 1), (3, 4, 6)),
        Coil((3, 9, 6), (5.0, 5.0), -math.pi / 2, 2.5 * math.pi, 2.0),
        Coil((8, 9, 11), (3.0, 4.0), -math.pi / 2, -math.pi, 1.0, ZX),
    ]
    chain = Chain(pieces[:3])
    end = [chain.position(s)[0] for s in chain.ends]
    track = Track((0, 0, 0), end, [0, 0, 2.5 * math.pi], [(0, 0, 0)] * 2 + [(3, 9, 6)], [0] * 3, [np.eye(3)])
    s = np.linspace(0, chain.length, 301)
    for name in ("position", "heading", "curvature", "climb", "tangent", "normal"):
        np.testing.assert_allclose(getattr(track, name)(s), getattr(chain, name)(s), atol=1e-9, err_msg=name)
    np.testing.assert_allclose(track.corners, chain.corners)
    np.testing.assert_allclose(track.length, chain.length)
    again = path_of("Track", track.parameters())
    np.testing.assert_allclose(again.position(s), track.position(s))
    assert frames[0] == XY


_PLACE = st.tuples(st.integers(-9, 9), st.integers(-9, 9))
_MOVE = st.one_of(
    _PLACE.map(lambda p: f"G0 X{p[0]} Y{p[1]}"),
    _PLACE.map(lambda p: f"G1 X{p[0]} Y{p[1]} Z{p[0] % 3}"),
    _PLACE.map(lambda p: f"G2 X{p[0]} Y{p[1]} R30"),
    st.just("G3 I2 J1 P2"),
    st.sampled_from(["G4 P0.05", "G61", "G61.1", "G64", "G64 P0.1", "G64 P0.2 Q0.1", "F900", "F90000"]),
)


@given(st.lists(_MOVE, min_size=1, max_size=15))
@examples(100)
def test_every_program_is_run_without_a_jump_from_its_start_to_its_end(rows):
    controller = program("F1200\n" + "\n".join(rows), rapid=6000)
    try:
        points = controller.setpoints(PERIOD)
    except InputError as error:
        if "moves none" in str(error) or "arc by R that ends at its start" in str(error):
            return
        raise
    steps = np.linalg.norm(np.diff(points.position, axis=0), axis=1)
    assert steps.max() <= 100 * math.sqrt(len(controller.axes)) * PERIOD * (1 + 1e-9)
    end = controller.program.moves[-1, END : END + len(controller.axes)]
    np.testing.assert_allclose(points.position[-1], end, atol=1e-6)
    np.testing.assert_allclose(points.position[0], 0, atol=1e-9)
    lines_run = controller.lines(PERIOD)
    assert (np.diff(lines_run) >= 0).all()
    at_feed = np.isin(lines_run, [k for k, row in enumerate(rows, 2) if row[:2] in ("G1", "G2", "G3")])
    assert not (points.dispense & ~at_feed).any()
    level = np.append(np.diff(points.position[:, :2], axis=0).any(axis=1), False)
    within = level & np.append(lines_run[1:] == lines_run[:-1], False)
    # an arc of a corner belongs to the move after it, which lays no glue where it is vertical
    moves = controller.program.moves
    ends = np.vstack([controller.program.start[:2], moves[:, END : END + 2]])
    vertical = (np.diff(ends, axis=0) == 0).all(axis=1) & (moves[:, KIND] == LINE)
    within &= ~np.isin(lines_run, moves[vertical, SOURCE])
    np.testing.assert_array_equal(points.dispense[within], at_feed[within])


def test_programs_without_a_move_are_refused():
    with pytest.raises(InputError, match="moves none of x, y, z"):
        _ = program("M3\nG4 P1").duration
    with pytest.raises(InputError, match="must have a piece"):
        Track((0, 0, 0), np.zeros((0, 3)), [], np.zeros((0, 3)), [], [np.eye(3)])
