"""Traces by vertices a chord apart: where they lie, and at which of a run's a trace may begin."""

import math

import numpy as np
import pytest

from gantrysim.compare.vertices import Vertices, noise_of, starts, vertices


@pytest.mark.parametrize("curve", ["line", "circle"])
def test_vertices_lie_on_the_trace_a_chord_apart_whatever_its_samples(curve):
    generator = np.random.default_rng(1)
    time = np.cumsum(generator.uniform(0.0, 0.02, 3000))
    # samples that stand still, and some that jump over several chords
    time[500:600] = time[500]
    angle = time / time[-1] * 2.0
    points = 20 * np.column_stack([np.cos(angle), np.sin(angle)])
    if curve == "line":
        points = np.column_stack([30 * angle, 10 * angle])
    points = np.delete(points, np.s_[1000:1100], axis=0)
    found = vertices(points, 0.3)
    assert np.linalg.norm(np.diff(found.points, axis=0), axis=1) == pytest.approx(0.3, rel=1e-9)
    rows = np.arange(len(points))
    on_trace = np.column_stack([np.interp(found.row, rows, points[:, k]) for k in range(2)])
    np.testing.assert_allclose(found.points, on_trace, atol=1e-9)
    assert found.row[0] == 0
    # all of the way but less than a chord
    assert np.linalg.norm(points[-1] - found.points[-1]) < 0.3


def walk(angles):
    """Vertices of steps of 1 mm in directions."""
    steps = np.column_stack([np.cos(angles), np.sin(angles)])
    points = np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
    return Vertices(np.arange(len(points), dtype=float), points)


def random_angles(count, seed=2):
    return np.random.default_rng(seed).uniform(-math.pi, math.pi, count)


@pytest.mark.parametrize("turn", [0.0, 0.7, -2.5])
def test_a_part_begins_at_its_vertex_of_the_run_with_its_turn(turn):
    angles = random_angles(200)
    part = walk(angles[30:90] + turn)
    place, found = starts(part, walk(angles), turning=True)[0]
    assert place == 30
    assert found == pytest.approx(turn, abs=1e-6)
    if not turn:
        assert starts(part, walk(angles), turning=False)[0] == (30, 0.0)


def test_a_trace_that_begins_before_the_run_has_a_negative_number():
    angles = random_angles(200)
    assert starts(walk(angles), walk(angles[40:120]), turning=False)[0] == (-40, 0.0)


@pytest.mark.parametrize(("off", "is_tried"), [(0.0, True), (0.25, True), (0.4, False)])
def test_another_place_is_tried_where_its_difference_is_within_a_tenth_of_the_trace_s_squares(off, is_tried):
    """Directions that are off by an angle a differ by 2 (1 - cos a) of their squares: a tenth at 0.32 rad."""
    pattern = random_angles(60)
    run = np.concatenate([random_angles(50, 3), pattern, random_angles(50, 4), pattern + off, random_angles(50, 5)])
    places = [place for place, _ in starts(walk(pattern), walk(run), turning=False)]
    if off:
        assert places[0] == 50
    assert sorted(places) == ([50, 160] if is_tried else [50])


def test_noise_of_few_samples_is_not_known_and_that_of_all_columns_is_their_mean_square():
    assert noise_of(np.zeros((4, 2))) == 0
    noisy = np.random.default_rng(5).standard_normal((20000, 2)) * [1e-3, 3e-3]
    assert noise_of(noisy) == pytest.approx(math.sqrt(5) * 1e-3, rel=0.03)
    assert noise_of(np.random.default_rng(5).standard_normal((5, 1))) > 0
