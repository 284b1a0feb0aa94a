"""Outline tracing on an XY stage on a rotary table, against a rounded polygon and a transformation of the tests' own.

C + R(TH) (W + u + sigma S - C) = K, with rotation matrices: u is the place of the work under the needle.
"""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gantrysim.controllers.stage import OutlineTrace

from support.outlines import (
    ANGLE,
    ELL,
    POSITION,
    RECTANGLE,
    SPEED,
    TABLE,
    Rounded,
    accelerations,
    angle_between,
    on_the_work,
    place,
    traces,
    turned,
    velocities,
)
from support.soaked import examples, suite_runs


@pytest.mark.validates(
    "outline on the rotary stage: perimeter, times, speeds",
    "table of the specification",
    "its last digit",
)
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


@pytest.mark.parametrize(
    ("pieces", "error", "figure"), suite_runs([(1, 55.650, 5e-4), (9, 0.7230, 5e-5), (90, 0.00723, 5e-6)], 1)
)
def test_the_notes_errors_of_linear_corner_interpolation(pieces, error, figure):
    """rho (1 - cos(pi / 4 N)), the chord's distance from the arc."""
    trace = OutlineTrace(corner_pieces=pieces)
    exact = OutlineTrace()
    s = np.linspace(0, trace.requested.length, 200_001)
    off = np.linalg.norm((trace.coordinates(s) - exact.coordinates(s))[:, 1:], axis=1).max()
    assert off == pytest.approx(error, abs=figure)
    assert off == pytest.approx(190 * (1 - math.cos(math.pi / 4 / pieces)), rel=1e-4)
    assert trace.coordinates(s)[:, 0] == pytest.approx(exact.coordinates(s)[:, 0], abs=1e-7)
    assert trace.notes == (f"corners: {pieces} linear pieces each deviate from the arc by up to {off:.4g} mm",)
    # the needle is as far off the outline
    u = on_the_work(trace, trace.coordinates(s))
    assert np.linalg.norm(u - Rounded(RECTANGLE, 10)(s)[0], axis=1).max() == pytest.approx(off, rel=1e-9)


def test_an_inner_corner_deviates_more_from_its_arc():
    """All corners turn by 90 deg; about the inner one the stage's radius is 210 mm, about the others 190 mm."""
    trace = OutlineTrace(corners=ELL, corner_pieces=9)
    assert trace.notes == (f"corners: 9 linear pieces each deviate from the arc by up to {210 / 190 * 0.7230:.4g} mm",)


@given(traces(), st.integers(1, 12))
@examples(40)
def test_linear_corners_deviate_as_noted(job, pieces):
    """Convex and concave corners have arcs of other radii, |K - C - r n_K| and |K - C + r n_K|."""
    trace, exact = OutlineTrace(**job, corner_pieces=pieces), OutlineTrace(**job)
    s = np.linspace(0, trace.requested.length, 40_001)
    parts = [
        np.linspace(a, b, 2 * pieces + 1) for a, b in zip(exact.turning.s[1::2], exact.turning.s[2::2], strict=True)
    ]
    s = np.concatenate([s, *parts])
    off = np.linalg.norm((trace.coordinates(s) - exact.coordinates(s))[:, 1:], axis=1).max()
    text = float(trace.notes[-1].split()[-2])
    assert trace.notes[-1] == f"corners: {pieces} linear pieces each deviate from the arc by up to {text:.4g} mm"
    assert text == pytest.approx(off, rel=1e-3, abs=1e-9)


@given(traces())
@examples(100)
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
@examples(40)
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
@examples(40)
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
@examples(40)
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
