"""Corners within their tolerance by brute force; speeds and accelerations of the setpoints by differences; travel."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gantrysim.base.errors import InputError
from gantrysim.controllers.drawings import Drawing
from gantrysim.job.programs import build
from gantrysim.paths.pieces import Line

from support.drawings import bulge_points, circle, csv, differences, dxf, farthest, group, line, polyline, sampled, svg
from support.soaked import examples

TICK = 1e-3  # [s]
# Share by which velocities and accelerations exceed their limits between the nodes of the profile, and absolute for
# the rounding of the differences [mm/s²].
EXCESS = 2e-3
NOISE = 0.05

coordinates = st.integers(-100, 100).map(lambda k: k / 10)
vertices = st.lists(
    st.tuples(coordinates, coordinates, st.sampled_from([0, 0, 0, 0.3, -0.4, 1, -1.5])),
    min_size=3,
    max_size=7,
    unique_by=lambda vertex: vertex[:2],
)


def drawn(points):
    """The polyline's points, closely on its arcs."""
    parts = []
    for (x, y, bulge), (u, v, _) in pairwise(points):
        ends = np.array([(x, y), (u, v)], float)
        parts.append(bulge_points(*ends, bulge, 3000) if bulge else ends)
    return np.pad(np.concatenate(parts), ((0, 0), (0, 1)))


def closely(points, spacing=0.005):
    at = np.append(0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1)))
    s = np.unique(np.append(np.arange(0, at[-1], spacing), at))
    return np.stack([np.interp(s, at, column) for column in points.T], axis=1)


@given(vertices, st.floats(1e-3, 2.0))
@examples(12)
def test_every_corner_deviates_by_at_most_the_tolerance(points, tolerance):
    drawing = Drawing(dxf(polyline(points)), corner_tolerance=tolerance)
    exact = closely(drawn(points))
    path = closely(sampled(drawing.route.chain, 0.05))
    slack = 1e-4 * tolerance + 2e-5  # of the sampled arcs
    assert farthest(path, exact) <= tolerance + slack
    assert farthest(exact, path) <= tolerance + slack
    assert path[[0, -1]] == pytest.approx(exact[[0, -1]], abs=1e-9)
    # the tangent is continuous wherever a corner is rounded
    assert drawing.route.chain.corners.size == drawing.route.corners.sharp


@pytest.mark.parametrize("turn", [10, 45, 90, 120, 170])
def test_the_arc_of_a_corner_uses_the_whole_tolerance(turn):
    tolerance, legs = 0.1, 40.0
    z = legs + legs * np.exp(1j * math.radians(turn))
    chain = Drawing(csv([(0, 0), (legs, 0), (z.real, z.imag)]), corner_tolerance=tolerance).route.chain
    _, blend, _ = chain.pieces
    half = math.radians(turn) / 2
    # r (1 / cos(theta / 2) - 1) = tolerance
    assert blend.radius[0] == pytest.approx(tolerance / (1 / math.cos(half) - 1), rel=1e-6)
    off = np.linalg.norm(sampled(chain) - [legs, 0, 0], axis=1).min()
    assert off == pytest.approx(tolerance, rel=1e-6)


def test_a_corner_in_space_is_rounded_in_its_own_plane():
    points = [(0, 0, 0), (30, 0, 5), (30, 30, 20), (0, 10, 0)]
    drawing = Drawing(csv(points), corner_tolerance=0.2)
    exact = closely(np.array(points, float))
    assert drawing.route.corners.rounded == 2
    assert not drawing.route.chain.corners.size
    assert farthest(sampled(drawing.route.chain), exact) <= 0.2 + 1e-6
    assert farthest(exact, sampled(drawing.route.chain)) == pytest.approx(0.2, rel=1e-3)


def test_short_lines_leave_half_of_themselves_to_each_corner():
    points = [(k, k % 2) for k in range(10)]
    drawing = Drawing(csv(points), corner_tolerance=5.0)
    assert drawing.route.corners.rounded == 8
    inner = [piece for piece in drawing.route.chain.pieces[1:-1] if isinstance(piece, Line)]
    assert not inner
    assert farthest(closely(np.pad(np.array(points, float), ((0, 0), (0, 1)))), sampled(drawing.route.chain)) < 5


