"""A run whose errors contradict the distances of its points says so above its verdict, and blames nothing."""

from dataclasses import replace

import numpy as np
import pytest

from gantrysim import Budget, Job
from gantrysim.base.errors import InputError
from gantrysim.glue.bead.bead import Bead
from gantrysim.job.causes import causes_of
from gantrysim.metrics.analysis import Analysis
from gantrysim.paths.feet import Projection
from gantrysim.report.headline import contour_sentence
from gantrysim.results.verdict import Verdict
from gantrysim.study.cases import Case, measure


@pytest.fixture(scope="module")
def job():
    return Job.load("softmc-arc")


@pytest.fixture(scope="module")
def run(job):
    return job.run()


def spoiled(run, trace, change):
    """A budget with the feet of one trace changed."""
    analysis = Analysis(run)
    for name in ("commanded", "encoder", "motor", "nozzle"):
        getattr(analysis, name)
    analysis.__dict__[trace] = change(getattr(analysis, trace))
    return Budget(analysis)


def lost(foot):
    """The foot of one tick on another leg, half a millimetre further away."""
    columns = {name: np.array(values) for name, values in vars(foot).items()}
    columns["lateral"][300] += 0.5
    columns["distance"][300] += 0.5
    return Projection(**columns)


def nearer(foot):
    return replace(foot, distance=0.2 * foot.distance)


def test_a_right_run_has_none(run):
    assert Budget(run).contradictions == ()


@pytest.mark.parametrize(
    ("trace", "change", "text"),
    [
        ("encoder", lost, "the change of distance by the link servo is 500 µm"),
        ("nozzle", lost, "the change of distance by the link structure is 500 µm"),
        ("nozzle", nearer, "the distance of the nearest point of the path is"),
    ],
)
def test_a_wrong_foot_is_told_and_nothing_blamed(job, run, trace, change, text):
    budget = spoiled(run, trace, change)
    found = budget.contradictions
    assert any(text in line for line in found), found
    verdict = Verdict.of_results(job, budget, Bead(run, job.bead, budget.analysis))
    assert verdict.headline.startswith("! warn: errors not known, because")
    assert not any(row.checks for row in verdict.rows)
    assert str(verdict).splitlines()[0] == f"verdict {verdict.headline}"
    assert verdict.content()["contradiction"] == verdict.contradiction
    assert "not known" in contour_sentence(budget)
    with pytest.raises(InputError, match="neither its errors nor their causes are known"):
        causes_of(job, budget=budget)


def test_a_study_does_not_take_it_as_a_run_that_keeps_its_limits(job, run, monkeypatch):
    monkeypatch.setattr("gantrysim.study.cases.Budget", lambda run: spoiled(run, "encoder", lost))
    row = measure(Case.of(job, {}, value=0.0))
    assert row["status"].startswith("refused: errors not known, because the change of distance by the link servo is")
    assert list(row) == ["status"]
