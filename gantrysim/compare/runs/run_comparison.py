"""`compare_runs`: which of several runs is better, by how much, and what differs between their jobs."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from gantrysim.base.errors import InputError
from gantrysim.compare.runs.compared_run import FEWEST, MOST, ComparedRun, names_of_jobs
from gantrysim.compare.runs.compared_runs import ComparedRuns
from gantrysim.compare.runs.runs_page import write_runs
from gantrysim.record.run import Run
from gantrysim.report.saved import SavedRun
from gantrysim.results.run_results import RunResults


class RunComparison(ComparedRuns):
    """Runs beside one another, and the report on them."""

    def report(self, folder: str | os.PathLike[str]) -> Path:
        """Write report.html and compare.json into a folder; return the path of report.html.

        Raises:
            InputError: the folder cannot be written.
        """
        return write_runs(self, Path(folder))


def compare_runs(*runs: Run | SavedRun | RunResults, names: Sequence[str] | None = None) -> RunComparison:
    """Compare runs: which has the better verdict, by how much, and how their jobs differ.

    Changes are relative to the first run. Runs of different machines can be compared, because errors and bead are in
    the work frame; values of an axis that one of the machines lacks are omitted.

    Args:
        runs: two to four, each with its job: from `Job.run` or `SavedRun.load`.
        names: names of the runs; by default those of their jobs.

    Raises:
        InputError: too few or too many runs, a run without its job, or one whose dispenser is never on.
    """
    check_number(len(runs))
    if names is not None and len(names) != len(runs):
        raise InputError(f"compare: {len(names)} names of {len(runs)} runs: must be as many")
    given = names_of_jobs([_job_name(run) for run in runs]) if names is None else list(names)
    return RunComparison(tuple(ComparedRun.of(run, name) for run, name in zip(runs, given, strict=True)))


def check_number(runs: int) -> None:
    """Raise InputError unless so many runs can be compared."""
    if runs < FEWEST:
        raise InputError(f"compare: {runs} run: name another to compare it with, or a log with --measured FILE")
    if runs > MOST:
        raise InputError(f"compare: {runs} runs: must be {FEWEST} to {MOST}, as more lines cannot be told apart")


def _job_name(run: Run | SavedRun | RunResults) -> str:
    job = getattr(run, "job", None)
    return "run" if job is None else str(job.name)
