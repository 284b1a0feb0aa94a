"""Chains of lines, helices and cones in any plane, arc chains that climb, and projection onto both."""

import json
import math
import time
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.optimize import minimize_scalar

from gantrysim.base.errors import InputError
from gantrysim.paths.arcs import ArcChain
from gantrysim.paths.chain import Chain
from gantrysim.paths.kinds import path_of
from gantrysim.paths.pieces import XY, XZ, YZ, ZX, Coil, Line

from support.soaked import examples

POSITION = 1e-9  # [mm]
ANGLE = 1e-9  # [rad]
UNIT = 1e-12  # of a unit vector
QUADRATURE = 1e-10  # of Gauss' rule with 20 points over less than a radian
FOOT = 1e-7  # arc length of a foot point well off the centre of curvature [mm]
JOINT = 1e-8  # to both sides of a joint [mm]

# a plane square to none of the axes: the columns of a turn about (1, 1, 1), tilted further about x
TILTED = (
    (0.8, 0.48, 0.36),
    (-0.6, 0.64, 0.48),
)
PLANES = {"XY": XY, "ZX": ZX, "YZ": YZ, "XZ": XZ, "tilted": TILTED}
NORMALS = {"XY": (0, 0, 1), "ZX": (0, 1, 0), "YZ": (1, 0, 0), "XZ": (0, -1, 0), "tilted": (0, -0.6, 0.8)}
EVERY_PLANE = pytest.mark.parametrize("plane", PLANES)

planes = st.sampled_from(sorted(PLANES))
places = st.tuples(*[st.floats(-50, 50)] * 3)


@st.composite
def coils(draw, plane=None):
    """A coil of any kind, no sharper than half a millimetre, of up to two and a half turns."""
    first = draw(st.floats(0.5, 50))
    last = draw(st.one_of(st.just(first), st.floats(0.5, 50)))
    angle = draw(st.floats(0.1, 15)) * draw(st.sampled_from([-1, 1]))
    rise = draw(st.one_of(st.just(0.0), st.floats(-30, 30)))
    return Coil(draw(places), (first, last), draw(st.floats(-7, 7)), angle, rise, PLANES[plane or draw(planes)])


def on(coil, share):
    """Point of a coil after a share of its angle: its definition, in vectors."""
    u, v = np.array(coil.frame, float)
    psi = coil.begin + share * coil.angle
    radius = coil.radius[0] + share * (coil.radius[1] - coil.radius[0])
    outward = math.cos(psi) * u + math.sin(psi) * v
    return np.array(coil.centre) + radius * outward + share * coil.rise * np.cross(u, v)


def way(coil, share):
    """Arc length to there: the integral of the speed over the share, in cylindrical coordinates."""
    grown = coil.radius[1] - coil.radius[0]

    def speed(x):
        return math.hypot(grown, (coil.radius[0] + grown * x) * coil.angle, coil.rise)

    return quad(speed, 0, share, epsabs=0, epsrel=1e-13, limit=200)[0]


@st.composite
def walks(draw):
    """Pieces one behind the other, in any planes, and the points where they meet."""
    at = np.array(draw(places))
    pieces, joints = [], [at]
    for _ in range(draw(st.integers(1, 6))):
        if draw(st.booleans()):
            end = at + np.array(draw(st.tuples(*[st.floats(-20, 20)] * 3)))
            if np.linalg.norm(end - at) < 0.1:
                end = at + np.array([0, 0, 3])
            piece = Line(tuple(at), tuple(end), PLANES[draw(planes)])
        else:
            coil = draw(coils())
            centre = tuple(np.array(coil.centre) + at - on(coil, 0))
            piece = Coil(centre, coil.radius, coil.begin, coil.angle, coil.rise, coil.frame)
            end = on(piece, 1)
        pieces.append(piece)
        joints.append(end)
        at = end
    return pieces, np.array(joints)


def gauss(function, low, high):
    """Integral of a function of the arc length, vector-valued, by Gauss' rule."""
    node, weight = np.polynomial.legendre.leggauss(20)
    return 0.5 * (high - low) * weight @ function(0.5 * (high + low) + 0.5 * (high - low) * node)


def brute(path, point, rough=20_001):
    """Smallest distance of a point to a path: of many points, made finer about the best of them."""
    s = np.linspace(0, path.length, rough)
    k = int(np.linalg.norm(path.position(s) - point, axis=1).argmin())

    def distance(ahead):
        return float(np.linalg.norm(path.position(s[k] + ahead)[0] - point))

    bounds = s[max(k - 1, 0)] - s[k], s[min(k + 1, rough - 1)] - s[k]
    fine = minimize_scalar(distance, bounds=bounds, method="bounded", options={"xatol": 1e-12})
    return min(fine.fun, distance(0.0))


