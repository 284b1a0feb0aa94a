"""Runs that a search makes as far as they may still matter: their bounds, and what the search finds with them."""

import math

import numpy as np
import pytest

from gantrysim.metrics.budget import p95_of
from gantrysim.remedy.bench import Bench
from gantrysim.remedy.course import Course, forget_worst
from gantrysim.remedy.outcome import Motion
from gantrysim.results.verdict import begun_path_row

from support.remedies import AREA, LAG, SIDES, lines_job, outcome


def jobs():
    """Jobs of seven motions, from one that passes to one that fails by far, with two kinds of glue each."""
    base = lines_job(SIDES, dispenser={"area": AREA, **LAG})
    largest = 1e3 * float(Motion.of(base).budget.contour_values.max)
    limit = {"tolerance.path_max": 1e-3 * largest, "tolerance.path_p95": 1e-3 * largest}
    return [
        base.changed({"servo.frequency": frequency, "dispenser.advance": advance, **limit})
        for frequency in (25.0, 20.0, 15.0, 10.0, 8.0, 6.0, 5.0)
        for advance in (0.0, 0.02)
    ]


@pytest.mark.parametrize("frequency", [25.0, 10.0, 5.0])
def test_parts_of_a_run_bound_its_burden_from_below(frequency):
    """The bound grows to the burden of the whole, which is that of the rows of a run in one go."""
    job = jobs()[0].changed({"servo.frequency": frequency})
    course = Course()
    # far from it, the last part is left out
    limit = 100.0 if frequency == 25.0 else 0.0
    bounds = []
    while course.motion is None:
        course.advance(job, limit)
        bounds.append(course.burden)
    assert len(bounds) == (3 if limit == 0 else 2)
    assert bounds == sorted(bounds)
    assert bounds[-1] == Motion.of(job).burden
    # the first corner is passed by then
    assert bounds[-2] > 0 or limit > 0


def test_the_contour_error_of_a_begun_run_is_at_least_that_of_any_run_that_goes_on():
    """Whatever the rest adds, neither the largest error nor that of 95 % becomes smaller."""
    rng = np.random.default_rng(7)
    job = jobs()[0]
    tolerance = job.limits(0.8)
    for size in (1, 40, 400):
        begun = rng.exponential(0.02, size)
        row = begun_path_row(begun, 800, tolerance)
        values = {check.name: check.value for check in row.checks}
        assert values["path_max"] == pytest.approx(1e3 * begun.max())
        for rest in (np.zeros(800 - size), rng.exponential(0.05, 800 - size)):
            whole = np.concatenate([begun, rest])
            assert values["path_p95"] <= 1e3 * p95_of(whole) + 1e-12
            assert values["path_max"] <= 1e3 * whole.max() + 1e-12
    assert [check.name for check in begun_path_row(begun, None, tolerance).checks] == ["path_max"]


@pytest.mark.parametrize("workers", [1, 3])
def test_what_is_within_a_limit_is_found_and_the_rest_is_worse(workers):
    every = jobs()
    burdens = [outcome(job).burden for job in every]
    middle = sorted(burdens)[5]
    bench = Bench(every[0], workers=workers)
    found = bench.promising(every, lambda known: middle)
    for burden, shown in zip(burdens, found, strict=True):
        assert shown is None or shown.burden == burden
        assert (shown is not None) or burden > middle
    assert sum(shown is None for shown in found) >= 5
    # the least one, whatever is known first
    least = bench.promising(every, lambda known: min((other.burden for other in known), default=math.inf))
    assert min(shown.burden for shown in least if shown is not None) == min(burdens)


def test_a_limit_that_falls_ends_runs_before_their_end():
    """Of 14 jobs the best is found with fewer verdicts than jobs, and fewer complete runs than motions."""
    bench = Bench(jobs()[0], workers=1)
    found = bench.promising(jobs(), lambda known: min((other.burden for other in known), default=1e6))
    assert 1 <= sum(shown is not None for shown in found) <= 4


def test_a_bound_is_kept_and_a_job_asked_for_again_is_simulated_to_its_end():
    every = jobs()
    bench = Bench(every[0], workers=1)
    assert bench.promising(every[-1:], lambda known: 0.0) == [None]
    assert bench.measure_all(every[-1:]) == [outcome(every[-1])]


def test_the_courses_with_the_largest_burden_are_forgotten_where_there_is_no_room():
    job = jobs()[0]
    courses = [Course(burden=burden) for burden in (3.0, 1.0, 2.0)]
    for course in courses:
        course.advance(job, 0.0)
    ticks = courses[0].ticks
    forget_worst([*courses, courses[0]], 2 * ticks)
    assert [course.ticks for course in courses] == [0, ticks, ticks]
    assert [course.burden for course in courses] == [3.0, 1.0, 2.0]
    forget_worst(courses, 0)
    assert [course.ticks for course in courses] == [0, ticks, 0]
