"""The search at equal cost: not behind Nelder-Mead from the derived gains, with few margins for each run."""

import runpy
from pathlib import Path

import pytest

from gantrysim.servo.stability.margins import Plant

from support.soaked import suite_runs
from support.tunings import detuned, tuning

RUNS = 24
BEHIND = 1.03  # largest ratio of the metric to Nelder-Mead's
PEAKS = 12  # of |S|, computed for each candidate in the mean
SCAN = 320  # and for the stiffest shape
SCRIPT = Path(__file__).parents[3] / "scripts/compare_tuners.py"


@pytest.fixture(scope="module")
def script():
    return runpy.run_path(str(SCRIPT))


SOFT = {"kp": 0.3, "kd": 2.0}
SKEWED = {"kp": 4.0, "ki": 0.2, "velocity_ff": 0.0}


@pytest.mark.parametrize("factors", suite_runs([SOFT, SKEWED]))
def test_the_search_is_not_behind_nelder_mead_that_is_given_the_derived_gains(script, tmp_path, monkeypatch, factors):
    peaks = []
    sensitivity = Plant.sensitivity
    monkeypatch.setattr(Plant, "sensitivity", lambda *arguments: peaks.append(1) or sensitivity(*arguments))
    study = tuning(detuned(1.0, **factors), law="pid", budget=RUNS, robust=0, unseen=0)
    runs = script["Runs"](tmp_path / "runs.jsonl")
    history = study.history_of(lambda cases: runs(cases, study.metric))
    assert history.runs == RUNS
    assert len(peaks) < SCAN + PEAKS * (RUNS + history.skipped)
    objective = script["Objective"](study, runs, None)
    objective.begin_at_the_better()
    with pytest.raises(script["BudgetSpentError"]):
        script["OTHERS"]["Nelder-Mead"](objective, 1)
    assert objective.made == RUNS
    assert history.best.order(0.02)[0] == 1
    assert history.best.metric <= BEHIND * script["value_at"](objective.trace, RUNS)