@given(coils(), st.floats(1e-6, 1))
@examples(200)
def test_coil_is_its_definition_at_the_integral_of_its_speed(coil, share):
    path = Chain([coil])
    s = way(coil, share)
    assert path.length == pytest.approx(way(coil, 1), rel=1e-12)
    assert path.position(s)[0] == pytest.approx(on(coil, share), abs=POSITION)


@pytest.mark.parametrize("sense", [-1, 1])
@EVERY_PLANE
def test_helix_in_closed_form(plane, sense):
    radius, pitch, turns = 12.0, 5.0, 3.25
    h = pitch / (2 * math.pi)
    u, v = np.array(PLANES[plane])
    w = np.array(NORMALS[plane])
    path = Chain([Coil((1, 2, 3), (radius, radius), 0.4, sense * 2 * math.pi * turns, pitch * turns, PLANES[plane])])
    speed = math.hypot(radius, h)
    assert path.length == pytest.approx(2 * math.pi * turns * speed, rel=1e-14)
    phi = np.linspace(0, 2 * math.pi * turns, 50)[:, None]
    psi = 0.4 + sense * phi
    expected = [1, 2, 3] + radius * (np.cos(psi) * u + np.sin(psi) * v) + h * phi * w
    s = speed * phi[:, 0]
    assert path.position(s) == pytest.approx(expected, abs=POSITION)
    tangent = (sense * radius * (-np.sin(psi) * u + np.cos(psi) * v) + h * w) / speed
    assert path.tangent(s) == pytest.approx(tangent, abs=UNIT)
    assert path.climb(s) == pytest.approx(np.full(50, h / speed), abs=UNIT)
    assert path.heading(s) == pytest.approx(0.4 + sense * (phi[:, 0] + 0.5 * math.pi), abs=ANGLE)
    assert path.curvature(s) == pytest.approx(np.full(50, sense / speed), rel=1e-12)
    # the whole curvature vector of a helix points to its axis and is r / (r^2 + h^2)
    inward = -(np.cos(psi) * u + np.sin(psi) * v)
    assert path.local(s).curvature == pytest.approx(radius / speed**2 * inward, abs=UNIT)


def test_archimedes_cone_in_closed_form():
    """Two turns from r = 30 mm to 10 mm, 12 mm high: the length is the standard integral of sqrt(rho^2 + c^2)."""
    b, h = -20 / (4 * math.pi), 12 / (4 * math.pi)
    c = math.hypot(b, h)

    def primitive(rho):
        return 0.5 * rho * math.hypot(rho, c) + 0.5 * c**2 * math.log(rho + math.hypot(rho, c))

    path = Chain([Coil((0, 0, 0), (30, 10), 0, 4 * math.pi, 12)])
    assert path.length == pytest.approx((primitive(10) - primitive(30)) / b, rel=1e-13)
    half = (primitive(20) - primitive(30)) / b
    assert path.position([0, half, path.length]) == pytest.approx(
        np.array([[30, 0, 0], [20, 0, 6], [10, 0, 12]]), abs=POSITION
    )
    assert path.climb(half)[0] == pytest.approx(h / math.hypot(20, c), rel=1e-12)
    # theta = psi + atan2(rho, b), so d(theta)/d(psi) = 1 + b^2 / (rho^2 + b^2)
    turning = (1 + b**2 / (400 + b**2)) / math.hypot(20, c)
    assert path.curvature(half)[0] == pytest.approx(turning, rel=1e-12)


@given(coils(), st.floats(0, 1))
@examples(200)
def test_tangent_is_the_derivative_of_position_and_curvature_that_of_heading(coil, fraction):
    path = Chain([coil])
    low = fraction * path.length
    sharpest = np.abs(path.curvature(np.linspace(0, path.length, 50))).max()
    high = min(low + 0.5 / sharpest, path.length)
    position, heading = path.position([low, high]), path.heading([low, high])
    assert position[1] - position[0] == pytest.approx(gauss(path.tangent, low, high), abs=QUADRATURE * path.length)
    turned = gauss(path.curvature, low, high)
    assert heading[1] - heading[0] == pytest.approx(turned, abs=QUADRATURE * max(path.length, 1))


