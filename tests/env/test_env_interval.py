"""Measurements between two decisions, tick by tick, against paths and numbers given by hand."""

import numpy as np
import pytest

from gantrysim.env.interval import PER_AXIS, SHARED, SPAN, TOTAL, measure
from gantrysim.env.observation import IntervalValues
from gantrysim.native.row import Log
from gantrysim.paths.arcs import ArcChain
from gantrysim.paths.spirals import Involute

CHORD = 1e-4  # [mm], that a chord of 0.05 mm is off a curve of 3 mm radius
AXES = 2


def log_of(tips, encoder=None, demand=None):
    """A servo's log with the nozzle at these points."""
    log = Log.of(len(tips), AXES)
    log.axis["encoder"] = tips[:, :AXES] if encoder is None else encoder
    log.axis["demand"] = 0.0 if demand is None else demand
    log.tick["nozzle"] = tips
    log.tick["setpoint"] = np.arange(len(tips))
    return log


def span_of(path, tips, on, log, foot=-1):
    """What is to be measured, with the addresses of arrays that are to be kept alive: these."""
    s, points = path.table
    arrays = np.ascontiguousarray(tips[:, :AXES]), np.ascontiguousarray(on, bool), np.asfortranarray(points)
    span = np.zeros(1, SPAN)
    span["log"], span["axis_log"] = log.tick.ctypes.data, log.axis.ctypes.data
    span["setpoints"], span["dispense"], span["points"] = (array.ctypes.data for array in arrays)
    span["count"], span["entries"], span["spacing"], span["foot"] = len(tips), len(points), s[1], foot
    return span, arrays


def empty_rows(places):
    """Rows to be written, of which nothing may stay."""
    return np.full((places, len(SHARED) + AXES * len(PER_AXIS)), 7.0)


def measured(path, tips, dispense=None, foot=-1, log=None, cuts=(), peak=(1.0, 1.0)):
    """The values of one interval after the other, the totals after each, and the last foot."""
    log = log_of(tips) if log is None else log
    on = np.ones(len(tips), bool) if dispense is None else dispense
    span, _kept = span_of(path, tips, on, log, foot)
    rows, totals, total = [], [], np.zeros((1, TOTAL))
    for first, last in zip((0, *cuts), (*cuts, len(tips)), strict=True):
        row = empty_rows(1)
        span["first"], span["last"] = first, last
        measure(span, np.array([0]), 1e-3, np.array(peak), row, total)
        rows.append(row[0])
        totals.append(total[0].copy())
    return IntervalValues.of(np.array(rows)), np.array(totals), int(span["foot"][0])


def test_a_trace_nearer_to_the_next_turn_stays_on_its_own():
    path = Involute(40.0, 8.0, 3, start=(0.0, 0.0))
    s = np.linspace(0, path.length, 6001)
    off = 0.7 * 8.0  # to the outside, where the turn before lies nearer; the first turn has none
    tips = path.position(s) + off * path.normal(s)
    seen, _, foot = measured(path, tips, cuts=(2000, 4000))
    assert np.allclose(seen.contour_rms, off, atol=1e-3)
    assert np.allclose(seen.contour_max, off, atol=CHORD)
    assert np.allclose(seen.lateral, off, atol=1e-3)
    assert foot == pytest.approx(len(path.table[0]) - 1, abs=3)


def test_a_trace_begins_at_the_start_of_a_closed_path():
    circle = ArcChain((10.0, 0.0), 0.5 * np.pi, [0.1], [2 * np.pi * 10.0])
    s = np.linspace(0, 20.0, 201)
    tips = circle.position(s) - 0.02 * circle.tangent(s[:1])  # a little behind: the end of the path is nearer
    *_, foot = measured(circle, tips)
    assert foot * circle.table[0][1] == pytest.approx(20.0, abs=0.1)


def test_with_the_dispenser_off_following_errors_count_and_contour_errors_do_not():
    line = ArcChain((0.0, 0.0), 0.0, [0.0], [10.0])
    tips = line.position(np.linspace(0, 10.0, 101)) + np.array([0.0, 0.3, 0.0])
    on = np.zeros(101, bool)
    on[50:] = True
    log = log_of(tips, encoder=tips[:, :AXES] - [0.1, -0.2])
    seen, totals, _ = measured(line, tips, on, log=log, cuts=(50, 60))
    assert totals[:, 0].tolist() == [0, 10, 51]
    assert totals[:, 1] == pytest.approx(0.3**2 * totals[:, 0])
    assert totals[:, 2] == pytest.approx([0.0, 0.3, 0.3])
    assert seen.contour_rms == pytest.approx([0.0, 0.3, 0.3])
    assert seen.contour_max == pytest.approx([0.0, 0.3, 0.3])
    assert seen.lateral == pytest.approx([0.0, 0.3, 0.3])
    assert seen.following_mean == pytest.approx(np.array([[0.1, -0.2]] * 3))
    assert seen.following_rms == pytest.approx(np.array([[0.1, 0.2]] * 3))
    assert seen.following_max == pytest.approx(np.array([[0.1, 0.2]] * 3))


