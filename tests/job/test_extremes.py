"""Extreme values of every key of every built-in job: refused in one line, or planned with finite numbers."""

import functools
import tomllib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gantrysim.job.job import Job
from gantrysim.job.loading import builtin_jobs, job_text
from gantrysim.job.overrides import known_keys

from support.extremes import VALUES, attempt
from support.soaked import examples, suite_runs

QUICK = ("an225", "fanuc-spiral", "linuxcnc-flanges", "softmc-helical", "stage-outline", "trio-basic")
loaded = functools.cache(Job.load)


def keys_of(job):
    return known_keys(tomllib.loads(job_text(job)))


@pytest.mark.parametrize("job", suite_runs(QUICK, 0, 3))
@given(data=st.data())
@examples(8)
def test_some_extreme_values(job, data):
    key = data.draw(st.sampled_from(keys_of(job)))
    attempt(job, loaded(job), key, data.draw(st.sampled_from(VALUES)))


FOUND = {
    "speed of a program": ("an225", "program.speed", "1e308"),
    "lag of a dispenser": ("an225", "dispenser.opening", "1e308"),
    "advance": ("an225", "dispenser.advance", "1e300"),
    "yield stress": ("an225", "dispenser.needle.yield_stress", "1e300"),
    "gap": ("an225", "bead.gap", "1e308"),
    "servo period": ("an225", "servo.period", "1e-308"),
    "integral time": ("an225", "servo.integral_time", "1e-308"),
    "an integer of 401 digits": ("trio-basic", "program.buffers", "1" + "0" * 400),
    "blend time": ("fanuc-spiral", "program.blend_time", "1e15"),
    "placement": ("fanuc-spiral", "program.placement.y", "1e308"),
    "jerk": ("softmc-helical", "program.group.jerk", "1e-308"),
    "lift": ("svg-gasket", "program.lift", "1e-15"),
    "cycle": ("linuxcnc-flanges", "program.cycle", "1e300"),
}


@pytest.mark.parametrize(("job", "key", "value"), FOUND.values(), ids=FOUND.keys())
def test_what_once_ended_in_a_traceback_or_in_inf(job, key, value):
    assert attempt(job, loaded(job), key, value) is False


def test_a_fast_rotary_axis_raises_no_warning():
    assert attempt("fanuc-conical", loaded("fanuc-conical"), "program.rotary_velocity", "1e12") is True


def test_a_bound_bites_where_it_says_and_not_before():
    assert attempt("an225", loaded("an225"), "program.interpreter_time", "1e-100") is True
    assert attempt("an225", loaded("an225"), "program.interpreter_time", "9e-101") is False
    assert attempt("an225", loaded("an225"), "dispenser.opening", "4") is True
    assert attempt("an225", loaded("an225"), "dispenser.opening", "4.1") is False


@pytest.mark.soak
@pytest.mark.parametrize("job", builtin_jobs())
def test_every_key_of_every_job(job, record_property):
    tried = planned = 0
    for key in keys_of(job):
        for value in VALUES:
            planned += attempt(job, loaded(job), key, value)
            tried += 1
    assert 0 < planned < tried
    record_property("attack", "job files: every key of every built-in job, set to extreme numbers, texts or lists")
    record_property("tries", tried)
    record_property("refused", tried - planned)