@given(walks())
@examples(100)
def test_tangent_normal_and_frame_are_square_and_the_climb_is_along_the_planes_normal(walk):
    pieces, _ = walk
    path = Chain(pieces)
    s = 0.5 * (np.concatenate([[0], path.ends[:-1]]) + path.ends)  # the middle of every piece
    tangent, normal, frame = path.tangent(s), path.normal(s), path.frame(s)
    for k, piece in enumerate(path.pieces):
        u, v = np.array(piece.frame, float)
        assert frame[k] == pytest.approx(np.array([u, v, np.cross(u, v)]), abs=UNIT)
        assert np.linalg.norm(tangent[k]) == pytest.approx(1, abs=UNIT)
        assert np.linalg.norm(normal[k]) == pytest.approx(1, abs=UNIT)
        assert normal[k] @ tangent[k] == pytest.approx(0, abs=UNIT)
        assert normal[k] @ frame[k, 2] == pytest.approx(0, abs=UNIT)
        assert tangent[k] @ frame[k, 2] == pytest.approx(path.climb(s[k])[0], abs=UNIT)
        # to the left: w x t points along n
        assert np.cross(frame[k, 2], tangent[k]) @ normal[k] >= -UNIT
        heading = path.heading(s[k])[0]
        flat = tangent[k] @ u, tangent[k] @ v
        cosine = math.hypot(*flat)
        assert flat == pytest.approx((cosine * math.cos(heading), cosine * math.sin(heading)), abs=UNIT * 10)


@given(walks())
@examples(100)
def test_pieces_join_where_they_meet(walk):
    pieces, joints = walk
    path = Chain(pieces)
    assert path.pieces == tuple(pieces)
    assert path.length == path.ends[-1]
    at = np.concatenate([[0.0], path.ends])
    assert path.position(at) == pytest.approx(joints, abs=POSITION)
    # a whole step over a joint is twice JOINT along the tangents of both sides
    before, after = path.ends[:-1] - JOINT, path.ends[:-1] + JOINT
    step = path.position(after) - path.position(before)
    assert step == pytest.approx(JOINT * (path.tangent(before) + path.tangent(after)), abs=POSITION)


@given(st.lists(st.floats(-3.0, 3.0), min_size=1, max_size=12), st.floats(-9, 9))
@examples(100)
def test_heading_jumps_at_a_corner_by_the_corners_angle_and_is_not_wrapped(corners, first):
    headings = first + np.concatenate([[0.0], np.cumsum(corners)])
    points = np.concatenate([[0.0], np.cumsum(5 * np.exp(1j * headings))])
    flat = [(z.real, z.imag, 0.0) for z in points.tolist()]
    path = Chain([Line(a, b) for a, b in pairwise(flat)])
    found = path.heading(path.ends - 2.5)
    assert np.diff(found) == pytest.approx(np.array(corners), abs=ANGLE)
    assert math.remainder(found[0] - first, 2 * math.pi) == pytest.approx(0, abs=ANGLE)
    assert path.curvature(path.ends - 2.5).tolist() == [0.0] * len(flat[1:])
    # a line takes its heading to its joint, which belongs to the next
    assert path.heading(path.ends[:-1]) == pytest.approx(found[1:], abs=ANGLE)
    assert path.heading(path.ends[:-1] - JOINT) == pytest.approx(found[:-1], abs=ANGLE)


@pytest.mark.parametrize("turn", [-1, 1])
@EVERY_PLANE
def test_heading_grows_by_a_whole_turn_for_every_lap_of_a_stadium(plane, turn):
    u, v = np.array(PLANES[plane])
    laps, length, radius = 4, 30.0, 8.0

    def place(x, y):
        return tuple((x * u + turn * y * v).tolist())

    lap = [
        Line(place(0, 0), place(length, 0), PLANES[plane]),
        Coil(place(length, radius), (radius, radius), -turn * math.pi / 2, turn * math.pi, 0, PLANES[plane]),
        Line(place(length, 2 * radius), place(0, 2 * radius), PLANES[plane]),
        Coil(place(0, radius), (radius, radius), turn * math.pi / 2, turn * math.pi, 0, PLANES[plane]),
    ]
    path = Chain(lap * laps)
    s = np.linspace(0, path.length, 2001)
    heading = path.heading(s)
    assert heading[0] == pytest.approx(0, abs=ANGLE)
    assert heading[-1] == pytest.approx(turn * 2 * math.pi * laps, abs=ANGLE)
    assert np.abs(np.diff(heading)).max() <= (s[1] - s[0]) / radius + ANGLE
    assert path.length == pytest.approx(laps * 2 * (length + math.pi * radius), rel=1e-14)
    assert path.position(path.length)[0] == pytest.approx(np.zeros(3), abs=POSITION)
    assert path.climb(s) == pytest.approx(np.zeros(2001), abs=UNIT)


