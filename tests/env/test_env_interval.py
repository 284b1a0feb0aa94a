"""Measurements between two decisions, tick by tick, against paths and numbers given by hand."""

import gymnasium
import numpy as np
import pytest

from gantrysim.env import episode_batch
from gantrysim.env.decision import IntervalValues
from gantrysim.env.interval import AXIS_VALUES, MEASURED_SPAN, PATH_VALUES, measure
from gantrysim.machine.row import ROW, Log
from gantrysim.paths.arcs import ArcChain
from gantrysim.paths.spirals import Involute

from support.soaked import suite_runs

CHORD = 1e-4  # [mm], that a chord of 0.05 mm is off a curve of 3 mm radius
AXES = 2
LINE = np.linspace(0, 10.0, 101)  # progress along a line of 10 mm


def log_of(tips, encoder=None, demand=None):
    """A servo's log with the nozzle at these points."""
    log = Log.of(len(tips), AXES)
    log.axis["encoder"] = tips[:, :AXES] if encoder is None else encoder
    log.axis["demand"] = 0.0 if demand is None else demand
    log.tick["nozzle"] = tips
    log.tick["setpoint"] = np.arange(len(tips))
    return log


def row_of(tips, log, ticks):
    """The part of a servo's row that is read, with the addresses of arrays that are to be kept alive: these."""
    setpoints = np.ascontiguousarray(tips[:, :AXES])
    row = np.zeros(1, ROW)
    row["axes"], row["period"], row["tick"] = AXES, 1e-3, ticks
    row["log"], row["axis_log"] = log.tick.ctypes.data, log.axis.ctypes.data
    row["setpoints"] = setpoints.ctypes.data
    return row, setpoints


def span_of(path, progress, on, peak, of_path, of_axes):
    """What is to be measured, with the addresses of arrays that are to be kept alive: these."""
    table = path.table
    arrays = {
        "dispense": np.ascontiguousarray(on, bool),
        "points": table.points,
        "peak": np.array(peak, float),
        "path_values": of_path,
        "axis_values": of_axes,
        "s": table.s,
        "progress": progress,
    }
    span = np.zeros(1, MEASURED_SPAN)
    for name, array in arrays.items():
        span[name] = array.ctypes.data
    span["count"], span["entries"], span["widest"] = len(on), len(table.s), table.widest
    return span, arrays


def measured(path, tips, progress, dispense=None, log=None, cuts=(), peak=(1.0, 1.0)):
    """The values of one interval after the other, the totals after each, and the last foot."""
    log = log_of(tips) if log is None else log
    on = np.ones(len(tips), bool) if dispense is None else dispense
    of_path = np.zeros(1, PATH_VALUES)
    of_axes = np.zeros((1, AXES), AXIS_VALUES)
    span, _kept = span_of(path, np.array(progress, float), on, peak, of_path, of_axes)
    values = []
    totals = []
    for last in (*cuts, len(tips)):
        row, _setpoints = row_of(tips, log, last)
        before = span["before"].copy()
        for _ in range(2):  # as an interval is measured again where its steps are taken back
            of_path[:] = 7.0
            of_axes[:] = 7.0
            measure(row.ctypes.data, span.ctypes.data)
        assert span["before"] == before
        assert span["after"]["tick"] == last
        span["before"] = span["after"]
        values.append((of_path.copy(), of_axes.copy()))
        totals.append(span["after"].copy())
    seen = IntervalValues.of(*map(np.concatenate, zip(*values, strict=True)))
    return seen, np.concatenate(totals), int(span["after"]["foot"][0])


def test_a_trace_nearer_to_the_next_turn_stays_on_its_own():
    path = Involute(40.0, 8.0, 3, start=(0.0, 0.0))
    s = np.linspace(0, path.length, 6001)
    off = 0.7 * 8.0  # to the outside, where the turn before lies nearer; the first turn has none
    tips = path.position(s) + off * path.normal(s)
    seen, _, foot = measured(path, tips, s, cuts=(2000, 4000))
    assert np.allclose(seen.contour_rms, off, atol=1e-3)
    assert np.allclose(seen.contour_max, off, atol=CHORD)
    assert np.allclose(seen.lateral, off, atol=1e-3)
    assert foot == pytest.approx(len(path.table.s) - 1, abs=3)


def test_a_trace_begins_at_the_start_of_a_closed_path():
    circle = ArcChain((10.0, 0.0), 0.5 * np.pi, [0.1], [2 * np.pi * 10.0])
    s = np.linspace(0, 20.0, 201)
    tips = circle.position(s) - 0.02 * circle.tangent(s[:1])  # a little behind: the end of the path is nearer
    *_, foot = measured(circle, tips, s)
    assert circle.table.s[foot] == pytest.approx(20.0, abs=0.1)