def test_corners_that_double_back_or_change_the_glue_stay():
    back = Drawing(csv([(0, 0), (30, 0), (10, 0)]), corner_tolerance=1.0)
    assert (back.route.corners.rounded, back.route.corners.sharp) == (0, 1)
    switched = Drawing("x,y,glue\n0,0,1\n30,0,1\n30,30,0\n0,30,0", corner_tolerance=1.0)
    assert (switched.route.corners.rounded, switched.route.corners.sharp) == (1, 1)


limits = st.tuples(*[st.sampled_from([60.0, 150.0, 1000.0, math.inf])] * 2, st.just(100.0))
accelerations = st.tuples(*[st.sampled_from([300.0, 2000.0, 5000.0])] * 2, st.just(1000.0))


@given(vertices, st.sampled_from([0, 0.02, 0.5]), limits, accelerations, st.sampled_from([20.0, 100.0, 400.0]))
@examples(25)
def test_setpoints_keep_the_limits_of_the_axes_and_the_speed(points, tolerance, velocity, acceleration, speed):
    drawing = Drawing(
        dxf(polyline(points), circle((5.0, 5.0), 3.0)),
        corner_tolerance=tolerance,
        velocity=velocity,
        acceleration=acceleration,
        speed=speed,
        travel_speed=speed,
        lift=4.0,
    )
    setpoints = drawing.setpoints(TICK)
    fast, hard = differences(setpoints)
    assert (np.abs(fast).max(axis=0) <= np.array(velocity) * (1 + EXCESS)).all()
    assert (np.abs(hard).max(axis=0) <= np.array(acceleration) * (1 + EXCESS) + NOISE).all()
    assert np.linalg.norm(fast, axis=1).max() <= speed * (1 + 1e-6)
    assert setpoints.position[-1] == pytest.approx(drawing.requested.position(drawing.requested.length)[0], abs=1e-9)


def test_the_limits_are_used_in_full():
    square = svg('<rect x="10" y="10" width="60" height="60"/>', '<circle cx="50" cy="50" r="20"/>')
    drawing = Drawing(
        square, speed=1000.0, travel_speed=1000.0, velocity=(150, 200, 100), acceleration=(2000, 1500, 1000)
    )
    fast, hard = differences(drawing.setpoints(TICK))
    assert np.abs(fast).max(axis=0) == pytest.approx([150, 200], rel=EXCESS)
    assert np.abs(hard).max(axis=0) == pytest.approx([2000, 1500], rel=EXCESS)
    free = Drawing(square, speed=1000.0, travel_speed=1000.0, velocity=(math.inf,) * 3, acceleration=(math.inf,) * 3)
    assert free.duration == pytest.approx(free.route.chain.length / 1000, rel=1e-9)
    # rest to rest along one line in closed form: v / a + (l - v^2 / a) / v
    single = Drawing(csv([(0, 0), (80, 0)]), speed=100.0)
    assert single.duration == pytest.approx(100 / 2000 + 80 / 100, rel=1e-4)


@pytest.mark.parametrize("jump", [0.0, 10.0, 40.0])
def test_a_sharp_corner_is_passed_at_the_allowed_jump(jump):
    drawing = Drawing(csv([(0, 0), (40, 0), (40, 40)]), corner_tolerance=0, corner_speed=jump)
    fast = differences(drawing.setpoints(1e-4))[0]
    at = int(np.flatnonzero(fast[:, 1] > 0)[0])
    # both axes change by the path speed; within a tick of the corner each accelerates besides
    assert np.abs(fast[at + 1] - fast[at - 1]).max() == pytest.approx(jump, abs=2000 * 3e-4 + 0.1)
    through = [Drawing(csv([(0, 0), (40, 0), (40, 40)]), corner_tolerance=t).duration for t in (0.2, 0.02, 0)]
    assert through[0] < through[1] < through[2]


def test_glue_is_laid_on_strokes_and_not_between():
    drawing = Drawing(dxf(line((0, 0), (20, 0)), line((20, 10), (0, 10))), lift=5.0, height=1.0)
    setpoints = drawing.setpoints(TICK)
    low = np.abs(setpoints.position[:, 2] - 1) < 1e-9
    y = setpoints.position[:, 1]
    assert setpoints.axes == ("x", "y", "z")
    assert setpoints.dispense[low & (y > 0) & (y < 10)].sum() == 0
    assert not setpoints.dispense[~low].any()
    assert setpoints.dispense.sum() * TICK == pytest.approx(2 * (20 / 50 + 50 / 2000), abs=5 * TICK)
    assert setpoints.position[:, 2].max() == pytest.approx(6)
    assert setpoints.position[[0, -1], 2] == pytest.approx([6, 6])
    assert Drawing(dxf(line((0, 0), (20, 0)))).axes == ("x", "y")