def test_lines_along_the_normal_keep_the_heading_of_the_piece_before():
    path = Chain(
        [
            Line((0, 0, 0), (0, 0, 2)),
            Line((0, 0, 2), (0, 10, 2)),
            Line((0, 10, 2), (0, 10, -4)),
            Line((0, 10, -4), (-10, 10, -4)),
        ]
    )
    s = np.array([1.0, 7.0, 15.0, 23.0])
    assert path.heading(s) == pytest.approx([0, math.pi / 2, math.pi / 2, math.pi], abs=ANGLE)
    assert path.climb(s).tolist() == [1, 0, -1, 0]
    assert path.tangent(s) == pytest.approx(np.array([[0, 0, 1], [0, 1, 0], [0, 0, -1], [-1, 0, 0]]), abs=UNIT)
    assert path.normal(s) == pytest.approx(np.array([[0, 1, 0], [-1, 0, 0], [-1, 0, 0], [0, -1, 0]]), abs=UNIT)
    foot = path.project([[0, 11.5, 0], [0.5, 10, 0]])
    assert foot.s == pytest.approx([14, 14], abs=FOOT)
    assert foot.distance == pytest.approx([1.5, 0.5], abs=POSITION)
    # left of the heading +y is -x
    assert foot.lateral == pytest.approx([0, -0.5], abs=POSITION)


def test_a_line_in_a_plane_of_its_own_climbs_from_it():
    path = Chain([Line((0, 0, 0), (3, 0, 4), ZX)])
    assert path.climb(1)[0] == pytest.approx(0, abs=UNIT)
    assert path.heading(1)[0] == pytest.approx(math.atan2(3, 4), abs=ANGLE)
    assert path.normal(1)[0] == pytest.approx([0.8, 0, -0.6], abs=UNIT)
    flat = Chain([Line((0, 0, 0), (3, 0, 4))])
    assert flat.climb(1)[0] == pytest.approx(0.8, abs=UNIT)
    assert flat.tangent(1)[0] == pytest.approx([0.6, 0, 0.8], abs=UNIT)


def test_pieces_of_zero_length_are_dropped():
    kept = [Line((0, 0, 0), (5, 0, 0)), Coil((5, 3, 0), (3, 3), -math.pi / 2, 1.0)]
    nothing = [Line((5, 0, 0), (5, 0, 0)), Coil((5, 3, 0), (3, 3), -math.pi / 2, 0.0), Line((5, 0, 0), (5, 0, 1e-12))]
    path = Chain([kept[0], *nothing, kept[1]])
    assert path.pieces == tuple(kept)
    assert path.ends == pytest.approx([5, 8], abs=POSITION)
    for empty in ([], nothing):
        with pytest.raises(InputError, match=r"^chain: must have a piece of positive length$"):
            Chain(empty)


@pytest.mark.parametrize(
    "piece", [Line((-1e308, 0, 0), (1e308, 0, 0)), Coil((0, 0, 0), (1e300, 1e300), 0, 1e300)], ids=["line", "coil"]
)
def test_a_length_beyond_all_numbers_is_refused(piece):
    with pytest.raises(InputError, match=r"^chain: length = inf mm: must be finite$"):
        Chain([piece])


@given(walks())
@examples(50)
def test_a_chain_is_built_again_from_its_parameters_through_json(walk):
    path = Chain(walk[0])
    again = path_of("Chain", json.loads(json.dumps(path.parameters())))
    s = np.linspace(0, path.length, 57)
    assert again.length == path.length
    assert np.array_equal(again.position(s), path.position(s))
    assert np.array_equal(again.heading(s), path.heading(s))
    assert np.array_equal(again.frame(s), path.frame(s))
    assert np.array_equal(again.climb(s), path.climb(s))


def test_pieces_of_unknown_kind_or_arguments_are_named():
    line = {"kind": "Line", "start": (0, 0, 0), "end": (1, 0, 0)}
    assert Chain([line]).length == 1
    with pytest.raises(InputError, match=r"^chain: piece of kind 'Arc': must be Line or Coil$"):
        Chain([{**line, "kind": "Arc"}])
    with pytest.raises(InputError, match=r"kind None"):
        Chain([{"start": (0, 0, 0), "end": (1, 0, 0)}])
    with pytest.raises(InputError, match=r"^path Chain: .*unexpected keyword argument 'to'"):
        path_of("Chain", {"pieces": [{**line, "to": 1}]})


