"""A study of many runs keeps their rows alone: the memory of the process does not grow with their number."""

from dataclasses import replace

import pytest

from gantrysim import Job
from gantrysim.study.cases import Case
from gantrysim.study.ledger import Ledger
from gantrysim.study.runner import run_cases

from support.memories import resident
from support.studies import SHORT

ROW = 20_000  # most that a row of the study may keep, its case, ledger and job's settings included [B]
FIRST = 20  # runs after which all code is loaded


@pytest.mark.soak
@pytest.mark.parametrize("count", [45, pytest.param(10_000, marks=pytest.mark.soak)])
def test_the_rows_are_all_that_is_kept_of_the_runs(count, record_property):
    record_property("attack", "memory: many runs in one study, which must not grow")
    record_property("tries", count)
    job = Job.load("an225", SHORT)
    case = Case.of(job, {"program.loop_period": 0.05})
    held = []

    def note(done, every):
        if done in (FIRST, every):
            held.append(resident())

    cases = [replace(case, overrides=(("program.loop_period", f"{0.05 + 1e-6 * k:.6f}"),)) for k in range(count)]
    with Ledger(None, {}) as ledger:
        rows = run_cases(cases, ledger, workers=1, progress=note)
    assert [row["status"] for row in rows] == ["ok"] * count
    ticks = len(job.setpoints.position)
    assert held[-1] - held[0] < ROW * count + 2 * 1000 * ticks < 1000 * ticks * count  # far less than the runs
