"""Outline tracing on an XY stage on a rotary table, against a rounded polygon and a transformation of the tests' own.

C + R(TH) (W + u + sigma S - C) = K, with rotation matrices: u is the place of the work under the needle.
"""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gantrysim.controllers.stage import OutlineTrace
from gantrysim.errors import InputError

POSITION = 1e-9  # of the needle on the outline [mm]
ANGLE = 1e-9  # of the outward normal at the needle [deg]
SPEED = 1e-6  # relative, of the needle on the work where no limit bites
VELOCITY = 1e-5  # relative, beyond a limit of an axis
# The law keeps a thousandth of an acceleration in hand for what lies between its nodes. A corner where axes
# turn by a radian a millimetre may need more of it.
ACCELERATION = 2e-3
NODES = 0.05  # between places where the limits are looked at: a halt costs up to as much at the path speed [mm]
TABLE = 5e-5  # what the note's figures leave open


def rotation(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.moveaxis(np.array([[c, -s], [s, c]]), (0, 1), (-2, -1))


def turned(vectors, angle):
    """Vectors (n, 2) or (2,) turned by angles (n,) or one [rad]."""
    return np.einsum("...ij,...j->...i", rotation(np.asarray(angle)), np.asarray(vectors, float))


def on_the_work(trace, position):
    """Place of the work under the needle, (n, 2), by the forward transformation, for axes th, x, y."""
    th, stage = np.radians(position[:, 0]), position[:, 1:]
    needle, centre, work = (np.array(v, float) for v in (trace.needle, trace.centre, trace.work_centre))
    # R(-TH) (K - C) = W + u + sigma S - C
    return turned(np.broadcast_to(needle - centre, stage.shape), -th) + centre - work - trace.sigma * stage


class Rounded:
    """A polygon with rounded corners: points and outward normals over the arc length, in the order of its corners."""

    def __init__(self, corners, radius):
        p = np.array(corners, float)
        m = len(p)
        way = np.roll(p, -1, axis=0) - p
        way /= np.linalg.norm(way, axis=1)[:, None]
        area = 0.5 * sum(p[k][0] * p[(k + 1) % m][1] - p[k][1] * p[(k + 1) % m][0] for k in range(m))
        self.outside = -1.0 if area > 0 else 1.0  # left of the way, where clockwise
        self.edges, self.arcs, self.ends = [], [], [0.0]
        cut = np.empty(m)
        self.turn = np.empty(m)
        for k in range(m):  # the corner at the end of edge k
            a, b = way[k], way[(k + 1) % m]
            self.turn[k] = math.atan2(a[0] * b[1] - a[1] * b[0], a @ b)
            cut[k] = radius * math.tan(0.5 * abs(self.turn[k]))
        self.room = min(
            np.linalg.norm(p[(k + 1) % m] - p[k]) * radius / (cut[k] + cut[k - 1]) for k in range(m)
        )  # largest radius for which all arcs have room
        self.pieces = []
        for k in range(m):
            begin, end = p[k] + cut[k - 1] * way[k], p[(k + 1) % m] - cut[k] * way[k]
            left = np.array([-way[k][1], way[k][0]])
            self.pieces.append(("edge", begin, way[k], left))
            self.ends.append(self.ends[-1] + (end - begin) @ way[k])
            side = math.copysign(1.0, self.turn[k])
            self.pieces.append(("arc", end + side * radius * left, -side * left, side / radius))
            self.ends.append(self.ends[-1] + radius * abs(self.turn[k]))
        self.ends = np.array(self.ends)
        self.length = self.ends[-1]

    def __call__(self, s):
        points, normals = np.empty((len(s), 2)), np.empty((len(s), 2))
        k = np.clip(np.searchsorted(self.ends, s, side="right") - 1, 0, len(self.pieces) - 1)
        for i, (kind, place, first, second) in enumerate(self.pieces):
            here = k == i
            rest = s[here] - self.ends[i]
            if kind == "edge":
                points[here] = place + rest[:, None] * first
                normals[here] = self.outside * second
            else:
                radial = turned(np.broadcast_to(first, (rest.size, 2)), rest * second)
                points[here] = place + radial / abs(second)
                normals[here] = radial * -math.copysign(1.0, second) * self.outside
        return points, normals


RECTANGLE = ((-50, -30), (-50, 30), (50, 30), (50, -30))  # clockwise, the left edge first, upwards
ELL = ((0, 0), (60, 0), (60, -30), (120, -30), (120, 60), (0, 60))  # one corner is concave


@st.composite
def polygons(draw):
    """Corners of a polygon about a place of its own: 3 to 6, some concave, in either sense."""
    m = draw(st.integers(3, 6))
    angles = [2 * math.pi * (k + draw(st.floats(-0.2, 0.2))) / m for k in range(m)]
    radii = [draw(st.floats(30, 120)) for _ in range(m)]
    x, y = draw(st.floats(-50, 50)), draw(st.floats(-50, 50))
    corners = [(x + r * math.cos(a), y + r * math.sin(a)) for r, a in zip(radii, angles, strict=True)]
    return tuple(corners if draw(st.booleans()) else reversed(corners))


place = st.tuples(st.floats(-300, 300), st.floats(-300, 300))


@st.composite
def traces(draw, **fixed):
    corners = draw(polygons())
    direction = draw(st.floats(-math.pi, math.pi))
    return {
        "corners": corners,
        "corner_radius": draw(st.floats(0.1, 0.9)) * Rounded(corners, 1.0).room,
        "speed": draw(st.floats(5, 200)),
        "needle": draw(place),
        "centre": draw(place),
        "work_centre": draw(place),
        "normal": (draw(st.floats(0.1, 10)) * math.cos(direction), math.sin(direction)),
        "sigma": draw(st.sampled_from([-1, 1])),
        **fixed,
    }


def angle_between(a, b):
    """From b to a, [deg]."""
    return np.degrees(np.arctan2(b[..., 0] * a[..., 1] - b[..., 1] * a[..., 0], np.sum(a * b, axis=-1)))


def velocities(setpoints):
    return np.diff(setpoints.position, axis=0)[:-1] / setpoints.period


def accelerations(setpoints):
    return np.diff(velocities(setpoints), axis=0) / setpoints.period


def test_the_notes_perimeter_times_and_speeds():
    trace = OutlineTrace()
    assert trace.requested.length == pytest.approx(302.8319, abs=TABLE)
    assert trace.requested.length == pytest.approx(240 + 20 * math.pi, abs=POSITION)
    assert trace.duration == pytest.approx(6.05664, abs=5e-6)
    assert trace.axes == ("th", "x", "y")
    assert trace.notes == ()
    edges = np.concatenate([[0], trace.turning.s])
    corner = np.diff(trace.turning.s)[1::2] / 50
    assert corner == pytest.approx(np.full(4, 0.314159), abs=5e-7)
    assert edges.size == 10
    setpoints = trace.setpoints(1e-4)
    velocity = velocities(setpoints)
    t = setpoints.time[:-2]
    turning = (t > 0.8 + 1e-3) & (t < 0.8 + 0.314159 - 1e-3)
    assert velocity[turning, 0] == pytest.approx(np.full(turning.sum(), 286.479), abs=5e-4)
    assert velocity[turning, 0] == pytest.approx(50 / (math.pi * 10 / 180), rel=1e-6)  # LSP / DRL, not times
    stage = np.hypot(velocity[turning, 1], velocity[turning, 2])
    assert stage == pytest.approx(np.full(turning.sum(), 950), rel=1e-6)
    bend = accelerations(setpoints)
    inside = (t[:-1] > 0.801) & (t[:-1] < 1.113)
    assert np.hypot(bend[inside, 1], bend[inside, 2]) == pytest.approx(np.full(inside.sum(), 4750), rel=1e-5)


def test_the_stage_runs_on_an_arc_of_radius_190_in_every_corner():
    trace = OutlineTrace()
    for low, high in zip(trace.turning.s[1::2], trace.turning.s[2::2], strict=True):
        stage = trace.coordinates(np.linspace(low, high, 50))[:, 1:]
        # the circle through three points, and the others on it
        (ax, ay), (bx, by), (cx, cy) = stage[[0, 25, 49]]
        centre = np.linalg.solve(
            2 * np.array([[bx - ax, by - ay], [cx - ax, cy - ay]]),
            [bx**2 + by**2 - ax**2 - ay**2, cx**2 + cy**2 - ax**2 - ay**2],
        )
        assert np.linalg.norm(stage - centre, axis=1) == pytest.approx(np.full(50, 190), abs=1e-8)


@pytest.mark.parametrize(
    ("edge", "th", "begin", "end"),
    [
        (0, 0, ((-50, -20), (150, -20)), ((-50, 20), (150, 20))),
        (1, 90, ((-40, 30), (-40, -170)), ((40, 30), (40, -170))),
        (2, 180, ((50, 20), (-150, 20)), ((50, -20), (-150, -20))),
        (3, 270, ((40, -30), (40, 170)), ((-40, -30), (-40, 170))),
    ],
)
def test_the_notes_table_of_edges(edge, th, begin, end):
    trace = OutlineTrace()
    lengths = [40, 5 * math.pi, 80, 5 * math.pi] * 2
    s = np.cumsum([0, *lengths])[2 * edge : 2 * edge + 2]
    assert trace.coordinates(s) == pytest.approx(np.array([[th, *begin[1]], [th, *end[1]]]), abs=POSITION)
    assert trace.requested.position(s)[:, :2] == pytest.approx(np.array([begin[0], end[0]]), abs=POSITION)
    assert trace.coordinates(np.linspace(*s, 9))[:, 0] == pytest.approx(np.full(9, th), abs=ANGLE)


def test_the_middle_of_the_first_corner():
    trace = OutlineTrace()
    s = 40 + 2.5 * math.pi
    assert trace.requested.position(s)[0] == pytest.approx([-47.0711, 27.0711, 0], abs=TABLE)
    assert trace.coordinates(s)[0] == pytest.approx([45, 94.3503, -114.3503], abs=TABLE)


@pytest.mark.parametrize(("pieces", "error", "figure"), [(1, 55.650, 5e-4), (9, 0.7230, 5e-5), (90, 0.00723, 5e-6)])
def test_the_notes_errors_of_linear_corner_interpolation(pieces, error, figure):
    """rho (1 - cos(pi / 4 N)), the chord's distance from the arc."""
    trace = OutlineTrace(corner_pieces=pieces)
    exact = OutlineTrace()
    s = np.linspace(0, trace.requested.length, 200_001)
    off = np.linalg.norm((trace.coordinates(s) - exact.coordinates(s))[:, 1:], axis=1).max()
    assert off == pytest.approx(error, abs=figure)
    assert off == pytest.approx(190 * (1 - math.cos(math.pi / 4 / pieces)), rel=1e-4)
    assert trace.coordinates(s)[:, 0] == pytest.approx(exact.coordinates(s)[:, 0], abs=1e-7)
    assert trace.notes == (f"corners: {pieces} linear pieces each are off the arc by up to {off:.4g} mm",)
    # the needle is as far off the outline
    u = on_the_work(trace, trace.coordinates(s))
    assert np.linalg.norm(u - Rounded(RECTANGLE, 10)(s)[0], axis=1).max() == pytest.approx(off, rel=1e-9)


def test_an_inner_corner_is_further_off_its_arc():
    """All corners turn by 90 deg; about the inner one the stage's radius is 210 mm, about the others 190 mm."""
    trace = OutlineTrace(corners=ELL, corner_pieces=9)
    assert trace.notes == (f"corners: 9 linear pieces each are off the arc by up to {210 / 190 * 0.7230:.4g} mm",)


@given(traces(), st.integers(1, 12))
@settings(max_examples=40, deadline=None)
def test_linear_corners_are_off_by_what_the_notes_say(job, pieces):
    """Convex and concave corners have arcs of other radii, |K - C - r n_K| and |K - C + r n_K|."""
    trace, exact = OutlineTrace(**job, corner_pieces=pieces), OutlineTrace(**job)
    s = np.linspace(0, trace.requested.length, 40_001)
    parts = [
        np.linspace(a, b, 2 * pieces + 1) for a, b in zip(exact.turning.s[1::2], exact.turning.s[2::2], strict=True)
    ]
    s = np.concatenate([s, *parts])
    off = np.linalg.norm((trace.coordinates(s) - exact.coordinates(s))[:, 1:], axis=1).max()
    said = float(trace.notes[-1].split()[-2])
    assert trace.notes[-1] == f"corners: {pieces} linear pieces each are off the arc by up to {said:.4g} mm"
    assert said == pytest.approx(off, rel=1e-3, abs=1e-9)


@given(traces())
@settings(max_examples=100, deadline=None)
def test_the_needle_runs_along_the_outline_at_lsp_with_the_normal_on_n_k(job):
    trace, oracle = OutlineTrace(**job), Rounded(job["corners"], job["corner_radius"])
    assert trace.requested.length == pytest.approx(oracle.length, rel=1e-12)
    assert trace.duration == pytest.approx(oracle.length / job["speed"], rel=1e-12)
    setpoints = trace.setpoints(trace.duration / 700.5)
    way = np.minimum(setpoints.time * job["speed"], oracle.length)
    expected, normals = oracle(way)
    u = on_the_work(trace, setpoints.position)
    assert u == pytest.approx(expected, abs=POSITION)
    at_needle = turned(normals, np.radians(setpoints.position[:, 0]))
    assert np.abs(angle_between(at_needle, np.array(job["normal"]))).max() <= 1e-7
    # the table never jumps
    assert np.abs(np.diff(setpoints.position[:, 0])).max() <= np.degrees(
        job["speed"] * setpoints.period / job["corner_radius"]
    ) * (1 + 1e-9)
    # and turns once round in all, against the sense of the corners
    assert setpoints.position[-1, 0] - setpoints.position[0, 0] == pytest.approx(360 * oracle.outside, abs=1e-7)
    assert np.all(setpoints.dispense)
    assert setpoints.requested is trace.requested
    assert setpoints.axes == ("th", "x", "y")


@given(traces())
@settings(max_examples=40, deadline=None)
def test_the_needles_speed_relative_to_the_work_is_lsp_all_the_way_round(job):
    """Chords of the commanded positions on the work, those over the joints of edges and arcs left out."""
    trace, oracle = OutlineTrace(**job), Rounded(job["corners"], job["corner_radius"])
    setpoints = trace.setpoints(trace.duration / 3000.5)
    chord = np.linalg.norm(np.diff(on_the_work(trace, setpoints.position), axis=0), axis=1)[:-1]
    way = setpoints.time[:-1] * job["speed"]
    piece = np.searchsorted(oracle.ends, way, side="right") - 1
    arc, r = job["speed"] * setpoints.period, job["corner_radius"]
    expected = np.where(piece[:-1] % 2 == 0, arc, 2 * r * np.sin(0.5 * arc / r))
    whole = piece[:-1] == piece[1:]
    assert whole.sum() > 2900
    assert chord[whole] == pytest.approx(expected[whole], rel=SPEED)


@pytest.mark.parametrize("clockwise", [True, False])
@pytest.mark.parametrize("sigma", [-1, 1])
def test_a_rectangle_may_be_run_in_both_senses(clockwise, sigma):
    trace = OutlineTrace(clockwise=clockwise, sigma=sigma)
    corners = RECTANGLE if clockwise else ((-50, 30), (-50, -30), (50, -30), (50, 30))
    s = np.linspace(0, trace.requested.length, 999)
    points, _ = Rounded(corners, 10)(s)
    assert trace.requested.position(s)[:, :2] == pytest.approx(points, abs=POSITION)
    assert on_the_work(trace, trace.coordinates(s)) == pytest.approx(points, abs=POSITION)
    explicit = OutlineTrace(corners=corners, sigma=sigma)
    assert explicit.coordinates(s) == pytest.approx(trace.coordinates(s), abs=POSITION)
    assert trace.coordinates(s)[-1, 0] == pytest.approx(360 if clockwise else -360, abs=ANGLE)


@given(traces(), st.floats(0, 1))
@settings(max_examples=40, deadline=None)
def test_with_the_rotation_about_the_corners_centre_the_stage_stands_still_in_it(job, share):
    """C = K - r n_K: so for the corners that turn as the outline does; an inner corner needs C = K + r n_K."""
    oracle = Rounded(job["corners"], job["corner_radius"])
    n = np.array(job["normal"]) / np.linalg.norm(job["normal"])
    outer = np.sign(oracle.turn) == -oracle.outside
    for side, kind in ((-1, outer), (1, ~outer)):
        job["centre"] = tuple(np.array(job["needle"]) + side * job["corner_radius"] * n)
        trace = OutlineTrace(**job)
        for k in np.flatnonzero(kind):
            at = trace.coordinates(np.linspace(*oracle.ends[2 * k + 1 : 2 * k + 3], 9))
            assert np.abs(at[:, 1:] - at[0, 1:]).max() <= POSITION
            assert abs(at[-1, 0] - at[0, 0]) == pytest.approx(np.degrees(abs(oracle.turn[k])), abs=1e-7)


@given(traces(), place, st.floats(-math.pi, math.pi))
@settings(max_examples=40, deadline=None)
def test_a_moved_or_turned_set_up_moves_or_turns_the_setpoints(job, shift, angle):
    base = OutlineTrace(**job)
    s = np.linspace(0, base.requested.length, 301)
    th, *stage = base.coordinates(s).T
    stage = np.array(stage).T

    def moved(**changed):
        values = OutlineTrace(**{**job, **changed}).coordinates(s)
        return values[:, 0] - th, values[:, 1:]

    def add(name, vector):
        return {name: tuple(np.add(job[name], vector))}

    # the whole set-up in the base frame
    turns, there = moved(**add("needle", shift), **add("centre", shift), **add("work_centre", shift))
    assert np.abs(turns).max() <= 1e-7
    assert there == pytest.approx(stage, abs=POSITION)
    # the work on the stage
    turns, there = moved(**add("work_centre", shift))
    assert there == pytest.approx(stage - job["sigma"] * np.array(shift), abs=POSITION)
    # the outline on the work
    turns, there = moved(corners=tuple(tuple(np.add(corner, shift)) for corner in job["corners"]))
    assert there == pytest.approx(stage - job["sigma"] * np.array(shift), abs=POSITION)
    # the needle and its normal about the centre: the table alone turns
    needle = np.add(job["centre"], turned(np.subtract(job["needle"], job["centre"]), angle))
    turns, there = moved(needle=tuple(needle), normal=tuple(turned(job["normal"], angle)))
    assert there == pytest.approx(stage, abs=POSITION)
    assert np.cos(np.radians(turns)) == pytest.approx(np.full(s.size, math.cos(angle)), abs=1e-9)
    assert np.ptp(turns) <= 1e-7
    # the work about its own centre and that about the table's: the stage's places turn with it
    work = np.add(job["centre"], turned(np.subtract(job["work_centre"], job["centre"]), angle))
    corners = tuple(tuple(turned(corner, angle)) for corner in job["corners"])
    turns, there = moved(work_centre=tuple(work), corners=corners)
    assert there == pytest.approx(turned(stage, angle), abs=1e-8)
    assert np.cos(np.radians(turns)) == pytest.approx(np.full(s.size, math.cos(angle)), abs=1e-9)
    # the stage read the other way
    _, there = moved(sigma=-job["sigma"])
    assert there == pytest.approx(-stage, abs=POSITION)


INF = math.inf
SET_UP = {"needle": (-120.0, 30.0), "centre": (-40.0, -20.0), "normal": (-1.0, 0.4), "speed": 60.0}
LIMITS = [("velocity", 0, 150.0), ("velocity", 1, 150.0), ("velocity", 2, 90.0)]
ACCELERATIONS = [("acceleration", 0, 900.0), ("acceleration", 1, 700.0), ("acceleration", 2, 400.0)]


def alone(name, axis, limit):
    return {name: tuple(limit if k == axis else INF for k in range(3))}


@pytest.mark.parametrize("corners", [RECTANGLE, ELL], ids=["rectangle", "ell"])
@pytest.mark.parametrize(("name", "axis", "limit"), LIMITS)
def test_a_velocity_limit_bites_and_holds(name, axis, limit, corners):
    free = OutlineTrace(corners=corners, **SET_UP)
    held = OutlineTrace(corners=corners, **SET_UP, **alone(name, axis, limit))
    without, within = (np.abs(velocities(trace.setpoints(2e-4))[:, axis]).max() for trace in (free, held))
    assert without > 1.2 * limit
    assert 0.999 * limit <= within <= limit * (1 + VELOCITY)
    assert held.duration > free.duration


@pytest.mark.parametrize("blend", [0.0, 6.0])
@pytest.mark.parametrize("corners", [RECTANGLE, ELL], ids=["rectangle", "ell"])
@pytest.mark.parametrize(("name", "axis", "limit"), ACCELERATIONS)
def test_an_acceleration_limit_bites_and_holds(name, axis, limit, corners, blend):
    free = OutlineTrace(corners=corners, **SET_UP, blend=blend)
    held = OutlineTrace(corners=corners, **SET_UP, blend=blend, **alone(name, axis, limit))
    without, within = (np.abs(accelerations(trace.setpoints(2e-4))[:, axis]).max() for trace in (free, held))
    assert without > 2 * limit
    assert 0.99 * limit <= within <= limit * (1 + ACCELERATION)
    assert held.duration > free.duration


@given(traces(), st.sampled_from([0.0, 0.2, 0.8]), st.data())
@settings(max_examples=40, deadline=None)
def test_all_limits_hold_together_whatever_the_set_up(job, blend, data):
    """With the needle on the outline all the while: the limits change when, not where."""
    oracle = Rounded(job["corners"], job["corner_radius"])
    velocity = tuple(data.draw(st.floats(20, 200)) for _ in range(3))
    acceleration = tuple(data.draw(st.floats(200, 2000)) for _ in range(3))
    blend *= job["corner_radius"]
    trace = OutlineTrace(**job, blend=blend, velocity=velocity, acceleration=acceleration)
    setpoints = trace.setpoints(trace.duration / 20_000.5)
    assert np.all(np.abs(velocities(setpoints)).max(axis=0) <= np.array(velocity) * (1 + ACCELERATION))
    assert np.all(np.abs(accelerations(setpoints)).max(axis=0) <= np.array(acceleration) * (1 + 2 * ACCELERATION))
    u = on_the_work(trace, setpoints.position)
    way = trace.law.position(setpoints.time)
    assert u == pytest.approx(oracle(way)[0], abs=1e-8)
    assert np.all(np.diff(way) >= 0)
    assert trace.law.velocity(np.linspace(0, trace.duration, 5001)).max() <= job["speed"] * (1 + 1e-9)
    assert trace.duration > oracle.length / job["speed"]


@pytest.mark.parametrize(("name", "axis", "limit"), LIMITS)
def test_a_velocity_limit_holds_along_linear_pieces(name, axis, limit):
    """Constant speed in every piece: that of its chord, or of the limit."""
    held = OutlineTrace(corners=ELL, **SET_UP, corner_pieces=5, **alone(name, axis, limit))
    free = OutlineTrace(corners=ELL, **SET_UP, corner_pieces=5)
    parts = [np.linspace(*free.turning.s[k : k + 2], 6 if k % 2 else 2) for k in range(len(free.turning.s) - 1)]
    s = np.unique(np.concatenate(parts))
    step = np.abs(np.diff(free.coordinates(s), axis=0))[:, axis]
    times = np.maximum(np.diff(s) / 60, step / limit)
    assert held.duration == pytest.approx(times.sum(), rel=1e-6)
    assert np.abs(velocities(held.setpoints(2e-4))[:, axis]).max() <= limit * (1 + VELOCITY)
    assert np.abs(velocities(free.setpoints(2e-4))[:, axis]).max() > 1.2 * limit


def test_linear_pieces_halt_at_every_joint_where_an_acceleration_is_limited():
    limits = {"acceleration": (3000.0, 3000.0, 3000.0)}
    trace = OutlineTrace(**limits, corner_pieces=3)
    s = np.concatenate([np.linspace(*trace.turning.s[k : k + 2], 4) for k in (1, 3, 5, 7)])
    halts = trace.law.velocity(np.array([trace.law.reached(at) for at in s]))
    assert halts == pytest.approx(np.zeros(s.size), abs=1e-2)
    # each from rest to rest: the axis that needs most of its limit a millimetre sets the pace
    edges = np.unique(np.concatenate([trace.turning.s, s]))
    edges = edges[np.diff(edges, prepend=-1) > 1e-6]
    rate = np.abs(np.diff(trace.coordinates(edges), axis=0)).max(axis=1) / np.diff(edges)
    times = [trapezoid(length, 50, 3000 / most) for length, most in zip(np.diff(edges), rate, strict=True)]
    assert trace.duration == pytest.approx(sum(times), rel=1e-3)
    assert trace.duration > OutlineTrace(**limits).duration


def trapezoid(length, speed, acceleration):
    """Time from rest to rest."""
    if speed**2 / acceleration <= length:
        return length / speed + speed / acceleration
    return 2 * math.sqrt(length / acceleration)


@pytest.mark.parametrize("alpha", [300.0, 3000.0, 30_000.0])
def test_the_time_with_halts_at_every_joint_in_closed_form(alpha):
    """With C = K - r n_K the stage moves along edges alone and the table in corners alone, each from rest to rest."""
    trace = OutlineTrace(centre=(-190.0, 0.0), acceleration=(alpha, 400.0, 400.0))
    edges = sum(2 * trapezoid(length, 50, 400) for length in (40, 80))
    corners = 4 * trapezoid(5 * math.pi, 50, math.radians(alpha) * 10)
    assert trace.duration == pytest.approx(edges + corners, rel=1e-3)  # a thousandth of the accelerations is in hand
    assert trace.duration >= edges + corners
    halts = trace.law.velocity(np.array([trace.law.reached(s) for s in trace.turning.s]))
    assert halts == pytest.approx(np.zeros(9), abs=1e-3)


def test_the_time_where_only_the_table_is_limited():
    """Edges are run at LSP but for what two nodes cost at their ends."""
    trace = OutlineTrace(acceleration=(3000.0, INF, INF))
    corners = 4 * trapezoid(5 * math.pi, 50, math.radians(3000) * 10)
    late = trace.duration - (240 / 50 + corners)
    assert 0 < late <= 8 * NODES / 50 + 1e-3 * corners
    said = (
        f"speed: the axes' limits make it {trace.duration:.3f} s instead of 6.057 s, "
        "6 % of the mean speed lost, down to 0 mm/s at 40.0 mm of the outline"
    )
    assert trace.notes == (said,)


def test_the_time_where_the_tables_velocity_is_limited():
    trace = OutlineTrace(velocity=(100.0, INF, INF))
    slow = math.radians(100) * 10
    assert trace.duration == pytest.approx(240 / 50 + 20 * math.pi / slow, rel=1e-9)
    assert trace.notes == (
        "speed: the axes' limits make it 8.400 s instead of 6.057 s, 28 % of the mean speed lost, "
        "down to 17.5 mm/s at 40.0 mm of the outline",
    )
    t = np.linspace(0, trace.duration, 1001)
    speed = trace.law.velocity(t)
    assert np.all(np.isclose(speed, 50) | np.isclose(speed, slow) | (np.abs(np.gradient(speed)) > 0))


@pytest.mark.parametrize("axis", [1, 2])
def test_the_time_where_an_axis_of_the_stage_has_a_velocity_limit(axis):
    """In a corner |S'| is 19 and turns with TH: dt = ds / min(LSP, limit / |S'| |cos|).

    So that no velocity passes its limit between two nodes, their speeds are held to both: that costs a share of
    the angle of 0.05 mm, 0.005 rad.
    """
    trace = OutlineTrace(velocity=tuple(200.0 if k == axis else INF for k in range(3)))
    s = (np.arange(400_000) + 0.5) / 400_000 * 5 * math.pi
    part = np.abs(np.cos(s / 10)) * 19
    corner = np.sum(1 / np.minimum(50, 200 / part)) * 5 * math.pi / 400_000
    assert 0 <= trace.duration - (240 / 50 + 4 * corner) <= 0.005 * 4 * corner


def test_limits_that_do_not_bite_cost_nothing():
    trace = OutlineTrace(velocity=(300.0, 1000.0, 1000.0))
    assert trace.duration == pytest.approx(6.05664, abs=5e-6)
    assert trace.notes == ()
    setpoints = trace.setpoints(1e-3)
    assert setpoints.position == pytest.approx(OutlineTrace().setpoints(1e-3).position, abs=1e-7)
    chord = np.linalg.norm(np.diff(on_the_work(trace, setpoints.position), axis=0), axis=1)[:-1]
    assert chord / 1e-3 == pytest.approx(np.full(chord.size, 50), rel=2e-6)  # r = 10 mm: the chord is shorter by 1e-6


def test_blending_is_faster_than_stopping_and_leaves_the_needle_on_the_outline():
    limits = {"acceleration": (3000.0, 3000.0, 3000.0)}
    times = [OutlineTrace(**limits, blend=blend).duration for blend in (0.0, 2.0, 5.0, 10.0)]
    assert np.all(np.diff(times) < 0)
    trace = OutlineTrace(**limits, blend=5.0)
    setpoints = trace.setpoints(1e-3)
    oracle = Rounded(RECTANGLE, 10)
    points, normals = oracle(trace.law.position(setpoints.time))
    assert on_the_work(trace, setpoints.position) == pytest.approx(points, abs=POSITION)
    off = np.abs(angle_between(turned(normals, np.radians(setpoints.position[:, 0])), np.array([-1.0, 0.0])))
    bound = math.degrees(5 / 10 / 8)
    assert 0.99 * bound < off.max() <= bound * (1 + 1e-9)
    lost = 100 * (1 - 302.8318530717959 / 50 / trace.duration)
    assert trace.notes == (
        f"speed: the axes' limits make it {trace.duration:.3f} s instead of 6.057 s, {lost:.0f} % of the mean "
        f"speed lost, down to {trace.law.slowest[0]:.3g} mm/s at {trace.law.slowest[1]:.1f} mm of the outline",
        f"blend: the normal at the needle is off by up to {bound:.2f} deg",
    )
    assert trace.law.slowest[0] > 10
    # the slowest that is said is between the first rise and the last fall
    t = np.linspace(0.5, trace.duration - 0.5, 20_001)
    assert trace.law.velocity(t).min() == pytest.approx(trace.law.slowest[0], rel=1e-2)


@given(traces(), st.floats(0.05, 3))
@settings(max_examples=60, deadline=None)
def test_a_blended_normal_is_off_by_no_more_than_its_bound(job, share):
    """By w / 8 r where all corners turn one way, and by twice that where some turn the other.

    The mean over a window w is off by the integral of half the second difference, (TH' after - TH' before) t, and
    the slope TH' lies in (0, 1/r) or in (-1/r, 1/r).
    """
    oracle = Rounded(job["corners"], job["corner_radius"])
    blend = min(share * job["corner_radius"], oracle.length)
    trace = OutlineTrace(**job, blend=blend)
    s = np.concatenate([np.linspace(0, oracle.length, 8001), oracle.ends[:-1]])
    at = trace.coordinates(s)
    points, normals = oracle(s)
    assert on_the_work(trace, at) == pytest.approx(points, abs=POSITION)
    off = np.abs(angle_between(turned(normals, np.radians(at[:, 0])), np.array(job["normal"])))
    convex = np.all(np.sign(oracle.turn) == np.sign(oracle.turn[0]))
    assert off.max() <= math.degrees(blend / job["corner_radius"] / 8) * (1 if convex else 2) + 1e-7
    assert (
        trace.notes[-1]
        == f"blend: the normal at the needle is off by up to {float(trace.notes[-1].split()[-2]):.2f} deg"
    )
    assert float(trace.notes[-1].split()[-2]) == pytest.approx(off.max(), abs=0.0051)
    # the table's rate does not jump: by central differences its slope changes by no more than w's share a step
    fine = np.linspace(0, oracle.length, 20_001)
    rate = np.diff(np.radians(trace.coordinates(fine)[:, 0])) / fine[1]
    step = 2 / job["corner_radius"] * (fine[1] / blend)
    assert np.abs(np.diff(rate)).max() <= step * (1 + 1e-6) + 1e-9
    # and in the end it has turned as far, but for what is eased beyond the ends
    assert at[len(s) - len(oracle.ends), 0] - at[0, 0] == pytest.approx(360 * oracle.outside, abs=math.degrees(blend))


def test_limits_of_the_travel_are_the_furthest_places_within_corners():
    """With n_K at 45 deg the arc of radius 190 about its centre has its furthest place in the middle of a corner."""
    n = (-math.sqrt(0.5), math.sqrt(0.5))
    set_up = {"needle": (-200 * math.sqrt(0.5), 200 * math.sqrt(0.5)), "normal": n}
    s = np.linspace(0, 302.8318530717959, 400_001)
    th, x, y = OutlineTrace(**set_up).coordinates(s).T
    assert np.abs(th).max() > 300
    for name, values in (("travel_x", x), ("travel_y", y)):
        low, high = values.min(), values.max()
        OutlineTrace(**set_up, **{name: (low - 1e-6, high + 1e-6)})
        for bad in ((low + 1e-4, high + 1), (low - 1, high - 1e-4)):
            with pytest.raises(InputError, match=rf"needs stage {name[-1]} = "):
                OutlineTrace(**set_up, **{name: bad})


@given(traces())
@settings(max_examples=40, deadline=None)
def test_travel_is_held_to_the_furthest_place_of_any_outline(job):
    trace = OutlineTrace(**job)
    s = np.concatenate(
        [np.linspace(a, b, 3001) for a, b in zip(trace.turning.s[:-1], trace.turning.s[1:], strict=True)]
    )
    x = trace.coordinates(s)[:, 1]
    OutlineTrace(**job, travel_x=(x.min() - 1e-3, x.max() + 1e-3))
    for bad in ((x.min() + 1e-6, x.max() + 1), (x.min() - 1, x.max() - 1e-6)):
        with pytest.raises(InputError, match="needs stage x = "):
            OutlineTrace(**job, travel_x=bad)


def test_travel_that_is_met_exactly_is_enough():
    OutlineTrace(travel_x=(-150, 150), travel_y=(-170, 170))


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        (
            {"travel_x": (-100, 100)},
            "outline piece 1 of 8, at 0 mm: needle (-200, 0) mm needs stage x = 150 mm at th = 0 deg: "
            "must lie in -100 to 100 mm; move the needle, the work centre or the centre of rotation",
        ),
        (
            {"travel_y": (-170, 169)},
            "outline piece 6 of 8, at 207.1 mm: needle (-200, 0) mm needs stage y = 170 mm at th = 270 deg: "
            "must lie in -170 to 169 mm; move the needle, the work centre or the centre of rotation",
        ),
        (
            {"travel_y": (-100, math.inf)},
            "outline piece 2 of 8, at 55.71 mm: needle (-200, 0) mm needs stage y = -170 mm at th = 90 deg: "
            "must lie in -100 to inf mm; move the needle, the work centre or the centre of rotation",
        ),
        ({"travel_x": (3, 1)}, "travel_x = (3, 1) mm: must be a lower and a higher limit"),
        ({"travel_y": (1, 1)}, "travel_y = (1, 1) mm: must be a lower and a higher limit"),
        ({"travel_y": (1, 2, 3)}, "travel_y = (1, 2, 3) mm: must be a lower and a higher limit"),
        ({"travel_x": (math.nan, 1)}, "travel_x = (nan, 1) mm: must be a lower and a higher limit"),
        (
            {"corner_radius": 31},
            "corner_radius = 31 mm: must be at most 30 mm, for which edge 1 of 60 mm has room",
        ),
        (
            {"corners": ((0, 0), (100, 0), (100, 2), (50, 60), (0, 80)), "corner_radius": 20},
            "corner_radius = 20 mm: must be at most 1.45822 mm, for which edge 2 of 2 mm has room",
        ),
        (  # edge 1 lacks most, and edge 4 has room for less
            {"corners": ((-28, -71), (3, 94), (-27, 77), (-24, 64)), "corner_radius": 20},
            "corner_radius = 20 mm: must be at most 10.4569 mm, for which edge 4 of 135.059 mm has room",
        ),
        ({"corners": ((0, 0), (100, 0))}, "outline of 2 corners: must have at least 3"),
        ({"corners": ((0, 0), (9, 0), (9, 0), (0, 5))}, "outline: corners 2 and 3 are one point"),
        ({"corners": ((0, 0), (9, 0), (9, 9), (0, 0))}, "outline: corners 4 and 1 are one point"),
        (
            {"corners": ((0, 0), (100, 0), (50, 0))},
            "outline: encloses no area; its corners must not lie on one line, nor its edges cross",
        ),
        ({"corners": ((0, 0), (100, 0), (50, 0), (50, 50))}, "outline: doubles back at corner 2"),
        ({"corners": ((50, 50), (0, 0), (100, 0), (50, 0))}, "outline: doubles back at corner 3"),
        (
            {"corners": ((0, 0), (100, 0), (10, 80), (100, 90))},
            "outline: edges 2 and 4 cross: must not",
        ),
        (
            {"corners": tuple((math.cos(0.8 * math.pi * k) * 50, math.sin(0.8 * math.pi * k) * 50) for k in range(5))},
            "outline: edges 1 and 3 cross: must not",
        ),
        ({"corners": ((0, 0), (1, math.inf), (5, 5))}, "outline corner 2 y = inf mm: must be finite"),
        ({"blend": 1e4}, "blend = 10000 mm: must be at most the outline, 302.832 mm"),
        ({"blend": -1}, "blend = -1 mm: must be at least 0 mm"),
        (
            {"blend": 1, "corner_pieces": 2},
            "blend = 1 mm: must be 0 mm where corner_pieces is 2; linear pieces are not eased",
        ),
        ({"velocity": (1, 2)}, "velocity of 2 values: must be three, of th, x and y"),
        ({"velocity": (1, -2, 3)}, "velocity of x = -2 mm/s: must be greater than 0 mm/s"),
        ({"velocity": (0, 2, 3)}, "velocity of th = 0 deg/s: must be greater than 0 deg/s"),
        ({"acceleration": (0, 1, 1)}, "acceleration of th = 0 deg/s²: must be greater than 0 deg/s²"),
        ({"acceleration": (1, 1, math.nan)}, "acceleration of y = nan mm/s²: must be finite"),
        ({"acceleration": (1, -math.inf, 1)}, "acceleration of x = -inf mm/s²: must be finite"),
        ({"sigma": 0}, "sigma = 0: must be 1 or -1"),
        ({"normal": (0, 0)}, "normal = (0, 0): must have a direction"),
        ({"normal": (0, math.nan)}, "normal y = nan mm: must be finite"),
        ({"needle": (1, 2, 3)}, "needle = (1, 2, 3): must be two numbers, x and y [mm]"),
        ({"centre": (math.inf, 0)}, "centre x = inf mm: must be finite"),
        ({"work_centre": (0,)}, "work_centre = (0,): must be two numbers, x and y [mm]"),
        ({"corner_pieces": 1.5}, "corner_pieces = 1.5: must be a whole number"),
        ({"corner_pieces": -1}, "corner_pieces = -1: must be at least 0"),
        ({"width": 0}, "width = 0 mm: must be greater than 0 mm"),
        ({"height": -60}, "height = -60 mm: must be greater than 0 mm"),
        ({"corner_radius": 0}, "corner_radius = 0 mm: must be greater than 0 mm"),
        ({"speed": -1}, "speed = -1 mm/s: must be greater than 0 mm/s"),
    ],
)
def test_a_value_out_of_its_bound_is_named_in_full(changed, said):
    with pytest.raises(InputError) as error:
        OutlineTrace(**changed)
    assert str(error.value) == said