@pytest.mark.parametrize(
    ("changed", "text"),
    [
        ({"centre": (0, math.nan, 0)}, r"^coil: centre = \(0, nan, 0\): must be finite$"),
        ({"radius": (5.0, math.inf)}, r"^coil: radius = \(5\.0, inf\): must be finite$"),
        ({"begin": math.nan}, r"^coil: begin = nan: must be finite$"),
        ({"angle": -math.inf}, r"^coil: angle = -inf: must be finite$"),
        ({"rise": math.nan}, r"^coil: rise = nan: must be finite$"),
        ({"radius": (5.0, -1.0)}, r"^coil: radius = -1 mm: must be at least 0 mm$"),
        ({"angle": 0.0, "rise": 1.0}, r"^coil: angle = 0 rad: must not be 0 where the radius or the height changes$"),
        ({"angle": 0.0, "radius": (5.0, 6.0)}, r"^coil: angle = 0 rad"),
        ({"frame": ((1, 0, 0), (1, 1, 0))}, r"^coil: frame = .*: must be two orthogonal unit vectors$"),
        ({"frame": ((1, 0, 0), (0, 2, 0))}, r"^coil: frame = "),
        ({"frame": ((1, 0, 0), (0, math.nan, 0))}, r"^coil: frame = "),
    ],
)
def test_an_invalid_coil_is_refused(changed, text):
    with pytest.raises(InputError, match=text):
        Coil(**{"centre": (0, 0, 0), "radius": (5.0, 5.0), "begin": 0.0, "angle": 1.0, **changed})


def test_an_invalid_line_is_refused():
    with pytest.raises(InputError, match=r"^line: end = \(nan, 0, 0\): must be finite$"):
        Line((0, 0, 0), (math.nan, 0, 0))
    with pytest.raises(InputError, match=r"^line: start = \(0, 0, inf\): must be finite$"):
        Line((0, 0, math.inf), (0, 0, 0))
    with pytest.raises(InputError, match=r"^line: frame = "):
        Line((0, 0, 0), (1, 0, 0), ((1, 0, 0), (1, 0, 0)))


def test_turn_spacing_is_that_of_the_spirals_where_they_have_the_same():
    line, arc = Line((39, 0, 0), (30, 0, 0)), Coil((0, 0, 0), (10, 10), 0, 2 * math.pi)
    inward, outward = Coil((0, 0, 0), (30, 10), 0, -8 * math.pi), Coil((0, 0, 0), (10, 15), 0, 2 * math.pi, 4)
    assert Chain([line]).turn_spacing is None
    assert Chain([arc]).turn_spacing is None
    for radii in ((30, 10), (10, 30)):
        for angle in (-8 * math.pi, 8 * math.pi):
            assert Chain([Coil((0, 0, 0), radii, 0, angle)]).turn_spacing == pytest.approx(5, abs=1e-6)
    assert Chain([line, inward, arc, outward]).turn_spacing == pytest.approx(5, abs=1e-6)
    assert Chain([inward, Coil((0, 0, 0), (10, 16), 0, 2 * math.pi)]).turn_spacing is None
    # radii that differ by their rounding are those of an arc
    rounded = Coil((0, 0, 0), (10.0, 10.000000000000002), 0, 6)
    assert Chain([rounded]).turn_spacing is None
    assert Chain([inward, rounded]).turn_spacing == pytest.approx(5, abs=1e-6)
    in_a_file = Coil((0, 0, 0), (10.0, 10.002), 0, 6)
    assert Chain([inward, in_a_file]).turn_spacing == pytest.approx(5, abs=1e-6)


def test_a_piece_that_does_not_begin_where_the_one_before_ends_is_named():
    first, second = Line((0, 0, 0), (10, 0, 0)), Line((10, 0, 0), (10, 5, 0))
    with pytest.raises(
        InputError, match=r"^chain: piece 3 begins 0\.5 mm from where piece 2 ends: must be within 1e-06 mm$"
    ):
        Chain([first, second, Line((10, 5.5, 0), (20, 5.5, 0))])
    assert Chain([first, second, Line((10, 5 + 1e-9, 0), (20, 5, 0))]).length == pytest.approx(25)


def test_heading_of_a_spiral_into_its_very_centre_does_not_jump_where_the_radius_is_rounded_below_it():
    path = Chain([Coil((0, 0, 0), (0.3, 0.3 - 0.1 * 3), 0, 6 * math.pi)])  # the end radius is -6e-17 mm
    heading = path.heading(np.linspace(0, path.length, 5001))
    assert heading[-1] - heading[0] == pytest.approx(
        6 * math.pi + math.pi - math.atan2(0.3, -0.1 / 2 / math.pi), abs=1e-9
    )
    assert np.diff(heading).min() > 0


@given(coils(), st.floats(0.02, 0.98), st.floats(-1, 1), st.floats(-1, 1))
@examples(100)
def test_point_off_a_coil_projects_onto_its_nearest_point(coil, fraction, across, up):
    path = Chain([coil])
    s = fraction * path.length
    tangent, normal = path.tangent(s)[0], path.normal(s)[0]
    point = path.position(s)[0] + 3 * across * normal + 3 * up * np.cross(tangent, normal)
    foot = path.project(point)
    nearest = brute(path, point)
    # the table of points may prefer a branch that is as near to within its spacing squared
    near = min(0.025, 0.05**2 / 8 * (1 / max(nearest, 1e-9) + 1 / 0.25))
    assert nearest - FOOT <= foot.distance[0] <= nearest + near
    assert np.linalg.norm(foot.offset[0]) == pytest.approx(foot.distance[0], abs=POSITION)
    assert point - foot.offset[0] == pytest.approx(path.position(foot.s)[0], abs=POSITION)
    inside = 1e-6 < foot.s[0] < path.length - 1e-6
    curved = np.linalg.norm(path.local(foot.s).curvature[0]) * foot.distance[0] > 0.9
    if inside and not curved:  # the offset is square to the path
        assert foot.offset[0] @ path.tangent(foot.s)[0] == pytest.approx(0, abs=1e-6)


