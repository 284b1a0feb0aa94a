"""How the time of a trace goes against that of a run, of motions that are made up, and in words."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from gantrysim.compare.alignment import Motion, Timing, _plus_minus, _time_words, timing_of
from gantrysim.compare.estimates import Estimate, clustered_intervals
from gantrysim.compare.runs.differences import _flat, _text

NONE = Estimate(0.0, math.inf)


def motion(to_trace, noise=0.0):
    """Samples of a run that speeds up, goes at 50 mm/s and slows down, with the trace's time of each instant."""
    instants = np.linspace(0.0, 10.0, 2001)
    speed = 50.0 * np.clip(np.minimum(instants, 10.0 - instants), 0.0, 1.0)
    acceleration = np.gradient(speed, instants)
    time = to_trace(instants) + noise * np.random.default_rng(1).standard_normal(instants.size)
    still = speed < 1e-6
    dispense = (instants > 2.0) & (instants < 8.0)
    return Motion(time, instants, speed, acceleration, still, dispense)


@pytest.mark.parametrize("late", [0.3, -1.2])
def test_a_trace_that_is_late_has_a_shift_and_no_other_clock(late):
    timing = timing_of(motion(lambda t: t + late, 1e-5), 1e-3)
    assert timing.kind == "shift"
    assert timing.shift.value == pytest.approx(late, abs=1e-5)
    assert timing.clock.value == pytest.approx(0.0, abs=1e-5)
    np.testing.assert_allclose(timing.instants(np.array([5.0 + late])), [5.0], atol=1e-5)


@pytest.mark.parametrize("rate", [5e-4, -8e-4])
def test_a_clock_that_is_fast_has_its_rate_about_the_middle_of_the_motion(rate):
    timing = timing_of(motion(lambda t: (1 + rate) * t + 0.1, 1e-6), 1e-3)
    assert timing.kind == "clock"
    assert timing.clock.value == pytest.approx(rate, rel=5e-3)
    # the motion is symmetrical about 5 s
    assert timing.middle == pytest.approx(5.0, abs=1e-3)
    assert timing.shift.value == pytest.approx(5.0 * rate + 0.1, abs=1e-5)
    # no clock is so wrong: the speeds differ
    assert timing_of(motion(lambda t: (1 + 10 * rate) * t + 0.1, 1e-6), 1e-3).kind == "speed"
    np.testing.assert_allclose(timing.instants((1 + rate) * np.array([1.0, 8.0]) + 0.1), [1.0, 8.0], atol=1e-4)


def test_a_trace_at_another_speed_takes_as_many_times_as_long():
    """With another course in time too, which no clock has: it stands in the middle."""
    timing = timing_of(motion(lambda t: t / 0.8 + 0.5 * (t > 5.0)), 1e-3)
    assert timing.kind == "speed"
    assert timing.speed.value == pytest.approx(0.8, rel=1e-3)


def test_hardly_a_sample_in_motion_tells_nothing_of_time():
    whole = motion(lambda t: t)
    assert timing_of(Motion(*(values[200:203] for values in whole)), 1e-3) is None


@pytest.mark.parametrize(
    ("timing", "words"),
    [
        (
            Timing("shift", Estimate(0.25, 0.001), NONE, 0.0, None, 1.0),
            "s against the run's (± 0.001 s), at equal speeds",
        ),
        (
            Timing("clock", Estimate(0.25, 0.001), Estimate(-1.5e-4, 2e-6), 5.0, None, 1.0),
            "against the run's at its middle, at equal speeds, and its clock runs slow by 150.0 ± 2 ppm",
        ),
        (
            Timing("clock", Estimate(0.25, 0.001), Estimate(1.5e-4, math.inf), 5.0, None, 1.0),
            "and its clock runs fast by 150.0 with no bound by the data",
        ),
        (
            Timing("speed", Estimate(0.25, 0.001), NONE, 5.0, Estimate(0.8, 0.004), 1.27),
            "the speeds differ, the trace takes 1.27 times as long for the same way; where glue flows at a steady "
            "speed, the trace has 0.8000 ± 0.004 of it",
        ),
    ],
)
def test_the_time_of_a_trace_is_told(timing, words):
    text = _time_words(SimpleNamespace(timing=timing, shift=timing.shift.value)).replace("\xa0", " ")
    assert text.endswith(words)


def test_an_interval_has_its_unit_and_two_digits():
    assert _plus_minus(1.234e-3, "µm", 1e3) == "± 1.2 µm"
    assert _plus_minus(0.1234, "µm", 1e3) == "± 120 µm"
    assert _plus_minus(math.inf, "µm", 1e3) == "with no bound by the data"


def test_values_of_as_many_blocks_as_unknowns_have_no_interval():
    residual = np.random.default_rng(1).standard_normal((2, 1))
    assert clustered_intervals(residual, np.random.default_rng(2).standard_normal((2, 1, 2))).tolist() == [math.inf] * 2
    assert clustered_intervals(residual, np.zeros((2, 1, 0))).size == 0


def test_tables_and_lists_of_tables_have_dotted_keys():
    content = {"a": 1, "b": {"c": 2.5, "d": {"e": "x"}}, "f": [{"g": 3}, {"g": 4}], "h": [1.0, 2.0]}
    assert dict(_flat(content)) == {"a": 1, "b.c": 2.5, "b.d.e": "x", "f.0.g": 3, "f.1.g": 4, "h": [1.0, 2.0]}


@pytest.mark.parametrize(
    ("value", "text"),
    [(True, "true"), (False, "false"), (0.1 + 0.2, "0.3"), (3, "3"), ([1.0, True, "x"], "[1, true, x]"), (None, "–")],
)
def test_a_value_of_a_job_is_told_without_rounding(value, text):
    assert _text(value) == text
