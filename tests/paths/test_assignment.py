"""The progress that is assigned to a trace whose controller states none, against all possible ones."""

import itertools

import numpy as np
import pytest

from gantrysim import Budget, Machine, Servo, simulate
from gantrysim.paths import assignment
from gantrysim.paths.assignment import assigned_progress
from gantrysim.paths.chain import Chain
from gantrysim.paths.pieces import Line
from gantrysim.record.setpoints import Setpoints


def polygon(*points):
    return Chain([Line((*start, 0.0), (*end, 0.0)) for start, end in itertools.pairwise(points)])


def test_no_progress_has_a_smaller_sum_of_squares(monkeypatch):
    monkeypatch.setattr(assignment, "_FINEST", 1.0)
    rng = np.random.default_rng(5)
    for _ in range(20):
        path = polygon(*np.cumsum(rng.uniform(-2, 2, (4, 2)), axis=0))
        count = int(np.ceil(path.length)) + 1
        s = np.linspace(0, path.length, count)
        points = path.position(s)
        trace = np.column_stack([rng.uniform(-3, 3, (5, 2)), np.zeros(5)])
        squares = ((trace[:, None] - points) ** 2).sum(axis=2)
        sums = [
            squares[np.arange(5), list(entries)].sum()
            for entries in itertools.combinations_with_replacement(range(count), 5)
        ]
        found = assigned_progress(path, trace)
        assert (np.diff(found) >= 0).all()
        entries = np.round(found / s[1]).astype(int)
        assert squares[np.arange(5), entries].sum() == pytest.approx(min(sums))


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
    assert first.analysis.progress_is_stated
    assert not second.analysis.progress_is_stated
    assert second.values.contour.rms == pytest.approx(first.values.contour.rms, rel=1e-3)
    assert second.values.contour.max == pytest.approx(first.values.contour.max, rel=1e-3)