CLIMBING = {
    "helix": Chain([Coil((0, 0, 0), (20, 20), 0.3, 8 * math.pi, 24)]),
    "helix down, clockwise": Chain([Coil((0, 0, 0), (20, 20), 0.3, -8 * math.pi, -24)]),
    "cone": Chain([Coil((0, 0, 0), (40, 10), 0.3, 8 * math.pi, 24)]),
    "helix about y": Chain([Coil((0, 0, 0), (20, 20), 0.3, 8 * math.pi, 24, ZX)]),
    "tilted cone": Chain([Coil((0, 0, 0), (40, 10), 0.3, -8 * math.pi, 24, TILTED)]),
    "arc chain": ArcChain([5, 0], 0.2, [1 / 20, -1 / 30, 0], [100, 60, 20], [10, -5, 3]),
}


@pytest.mark.parametrize("name", CLIMBING)
@pytest.mark.parametrize("off", [0.0, 0.4, 2.0])
def test_projection_off_a_climbing_path_returns_the_arc_length_of_the_point(name, off):
    path = CLIMBING[name]
    s = np.linspace(0.5, path.length - 0.5, 400)
    tangent, normal = path.tangent(s), path.normal(s)
    around = np.linspace(0, 40, 400)[:, None]
    offset = off * (np.cos(around) * normal + np.sin(around) * np.cross(tangent, normal))
    trace = path.position(s) + offset
    for foot in (path.project(trace), path.follow(trace), path.follow(trace, s)):
        assert foot.s == pytest.approx(s, abs=FOOT)
        assert foot.distance == pytest.approx(np.full(400, off), abs=FOOT)
        assert foot.offset == pytest.approx(offset, abs=FOOT)
        assert foot.lateral == pytest.approx(off * np.cos(around[:, 0]), abs=FOOT)


def test_a_trace_stays_on_its_turn_of_a_helix_where_the_next_is_nearer():
    path = CLIMBING["helix"]  # turns lie 6 mm apart
    s = np.linspace(1, path.length - 170, 3000)  # there is another turn above
    sagging = np.concatenate([np.linspace(0, 4, 1000), np.full(2000, 4.0)])  # beyond half the pitch
    trace = path.position(s) + sagging[:, None] * [0, 0, 1]
    followed = path.follow(trace, s)
    # 4 mm straight up: nearest on its own turn is ahead by 4 sin(beta)
    sine = path.climb(0)[0]
    assert followed.s[1500:] == pytest.approx(s[1500:] + 4 * sine, abs=0.05)
    jumped = path.project(trace)
    assert jumped.distance[1500:].max() < 2.1
    assert followed.distance[1500:].min() > 3.9


@given(
    turn=st.floats(0.05, 3.0),
    climb=st.floats(-0.5, 0.5),
    along=st.floats(-0.4, 0.4),
    off=st.tuples(*[st.floats(-0.1, 0.1)] * 3),
    shift=st.floats(0, 0.05),
)
@examples(300)
def test_points_near_a_corner_project_onto_the_nearer_of_its_sides(turn, climb, along, off, shift):
    """However sharp, and wherever the corner lies between two points of the table."""
    before = np.array([1.0, 0, 0])
    after = np.array([math.cos(turn), math.sin(turn), climb]) / math.hypot(1, climb)
    path = Chain([Line(tuple(-(9 + shift) * before), (0, 0, 0)), Line((0, 0, 0), tuple(9 * after))])
    point = along * (before if along < 0 else after) + off
    exact = min(
        np.linalg.norm(point - min(point @ before, 0) * before), np.linalg.norm(point - max(point @ after, 0) * after)
    )
    assert path.project(point).distance[0] == pytest.approx(exact, abs=FOOT)
    trace = np.stack([-before, point])
    if turn < 2.4:  # a sharper corner is one to follow in the order of the motion, see test_follow.py
        assert path.follow(trace).distance[1] == pytest.approx(exact, abs=FOOT)


