"""A run as a comparison shows it: its name, its results, and what its causes are worth."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gantrysim.base.errors import InputError, expanded_path
from gantrysim.base.input_files import read_text
from gantrysim.glue.bead import Bead
from gantrysim.metrics.analysis import Analysis
from gantrysim.metrics.budget import Budget
from gantrysim.metrics.parts import ERROR_SIZES
from gantrysim.record.run import Run, check_run
from gantrysim.report.folder import SUMMARY, SavedRun
from gantrysim.results.run_results import RunResults

FEWEST_RUNS = 2
MOST_RUNS = 4  # of runs: more lines over one another cannot be told apart
RUN_DASHES: tuple[list[int], ...] = ([7, 3], [], [2, 3], [12, 3, 2, 3])  # lengths of dashes and gaps [pixels]

_RMS = ERROR_SIZES[0]
_SUMMARY_SIZE = 1 << 24  # summary, ten times that of a spiral of a thousand turns [bytes]


@dataclass(frozen=True, eq=False)
class ComparedRun:
    """A run that is compared.

    Attributes:
        name: as the comparison calls it.
        results: of the run, its job and machine.
        causes: what each cause of error is worth of the rms contour error, by name; None where they are not known [mm].
        changed: whether the physics of the machine have changed since the run.
    """

    name: str
    results: RunResults
    causes: Mapping[str, float] | None = None
    changed: bool = False

    @property
    def analysis(self) -> Analysis:
        """Analysis of the run."""
        return self.results.budget.analysis

    @property
    def run(self) -> Run:
        """Record of the run."""
        return self.analysis.run

    @classmethod
    def of(cls, given: Run | SavedRun | RunResults, name: str) -> ComparedRun:
        """Return a run to be compared.

        Args:
            given: a run with its job, a saved run, or results.
            name: of the run.

        Raises:
            InputError: a run without its job, or one whose dispenser is never on.
        """
        if isinstance(given, RunResults):
            causes = given.causes
            effects = () if causes is None else causes.effects
            worth = {effect.cause.name: effect.worth["contour"].rms for effect in effects if effect.worth}
            return cls(name, given, worth or None)
        if isinstance(given, SavedRun):
            results = _results(given.run, name)
            return cls(name, results, _saved_causes(expanded_path(given.folder) / SUMMARY), given.changed)
        check_run(given)
        return cls(name, _results(given, name))


def _results(run: Run, name: str) -> RunResults:
    if run.job is None:
        raise InputError(f"run {name}: has no job: write run.replaced(job=job)")
    if not run.dispense.any():
        raise InputError(f"run {name}: its dispenser is never on: there is no bead to compare")
    analysis = Analysis(run)
    job = run.job
    return RunResults(job, job.built_machine, Budget(analysis), Bead(run, job.bead, analysis))


def _saved_causes(file: Path) -> dict[str, float] | None:
    """Return what the causes in a summary are worth of the rms contour error [mm]; None where there are none.

    The file may be a stranger's: what is no number is left out, and so is all of no regular file.
    """
    try:
        content = json.loads(read_text(file, most=_SUMMARY_SIZE))
        causes: dict[str, Any] = content["causes"] or {}
        worth = {name: effect["worth"]["contour"][_RMS.key] for name, effect in causes.items() if effect["worth"]}
    except (OSError, ValueError, LookupError, TypeError, AttributeError, RecursionError):
        return None
    known = {str(name): value / _RMS.factor for name, value in worth.items() if _is_number(value)}
    return known or None


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def names_of_folders(folders: Sequence[Path]) -> list[str]:
    """Return short names of folders: their last parts, as many as tell them apart."""
    whole = [expanded_path(folder).resolve() for folder in folders]
    for count in range(1, max(len(path.parts) for path in whole) + 1):
        names = ["/".join(path.parts[-count:]) for path in whole]
        if len(set(names)) == len(names):
            return names
    return [str(path) for path in whole]


def names_of_jobs(jobs: Sequence[str]) -> list[str]:
    """Return names of runs by those of their jobs, numbered where these are the same."""
    if len(set(jobs)) == len(jobs):
        return list(jobs)
    return [f"{job} ({number})" for number, job in enumerate(jobs, 1)]
