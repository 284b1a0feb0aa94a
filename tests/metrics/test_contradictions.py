"""A run whose errors contradict the distances of its points says so above its verdict, and blames nothing."""

from dataclasses import replace

import numpy as np
import pytest

from gantrysim import Budget, Job
from gantrysim.base.errors import InputError
from gantrysim.bead.bead import Bead
from gantrysim.job.causes import causes_of
from gantrysim.metrics.analysis import Analysis
from gantrysim.paths.feet import Projection
from gantrysim.report.headline import headline
from gantrysim.results.verdict import Verdict


@pytest.fixture(scope="module")
def job():
    return Job.load("softmc-arc")


@pytest.fixture(scope="module")
def run(job):
    return job.run()


def moved(projection, rows, change):
    columns = {name: np.array(values) for name, values in vars(projection).items()}
    columns["lateral"][rows] += change
    columns["distance"][rows] += change
    return Projection(**columns)


def spoiled(run, trace, change):
    """A budget whose feet of one trace are wrong at a tick."""
    analysis = Analysis(run)
    setattr_ = analysis.__dict__.__setitem__
    for name in ("commanded", "encoder", "motor", "nozzle"):
        setattr_(name, getattr(analysis, name))
    setattr_(trace, moved(getattr(analysis, trace), 300, change))
    return Budget(analysis)


def test_a_right_run_has_none(run):
    assert Budget(run).contradictions == ()


@pytest.mark.parametrize(
    ("trace", "change", "text"),
    [
        ("nozzle", 0.5, "the nozzle's distance from the path is 5"),
        ("nozzle", -0.05, "the distance of the nearest point of the path is"),
    ],
)
def test_a_wrong_foot_is_told_and_nothing_blamed(job, run, trace, change, text):
    budget = spoiled(run, trace, change)
    if change < 0:  # at the worst place, where the whole path is searched
        worst = int(np.argmax(Budget(run).analysis.nozzle.distance))
        budget.analysis.__dict__["nozzle"] = moved(Analysis(run).nozzle, worst, 0.0)
        distance = np.array(budget.analysis.nozzle.distance)
        budget.analysis.__dict__["nozzle"] = replace(budget.analysis.nozzle, distance=0.2 * distance)
    found = budget.contradictions
    assert any(text in line for line in found)
    verdict = Verdict.of_results(job, budget, Bead(run, job.bead, budget.analysis))
    assert verdict.headline.startswith("! warn: errors not known, because")
    assert not any(row.checks for row in verdict.rows)
    assert str(verdict).splitlines()[0] == f"verdict {verdict.headline}"
    assert verdict.content()["contradiction"] == verdict.contradiction
    assert "not known" in headline(budget)
    with pytest.raises(InputError, match="neither its errors nor their causes are known"):
        causes_of(job, budget=budget)
