"""A measured trace, or the record of a run, beside the simulated runs."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError
from gantrysim.compare.alignment import Alignment
from gantrysim.compare.comparison import Comparison
from gantrysim.compare.measured import Assignment, Trace
from gantrysim.compare.page import alignment_text, headline
from gantrysim.compare.runs.compared_run import ComparedRun
from gantrysim.live.draft import Beside
from gantrysim.record.run import Run
from gantrysim.results.run_results import RunResults
from gantrysim.tables.column_table import ColumnTable
from gantrysim.tables.reading import read_table

_RECORD = ".npz"


class Laid(NamedTuple):
    """What is drawn of a trace and of runs, and what is said.

    Attributes:
        runs: the trace first; none where it does not fit.
        words: name, sentence and notes for the page.
    """

    runs: tuple[ComparedRun, ...]
    words: dict[str, Any]


class Companion:
    """What lies beside the runs, and how it lay the last time."""

    def __init__(self) -> None:
        self._read: tuple[tuple[str, int], Run | ColumnTable] | None = None
        self._latest: tuple[Beside, Floats, Alignment | InputError] | None = None
        self._kept: tuple[Beside, RunResults, ComparedRun] | None = None

    def lay(
        self, given: Beside, results: RunResults, reference: RunResults | None = None, *, anew: bool
    ) -> Laid | None:
        """Return the trace, a former run and a run, each up to the last link that the trace measures.

        Args:
            given: file, and what its columns are.
            results: of the run.
            reference: results of a former run.
            anew: whether the trace is aligned anew, which takes a second; else as with the run before, and nothing is
                returned where that had another command.
        """
        run = results.budget.analysis.run
        known = None if anew else self._known_alignment(given, run)
        if known is None and not anew:
            return None
        try:
            if isinstance(known, InputError):
                raise known
            comparison = self._comparison_with(given, results, known)
            kept_runs = () if reference is None else (self._kept_run(given, reference, comparison.alignment, run),)
        except InputError as error:
            self._latest = (given, np.array(run.commanded), error)
            return Laid((), {"name": given.name, "sentence": str(error), "notes": [], "failed": True})
        self._latest = (given, np.array(run.commanded), comparison.alignment)
        measured = ComparedRun(given.name, RunResults(results.basis, results.machine, comparison.measured))
        words = {
            "name": given.name,
            "sentence": headline(comparison),
            "notes": [alignment_text(comparison), *comparison.notes],
            "failed": False,
        }
        return Laid((measured, *kept_runs, _run("now", comparison, results)), words)

    def _known_alignment(self, given: Beside, run: Run) -> Alignment | InputError | None:
        """Return the alignment with a run of the same command, or why there is none; None where it was not sought."""
        if self._latest is None or self._latest[0] != given:
            return None
        _, commanded, alignment = self._latest
        return alignment if np.array_equal(commanded, run.commanded) else None

    def _kept_run(self, given: Beside, reference: RunResults, alignment: Alignment, run: Run) -> ComparedRun:
        if np.array_equal(reference.budget.analysis.run.commanded, run.commanded):
            return _run("kept", self._comparison_with(given, reference, alignment), reference)
        # of another command: aligned once, as it does not change
        if self._kept is None or self._kept[0] != given or self._kept[1] is not reference:
            self._kept = (given, reference, _run("kept", self._comparison_with(given, reference, None), reference))
        return self._kept[2]

    def _comparison_with(self, given: Beside, results: RunResults, alignment: Alignment | None) -> Comparison:
        run = results.budget.analysis.run
        try:
            return Comparison.of(self._trace(given, run), run, results.machine, alignment=alignment)
        except InputError as error:
            # options of the command are fields of the page
            raise InputError(str(error).replace(given.path, given.name).replace("--columns", "Columns")) from None

    def _trace(self, given: Beside, run: Run) -> Trace:
        file = Path(given.path)
        version = (given.path, given.version)
        if self._read is None or self._read[0] != version:
            self._read = (version, Run.load(file) if file.suffix.lower() == _RECORD else read_table(file))
        log = self._read[1]
        if isinstance(log, Run):
            return Trace.of_run(log, run)
        assignment = Assignment.parse(given.columns) if given.columns else Assignment({})
        return Trace.of(log, replace(assignment, period=given.period), run)


def _run(name: str, comparison: Comparison, results: RunResults) -> ComparedRun:
    return ComparedRun(name, RunResults(results.basis, results.machine, comparison.simulated))