def test_layers_and_colours_choose_what_is_traced_and_what_glues():
    text = dxf(
        line((0, 0), (10, 0), "BEAD"),
        line((10, 0), (20, 0), "WAY"),
        line((20, 0), (30, 0), "BEAD", (62, 1)),
        line((0, 50), (30, 50), "FRAME"),
    )

    def laid(**arguments):
        drawing = Drawing(text, **arguments)
        return sum(leg.length for leg in drawing.route.legs if leg.glue), drawing.route.chain.length

    layers = ("bead", "Way")
    assert laid(layers=layers) == pytest.approx((30, 30))
    assert laid(layers=layers, glue=("BEAD",)) == pytest.approx((20, 30))
    assert laid(layers=layers, glue={"way": False}) == pytest.approx((20, 30))
    assert laid(layers=layers, glue=("red",)) == pytest.approx((10, 30))
    assert laid(layers=layers, glue=("#ff0000",)) == pytest.approx((10, 30))
    assert laid(layers=layers, glue={"red": False, "BEAD": True}) == pytest.approx((20, 30))
    # the way between is run at the travel speed without a stop
    drawing = Drawing(text, layers=layers, glue=("BEAD",), travel_speed=20.0, speed=20.0)
    assert drawing.duration == pytest.approx(30 / 20 + 20 / 2000, rel=1e-3)
    assert any("1 stroke of other layers" in note for note in drawing.notes)
    with pytest.raises(InputError, match=r"unknown layers: layer or colour 'bed': did you mean bead\?"):
        Drawing(text, layers=("bed",))
    with pytest.raises(InputError, match=r"unknown glue: layer or colour 'bed'"):
        Drawing(text, glue={"bed": False})


def test_colours_and_groups_of_svg():
    text = svg(
        '<g id="bead"><path d="M0 0h10" stroke="red"/></g><path style="stroke:#00f" d="M0 9h20"/><path d="M0 20h40"/>'
    )
    for names, length in ((("bead",), 10), (("red",), 10), (("blue",), 20), (("#00F",), 20), (("bead", "blue"), 30)):
        drawing = Drawing(text, glue=names)
        assert sum(leg.length for leg in drawing.route.legs if leg.glue) == pytest.approx(length, abs=1e-4)


@given(st.floats(1e-6, 0.009), st.floats(0, 2 * math.pi), st.sampled_from(["line", "arc", "arcs"]))
@examples(30)
def test_strokes_whose_ends_nearly_meet_are_joined(gap, direction, kind):
    dx, dy = gap * math.cos(direction), gap * math.sin(direction)
    first, second = {
        "line": (line((0, 0), (20, 0)), line((20 + dx, dy), (40, 5))),
        "arc": (line((0, 0), (20, 0)), polyline([(20 + dx, dy, 0.4), (40, 5, 0)])),
        "arcs": (polyline([(0, 0, -0.5), (20, 0, 0)]), polyline([(20 + dx, dy, 0.4), (40, 5, 0)])),
    }[kind]
    drawing = Drawing(dxf(first, second))
    assert drawing.route.stretches == 1
    assert not any(leg.travel for leg in drawing.route.legs)
    assert drawing.setpoints(TICK).dispense.all()
    apart = Drawing(dxf(first, second), join_tolerance=0.0)
    assert apart.route.stretches == 2


def test_order_and_direction():
    strokes = dxf(line((0, 0), (10, 0)), line((50, 0), (40, 0)), line((20, 0), (12, 0)), line((35, 5), (25, 5)))

    def starts(**arguments):
        return [leg.start[0] for leg in Drawing(strokes, **arguments).route.legs if leg.glue]

    assert starts() == [0, 50, 20, 35]
    assert starts(order="nearest") == [0, 20, 35, 50]
    assert starts(order="nearest", reverse=True) == [0, 12, 25, 40]
    # an outline of lines in mixed directions
    mixed = dxf(line((10, 0), (0, 0)), line((10, 0), (10, 10)), line((0, 10), (10, 10)), line((0, 10), (0, 0)))
    assert Drawing(mixed).route.stretches == 4
    assert Drawing(mixed, reverse=True).route.stretches == 1
    assert Drawing(mixed, reverse=True).requested.length == pytest.approx(40)


def dot(x, y):
    return group((0, "POINT"), (8, "0"), (10, float(x)), (20, float(y)), (30, 0.0))


