"""Forecasts of a burden against simulated ones, and the search with them against the search without."""

from functools import cache
from itertools import product
from random import Random
from types import SimpleNamespace

import numpy as np
import pytest

from gantrysim import Job
from gantrysim.base.errors import GantryError
from gantrysim.job.causes import causes_of
from gantrysim.job.loading import builtin_jobs
from gantrysim.metrics.analysis import Analysis
from gantrysim.remedy.bench import Bench
from gantrysim.remedy.combination import Pick
from gantrysim.remedy.deviation import PARTS, Deviation
from gantrysim.remedy.forecast import Forecast, ProgramError
from gantrysim.remedy.improve import improve
from gantrysim.remedy.lever import ROWS
from gantrysim.remedy.levers import LEVERS
from gantrysim.remedy.outcome import measured
from gantrysim.remedy.search import Search
from gantrysim.results.score import row_burden
from gantrysim.results.verdict import PATH

from support.remedies import rubbing, spiral_job

OF_PROGRAM = ("acceleration", "loop period", "exact waits")
PROGRAMS = ({"program.acceleration": 16e3}, {"program.loop_period": 0.02}, {"program.wait_resolution": 0.0})
TIGHT = {"tolerance.path_max": 2e-3, "tolerance.path_p95": 1e-3}
COMBINATIONS = 12
OTHERS = ({"servo.frequency": 20.0}, {"program.speed": 75.0}, {"servo.frequency": 40.0})


@cache
def spiral():
    """A spiral whose program misses the path by ten times what the machine adds."""
    return spiral_job()


@cache
def bench():
    known = Bench(spiral(), workers=1)
    known.measure_all([spiral(), *(spiral().changed(changes) for changes in (*PROGRAMS, *OTHERS))])
    return known


def combined(*changes):
    """The job with several levers set, and those with each alone."""
    job = spiral().changed({key: value for lever in changes for key, value in lever.items()})
    return job.sharing(spiral()), [spiral().changed(lever).sharing(spiral()) for lever in changes]


def foreseeable(outcome):
    """The part of a burden that is forecast."""
    return sum(row_burden(outcome.verdict[name]) for name in ("path", "stability"))


@pytest.mark.parametrize("changes", list(product(PROGRAMS, OTHERS)))
def test_a_job_has_at_least_the_burden_of_its_forecast(changes):
    job, alone = combined(*changes)
    forecast = Forecast(spiral(), bench()).burden(job, alone)
    outcome = measured(job)
    told = foreseeable(outcome)
    assert 0.8 * told < forecast <= told <= outcome.burden


def test_with_other_glue_the_forecast_is_exact():
    job = spiral().changed({"dispenser.advance": 0.02})
    outcome = measured(job)
    told = foreseeable(outcome)
    assert Forecast(spiral(), bench()).burden(job.sharing(spiral()), []) == pytest.approx(told, rel=1e-12)


def test_nothing_is_forecast_where_a_lever_alone_is_unknown_or_fails():
    forecast = Forecast(spiral(), bench())
    job, alone = combined(PROGRAMS[0], {"program.speed": 90.0})
    assert forecast.burden(job, alone) == 0
    faulty = {"servo.following_error_limit": 1e-4}
    assert bench().measure(spiral().changed(faulty)).failure
    job, alone = combined(PROGRAMS[0], faulty)
    assert forecast.burden(job, alone) == 0


@pytest.mark.parametrize("law", ["pid", ["pid", "zv"]])
def test_the_error_of_a_program_is_that_of_the_command_in_its_run(law):
    job = spiral().changed({"servo.law": law})
    assert np.array_equal(ProgramError.of(job).distance, Analysis(job.run()).commanded.distance)


@pytest.mark.parametrize("waits", [False, True])
def test_a_program_that_waits_for_its_axes_has_no_forecast_of_the_percentile(waits, monkeypatch):
    error = ProgramError(np.ones(100), np.zeros(100, int), 10.0, waits)
    deviation = Deviation(10.0, np.full(PARTS, 0.25))
    forecast = Forecast(spiral(), SimpleNamespace(deviation=lambda job: deviation))
    monkeypatch.setattr(forecast, "_error", lambda job: error)
    least = forecast._least_error(spiral(), [])
    assert (least.max, least.p95) == (0.5, 0.0 if waits else 0.5)


def test_forecasts_are_worthwhile_where_the_program_is_to_blame():
    assert Forecast(spiral(), bench()).is_worthwhile(bench().measure(spiral()))
    circle = rubbing()
    known = Bench(circle, workers=1)
    assert not Forecast(circle, known).is_worthwhile(known.measure(circle))


def test_the_search_finds_the_same_in_fewer_runs(monkeypatch):
    runs = []
    run = Job.run
    monkeypatch.setattr(Job, "run", lambda self: runs.append(self) or run(self))
    job = spiral_job(wait_resolution=0.004)
    causes = causes_of(job)
    forecast = improve(job, levers=OF_PROGRAM, causes=causes, fastest=False, workers=1)
    saved = len(runs)
    monkeypatch.setattr(Forecast, "is_worthwhile", lambda *_: False)
    simulated = improve(job, levers=OF_PROGRAM, causes=causes, fastest=False, workers=1)
    assert str(forecast) == str(simulated)
    assert forecast.rows == simulated.rows
    assert len(forecast.combination) > 2
    assert len(runs) - saved > 1.2 * saved


@pytest.mark.soak
@pytest.mark.parametrize("name", builtin_jobs())
def test_no_forecast_exceeds_what_the_run_of_a_combination_shows(name):
    """Of two or three levers that act on the path, at any of their settings, with a tolerance that no job keeps."""
    job = Job.load(name).changed(TIGHT)
    known = Bench(job)
    search = Search(job, known, ROWS)
    forecast = Forecast(job, known)
    picks = []
    for lever in LEVERS:
        settings = lever.settings(search.start)
        if PATH in lever.rows and not isinstance(settings, str):
            picks += [Pick(lever, setting.label) for setting in settings]
    random = Random(name)
    compared = 0
    while compared < COMBINATIONS:
        combination = random.sample(picks, random.choice([2, 3]))
        try:
            state = search.state_of(combination)
            alone = [search.state_of([pick]) for pick in combination]
        except GantryError:  # two settings of a lever, or such as do not fit
            continue
        if any(other.outcome.failure for other in alone):
            continue
        least = forecast.burden(state.job, [other.job for other in alone])
        if not state.outcome.failure:
            assert least <= foreseeable(state.outcome) + 1e-9
            compared += 1
