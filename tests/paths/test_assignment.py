"""The progress that is assigned to a trace whose controller states none, against all possible ones."""

import itertools

import numpy as np
import pytest

from gantrysim import Budget, Machine, Servo, simulate
from gantrysim.paths.chain import Chain
from gantrysim.paths.feet import assigned_progress
from gantrysim.paths.nearest import find_assignment
from gantrysim.paths.pieces import Line
from gantrysim.record.setpoints import Setpoints

from support.soaked import number_of_examples, suite_runs


def polygon(*points):
    return Chain([Line((*start, 0.0), (*end, 0.0)) for start, end in itertools.pairwise(points)])


def chord_squares(points, trace):
    """Squared distance of every point of a trace from every chord, (n, m)."""
    way = np.diff(points, axis=0)
    from_begin = trace[:, None] - points[:-1]
    share = np.clip((from_begin * way).sum(axis=2) / (way**2).sum(axis=1), 0, 1)
    return ((from_begin - share[:, :, None] * way) ** 2).sum(axis=2)


@pytest.mark.parametrize("bounded", suite_runs([False, True], 0))
def test_no_assignment_has_a_smaller_sum_of_squares(bounded):
    rng = np.random.default_rng(5)
    for _ in range(number_of_examples(40)):
        points = np.column_stack([np.cumsum(rng.uniform(-2, 2, (9, 2)), axis=0), np.zeros(9)])
        trace = np.column_stack([rng.uniform(-3, 3, (5, 2)), np.zeros(5)])
        between = np.sort(np.sort(rng.integers(0, 8, (2, 5)), axis=1), axis=0) if bounded else np.array([[0], [7]])
        between = np.ascontiguousarray(np.broadcast_to(between, (2, 5)))
        squares = chord_squares(points, trace)
        sums = [
            squares[np.arange(5), list(chords)].sum()
            for chords in itertools.combinations_with_replacement(range(8), 5)
            if ((between[0] <= chords) & (chords <= between[1])).all()
        ]
        chords = np.empty(5, np.int64)
        find_assignment(np.asfortranarray(points), trace, between, np.full(8, np.inf), np.empty((5, 8), bool), chords)
        assert (np.diff(chords) >= 0).all()
        assert ((between[0] <= chords) & (chords <= between[1])).all()
        assert squares[np.arange(5), chords].sum() == pytest.approx(min(sums))


def test_a_progress_stays_within_its_bounds():
    path = polygon((0, 0), (30, 0), (0, 0.1))
    s = np.linspace(1, 59, 2000)
    between = np.stack([np.maximum(s - 3, 0), np.minimum(s + 3, path.length)])
    beside = path.position(s) + np.array([0.0, 0.2, 0.0])
    found = assigned_progress(path, beside, between)
    assert ((between[0] <= found) & (found <= between[1])).all()
    assert found == pytest.approx(s, abs=0.3)


def test_a_way_there_and_back_is_told_apart():
    path = polygon((0, 0), (30, 0), (0, 0), (0, 10))
    s = np.linspace(0, path.length, 3000)
    assert assigned_progress(path, path.position(s)) == pytest.approx(s, abs=0.1)


def test_a_long_trace_is_assigned_by_some_of_its_points():
    path = polygon((0, 0), (30, 0), (30, 20))
    s = np.linspace(0, path.length, 40_001)
    assert assigned_progress(path, path.position(s)) == pytest.approx(s, abs=0.1)


def test_setpoints_without_progress_have_the_errors_of_those_with_it(xy: Machine):
    path = polygon((0, 0), (30, 0), (0, 0.5), (30, 1.0))
    stated = Setpoints.along(path, 30.0, 1e-3)
    servo = Servo.derive(xy.axes)
    unstated = Setpoints(1e-3, stated.axes, stated.position, stated.dispense, path)
    first = Budget(simulate(xy, servo, stated))
    second = Budget(simulate(xy, servo, unstated))
    assert first.analysis.run.progress is not None
    assert second.analysis.run.progress is None
    assert second.values.contour.rms == pytest.approx(first.values.contour.rms, rel=1e-3)
    assert second.values.contour.max == pytest.approx(first.values.contour.max, rel=1e-3)