def test_both_sides_of_a_corner_are_searched():
    """On the path itself the distance is none, right up to the joints."""
    first = Coil((0, 5, 0), (5, 5), -math.pi / 2, 1.0)
    x, y, _ = on(first, 1)
    second = Coil((x + 3, y, 0), (3, 3), math.pi, -2.0)
    path = Chain([first, second, Line(tuple(on(second, 1)), (0, 0, 0))])
    joints = path.ends[:-1, None] + np.linspace(-0.2, 0.2, 401)
    points = path.position(joints.ravel())
    assert path.project(points).distance == pytest.approx(np.zeros(joints.size), abs=POSITION)
    assert path.follow(path.position(np.linspace(0, path.length, 5000))).distance.max() < POSITION


def zigzag(count):
    """Corners of a random line in space, (count + 1, 3) [mm]."""
    random = np.random.default_rng(1)
    heading = np.cumsum(random.uniform(-2, 2, count))
    steps = np.stack([np.cos(heading), np.sin(heading), random.uniform(-0.5, 0.5, count)], axis=1)
    return np.concatenate([np.zeros((1, 3)), np.cumsum(steps * random.uniform(0.5, 2, (count, 1)), axis=0)])


@pytest.mark.soak
def test_the_work_for_a_chain_grows_with_its_pieces_and_no_faster():
    """CPU time of 5,000 lines over that of 500, each the least of several: a quadratic algorithm takes 100 times."""

    def seconds(count):
        ends = [tuple(point) for point in zigzag(count).tolist()]
        begun = time.process_time()
        path = Chain([Line(a, b) for a, b in pairwise(ends)])
        s = np.linspace(0, path.length, 10 * count)
        path.tangent(s), path.normal(s), path.local(s)
        path.follow(path.position(s)[:count])
        return time.process_time() - begun

    seconds(500)  # compiles
    assert min(seconds(5_000) for _ in range(2)) < 40 * min(seconds(500) for _ in range(5))


@pytest.mark.parametrize("angle", [0.0, 5e-5, 2e-4, 1e-3, 0.02, 0.09, 1.0])
def test_a_corner_is_a_jump_of_the_tangent_by_more_than_a_ten_thousandth(angle):
    chain = Chain([Line((0, 0, 0), (10, 0, 0)), Line((10, 0, 0), (10 + 5 * math.cos(angle), 5 * math.sin(angle), 0))])
    assert chain.corners.tolist() == ([10.0] if angle > 1e-4 else [])


@pytest.mark.soak
def test_ten_thousand_lines_lie_where_their_corners_are():
    points = zigzag(10_000)
    path = Chain([Line(a, b) for a, b in pairwise([tuple(point) for point in points.tolist()])])
    s = np.linspace(0, path.length, 100_001)
    found = path.position(s)
    corners = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    expected = np.stack([np.interp(s, corners, points[:, k]) for k in range(3)], axis=1)
    assert found == pytest.approx(expected, abs=POSITION)
    assert path.follow(found[:10_000]).distance == pytest.approx(np.zeros(10_000), abs=FOOT)


# Arc chains that climb


@given(
    radius=st.floats(5, 100),
    left=st.booleans(),
    turns=st.floats(0.1, 5),
    rise=st.floats(-50, 50),
    heading=st.floats(-7, 7),
    fraction=st.floats(0, 1),
)
@examples(100)
def test_an_arc_that_climbs_is_a_helix(radius, left, turns, rise, heading, fraction):
    kappa = (1 if left else -1) / radius
    flat = 2 * math.pi * radius * turns
    path = ArcChain((3, -4, 7), heading, kappa, flat, rise)
    assert path.length == pytest.approx(math.hypot(flat, rise), rel=1e-14)
    s = fraction * path.length
    theta = heading + kappa * fraction * flat
    x = 3 + (math.sin(theta) - math.sin(heading)) / kappa
    y = -4 - (math.cos(theta) - math.cos(heading)) / kappa
    assert path.position(s)[0] == pytest.approx([x, y, 7 + fraction * rise], abs=POSITION)
    assert path.heading(s)[0] == pytest.approx(theta, abs=ANGLE)
    assert path.climb(s)[0] == pytest.approx(rise / path.length, abs=UNIT)
    assert path.curvature(s)[0] == pytest.approx(kappa * flat / path.length, rel=1e-12)
    coil = Coil(
        (3 - math.sin(heading) / kappa, -4 + math.cos(heading) / kappa, 7),
        (radius, radius),
        heading - math.copysign(math.pi / 2, kappa),
        kappa * flat,
        rise,
    )
    same = Chain([coil])
    assert same.length == pytest.approx(path.length, rel=1e-13)
    assert same.position(s)[0] == pytest.approx(path.position(s)[0], abs=POSITION)
    assert same.tangent(s)[0] == pytest.approx(path.tangent(s)[0], abs=1e-10)