def test_the_largest_radius_that_is_offered_does_run():
    corners = ((0, 0), (100, 0), (100, 2), (50, 60), (0, 80))
    assert OutlineTrace(corners=corners, corner_radius=1.4582).corner_radius == 1.4582
    corners = ((-28, -71), (3, 94), (-27, 77), (-24, 64))
    assert OutlineTrace(corners=corners, corner_radius=10.4569).corner_radius == 10.4569
    assert OutlineTrace(corner_radius=30).requested.length == pytest.approx(2 * 40 + 60 * math.pi)


def test_edges_of_no_length_between_their_arcs_are_none():
    """A radius of half the height: the short edges are gone, and the long ones join half circles."""
    trace = OutlineTrace(corner_radius=30, acceleration=(3000.0, 3000.0, 3000.0))
    s = np.linspace(0, trace.requested.length, 2001)
    assert on_the_work(trace, trace.coordinates(s)) == pytest.approx(Rounded(RECTANGLE, 30)(s)[0], abs=POSITION)
    assert np.all(np.diff(trace.turning.s) > 1)


def test_a_corner_of_no_turn_is_none():
    corners = ((-50, -30), (-50, 0), (-50, 30), (50, 30), (50, -30))
    trace = OutlineTrace(corners=corners)
    s = np.linspace(0, trace.requested.length, 2001)
    assert trace.coordinates(s) == pytest.approx(OutlineTrace().coordinates(s), abs=POSITION)
    # nor does it halt there
    held, plain = (OutlineTrace(corners=c, acceleration=(3000.0,) * 3).duration for c in (corners, RECTANGLE))
    assert held == pytest.approx(plain, rel=1e-4)


@pytest.mark.parametrize(
    ("corners", "said"),
    [
        (((0, 0), (60, 0), (60, 60), (30, -30), (0, 60)), "edges 1 and 3 cross"),
        (((0, 0), (0, 60), (60, 0), (60, 90)), "edges 2 and 4 cross"),
    ],
)
def test_an_outline_whose_edges_cross_is_refused(corners, said):
    with pytest.raises(InputError, match=f"^outline: {said}: must not$"):
        OutlineTrace(corners=corners, corner_radius=2)


def test_an_outline_that_touches_itself_and_winds_twice_is_refused():
    corners = ((0, 0), (60, 0), (60, 60), (0, 60), (0, 0), (30, 0), (30, 30), (0, 30))  # two squares by one corner
    with pytest.raises(InputError, match=r"^outline: (turns by 720 deg in all: must not cross itself|.* one point)"):
        OutlineTrace(corners=corners, corner_radius=2)
