"""The view's clock, keys, texts and chart."""

import itertools
import math
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gantrysim.base.errors import InputError
from gantrysim.record.run_file import Fault
from gantrysim.render.strip import round_step
from gantrysim.render.view.clock import FASTEST_PACE, SLOWEST_PACE, Clock, Pace
from gantrysim.render.view.texts import (
    LIVE_KEYS,
    REPLAY_KEYS,
    Chart,
    ViewState,
    lines,
    moment_texts,
    plain,
    thinned_curve,
)

from support.soaked import examples

CLOCK = 1e-9  # relative, of sums of seconds

times = st.floats(0, 1e4)
speeds = st.floats(1e-2, 1e2)


@given(
    times, speeds, st.lists(st.tuples(st.floats(0.01, 100), st.sampled_from(["toggle", "x2", "x.5", "go"])), max_size=8)
)
def test_clock_is_the_sum_of_speed_times_time(start, speed, events):
    clock, now, expected, runs, end = Clock(speed, 50.0, since=start), start, 0.0, True, 50.0
    for pause, event in events:
        now += pause
        expected = min(expected + speed * pause * runs, end)
        assert clock.at(now) == pytest.approx(expected, rel=CLOCK, abs=CLOCK * (1 + now) * speed)
        if event == "toggle":
            clock, runs = clock.toggled(now), not runs
        elif event == "go":
            clock, expected = clock.moved(expected - 1.0, now), max(expected - 1.0, 0.0)
        else:
            factor = 2.0 if event == "x2" else 0.5
            clock, speed = clock.scaled(factor, now), min(max(speed * factor, SLOWEST_PACE), FASTEST_PACE)
        assert clock.at(now) == pytest.approx(expected, rel=CLOCK, abs=CLOCK * (1 + now) * speed)
        assert clock.is_paused is not runs
        assert clock.speed == speed


def test_clock_stays_at_its_end_and_before_its_start():
    clock = Clock(2.0, 10.0, since=100.0)
    assert clock.at(99.0) == 0.0
    assert clock.at(104.9) == pytest.approx(9.8)
    assert clock.at(106.0) == clock.at(1e6) == 10.0
    assert clock.moved(-5.0, 200.0).at(200.0) == 0.0
    assert clock.moved(99.0, 200.0).at(201.0) == 10.0
    assert clock.moved(4.0, 200.0).at(201.0) == 6.0
    assert clock.toggled(103.0).moved(4.0, 200.0).at(300.0) == 4.0


def test_keys_keep_the_speed_within_its_bounds_or_the_requested_one():
    fast = Clock(5 * FASTEST_PACE, since=0.0)
    assert fast.scaled(2.0, 0.0).speed == 5 * FASTEST_PACE
    assert fast.scaled(0.5, 0.0).speed == 2.5 * FASTEST_PACE
    assert Clock(FASTEST_PACE, since=0.0).scaled(2.0, 0.0).speed == FASTEST_PACE
    assert Clock(SLOWEST_PACE, since=0.0).scaled(0.5, 0.0).speed == SLOWEST_PACE


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ({"speed": 0.0}, "speed = 0: must be greater than 0"),
        ({"speed": math.nan}, "speed = nan: must be finite"),
    ],
)
def test_clock_refuses_a_bad_speed(arguments, text):
    with pytest.raises(InputError, match=rf"^{text}$"):
        Clock(**arguments)


def test_pace_is_what_was_shown_in_the_last_second():
    pace = Pace()
    seen = []
    for k in range(31):
        pace.note(10 + 0.1 * k, 0.05 * k if k < 15 else 0.75 + 0.3 * (k - 15))
        seen.append(pace.factor)
    assert seen[9] is None
    assert seen[10] == pytest.approx(0.5)
    assert seen[14] == pytest.approx(0.5)
    assert 0.5 < seen[20] < 3.0
    assert seen[26] == seen[30] == pytest.approx(3.0)
    pace.reset()
    assert pace.factor is None


def test_keys_are_listed_where_they_do_something():
    replay, live = dict(REPLAY_KEYS), dict(LIVE_KEYS)
    assert "Left, Right" in replay
    assert "Left, Right" not in live
    assert "Ctrl + right drag" in live
    assert "Ctrl + right drag" not in replay
    assert replay["Home, Backspace"] == "go to start"
    assert live["Home, Backspace"] == "restart"


def moment(name, time, until, speed, error, factor, *, live=False, ended=False, paused=False, fault=None, **options):
    """Texts of a source with one tick."""
    source = SimpleNamespace(tick=0, until=until, live=live, over=ended, fault=fault)
    telemetry = SimpleNamespace(time=[time], speed=lambda _: speed, error=[error])
    options = {"pace": None, "push": 0.0, "keys": True} | options
    view = ViewState(Clock(factor, since=None if paused else 0.0), **options)
    return moment_texts(name, source, telemetry, view)


def test_texts_of_a_moment():
    texts = moment("an225", 1.5, 10.4, 99.96, 12.34, 2.0, pace=1.99)
    assert texts.values == (
        ("replay", "an225"),
        ("time", "1.50 of 10.40 s"),
        ("path speed", "100.0 mm/s"),
        ("contour error", "12.3 micron"),
        ("speed", "2 x"),
    )
    assert texts.fault == ()
    assert texts.keys == REPLAY_KEYS
    assert len(moment("a", 0, 1, 0, 0, 1, keys=False).keys) == 1