pieces_of_arcs = st.lists(
    st.tuples(
        st.one_of(st.just(0.0), st.floats(-0.2, 0.2)),
        st.one_of(st.just(0.0), st.floats(0.5, 30)),
        st.one_of(st.just(0.0), st.floats(-20, 20)),
    ),
    min_size=1,
    max_size=8,
).filter(lambda pieces: sum(math.hypot(flat, rise) for _, flat, rise in pieces) > 0.1)


@given(pieces_of_arcs)
@examples(100)
def test_arc_chain_of_mixed_rises_is_the_flat_one_lifted(pieces):
    """At the same share of every piece x and y are those without a climb, and z goes evenly from height to height."""
    kappa, flat, rise = np.array(pieces).T
    path, below = ArcChain((1, 2, 3), 0.5, kappa, flat, rise), ArcChain((1, 2, 3), 0.5, kappa, flat)
    assert path.ends == pytest.approx(np.cumsum(np.hypot(flat, rise)), abs=POSITION)
    heights = 3 + np.concatenate([[0.0], np.cumsum(rise)])
    for k in np.flatnonzero(np.hypot(flat, rise) > 1e-6):
        share = np.linspace(0.01, 0.99, 9)
        s = path.ends[k] - (1 - share) * math.hypot(flat[k], rise[k])
        lifted = path.position(s)
        flat_points = below.position(below.ends[k] - (1 - share) * flat[k])
        if flat[k] > 0:
            assert lifted[:, :2] == pytest.approx(flat_points[:, :2], abs=POSITION)
        assert lifted[:, 2] == pytest.approx(heights[k] + share * rise[k], abs=POSITION)
        assert path.climb(s) == pytest.approx(np.full(9, rise[k] / math.hypot(flat[k], rise[k])), abs=UNIT)
        chunk = path.tangent(s)
        assert np.linalg.norm(chunk, axis=1) == pytest.approx(np.ones(9), abs=UNIT)
        way_on = gauss(path.tangent, s[0], s[-1])
        assert lifted[-1] - lifted[0] == pytest.approx(way_on, abs=1e-8)


def test_one_rise_is_that_of_every_piece():
    path = ArcChain((0, 0), 0, [0, 0.1], [3, 5], 4.0)
    assert path.position(path.ends)[:, 2] == pytest.approx([4, 8], abs=POSITION)


def test_arc_chain_that_goes_straight_up():
    path = ArcChain((1, 2), 0.3, 0, 0.0, -6.0)
    assert path.length == 6
    assert path.position([0, 2, 6]) == pytest.approx(np.array([[1, 2, 0], [1, 2, -2], [1, 2, -6]]), abs=POSITION)
    assert path.tangent(3)[0] == pytest.approx([0, 0, -1], abs=UNIT)


def test_an_arc_chain_that_climbs_is_built_again_through_json():
    path = ArcChain([1, 2, 3], 0.5, [0.1, 0, -0.02], [5, 6, 7], [1, -2, 0])
    parameters = {name: np.asarray(value).tolist() for name, value in path.parameters().items()}
    again = path_of("ArcChain", json.loads(json.dumps(parameters)))
    s = np.linspace(0, path.length, 57)
    assert again.length == path.length
    assert np.array_equal(again.position(s), path.position(s))
    assert np.array_equal(again.tangent(s), path.tangent(s))


def test_invalid_rises_are_refused():
    with pytest.raises(InputError, match=r"arc chain: 2 rises: must be one, or as many as the 3 pieces"):
        ArcChain([0, 0], 0, [0, 0, 0], [1, 1, 1], [1, 2])
    with pytest.raises(InputError, match=r"start, heading, curvatures, lengths and rises must be finite"):
        ArcChain([0, 0], 0, [0], [1], math.nan)


def test_places_at_the_same_length_of_different_coils_differ():
    """What is worked out for one call is kept for the next, where that asks for the very same places."""
    lead = Line((14, 0, 0), (10, 0, 0))  # 4 mm: the numbers into the pieces carry no rounding
    arc = Coil((0, 0, 0), (10, 10), 0, 0.8)  # 8 mm
    x, y, _ = Chain([arc]).position(8.0)[0]
    coil = Coil((x - 5 * math.cos(0.8), y - 5 * math.sin(0.8), 0), (5, 9), 0.8, 4, 3)
    path, alone = Chain([lead, arc, coil]), {4.0: Chain([arc]), 12.0: Chain([coil])}
    into = np.array([0.5, 2.0, 6.0])
    for begin, piece in alone.items():
        assert path.position(begin + into) == pytest.approx(piece.position(into), abs=POSITION)
        assert path.tangent(begin + into) == pytest.approx(piece.tangent(into), abs=1e-12)
