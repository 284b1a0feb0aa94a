"""softMC's CIRCLE: where it runs, against the manual's figures and against elementary geometry."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from gantrysim.controllers.softmc import Circle, Group, Move, Program

from support.soaked import examples

POSITION = 1e-9  # of points some hundred millimetres from the origin [mm]
PERIOD = 1e-3

SPIRAL = "\n".join(
    f"Circle G1 Angle=180 CircleCenter={{{0 if k % 2 else 12.5}, 0, {5 * k}}} CirclePlane=0 Vtran=500"
    for k in range(1, 9)
)
GROUP = Group(acceleration=30000)


def spiral():
    return Program(SPIRAL, GROUP, start=(25, 0, 0))


def end_of(program):
    return program.legs[-1].path.end


coordinate = st.floats(-100, 100)
points = st.tuples(coordinate, coordinate, coordinate)


@st.composite
def arcs(draw, start):
    """A circle by angle in the XY plane, of at least 1 mm radius, with a climb."""
    radius, begin = draw(st.floats(1, 80)), draw(st.floats(-math.pi, math.pi))
    angle = draw(st.sampled_from([-1, 1])) * draw(st.floats(5, 1200))
    x, y = start[0] + radius * math.cos(begin), start[1] + radius * math.sin(begin)
    return Circle(angle, (x, y, draw(coordinate)))


@pytest.mark.parametrize(
    ("k", "centre", "radius", "mid", "end"),
    [
        (1, 0, 25, (0, 25, 2.5), (-25, 0, 5)),
        (2, 12.5, 37.5, (12.5, -37.5, 7.5), (50, 0, 10)),
        (3, 0, 50, (0, 50, 12.5), (-50, 0, 15)),
        (4, 12.5, 62.5, (12.5, -62.5, 17.5), (75, 0, 20)),
        (5, 0, 75, (0, 75, 22.5), (-75, 0, 25)),
        (6, 12.5, 87.5, (12.5, -87.5, 27.5), (100, 0, 30)),
        (7, 0, 100, (0, 100, 32.5), (-100, 0, 35)),
        (8, 12.5, 112.5, (12.5, -112.5, 37.5), (125, 0, 40)),
    ],
)
def test_eight_half_circles_make_a_spiral_of_two_centres(k, centre, radius, mid, end):
    program = spiral()
    ends = np.concatenate([[0], program.requested.ends])
    piece = program.requested.pieces[k - 1]
    assert piece.centre == pytest.approx((centre, 0, 5 * (k - 1)), abs=POSITION)
    assert piece.radius == pytest.approx((radius, radius), abs=POSITION)
    middle, last = program.requested.position([ends[k - 1 : k + 1].mean(), ends[k]])
    assert middle == pytest.approx(mid, abs=POSITION)
    assert last == pytest.approx(end, abs=POSITION)
    assert program.legs[k - 1].path.end[:3] == pytest.approx(end, abs=POSITION)


@pytest.mark.validates(
    "spiral of half circles of softMC: length and time",
    "table of the specification",
    "its last digit",
)
def test_length_and_time_of_the_eight_half_circles():
    program = spiral()
    flat = sum(piece.radius[0] * abs(piece.angle) for piece in program.requested.pieces)
    assert flat == pytest.approx(1727.876, abs=5e-4)
    assert program.requested.length == pytest.approx(1728.458, abs=5e-4)
    assert program.duration == pytest.approx(3.590, abs=5e-4)


def test_circle_by_points():
    program = Program("Circle G1 CirclePoint={0,100} TargetPoint={-100,0}", start=(100, 0))
    (piece,) = program.requested.pieces
    assert piece.centre == pytest.approx((0, 0, 0), abs=POSITION)
    assert piece.radius == pytest.approx((100, 100), abs=POSITION)
    assert math.degrees(piece.angle) == pytest.approx(180)
    assert end_of(program)[:2] == pytest.approx((-100, 0))


@pytest.mark.parametrize(("via", "degrees"), [((0, 100), 180), ((0, -100), -180)])
def test_a_circle_by_points_in_the_xy_plane_turns_as_seen_from_above(via, degrees):
    path = Program([Circle(via=via, target=(-100, 0))], start=(100, 0)).requested
    turned = path.heading(path.length)[0] - path.heading(0)[0]
    assert math.degrees(turned) == pytest.approx(degrees)
    tilted = Program([Circle(via=(*via, 10), target=(-100, 0, 20))], start=(100, 0, 0)).requested
    assert np.sign(tilted.pieces[0].angle) == np.sign(degrees)
    assert np.cross(*tilted.pieces[0].frame)[2] > 0


def test_quarter_circle_about_20_10():
    program = Program("Circle Angle=90 CircleCenter={20,10}")
    assert program.requested.pieces[0].radius[0] == pytest.approx(22.3607, abs=5e-5)
    assert end_of(program)[:2] == pytest.approx((30, -10), abs=POSITION)
    assert program.setpoints(PERIOD).position[-1] == pytest.approx((30, -10), abs=POSITION)


def test_text_and_commands_say_the_same():
    text = """
    Move G1 {25, 0, 0}                                                       ' to the start
    circle g1 angle = 180 CIRCLECENTER={0, 0, 5} CirclePlane=0 Vtran=500
    ' a line of comment alone
    Circle CirclePoint={0,100} TargetPoint={-100,0} Acc=2000 Dec=1000 Jerk=5e4 PrfType=-1 Smooth=-1
    Circle G1 Angle=-90 CircleCenter={0,0,0} Abs=0 VCruise=20 Dispense=0 CirclePlane=2
    """.replace("Angle=-90 CircleCenter={0,0,0}", "Angle=-90 CircleCenter={0,0,1}")
    commands = [
        Move((25, 0, 0)),
        Circle(180, (0, 0, 5), velocity=500),
        Circle(
            via=(0, 100),
            target=(-100, 0),
            acceleration=2000,
            deceleration=1000,
            jerk=5e4,
            profile="smooth",
            smooth=-1,
        ),
        Circle(-90, (0, 0, 1), plane=2, absolute=False, velocity=20, dispense=False),
    ]
    from_text, from_commands = Program(text, start=(0, 0, 0)), Program(commands, start=(0, 0, 0))
    np.testing.assert_array_equal(from_text.setpoints(PERIOD).position, from_commands.setpoints(PERIOD).position)
    np.testing.assert_array_equal(from_text.setpoints(PERIOD).dispense, from_commands.setpoints(PERIOD).dispense)
    assert from_text.axes == ("x", "y", "z")


def test_omitted_coordinates_stay():
    program = Program([Circle(90, (0, 10)), Move((1, 2))], start=(0, 0, 7, 30))
    assert end_of(program) == pytest.approx((1, 2, 7, 30))
    assert program.requested.position(program.requested.ends[0])[0] == pytest.approx((10, 10, 7))


@given(points, st.data())
@examples(50)
def test_a_circle_keeps_its_distance_and_turns_and_climbs_evenly(start, data):
    circle = data.draw(arcs(start))
    path = Program([circle], start=start).requested
    share = np.linspace(0, 1, 200)
    position = path.position(share * path.length)
    place = (position[:, :2] - circle.centre[:2]) @ [1, 1j]
    assert np.abs(place) == pytest.approx(np.full(200, abs(place[0])), abs=POSITION)
    turned = np.angle(place / place[0] * np.exp(-1j * np.radians(circle.angle) * share))
    assert turned == pytest.approx(np.zeros(200), abs=1e-9)  # also tells + from -, and one turn from several
    climbed = start[2] + share * (circle.centre[2] - start[2])
    assert position[:, 2] == pytest.approx(climbed, abs=POSITION)
    length = math.hypot(math.radians(circle.angle) * abs(place[0]), circle.centre[2] - start[2])
    assert path.length == pytest.approx(length, rel=1e-12)


def test_several_turns_are_as_many_circles():
    path = Program([Circle(-1080, (30, 0))]).requested
    assert path.length == pytest.approx(3 * 2 * math.pi * 30)
    assert path.position([path.length, path.length / 3]) == pytest.approx(np.zeros((2, 3)), abs=POSITION)
    assert path.heading(path.length)[0] - path.heading(0)[0] == pytest.approx(-6 * math.pi)


@given(points, st.data(), st.sampled_from([(1, (0, 2, 1)), (2, (1, 2, 0))]))
@examples(50)
def test_planes_are_the_xy_plane_with_its_axes_exchanged(start, data, plane):
    number, order = plane
    circle = data.draw(arcs(start))

    def exchanged(point):
        out = [0.0, 0.0, 0.0]
        for value, axis in zip(point, order, strict=True):
            out[axis] = value
        return tuple(out)

    flat = Program([circle], GROUP, start).setpoints(PERIOD * 10).position
    turned = Circle(circle.angle, exchanged(circle.centre), plane=number)
    other = Program([turned], GROUP, exchanged(start)).setpoints(PERIOD * 10).position
    assert other[:, order] == pytest.approx(flat, abs=POSITION)


@given(points, points, points)
@examples(100)
def test_a_circle_through_points_passes_them_in_their_plane(start, via, target):
    h, v, t = map(np.array, (start, via, target))
    sides = [np.linalg.norm(v - h), np.linalg.norm(t - h), np.linalg.norm(t - v)]
    normal = np.cross(v - h, t - h)
    assume(min(sides) > 1 and np.linalg.norm(normal) > 0.02 * max(sides) ** 2)
    path = Program([Circle(via=via, target=target)], start=start).requested
    trace = path.position(np.linspace(0, path.length, 300))
    assert trace[[0, -1]] == pytest.approx(np.array([h, t]), abs=1e-8)
    assert path.project(v).distance[0] < 1e-8
    assert (trace - h) @ normal / np.linalg.norm(normal) == pytest.approx(np.zeros(300), abs=1e-8)
    (piece,) = path.pieces
    assert np.linalg.norm(trace - piece.centre, axis=1) == pytest.approx(np.full(300, piece.radius[0]), abs=1e-8)
    assert abs(piece.angle) < 2 * math.pi
    assert 0 < path.project(v).s[0] < path.length


@given(st.lists(points, min_size=1, max_size=4), points, st.floats(-180, 180), points)
@examples(50)
def test_a_program_moved_and_turned_moves_and_turns_the_setpoints(targets, start, degrees, shift):
    turn, c, s = np.eye(3), math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    turn[:2, :2] = [[c, -s], [s, c]]

    def moved(point):
        return tuple(turn @ point + shift)

    there, back = [], []
    for target in targets:
        there.append(Move(target))
        centre = np.add(target, (7, -5, 3))
        there.append(Circle(200, tuple(centre)))
        back += [Move(moved(target)), Circle(200, moved(centre))]
    there.append(Circle(via=(210, 220, 230), target=(-300, 310, 320)))
    back.append(Circle(via=moved((210, 220, 230)), target=moved((-300, 310, 320))))
    first = Program(there, GROUP, start).setpoints(0.02).position
    second = Program(back, GROUP, moved(start)).setpoints(0.02).position
    assert len(second) == pytest.approx(len(first), abs=2)
    if len(second) == len(first):  # a duration may be rounded over a tick
        assert second == pytest.approx(first @ turn.T + shift, abs=1e-7)


@given(points, st.data())
@examples(30)
def test_incremental_coordinates_are_relative_to_the_start_of_the_command(start, data):
    circle = data.draw(arcs(start))
    first = Program([circle, Move((5, 6, 7))], GROUP, start)
    here = first.legs[0].path.end[:3]
    steps = [Circle(circle.angle, tuple(np.subtract(circle.centre, start))), Move(tuple(np.subtract((5, 6, 7), here)))]
    second = Program(steps, Group(acceleration=30000, absolute=False), start)
    assert end_of(second) == pytest.approx(end_of(first), abs=POSITION)
    assert second.requested.length == pytest.approx(first.requested.length, rel=1e-12)
    alone = Program([Circle(circle.angle, steps[0].centre, absolute=False), Move((5, 6, 7))], GROUP, start)
    assert end_of(alone) == pytest.approx((5, 6, 7, 0))


def test_a_move_to_the_present_position_takes_no_time():
    program = Program([Move((0, 0)), Move((10, 0)), Move((10, 0))])
    assert program.duration == Program([Move((10, 0))]).duration
    assert len(program.requested.pieces) == 1
    assert len(program.setpoints(PERIOD).position) == len(Program([Move((10, 0))]).setpoints(PERIOD).position)