def test_texts_of_exceptional_states():
    fault = Fault("following error", "y", 2.5, 5.1, 5.0, "mm", "the drives are disabled")
    texts = moment("j", 3, 2, 0, np.nan, 4.0, pace=2.3, live=True, push=40.0)
    values = dict(texts.values)
    assert values["live"] == "j"
    assert values["time"] == "3.00 of 3.00 s"
    assert values["contour error"] == "dispenser off"
    assert values["speed"] == "4 x, actual 2.3 x"
    assert values["push"] == "40 N"
    assert texts.keys == LIVE_KEYS
    ended = moment("j", 3, 2, 0, 0, 4.0, pace=0.0, ended=True, fault=fault)
    assert dict(ended.values)["speed"] == "4 x"
    assert ended.values[-1] == ("", "ended")
    assert [row[0] for row in ended.fault][:2] == ["fault", ""]
    assert " ".join(row[1] for row in ended.fault) == str(fault)
    paused = moment("j", 3, 2, 0, 0, 4.0, pace=0.0, paused=True)
    assert dict(paused.values)["speed"] == "4 x"
    assert paused.values[-1] == ("", "paused")


@given(st.text())
def test_texts_are_ascii(text):
    assert plain(text).isascii()
    assert plain("3 µm, 2 N·m, 1 mm³") == "3 micron, 2 N m, 1 mm3"


curves = st.integers(0, 2**32 - 1).map(lambda seed: np.random.default_rng(seed).normal(size=5000).cumsum())


@examples(25)
@given(curves, st.integers(2, 1000))
def test_thinned_curve_keeps_points_order_and_every_peak(value, points):
    time = np.arange(len(value)) * 1e-3
    t, v = thinned_curve(time, value, points)
    assert len(t) <= points
    assert (np.diff(t) > 0).all()
    assert np.array_equal(v, value[np.searchsorted(time, t)])
    assert v.max() == value.max()
    assert v.min() == value.min()
    bins = points // 2
    for begin, end in itertools.pairwise([k * 5000 // bins for k in range(bins + 1)]):
        inside = v[(t >= time[begin]) & (t <= time[end - 1])]
        assert inside.max() == value[begin:end].max()
        assert inside.min() == value[begin:end].min()


def test_short_curve_is_left_as_it_is():
    t, v = thinned_curve(np.arange(1000.0), np.arange(1000.0), 1000)
    assert len(t) == 1000
    assert np.array_equal(t, v)


def test_curve_with_gaps_is_drawn_as_lines():
    time, value = np.arange(10000) * 1e-3, np.sin(np.arange(10000.0))
    value[:100], value[4000:6000] = np.nan, np.nan
    drawn = lines(time, value, 1000)
    assert len(drawn) == 2
    assert sum(len(t) for t, _ in drawn) <= 1000
    assert drawn[0][0][0] >= 0.1
    assert drawn[0][0][-1] < 4.0
    assert drawn[1][0][0] >= 6.0
    assert max(v.max() for _, v in drawn) == np.nanmax(value)
    assert lines(time, np.full(10000, np.nan)) == []
    value[::50] = np.nan
    (whole,) = lines(time, value, 1000, most=99)
    assert len(whole[0]) <= 1000
    assert whole[1].max() == np.nanmax(value)


@given(st.floats(1e-6, 1e6))
def test_round_step_is_the_next_of_one_two_five(value):
    top = round_step(value)
    digit = top / 10 ** math.floor(math.log10(top) + 1e-9)
    assert value <= top * (1 + 1e-9)
    assert top < 2.5 * value * (1 + 1e-9)
    assert round(digit, 6) in (1, 2, 5)


def test_chart_holds_the_curve_and_the_present():
    chart, time = Chart(), np.arange(3000) * 1e-3
    error = np.where(time < 0.5, np.nan, 30 * time)
    chart.draw(time, error, until=10.4)
    figure = chart.figure
    n = figure.linepnt[0]
    assert 900 < n <= mujoco.mjMAXLINEPNT
    assert figure.linepnt[2:].sum() == 0
    assert figure.linedata[0, : 2 * n : 2][[0, -1]] == pytest.approx([0.5, 2.999])
    assert figure.linedata[0, 1 : 2 * n : 2] == pytest.approx(30 * figure.linedata[0, : 2 * n : 2], rel=1e-5)
    assert figure.linepnt[1] == 2
    assert figure.linedata[1, :4] == pytest.approx([2.999, 0, 2.999, 100])
    assert figure.range.tolist() == [[0, 12], [0, 100]]
    assert figure.gridsize[0] == 7
    chart.draw(time, 1e-9 * error, until=2.999)
    assert figure.range.tolist() == [[0, 3], [0, 1]]
    chart.draw(time[:2], error[:2], until=0.0)
    assert figure.linepnt[0] == 2
    assert figure.linepnt[1:].sum() == 0
    assert figure.range[1].tolist() == [0, 1]
