"""Rounded corners against closed forms, and against distances found by dense sampling."""

import math
from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial import cKDTree

from gantrysim.controllers.drawings.corners import (
    Count,
    Leg,
    _arcs,
    _deviation,
    _distance,
    legs_with_corners,
    length,
    part,
    points_at,
    tangent,
    turn,
)
from gantrysim.paths.pieces import Coil, Line

DENSE = np.linspace(0.0, 1.0, 20001)
TOLERANCE = 0.2  # [mm]
Z = 1.5  # [mm]


def line(begin, end, z=Z):
    return Line((*begin, z), (*end, z))


def arc(centre, radius, begin, angle, z=Z):
    return Coil((*centre, z), (radius, radius), begin, angle)


PIECES = {
    "line": line((1.0, -2.0), (5.0, 1.0)),
    "left arc": arc((2.0, 1.0), 3.0, -2.5, 2.0),
    "right arc": arc((2.0, 1.0), 3.0, 1.0, -4.0),
    "arc across its cut": arc((-1.0, 0.0), 2.0, 2.8, 1.0),
}


@pytest.fixture(params=PIECES)
def piece(request):
    return PIECES[request.param]


def test_points_and_tangent_are_those_of_a_motion_at_even_speed(piece):
    """The chords between dense points all have the same length, which adds up to the piece's."""
    points = points_at(piece, DENSE)
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    assert steps.sum() == pytest.approx(length(piece), rel=1e-7)
    assert steps == pytest.approx(length(piece) / (DENSE.size - 1), rel=1e-6)
    for k in (0, 4000, 19999):
        ahead = (points[k + 1] - points[k]) / steps[k]
        assert tangent(piece, DENSE[k]) == pytest.approx(ahead, abs=1e-3)


def test_a_part_of_a_piece_has_its_points(piece):
    shares = np.linspace(0.2, 0.7, 11)
    np.testing.assert_allclose(
        points_at(part(piece, 0.2, 0.7), np.linspace(0.0, 1.0, 11)), points_at(piece, shares), atol=1e-12
    )
    assert length(part(piece, 0.2, 0.7)) == pytest.approx(0.5 * length(piece))


def test_the_distance_from_a_piece_is_that_to_its_nearest_point(piece):
    """Points all round, beyond both ends, at the centre's other side and on the piece."""
    random = np.random.default_rng(4)
    points = np.concatenate([random.uniform(-8.0, 8.0, (200, 2)), points_at(piece, np.array([0.0, 0.37, 1.0]))[:, :2]])
    points = np.column_stack([points, np.full(len(points), Z)])
    nearest = np.linalg.norm(points[:, None] - points_at(piece, DENSE[::10])[None], axis=2).min(axis=1)
    np.testing.assert_allclose(_distance(points, piece), nearest, atol=3e-3)


def test_the_deviation_of_a_biarc_is_the_farthest_that_either_is_from_the_other():
    first = PIECES["line"]
    last = arc((5.0, 4.0), 3.0, -0.5 * math.pi, 1.2)
    arcs = _arcs(first, last, Z)
    blend = np.concatenate([points_at(one, DENSE[::20]) for one in arcs])
    corner = np.concatenate([points_at(one, DENSE[::20]) for one in (first, last)])
    apart = np.linalg.norm(blend[:, None] - corner[None], axis=2)
    expected = max(apart.min(axis=0).max(), apart.min(axis=1).max())
    assert expected > 0.1
    assert _deviation(arcs, first, last) == pytest.approx(expected, rel=0.02)
    # either may be the one that the other leaves
    assert _deviation([first, last], *arcs) == pytest.approx(expected, rel=0.02)


def rounded(*pieces, tolerance=TOLERANCE, **options):
    count = Count()
    legs = [Leg(piece, True, 10.0 + k, order=(2.0 * k, 2.0 * k + 1), **options) for k, piece in enumerate(pieces)]
    return legs_with_corners(legs, tolerance, count), count