def test_with_the_dispenser_off_following_errors_count_and_contour_errors_do_not():
    line = ArcChain((0.0, 0.0), 0.0, [0.0], [10.0])
    tips = line.position(np.linspace(0, 10.0, 101)) + np.array([0.0, 0.3, 0.0])
    on = np.zeros(101, bool)
    on[50:] = True
    log = log_of(tips, encoder=tips[:, :AXES] - [0.1, -0.2])
    seen, totals, _ = measured(line, tips, LINE, on, log=log, cuts=(50, 60))
    assert totals["laid"].tolist() == [0, 10, 51]
    assert totals["square"] == pytest.approx(0.3**2 * totals["laid"])
    assert totals["largest"] == pytest.approx([0.0, 0.3, 0.3])
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
    seen, *_ = measured(line, tips, LINE, on)
    assert seen.lateral == pytest.approx([-0.3])
    assert seen.contour_rms == pytest.approx([0.3])


def test_the_tick_of_a_divergence_counts_for_nothing():
    line = ArcChain((0.0, 0.0), 0.0, [0.0], [10.0])
    tips = line.position(np.linspace(0, 10.0, 101)) + np.array([0.0, 0.3, 0.0])
    whole, totals, _ = measured(line, tips[:100], LINE[:100])
    tips[100] = np.nan
    seen, after, _ = measured(line, tips, LINE)
    assert all(np.isfinite(values).all() for values in seen)
    assert all(map(np.array_equal, seen, whole))
    for name in ("laid", "square", "largest"):
        assert np.array_equal(after[name], totals[name])


def test_torque_use_and_ripple_of_given_demands():
    line = ArcChain((0.0, 0.0), 0.0, [0.0], [10.0])
    tips = line.position(np.linspace(0, 10.0, 101))
    demand = np.stack([0.1 * (-1.0) ** np.arange(101), np.linspace(0, -0.5, 101)], axis=1)
    seen, *_ = measured(line, tips, LINE, log=log_of(tips, demand=demand), cuts=(40,), peak=(1.0, 2.0))
    assert seen.torque == pytest.approx(np.array([[0.1, 0.0975], [0.1, 0.25]]))
    # the very first tick has no change before it, and counts for none
    assert seen.ripple[:, 0] == pytest.approx(np.sqrt(0.5) * 0.2)
    assert seen.ripple[:, 1] == pytest.approx(np.sqrt(0.5) * 0.005 / 2)


def test_speed_heading_and_turning_are_those_of_an_arc():
    arc = ArcChain((0.0, 0.0), 0.25 * np.pi, [-0.05], [15.0])
    s = np.linspace(0, 15.0, 151)
    seen, *_ = measured(arc, arc.position(s), s, cuts=(76,))
    assert seen.curvature == pytest.approx([-0.05, -0.05], rel=1e-3)
    assert seen.heading == pytest.approx(0.25 * np.pi - 0.05 * np.array([7.5, 14.8]), abs=2e-3)
    assert seen.speed == pytest.approx([75 / 76 * 100, 100.0], rel=1e-4)


def test_before_the_first_interval_nothing_is_measured():
    arc = ArcChain((0.0, 0.0), 0.0, [0.1], [15.0])
    s = np.linspace(0, 15, 151)
    seen, totals, foot = measured(arc, arc.position(s), s, cuts=(0,))
    assert foot > 0
    assert all(np.all(v[0] == 0) for v in (seen.contour_rms, seen.following_rms, seen.ripple, seen.speed))
    assert [totals[name][0] for name in ("laid", "square", "largest")] == [0, 0, 0]
    assert seen.curvature[0] == pytest.approx(0.1, rel=1e-3)  # but where the path begins is known


@pytest.mark.parametrize("name", suite_runs(["GainBandit-v0", "SpiralTuning-v0"], 0))
@pytest.mark.parametrize("last_action", [0.3, 1.0], ids=["to the end", "faults"])
def test_the_steps_measure_what_a_look_at_the_log_afterwards_does(name, last_action, monkeypatch):
    looks = []

    def look(*addresses):
        looks.append(addresses)
        measure(*addresses)

    def outcomes(is_observed):
        envs = gymnasium.make_vec(f"gantrysim/{name}", num_envs=4, decision_interval=0.05)
        envs.reset(seed=3)
        looks.clear()
        if not is_observed:
            monkeypatch.setattr(envs.unwrapped._episodes, "_observer_step", np.zeros(4, np.int64))
        actions = [0.1, 0.2, 0.3, *[last_action] * 5]
        yield from (envs.step(np.full((4, 4), action, np.float32)) for action in actions)
        envs.close()

    monkeypatch.setattr(episode_batch, "measure", look)
    by_steps = list(outcomes(True))
    over = sum(np.count_nonzero(terminated | truncated) for _, _, terminated, truncated, _ in by_steps[:-1])
    assert len(looks) == over  # at the start of the next episodes alone
    by_looks = list(outcomes(False))
    assert len(looks) == 4 * len(by_looks)
    for (seen, *outcome, infos), (seen_after, *outcome_after, infos_after) in zip(by_steps, by_looks, strict=True):
        assert np.array_equal(seen, seen_after)
        assert all(map(np.array_equal, outcome, outcome_after))
        assert infos.keys() == infos_after.keys()
        assert all(np.array_equal(values, infos_after[key]) for key, values in infos.items())
