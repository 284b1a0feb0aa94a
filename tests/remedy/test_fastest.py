"""The fastest program as good as a job, of outcomes that are functions of the speed."""

from types import SimpleNamespace

import pytest

from gantrysim import Verdict
from gantrysim.remedy.fastest import fastest_program
from gantrysim.remedy.outcome import Outcome
from gantrysim.results.checks import Check, Row
from gantrysim.study.speed.study import Grade

from support.remedies import DOTS, lines_job

WIDTH = 0.021  # of the bracket of a speed, relative
PROGRAMMED = 100.0  # [mm/s]


def bench_of(usage, duration=lambda speed: 100.0 / speed, tried=None):
    """A bench whose jobs use a share of a limit, and take a time, by their speed."""

    def measure(job):
        speed = job.controller.programmed_speed
        if tried is not None:
            tried.append(speed)
        check = Check(name="rms", quantity="rms", value=usage(speed), limit=1.0, unit="", source="given")
        return Outcome(Verdict((Row.of("path", [check]),)), duration(speed))

    return SimpleNamespace(
        measure=measure, measure_all=lambda jobs: [measure(job) for job in jobs], task=SimpleNamespace(name="")
    )


def steps(clean, warned, below=0.5):
    """A pass up to a speed, a warning up to another one, and a failure beyond."""
    return lambda speed: below if speed <= clean else (0.9 if speed <= warned else 1.5)


@pytest.fixture(scope="module")
def job():
    return lines_job(DOTS)


def test_a_clean_program_is_made_faster_while_it_stays_clean(job):
    tried = []
    fastest = fastest_program(job, bench_of(steps(183.0, 266.0), tried=tried))
    assert fastest.grade == Grade.CLEAN
    assert 183.0 / (1 + WIDTH) < fastest.speed <= 183.0 < fastest.search.above <= fastest.speed * (1 + WIDTH)
    assert 266.0 / (1 + WIDTH) < fastest.other.fastest <= 266.0
    assert fastest.programmed_speed == pytest.approx(PROGRAMMED)
    assert fastest.job.controller.programmed_speed == pytest.approx(fastest.speed)
    assert fastest.outcome.duration == pytest.approx(100.0 / fastest.speed)
    for speed in (fastest.speed, fastest.search.above):
        assert any(speed == pytest.approx(other) for other in tried)
    assert str(fastest) == (
        f"fastest program without a warning: {fastest.speed:.4g} mm/s instead of 100 mm/s, "
        f"{fastest.outcome.duration:.2f} s (not at {fastest.search.above:.4g} mm/s); without a failure up to "
        f"{fastest.other.fastest:.4g} mm/s"
    )


def test_a_program_with_a_warning_is_made_faster_while_it_does_not_fail(job):
    fastest = fastest_program(job, bench_of(steps(0.0, 222.0)))
    assert fastest.grade == Grade.WARNED
    assert 222.0 / (1 + WIDTH) < fastest.speed <= 222.0 < fastest.search.above
    assert fastest.other.fastest is None
    assert str(fastest).startswith("fastest program without a failure: ")
    assert str(fastest).endswith("; no speed tried is without a warning")
    slow_clean = fastest_program(job, bench_of(steps(52.0, 222.0)))
    assert 52.0 / (1 + WIDTH) < slow_clean.other.fastest <= 52.0
    assert str(slow_clean).endswith(f"; without a warning up to {slow_clean.other.fastest:.4g} mm/s")


def test_beyond_the_speed_at_which_the_time_no_longer_falls_a_program_is_no_faster(job):
    fastest = fastest_program(job, bench_of(steps(900.0, 900.0), lambda speed: max(100.0 / speed, 0.6)))
    assert 100.0 / 0.6 / 1.5 < fastest.speed < 1.5 * 100.0 / 0.6
    assert fastest.outcome.duration == pytest.approx(0.6, rel=0.05)


@pytest.mark.parametrize(
    ("usage", "duration"),
    [
        (steps(0.0, 0.0), lambda speed: 100.0 / speed),  # it fails
        (steps(PROGRAMMED * 1.0001, 101.0), lambda speed: 100.0 / speed),  # nothing faster is as good
        (steps(900.0, 900.0), lambda speed: 1.0 - 5e-6 * speed),  # a faster one is hardly shorter
    ],
)
def test_there_is_none_where_a_job_fails_or_nothing_as_good_is_shorter(job, usage, duration):
    assert fastest_program(job, bench_of(usage, duration)) is None
