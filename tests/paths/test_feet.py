"""Feet of points in closed form, by bisection, and against all points of the stretch of the path that is searched."""

import math

import numpy as np
import pytest

from gantrysim.paths.chain import Chain
from gantrysim.paths.nearest import Table, find_starts
from gantrysim.paths.pieces import Coil, Line
from gantrysim.paths.spirals import Involute

ROUNDING = 1e-13  # of a position some 100 mm from the origin [mm]
FRAME = 3e-13  # of the directions at a foot
PLACE = 1e-10  # of a foot along the path [mm]
SAGITTA = 5e-6  # of a chord [mm]

CHORDS = 8
SKIPPED = 3  # chords from one to the next of those looked at, the root of their number and one more

PATHS = {
    "involute": Involute(60.0, 6.0, 4.0, (20.0, 10.0)),
    "climbing involute": Involute(60.0, 6.0, 4.0, (20.0, 10.0), height=25.0),
    "cone": Chain([Coil((5, 3, 0), (40, 10), 0.3, 8 * math.pi, 24)]),
}


@pytest.mark.parametrize("off", [-3.0, -0.01, 1e-4, 0.4, 3.0])
def test_foot_on_a_circle_in_closed_form(off):
    """The distance is |r - R|, and the arc length R times the angle, wherever the point lies between two entries."""
    radius = 50.0
    path = Chain([Coil((7, -4, 0), (radius, radius), 0.0, 1.5 * math.pi)])
    angle = np.linspace(0.01, 1.49 * math.pi, 5000)
    points = np.column_stack([7 + (radius + off) * np.cos(angle), -4 + (radius + off) * np.sin(angle), 0 * angle])
    foot = path.follow(points, radius * angle)
    assert foot.distance == pytest.approx(np.full(angle.size, abs(off)), abs=ROUNDING)
    assert foot.lateral == pytest.approx(np.full(angle.size, -off), abs=ROUNDING)
    assert foot.s == pytest.approx(radius * angle, abs=PLACE)
    assert np.abs(foot.beyond).max() < ROUNDING


@pytest.mark.parametrize("name", PATHS)
@pytest.mark.parametrize("off", [0.002, 2.0])
def test_foot_is_where_bisection_finds_the_path_square_to_the_way_from_it(name, off):
    path = PATHS[name]
    s = np.linspace(0.5, path.length - 0.5, 700)
    tangent, normal = path.tangent(s), path.normal(s)
    around = np.linspace(0, 40, s.size)[:, None]
    points = path.position(s) + off * (np.cos(around) * normal + np.sin(around) * np.cross(tangent, normal))
    low = s - 0.3
    high = s + 0.3
    for _ in range(60):
        middle = 0.5 * (low + high)
        is_behind = np.einsum("ij,ij->i", points - path.position(middle), path.tangent(middle)) > 0
        low, high = np.where(is_behind, middle, low), np.where(is_behind, high, middle)
    offset = points - path.position(low)
    foot = path.follow(points, s)
    assert foot.distance == pytest.approx(np.linalg.norm(offset, axis=1), abs=ROUNDING)
    assert foot.lateral == pytest.approx(np.einsum("ij,ij->i", offset, path.normal(low)), abs=ROUNDING + FRAME * off)
    assert foot.offset == pytest.approx(offset, abs=PLACE)
    assert foot.s == pytest.approx(low, abs=PLACE)


def test_nearest_point_of_a_stretch_is_that_of_all_of_its_points():
    """On lines, arcs and corners, for points up to 4 mm off the path and 3 mm behind their places."""
    pieces = [
        Line((0, 0, 0), (20, 0, 0)),
        Coil((20, 3, 0), (3, 3), -0.5 * math.pi, math.pi),
        Line((20, 6, 0), (4, 6, 0)),
        Line((4, 6, 0), (6, 11, 2)),
        Coil((6, 31, 2), (20, 20), -0.5 * math.pi, 0.9),
    ]
    path = Chain(pieces)
    rng = np.random.default_rng(3)
    count = 4000
    place = np.sort(rng.uniform(0, path.length, count))
    stretches = np.clip(place + rng.uniform(0, 6, (2, count)) * [[-1], [1]], 0, path.length)
    behind = np.clip(place - rng.uniform(0, 3, count), 0, path.length)
    points = path.position(behind) + rng.uniform(-4, 4, (count, 1)) * path.normal(behind)
    foot = path.near(points, place, stretches)
    for k in range(count):
        s = np.linspace(*stretches[:, k], 400)
        distance = np.linalg.norm(path.position(s) - points[k], axis=1).min()
        step = (s[-1] - s[0]) / 399
        # no point of the stretch is nearer, but for the sagitta by which chords differ, and some point is as near
        assert distance - step <= foot.distance[k] <= distance + 2 * SAGITTA
        assert stretches[0, k] - PLACE <= foot.s[k] <= stretches[1, k] + PLACE


@pytest.mark.parametrize("chord", range(0, CHORDS, SKIPPED))
def test_the_search_of_a_whole_path_begins_at_the_nearest_chord_looked_at(chord):
    """Points square to the middle of such a chord; what lies in memory behind the path, on the point, is not looked at.

    The path is a straight one with entries every 10 mm.
    """
    s = 10.0 * np.arange(CHORDS + 1)
    point = np.array([[10.0 * chord + 5.0, 1.0, 0.0]])
    memory = np.repeat(point, CHORDS + 4, axis=0)
    memory[: CHORDS + 1] = np.column_stack([s, 0 * s, 0 * s])
    table = Table(s, memory[: CHORDS + 1], np.zeros(CHORDS + 1, bool), 10.0)
    places = np.full(1, np.nan)
    find_starts(table, point, places)
    assert places == s[chord]


@pytest.mark.parametrize("length", [20.0, 2e5])
def test_the_legs_of_a_corner_have_their_own_directions_however_far_along_it_lies(length):
    path = Chain([Line((0, 0, 0), (length, 0, 0)), Line((length, 0, 0), (length, 10, 0))])
    assert path.legs.before == pytest.approx(np.array([[1, 0, 0]]), abs=1e-12)
    assert path.legs.after == pytest.approx(np.array([[0, 1, 0]]), abs=1e-12)