def test_points_are_dots_where_they_have_a_time():
    text = dxf(line((0, 0), (10, 0)), dot(20, 0), dot(30, 0), line((40, 0), (50, 0)))
    ignored = Drawing(text)
    assert any("2 POINT" in note for note in ignored.notes)
    drawing = Drawing(text, dot_time=0.25)
    setpoints = drawing.setpoints(TICK)
    for x in (20, 30):
        there = np.abs(setpoints.position[:, 0] - x) < 1e-9
        assert (there & setpoints.dispense).sum() * TICK == pytest.approx(0.25, abs=2 * TICK)
    between = (setpoints.position[:, 0] > 20.01) & (setpoints.position[:, 0] < 29.99)
    assert between.any()
    assert not setpoints.dispense[between].any()
    assert np.abs(differences(setpoints)[1]).max() <= 2000 * (1 + EXCESS) + NOISE
    alone = Drawing(dxf(dot(20, 0)))  # nothing but a dot: 0.2 s, reached from beside it
    assert alone.setpoints(TICK).dispense.sum() * TICK == pytest.approx(0.2, abs=2 * TICK)
    assert alone.setpoints(TICK).position[0] == pytest.approx([20.5, 0])
    assert Drawing(dxf(dot(20, 0)), dot_time=0.1, start=(0, 0)).setpoints(TICK).dispense.any()


def test_the_motion_begins_at_the_start():
    for lift in (0.0, 5.0):
        drawing = Drawing(csv([(10, 10), (20, 10)]), start=(1, 2), lift=lift)
        assert drawing.setpoints(TICK).position[0, :2].tolist() == [1, 2]
        assert not drawing.setpoints(TICK).dispense[0]


def test_a_csv_s_own_glue_and_speed():
    text = "x;y;glue;speed\n0;0;1;\n30;0;1;20\n60;0;0;\n90;0;1;40,5\n"
    drawing = Drawing(text, speed=30.0, travel_speed=80.0)
    assert [(leg.glue, leg.speed) for leg in drawing.route.legs] == [(True, 20), (False, 80), (True, 40.5)]
    assert drawing.programmed_speed == 40.5
    faster = build("cad.Drawing", {**drawing.arguments(), **drawing.arguments_at(81)})
    assert [leg.speed for leg in faster.route.legs] == pytest.approx([40, 80, 81])
    assert faster.speed == 60
    for part, speed in (((5, 25), 20), ((35, 55), 80), ((65, 85), 40.5)):
        setpoints = drawing.setpoints(TICK)
        x = setpoints.position[:, 0]
        inside = (x[:-1] > part[0]) & (x[1:] < part[1])
        assert np.diff(x)[inside].max() / TICK == pytest.approx(speed, rel=1e-6)


@pytest.mark.parametrize(
    ("points", "speed", "acceleration", "weakest"),
    [
        ([(0, 0), (30, 40)], 100.0, (4000.0, 500.0, 1000.0), 500 / 0.8),
        ([(0, 0), (40, 30)], 100.0, (500.0, 4000.0, 1000.0), 500 / 0.8),
        ([(0, 0, 0), (32, 0, 24)], 60.0, (2000.0, 10.0, 300.0), 300 / 0.6),
        ([(0, 0), (80, 0)], 90.0, (700.0, 1.0, 1.0), 700.0),
    ],
)
def test_a_line_takes_the_time_that_the_axis_nearest_to_its_limit_allows(points, speed, acceleration, weakest):
    """Rest to rest at the speed v and a = min(a_i / |t_i|) along the direction t: l / v + v / a."""
    drawing = Drawing(csv(points), speed=speed, acceleration=acceleration)
    length = math.dist(*points)
    assert drawing.duration == pytest.approx(length / speed + speed / weakest, rel=5e-4)


@pytest.mark.parametrize("acceleration", [(4000.0, 300.0, 1000.0), (4000.0, 150.0, 1000.0)])
def test_a_circle_begins_and_ends_with_the_acceleration_of_the_axis_along_it(acceleration):
    """A slow circle from its rightmost point: its ramps run along y, and v² / r needs a sixth of any limit."""
    drawing = Drawing(svg('<circle cx="50" cy="50" r="20"/>'), speed=20.0, acceleration=acceleration)
    expected = 40 * math.pi / 20 + 20 / acceleration[1]
    assert drawing.duration == pytest.approx(expected, rel=3e-5)