@pytest.mark.parametrize("degrees", [1.0, 40.0, 90.0, 150.0, 174.0, -60.0])
def test_a_corner_of_two_lines_is_an_arc_at_the_tolerance(degrees):
    """d = tolerance / tan(theta / 4), at most the whole of a line; the radius is d / tan(theta / 2)."""
    theta = math.radians(degrees)
    far = (20.0 + 30.0 * math.cos(theta), 30.0 * math.sin(theta))
    legs, count = rounded(line((0.0, 0.0), (20.0, 0.0)), line((20.0, 0.0), far))
    assert (count.rounded, count.sharp) == (1, 0)
    distance = min(TOLERANCE / math.tan(0.25 * abs(theta)), 20.0)
    blend = next(leg.piece for leg in legs if isinstance(leg.piece, Coil))
    assert blend.radius[0] == pytest.approx(distance / math.tan(0.5 * abs(theta)), rel=1e-9)
    assert blend.angle == pytest.approx(theta, rel=1e-9)
    nearest = np.linalg.norm(points_at(blend, DENSE) - [20.0, 0.0, Z], axis=1).min()
    assert nearest == pytest.approx(distance * math.tan(0.25 * abs(theta)), rel=1e-6)
    assert legs[-1].length == pytest.approx(30.0 - distance)


PAIRS = {
    "line into an arc": (line((0.0, 0.0), (20.0, 0.0)), arc((20.0 - 12.0, 0.0), 12.0, 0.0, 2.0)),
    "arc into a line": (arc((0.0, 0.0), 15.0, 0.0, 1.5), line((15 * math.cos(1.5), 15 * math.sin(1.5)), (20.0, 30.0))),
    "two arcs": (arc((0.0, 0.0), 15.0, 0.0, 1.5), arc((15 * math.cos(1.5) - 9.0, 15 * math.sin(1.5)), 9.0, 0.0, 2.0)),
}


@pytest.mark.parametrize("kind", PAIRS)
def test_a_corner_with_an_arc_is_a_smooth_biarc_within_the_tolerance(kind):
    legs, count = rounded(*PAIRS[kind])
    assert (count.rounded, count.sharp) == (1, 0)
    assert len(legs) == 4
    for before, after in pairwise(legs):
        np.testing.assert_allclose(before.end, after.start, atol=1e-9)
        assert turn(tangent(before.piece, 1.0), tangent(after.piece, 0.0)) < 1e-6
    np.testing.assert_allclose(legs[0].start, points_at(PAIRS[kind][0], np.zeros(1))[0])
    np.testing.assert_allclose(legs[-1].end, points_at(PAIRS[kind][1], np.ones(1))[0], atol=1e-9)
    blend = np.concatenate([points_at(leg.piece, DENSE[::20]) for leg in legs])
    path = np.concatenate([points_at(piece, DENSE[::10]) for piece in PAIRS[kind]])
    deviation = max(cKDTree(path).query(blend)[0].max(), cKDTree(blend).query(path)[0].max())
    # a step of the search shrinks the distance by 0.85
    assert 0.5 * TOLERANCE < deviation < TOLERANCE * 1.005
    orders = [value for leg in legs for value in leg.order]
    assert orders == sorted(orders)
    assert (orders[0], orders[-1]) == (0.0, 3.0)
    assert [leg.speed for leg in legs] == [10.0, 10.0, 10.0, 11.0]


@pytest.mark.parametrize(
    ("pieces", "options"),
    [
        # above one another in z, an arc is not blended
        ((line((0.0, 0.0), (20.0, 0.0)), arc((8.0, 0.0), 12.0, 0.0, 2.0, z=Z + 1)), {}),
        # it doubles back
        ((line((0.0, 0.0), (20.0, 0.0)), line((20.0, 0.0), (0.0, 0.5))), {}),
        # it rests in the corner
        ((line((0.0, 0.0), (20.0, 0.0)), line((20.0, 0.0), (20.0, 9.0))), {"pause": 0.1}),
    ],
)
def test_a_corner_that_cannot_be_rounded_stays(pieces, options):
    legs, count = rounded(*pieces, **options)
    assert (count.rounded, count.sharp) == (0, 1)
    assert [leg.piece for leg in legs] == list(pieces)


def test_without_a_tolerance_or_a_corner_nothing_changes():
    pair = (line((0.0, 0.0), (20.0, 0.0)), line((20.0, 0.0), (20.0, 9.0)))
    assert rounded(*pair, tolerance=0.0)[1] == Count(0, 1)
    assert rounded(pair[0], line((20.0, 0.0), (40.0, 1e-4)))[1] == Count(0, 0)


def test_a_piece_between_two_corners_gives_half_of_itself_to_each():
    """4 mm long, of which a blend of 90 deg within 5 mm would take 5 / tan(22.5 deg)."""
    legs, count = rounded(
        line((0.0, 0.0), (20.0, 0.0)), line((20.0, 0.0), (20.0, 4.0)), line((20.0, 4.0), (40.0, 4.0)), tolerance=5.0
    )
    assert count.rounded == 2
    assert [leg.length for leg in legs] == pytest.approx([18.0, math.pi, math.pi, 18.0])
