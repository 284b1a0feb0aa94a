"""Offsets about corners: components that change nowhere faster than the point moves.

The oracles are plane geometry (the signed distance from a bent line) and the triangle inequality.
"""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from gantrysim.base.errors import InputError
from gantrysim.paths.chain import Chain
from gantrysim.paths.corners import Components
from gantrysim.paths.pieces import Coil, Line

from support.soaked import examples

EXACT = 1e-9  # [mm]
FOOT = 1e-8  # of a foot's place along a leg, which shows where the point is nearly on it [mm]
LEG = 10.0  # [mm]

angles = st.floats(-170, 170).filter(lambda angle: abs(angle) > 1)


def bent(turn, climb=0.0, second_climb=0.0):
    """A path of two legs that turns left by an angle, each leg with its angle of climb [deg]."""
    turn, climb, second_climb = map(math.radians, (turn, climb, second_climb))
    first = np.array([math.cos(climb), 0.0, math.sin(climb)])
    second = math.cos(second_climb) * np.array([math.cos(turn), math.sin(turn), 0.0])
    second[2] = math.sin(second_climb)
    corner = LEG * first
    return Chain([Line((0, 0, 0), tuple(corner)), Line(tuple(corner), tuple(corner + LEG * second))]), corner


@given(angles, st.floats(0, 2 * math.pi), st.floats(0.01, 2.0))
@examples(60)
def test_the_lateral_component_is_the_signed_distance_of_plane_geometry(turn, direction, radius):
    path, corner = bent(turn)
    point = corner + radius * np.array([math.cos(direction), math.sin(direction), 0.0])
    ways = [(np.zeros(3), corner), (corner, path.position(path.length)[0])]
    distance = math.inf
    for start, end in ways:
        share = np.clip((point - start) @ (end - start) / LEG**2, 0, 1)
        distance = min(distance, float(np.linalg.norm(point - start - share * (end - start))))
    left_of = [np.cross(end - start, point - start)[2] > 0 for start, end in ways]
    inside = all(left_of) if turn > 0 else any(left_of)  # left of the bent line
    foot = path.project(point)
    assert foot.lateral[0] == pytest.approx(distance if inside else -distance, abs=1e-7)
    assert abs(foot.beyond[0]) < EXACT


@given(angles, st.floats(-80, 80), st.floats(-80, 80), st.lists(st.floats(-1.5, 1.5), min_size=6, max_size=6))
@example(2.0, 0.0, -14.0, [0.0, 0.0, 0.0, 0.0, 0.0, -1e-5])
@examples(60)
def test_components_change_no_faster_than_the_point_moves(turn, climb, second_climb, ends):
    """In space, across the corner's wedge and across the bisector inside it, in steps of a thousandth."""
    path, corner = bent(turn, climb, second_climb)
    begin, end = np.array(ends[:3]), np.array(ends[3:])
    points = corner + np.linspace(0, 1, 1001)[:, None] * (end - begin) + begin
    foot = path.project(points)
    carried = path.legs.carry(Components(foot.lateral, foot.vertical, foot.beyond), foot.s, np.zeros(len(points)))
    across = np.stack([carried.lateral, carried.vertical], axis=1)
    assert np.linalg.norm(across, axis=1) == pytest.approx(foot.distance, abs=FOOT)
    first, second = path.tangent(LEG + np.array([-1e-6, 1e-6]))
    if first @ second < -0.8:
        return  # where the legs are nearly one line the sides of both are not told apart
    moved = np.linalg.norm(np.diff(points, axis=0), axis=1)
    assert np.all(np.linalg.norm(np.diff(across, axis=0), axis=1) <= moved + 1e-6)


def test_where_a_path_retraces_itself_its_sides_are_exchanged():
    """A point beside such a path has one offset, whichever leg it is measured from."""
    path = Chain([Line((0, 0, 0), (10, 0, 0)), Line((10, 0, 0), (0, 0, 0))])
    offset = np.array([[0.0, 0.003, 0.001]])
    there, back = (
        path.near(path.position([s]) + offset, np.array([s]), np.array([[s - 0.01], [s + 0.01]])) for s in (4.0, 16.0)
    )
    assert there.lateral == pytest.approx(0.003)
    assert back.lateral == pytest.approx(-0.003)
    carried = path.legs.carry(Components(back.lateral, back.vertical, back.beyond), back.s, there.s)
    assert (carried.lateral[0], carried.vertical[0]) == pytest.approx((0.003, 0.001), abs=EXACT)


@pytest.mark.soak
def test_corners_of_a_path_of_kilometres_are_those_of_a_short_one():
    """Where arc lengths are rounded to half a nanometre."""
    lines = []
    for k in range(6000):
        y = 3.0 * (k // 2 + k % 2)
        lines.append(
            Line((0, y, 0), (400, y, 0)) if k % 4 == 0 else Line((400, y, 0), (0, y, 0)) if k % 4 == 2 else None
        )
        if lines[-1] is None:
            x = 400 if k % 4 == 1 else 0
            lines[-1] = Line((x, y - 3.0, 0), (x, y, 0))
    path = Chain(lines)
    assert path.length > 1.2e6
    legs = path.legs
    assert np.abs(legs.axis).max(axis=1) == pytest.approx(np.ones(len(legs.s)))
    s = np.linspace(path.length - 5000, path.length, 20_001)
    trace = path.position(s) + 0.4 * path.normal(s)
    assert path.follow(trace, s).distance.max() < 0.4 + EXACT


def test_a_path_too_long_for_its_table_of_points_is_refused():
    path = Chain([Line((0, 0, 0), (1.2e7, 0, 0))])
    with pytest.raises(InputError, match=r"^path length = 1\.2e\+07 mm: must be at most 1e\+07 mm to find feet on it$"):
        path.project([0, 0, 0])
    assert Chain([Line((0, 0, 0), (3e6, 0, 0))]).table.widest <= 0.5 + 1e-9


@pytest.mark.parametrize("seed", range(10))
def test_points_of_a_path_lie_evenly_on_lines_and_within_the_sagitta_on_arcs(seed):
    """0.05 mm apart on lines, whatever bends beside them; on arcs within a chord's sagitta of 5 nm, and no denser."""
    random = np.random.default_rng(seed)
    first, last = random.uniform(5, 20, 2)
    radius = random.choice([0.02, 0.5, 3.0, 200.0])
    path = Chain(
        [
            Line((0, 0, 0), (first, 0, 0)),
            Coil((first, radius, 0), (radius, radius), -math.pi / 2, math.pi),
            Line((first, 2 * radius, 0), (first - last, 2 * radius, 0)),
        ]
    )
    spacing = min(path.length / math.ceil(path.length / 0.05), path.length / 256)
    edges = [0.0, first, first + math.pi * radius, path.length]
    chords = [np.diff(path.table.s[(path.table.s >= low) & (path.table.s <= high)]) for low, high in pairwise(edges)]
    for chord, length in ((chords[0], first), (chords[2], last)):
        np.testing.assert_allclose(chord, length / math.ceil(length / spacing - 1e-9), rtol=1e-9)
    largest = min(math.sqrt(8 * radius * 5e-6), spacing)
    assert largest / 2.1 < chords[1].min() <= chords[1].max() <= largest * (1 + 1e-9)
