"""The command `gantrysim show`: what a run has written, without simulating it again."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from gantrysim.base.errors import InputError, expanded_path, unknown
from gantrysim.cli.terminal import fits, is_prose_column, say, show, text_table

if TYPE_CHECKING:
    from gantrysim.results.run_results import RunResults

# of a run, in their order; those that a run does not have are left out of `-v`
ASPECTS = ("verdict", "budget", "figures", "faults", "causes", "glue-causes", "scatter", "notes", "levers")

_PLAIN_COLUMNS = 4  # columns


def show_run(
    run: Annotated[Path, typer.Argument(help="Output folder of gantrysim run.", show_default=False)],
    aspects: Annotated[
        list[str] | None, typer.Argument(metavar="[ASPECT]...", help=f"What to show: {', '.join(ASPECTS)}, or all.")
    ] = None,
) -> None:
    """Print what a run has found, from the files in its folder; nothing is simulated again.

    Without ASPECT the screen that gantrysim run ends with: verdict, cause, and the best change. The error budget is in
    budget, what each cause of error is worth in causes, all values of bead, motion and servo in figures, and every
    change that was simulated in levers.

    Exit status: 0, 2 for bad input.
    """
    from gantrysim.cli.tables import show_cause, show_change, show_choice, show_verdict
    from gantrysim.report.answer import Answer, without_order
    from gantrysim.report.folder import REPORT, SUMMARY, SavedRun

    names = list(ASPECTS) if aspects == ["all"] else list(aspects or ())
    for name in names:
        if name not in ASPECTS:
            raise unknown("aspect of a run", name, (*ASPECTS, "all"))
    saved = SavedRun.load(run)
    file = expanded_path(run) / SUMMARY
    if not file.is_file():
        raise InputError(f"run {run}: {SUMMARY} is missing: run {run / 'job.toml'} again")
    summary = json.loads(file.read_text(encoding="utf-8"))
    # a run that ended before the dispenser was on has no errors, and no sections
    if not saved.run.dispense.any() and "headline" in summary:
        say(f"verdict {summary['verdict']['headline']}", wrap=True)
        say(summary["headline"], wrap=True)
        return
    if "sections" not in summary:
        raise InputError(f"run {run}: written by an earlier version: run {run / 'job.toml'} again")
    results = _results(saved)
    if not names:
        answer = Answer.of(results)
        # what took further runs
        spoilt, also_spoilt = [*summary.get("spoilt", ()), "", ""][:2]
        spoilt = spoilt or answer.spoilt
        if summary["changes"] is not None:
            spoilt = without_order(spoilt, results.verdict)
        answer = replace(answer, spoilt=spoilt, also_spoilt=also_spoilt)
        show_verdict(answer)
        show_cause(answer, summary["headline"])
        show_choice(summary["notes"], str(run))
        if summary["changes"] is not None:
            show_change(summary["changes"], str(run))
        if (expanded_path(run) / REPORT).is_file():
            say(str(run / REPORT))
        return
    for name in names:
        if name == "notes":
            _show_chosen(summary["notes"])
        if not show_aspect(name, results, summary["sections"]) and aspects != ["all"]:
            say(f"{name}: none, {_MISSING_FILES[name]}", wrap=True)


def _show_chosen(notes: Sequence[str]) -> None:
    """Print what was chosen for a program given alone; the job file of its run gives it, and so has no such note."""
    from gantrysim.job.loaded import CHOSEN

    for note in notes:
        if note.startswith(CHOSEN):
            say(f"note: {note}", wrap=True)


_MISSING_FILES = {
    "faults": "the job has no deliberate faults",
    "causes": "gantrysim run --causes finds them",
    "glue-causes": "the glue passes, or gantrysim run --causes finds them",
    "scatter": "gantrysim run --repeat 16 finds it",
    "levers": "gantrysim run --improve simulates them where the verdict is no pass",
}


def _results(saved: Any) -> RunResults:
    from gantrysim.glue.bead import Bead
    from gantrysim.metrics.analysis import Analysis
    from gantrysim.metrics.budget import Budget
    from gantrysim.results.run_results import RunResults

    analysis = Analysis(saved.run)
    return RunResults(saved.job, saved.machine, Budget(analysis), Bead(saved.run, saved.job.bead, analysis))


def show_aspect(name: str, results: RunResults, sections: Mapping[str, Any]) -> bool:
    """Print an aspect of a run; return whether the run has it.

    Args:
        name: one of `ASPECTS`.
        results: of the run.
        sections: in text what took further runs, see `gantrysim.report.summary`.
    """
    if name in _OF_RECORD:
        _OF_RECORD[name](results)
        return True
    if name not in sections:
        return False
    show_section(sections[name])
    return True


def _show_verdict(results: RunResults) -> None:
    from gantrysim.cli.tables import verdict_table

    if results.verdict.unjudged:
        say(str(results.verdict), wrap=True)
    else:
        show(verdict_table(results.verdict))


def _show_budget(results: RunResults) -> None:
    from gantrysim.cli.tables import links_table
    from gantrysim.report.headline import contour_sentence

    show(links_table(results.job.name, results.machine, results.budget))
    say(contour_sentence(results.budget), wrap=True)


def _show_figures(results: RunResults) -> None:
    from gantrysim.cli.tables import outcome_table

    show(outcome_table(results.budget.analysis, results.bead_values, results.job.margins, results.dots))


def _show_notes(results: RunResults) -> None:
    from gantrysim.job.scatter import scatters
    from gantrysim.job.steps import run_notes
    from gantrysim.report.scatter import SCATTER_NOTE

    job = results.job
    run = results.budget.analysis.run
    say(f"servo: {job.servo_reason}", wrap=True)
    for note in run_notes(job, run):
        say(f"note: {note}", wrap=True)
    if run.fault is None and scatters(job):
        say(SCATTER_NOTE, wrap=True)


_OF_RECORD: dict[str, Callable[[RunResults], None]] = {
    "verdict": _show_verdict,
    "budget": _show_budget,
    "figures": _show_figures,
    "notes": _show_notes,
}


def show_section(section: Mapping[str, Any]) -> None:
    """Print a section of a page, see `gantrysim.report.document.Section.content`."""
    from gantrysim.cli.tables import option_lines

    say(section["title"])
    for paragraph in section["text"]:
        say(paragraph, wrap=True)
    if section["facts"]:
        show(text_table(("", "", ""), section["facts"], (False, True, False), ""))
    for table in section["tables"]:
        _show_table(table["heads"], table["rows"], table["numeric"], table["caption"] or "")
    for line in (section["code"] or "").rstrip().splitlines():
        say("\n".join(option_lines(line.split(" --"))) if line.startswith("--") else line)


def _show_table(heads: list[str], rows: list[list[str]], numeric: list[bool], caption: str) -> None:
    """Print a table; prose in its last column stands below it where the terminal is too narrow for it."""
    table = text_table(heads, rows, numeric, caption)
    if fits(table) or len(heads) < _PLAIN_COLUMNS or not is_prose_column(rows, len(heads) - 1):
        show(table)
        return
    show(text_table(heads[:-1], [row[:-1] for row in rows], numeric[:-1], caption))
    say(f"{heads[-1]}:")
    for name, text in dict.fromkeys((row[0], row[-1]) for row in rows):
        if text:
            say(f"{name}: {text}", wrap=True)
