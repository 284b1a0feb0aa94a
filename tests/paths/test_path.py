"""Paths by arc length: the geometry of arc chains, and projection onto a path."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gantrysim.base.errors import InputError
from gantrysim.paths.arcs import ArcChain
from gantrysim.paths.kinds import path_of
from gantrysim.paths.spirals import Involute

from support.runs import archimedean
from support.soaked import examples

POSITION = 1e-9  # [mm]
ANGLE = 1e-10  # [rad]
DIFFERENCE = 1e-7  # of a difference quotient over STEP
STEP = 1e-3  # [mm]
FOOT = 1e-7  # arc length of a foot point that is well off the centre of curvature [mm]
# Where two branches of a path are nearly as near, the table of points from which a projection starts may
# prefer the farther one. Its spacing h bounds by how much: h^2/8 (1/distance + curvature).
TABLE_SPACING = 0.05  # [mm]

SPIRALS = [
    Involute(60, 10, 4),
    Involute(60, 10, 4, (3, -8), 0.7, clockwise=False),
    archimedean(60, 10, 4),
    archimedean(60, 10, 4, (3, -8), 0.7, clockwise=False),
]


@st.composite
def chains(draw, turning=math.inf):
    """Start, heading, curvatures and lengths of a chain; of an absolute turning of at most `turning`."""
    pieces = draw(st.integers(1, 8))
    radius = st.floats(5, 100)
    bend = st.one_of(st.just(0.0), radius.map(lambda r: 1 / r), radius.map(lambda r: -1 / r))
    curvature = np.array(draw(st.lists(bend, min_size=pieces, max_size=pieces)))
    lengths = np.array(draw(st.lists(st.floats(0.5, 30), min_size=pieces, max_size=pieces)))
    total = np.abs(curvature) @ lengths
    if total > turning:
        lengths *= turning / total
    start = draw(st.tuples(st.floats(-50, 50), st.floats(-50, 50)))
    return start, draw(st.floats(-7, 7)), curvature, lengths


def walk(start, heading, curvature, lengths, s):
    """Position and heading at the arc length s by integrating exp(i theta) piece by piece."""
    z, theta = complex(*start), heading
    for kappa, length in zip(curvature, lengths, strict=True):
        run = min(s, length)
        if kappa == 0:
            z += run * np.exp(1j * theta)
        else:
            z += (np.exp(1j * (theta + kappa * run)) - np.exp(1j * theta)) / (1j * kappa)
        theta += kappa * run
        s -= run
        if s <= 0:
            break
    return z, theta


def distance_to_chain(point, start, heading, curvature, lengths):
    """Distance of a complex point to the chain: for every piece in closed form."""
    nearest = math.inf
    z, theta = complex(*start), heading
    for kappa, length in zip(curvature, lengths, strict=True):
        end, theta_end = walk((z.real, z.imag), theta, [kappa], [length], length)
        nearest = min(nearest, abs(point - z), abs(point - end))
        if kappa == 0:
            local = (point - z) * np.exp(-1j * theta)
            if 0 <= local.real <= length:
                nearest = min(nearest, abs(local.imag))
        else:
            centre = z + 1j * np.exp(1j * theta) / kappa
            swept = np.angle((point - centre) / (z - centre)) * np.sign(kappa) % (2 * np.pi)
            if swept <= abs(kappa) * length:
                nearest = min(nearest, abs(abs(point - centre) - 1 / abs(kappa)))
        z, theta = end, theta_end
    return nearest


def tie(distance, curvature):
    return min(TABLE_SPACING / 2, TABLE_SPACING**2 / 8 * (1 / max(distance, 1e-9) + curvature))


@given(chains(), st.floats(0, 1))
@examples(100)
def test_chain_is_the_integral_of_its_curvature(chain, fraction):
    path = ArcChain(*chain)
    s = fraction * path.length
    z, theta = walk(*chain, s)
    assert path.length == pytest.approx(chain[3].sum(), abs=POSITION)
    assert path.position(s)[0] == pytest.approx([z.real, z.imag, 0], abs=POSITION)
    assert path.heading(s)[0] == pytest.approx(theta, abs=ANGLE)


@given(chains())
@examples(50)
def test_chain_is_continuous_and_tangent_continuous_at_its_joints(chain):
    path = ArcChain(*chain)
    joints = np.cumsum(chain[3])[:-1]
    before, after = np.maximum(joints - 1e-10, 0), joints + 1e-10
    assert np.abs(path.position(after) - path.position(before)).max(initial=0) < POSITION
    assert np.abs(path.heading(after) - path.heading(before)).max(initial=0) < ANGLE


@given(chains(), st.data())
@examples(50)
def test_curvature_of_a_chain_is_that_of_the_piece(chain, data):
    piece = data.draw(st.integers(0, len(chain[2]) - 1))
    inside = chain[3][:piece].sum() + 0.5 * chain[3][piece]
    assert ArcChain(*chain).curvature(inside)[0] == chain[2][piece]


@given(chains(), st.floats(0.01, 0.99))
@examples(50)
def test_tangent_is_unit_and_the_derivative_of_position_with_the_normal_to_its_left(chain, fraction):
    path = ArcChain(*chain)
    s = fraction * path.length + np.array([-0.5, 0, 0.5]) * STEP
    before, at, after = path.position(s)
    # Simpson's rule over the step; a joint within it costs STEP^2 times the jump of curvature
    mean = np.array([1, 4, 1]) / 6 @ path.tangent(s)
    assert (after - before) / STEP == pytest.approx(mean, abs=STEP * 0.4 + DIFFERENCE)
    tangent, normal = path.tangent(s)[1], path.normal(s)[1]
    assert np.linalg.norm(tangent) == pytest.approx(1, abs=1e-14)
    assert tangent == pytest.approx([math.cos(path.heading(s)[1]), math.sin(path.heading(s)[1]), 0], abs=1e-14)
    assert np.cross([0, 0, 1], tangent) == pytest.approx(normal, abs=1e-14)
    assert at[2] == 0


def test_circle_closes_and_counts_its_heading_past_a_turn():
    circle = ArcChain([1, 2], 0.3, 1 / 25, 2 * np.pi * 25 * 3)
    assert circle.position(circle.length)[0] == pytest.approx([1, 2, 0], abs=POSITION)
    assert circle.heading(circle.length)[0] == pytest.approx(0.3 + 6 * np.pi, abs=ANGLE)
    centre = np.array([1 - 25 * math.sin(0.3), 2 + 25 * math.cos(0.3), 0])
    radii = np.linalg.norm(circle.position(np.linspace(0, circle.length, 50)) - centre, axis=1)
    assert radii == pytest.approx(np.full(50, 25), abs=POSITION)


def test_line_is_straight():
    line = ArcChain([1, 2, 5], math.atan2(3, 4), 0, 10)
    assert line.position([0, 5, 10]) == pytest.approx(np.array([[1, 2, 5], [5, 5, 5], [9, 8, 5]]), abs=POSITION)
    assert np.all(line.curvature([0, 5, 10]) == 0)


def test_pieces_of_length_zero_change_nothing():
    plain = ArcChain([0, 0], 0, [0.1, -0.05], [10, 20])
    padded = ArcChain([0, 0], 0, [9, 0.1, 3, -0.05, 7], [0, 10, 0, 20, 0])
    s = np.linspace(0, plain.length, 101)
    assert padded.length == plain.length
    assert padded.position(s) == pytest.approx(plain.position(s), abs=POSITION)
    assert padded.heading(s) == pytest.approx(plain.heading(s), abs=ANGLE)


@given(chains(turning=math.pi), st.floats(0, 1), st.floats(-2.4, 2.4))
@examples(100)
def test_projection_of_a_point_on_a_normal_gives_back_its_arc_length_and_offset(chain, fraction, lateral):
    """All radii are at least 5 mm and the chain turns by at most half a turn: the foot is unique."""
    path = ArcChain(*chain)
    s = fraction * path.length
    foot = path.project(path.position(s) + lateral * path.normal(s))
    assert foot.s[0] == pytest.approx(s, abs=FOOT)
    assert foot.lateral[0] == pytest.approx(lateral, abs=POSITION)
    assert foot.distance[0] == pytest.approx(abs(lateral), abs=POSITION)
    assert foot.offset[0] == pytest.approx(lateral * path.normal(s)[0], abs=FOOT)


@given(chains(), st.lists(st.tuples(st.floats(-100, 100), st.floats(-100, 100)), min_size=1, max_size=20))
@examples(100)
def test_distance_is_that_of_the_nearest_piece_in_closed_form(chain, around):
    points = np.array([[chain[0][0] + x, chain[0][1] + y, 0] for x, y in around])
    sharpest = np.abs(chain[2]).max()
    for point, distance in zip(points, ArcChain(*chain).project(points).distance, strict=True):
        exact = distance_to_chain(complex(*point[:2]), *chain)
        assert exact - POSITION <= distance <= exact + tie(exact, sharpest) + POSITION


@pytest.mark.parametrize("path", SPIRALS, ids=lambda path: f"{type(path).__name__}-{path.clockwise}")
def test_distance_is_never_larger_than_to_any_sampled_point(path):
    samples = path.position(np.linspace(0, path.length, 20_001))[:, :2]
    low, high = samples.min(0) - 20, samples.max(0) + 20
    points = np.column_stack([np.random.default_rng(1).uniform(low, high, (300, 2)), np.zeros(300)])
    distance = path.project(points).distance
    brute = np.array([np.sqrt(((samples - point[:2]) ** 2).sum(1).min()) for point in points])
    sharpest = float(np.abs(path.curvature(path.length)[0]))
    assert all(d <= b + tie(b, sharpest) for d, b in zip(distance, brute, strict=True))
    assert brute - distance == pytest.approx(0, abs=path.length / 20_000)


def test_distance_has_the_height_and_lateral_has_not():
    line = ArcChain([0, 0], 0, 0, 10)
    foot = line.project([[4, 3, 12], [4, -3, -4]])
    assert foot.s == pytest.approx([4, 4], abs=POSITION)
    assert foot.lateral == pytest.approx([3, -3], abs=POSITION)
    assert foot.distance == pytest.approx([math.hypot(3, 12), 5], abs=POSITION)
    assert foot.offset == pytest.approx(np.array([[0, 3, 12], [0, -3, -4]]), abs=POSITION)


def test_points_beyond_the_ends_project_onto_the_ends():
    line = ArcChain([0, 0], 0, 0, 10)
    foot = line.project([[-3, 4, 0], [13, -4, 0]])
    assert foot.s == pytest.approx([0, 10], abs=POSITION)
    assert foot.distance == pytest.approx([5, 5], abs=POSITION)
    assert foot.lateral == pytest.approx([4, -4], abs=POSITION)


def test_a_single_point_and_no_point_are_projected():
    line = ArcChain([0, 0], 0, 0, 10)
    assert line.project([4, 3, 0]).distance == pytest.approx([3], abs=POSITION)
    assert line.project(np.zeros((0, 3))).distance.shape == (0,)


def test_centre_of_a_circle_is_a_radius_away():
    circle = ArcChain([0, 0], 0, 1 / 25, 2 * np.pi * 25)
    assert circle.project([[0, 25, 0]]).distance == pytest.approx([25], abs=POSITION)


def test_projection_stays_on_its_turn_of_a_spiral_finer_than_the_table_of_points():
    path = Involute(5, 0.1, 40)
    s = np.linspace(1, 90, 500)
    assert path.project(path.position(s) + 0.01 * path.normal(s)).s == pytest.approx(s, abs=FOOT)


@pytest.mark.parametrize(
    ("curvature", "lengths"),
    [
        ([0.0], [3.0]),
        ([0.0, 0.2, 0.0, -0.1], [30.0, 7.0, 0.7, 20.0]),
        ([0.5, -2.0, 0.01], [2.0, 1.3, 11.0]),
    ],
)
def test_the_table_has_all_joints_and_chords_that_are_short_and_near_the_path(curvature, lengths):
    path = ArcChain((1, 2), 0.3, curvature, lengths)
    table = path.table
    s = table.s
    assert s[0] == 0
    assert s[-1] == pytest.approx(path.length, abs=1e-9)
    assert np.abs(s[:, None] - np.cumsum(lengths)).min(axis=0) == pytest.approx(np.zeros(len(lengths)), abs=1e-9)
    assert s[table.is_corner] == pytest.approx(path.corners, abs=1e-9)
    # evenly spaced, and never in fewer than 256 parts
    longest = min(TABLE_SPACING, path.length / 256)
    assert np.diff(s).min() > 0
    assert table.widest == pytest.approx(np.diff(s).max(), abs=1e-12)
    assert np.diff(s).max() <= longest * (1 + 1e-6)
    assert np.diff(s).max() > 0.4 * longest
    bend = np.abs(curvature)[np.minimum(np.searchsorted(np.cumsum(lengths), s[:-1], side="right"), len(lengths) - 1)]
    assert (bend * np.diff(s) ** 2 / 8 <= 5.001e-6).all()
    places = path.position(s)
    assert table.points == pytest.approx(places, abs=POSITION)


def test_distance_of_a_far_point_whose_foot_is_near_a_joint_of_an_arc_and_a_line():
    chain = (0, 0), 0, [0.2, 0.0], [27.0, 39.0]
    exact = distance_to_chain(-223 - 171j, *chain)
    assert ArcChain(*chain).project([[-223, -171, 0]]).distance[0] == pytest.approx(exact, abs=1e-3)


@pytest.mark.parametrize(
    "path",
    [*SPIRALS, ArcChain([1, 2], 0.5, [0.1, 0, -0.02], [5, 6, 7])],
    ids=lambda path: type(path).__name__,
)
def test_a_path_is_built_again_from_its_parameters(path):
    again = path_of(type(path).__name__, path.parameters())
    s = np.linspace(0, path.length, 57)
    assert type(again) is type(path)
    assert again.length == path.length
    assert np.array_equal(again.position(s), path.position(s))
    assert np.array_equal(again.heading(s), path.heading(s))


@pytest.mark.parametrize(
    ("points", "shape"),
    [
        ([[1, 2]], r"\(1, 2\)"),
        ([1, 2, 3, 4], r"\(1, 4\)"),
        (np.zeros((5, 2)), r"\(5, 2\)"),
        ([[1, 2, math.nan]], r"\(1, 3\)"),
        ([[1, math.inf, 0]], r"\(1, 3\)"),
    ],
)
def test_points_of_a_wrong_shape_or_not_finite_are_named(points, shape):
    with pytest.raises(InputError, match=rf"points of shape {shape}: must be finite and of shape \(n, 3\)"):
        ArcChain([0, 0], 0, 0, 10).project(points)


@pytest.mark.parametrize(
    ("curvature", "lengths", "counts"),
    [
        ([0.1, 0.2], [5], "2 curvatures and 1 lengths"),
        ([0.1], [5, 6], "1 curvatures and 2 lengths"),
        ([0.1, 0.2], [5, -1], "2 curvatures and 2 lengths"),
        ([0.1], [math.nan], "1 curvatures and 1 lengths"),
        ([[0.1, 0.2]], [[5, 6]], "2 curvatures and 2 lengths"),
    ],
)
def test_chain_of_wrong_pieces_is_named(curvature, lengths, counts):
    with pytest.raises(InputError, match=f"arc chain: {counts}: must be as many, at least one, and no length negative"):
        ArcChain([0, 0], 0, curvature, lengths)


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (([0, 0], 0, [], []), "0 curvatures and 0 lengths: must be as many, at least one"),
        (([0, 0, 0, 0], 0, [0.1], [1]), "start of 4 numbers: must be two or three"),
        (([0, 0], 0, [math.nan], [1]), "must be finite"),
        (([0, 0], 0, [0.1], [math.inf]), "must be finite"),
        (([0, math.nan], 0, [0.1], [1]), "must be finite"),
    ],
)
def test_invalid_chains_are_refused(arguments, text):
    with pytest.raises(InputError, match=text):
        ArcChain(*arguments)


@pytest.mark.parametrize("start", [(0, 0, 0), (0, math.nan), 1.0])
def test_a_spirals_start_is_two_finite_numbers(start):
    with pytest.raises(InputError, match="start"):
        Involute(50, 10, 2, start=start)


def test_a_trace_with_large_jumps_is_followed():
    circle = ArcChain([20, 0], math.pi / 2, [1 / 20], [40 * math.pi])
    trace = np.array([[20.0, 0, 0], [20.1, 1, 0], [1e15, 2e15, 0]])
    found = circle.follow(trace, np.array([0.0, 1.0, 2.0]))
    assert found.s[:2] == pytest.approx([0, 20 * math.atan2(1, 20.1)], abs=1e-9)
    assert found.distance[2] == pytest.approx(math.hypot(1e15, 2e15), rel=1e-12)


@given(chain=chains(), seed=st.integers(0, 2**32 - 1))
def test_points_of_a_chain_do_not_depend_on_their_order(chain, seed):
    path = ArcChain(*chain)
    places = np.concatenate([[0.0], path.ends, np.linspace(0.0, path.length, 50)])
    order = np.random.default_rng(seed).permutation(places.size)
    np.testing.assert_array_equal(path.position(places[order]), path.position(places)[order])