def test_the_mean_contour_error_is_taken_with_the_dispenser_on():
    line = ArcChain((0.0, 0.0), 0.0, [0.0], [10.0])
    tips = line.position(np.linspace(0, 10.0, 101)) + np.array([0.0, -0.3, 0.0])
    on = np.arange(101) >= 75
    seen, *_ = measured(line, tips, on)
    assert seen.lateral == pytest.approx([-0.3])
    assert seen.contour_rms == pytest.approx([0.3])


def test_the_tick_of_a_divergence_counts_for_nothing():
    line = ArcChain((0.0, 0.0), 0.0, [0.0], [10.0])
    tips = line.position(np.linspace(0, 10.0, 101)) + np.array([0.0, 0.3, 0.0])
    whole, totals, _ = measured(line, tips[:100])
    tips[100] = np.nan
    seen, after, _ = measured(line, tips)
    assert all(np.isfinite(values).all() for values in seen)
    assert all(map(np.array_equal, seen, whole))
    assert np.array_equal(after, totals)


def test_torque_use_and_ripple_of_given_demands():
    line = ArcChain((0.0, 0.0), 0.0, [0.0], [10.0])
    tips = line.position(np.linspace(0, 10.0, 101))
    demand = np.stack([0.1 * (-1.0) ** np.arange(101), np.linspace(0, -0.5, 101)], axis=1)
    seen, *_ = measured(line, tips, log=log_of(tips, demand=demand), cuts=(40,), peak=(1.0, 2.0))
    assert seen.torque == pytest.approx(np.array([[0.1, 0.0975], [0.1, 0.25]]))
    # the very first tick has no change before it, and counts for none
    assert seen.ripple[:, 0] == pytest.approx(np.sqrt(0.5) * 0.2)
    assert seen.ripple[:, 1] == pytest.approx(np.sqrt(0.5) * 0.005 / 2)


def test_speed_heading_and_turning_are_those_of_an_arc():
    arc = ArcChain((0.0, 0.0), 0.25 * np.pi, [-0.05], [15.0])
    s = np.linspace(0, 15.0, 151)
    seen, *_ = measured(arc, arc.position(s), cuts=(76,))
    assert seen.curvature == pytest.approx([-0.05, -0.05], rel=1e-3)
    assert seen.heading == pytest.approx(0.25 * np.pi - 0.05 * np.array([7.5, 14.6]), abs=2e-3)
    assert seen.speed == pytest.approx([75 / 76 * 100, 100.0], rel=1e-4)


def test_before_the_first_interval_nothing_is_measured():
    arc = ArcChain((0.0, 0.0), 0.0, [0.1], [15.0])
    seen, totals, foot = measured(arc, arc.position(np.linspace(0, 15, 151)), cuts=(0,))
    assert foot > 0
    assert all(np.all(v[0] == 0) for v in (seen.contour_rms, seen.following_rms, seen.ripple, seen.speed, totals))
    assert seen.curvature[0] == pytest.approx(0.1, rel=1e-3)  # but where the path begins is known


def test_only_the_places_that_are_asked_for_are_measured():
    line = ArcChain((0.0, 0.0), 0.0, [0.0], [10.0])
    kept, spans = [], np.zeros(3, SPAN)
    for place, off in enumerate((0.1, 0.2, 0.3)):
        tips = line.position(np.linspace(0, 10.0, 101)) + np.array([0.0, off, 0.0])
        log = log_of(tips)
        span, arrays = span_of(line, tips, np.ones(101), log)
        spans[place] = span[0]
        kept.append((log, arrays))
    spans["first"], spans["last"] = 0, 101
    rows, totals = empty_rows(3), np.zeros((3, TOTAL))
    measure(spans, np.array([2, 0]), 1e-3, np.ones(AXES), rows, totals)
    assert np.all(rows[1] == 7.0)
    assert spans["foot"][1] == -1
    assert IntervalValues.of(rows).contour_max[[0, 2]] == pytest.approx([0.1, 0.3])
    assert totals[:, 0].tolist() == [101, 0, 101]
    assert spans["foot"][[0, 2]].tolist() == [len(line.table[0]) - 1] * 2
