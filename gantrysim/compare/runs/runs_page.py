"""The report of a comparison of runs: its tables, and its sections, which tune and improve show of before and after."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from gantrysim.base.errors import InputError
from gantrysim.base.extras import package_versions
from gantrysim.base.quantity import MINUS, NOTHING, Quantity
from gantrysim.compare.runs.compared_run import FEWEST_RUNS, MOST_RUNS, ComparedRun, names_of_jobs
from gantrysim.compare.runs.compared_runs import ComparedRuns
from gantrysim.compare.runs.differences import CheckChange, with_share
from gantrysim.compare.runs.overlay_data import OverlayData
from gantrysim.compare.runs.overlays import (
    draw_compared_budgets,
    draw_compared_causes,
    draw_limit_use,
    draw_overlaid_errors,
    draw_overlaid_plan,
    drawn_links,
)
from gantrysim.job.causes import CELL_FORM
from gantrysim.metrics.budget import DESCRIPTIONS
from gantrysim.metrics.parts import ERROR, PART_COLUMNS
from gantrysim.record.run import Run
from gantrysim.report.document import Column, Section, Table, lead_of
from gantrysim.report.drawn_page import write_page
from gantrysim.report.folder import Output, SavedRun, output_folder
from gantrysim.report.plots.plan import plan_extent
from gantrysim.report.plots.style import view_height
from gantrysim.report.sections import drawn_plot
from gantrysim.results.run_results import RunResults

if TYPE_CHECKING:
    from matplotlib.figure import Figure


REPORT = "report.html"
SUMMARY = "compare.json"
# of both kinds of comparison, so that a later one replaces all files of an earlier one
OUTPUT = Output("comparison", SUMMARY, (SUMMARY, "overlay.png", "spectrum.png", REPORT))

_PLOT_WIDTH = 10.7  # of a plot across the page [inch]
_PLAN = 7.6  # of a plan view [inch]
_PANEL = 1.1  # height of a link's panel [inch]
_GROUP = 0.36  # height of a bar, with what lies between [inch]
_RMS, _, _MAX, _ = PART_COLUMNS

# effects are often smaller than the decimals of `ERROR`
WORTH: Quantity[Any] = replace(ERROR, form=CELL_FORM)

Cells = tuple[list[str], list[list[str]]]


def write_runs(comparison: ComparedRuns, folder: Path) -> Path:
    """Write report.html and compare.json of a comparison into a folder; return the path of report.html.

    Raises:
        InputError: the folder cannot be written.
    """
    return write_sections(comparison, folder, " beside ".join(comparison.names), run_sections(comparison))


def write_sections(comparison: ComparedRuns, folder: Path, title: str, sections: Iterable[Section]) -> Path:
    """Write a page of sections and compare.json of a comparison into a folder; return the path of report.html.

    Raises:
        InputError: the folder cannot be written.
    """
    subtitle = f"{len(comparison.runs)} runs compared; changes are counted from {comparison.names[0]}"
    with output_folder(folder, OUTPUT) as scratch:
        content = json.dumps(comparison.summary(), indent=2, allow_nan=False)
        (scratch / SUMMARY).write_text(f"{content}\n", encoding="utf-8")
        write_page(scratch / REPORT, title, subtitle, list(sections))
    return folder / REPORT


def run_sections(comparison: ComparedRuns) -> Iterator[Section]:
    """Yield the sections of a comparison, the answer first."""
    sentence = comparison.sentence
    lead = lead_of(sentence)
    yield Section("Summary", lead, figure=limits_figure(comparison), facts=_facts(comparison))
    if lead != sentence:
        yield Section("In full", sentence)
    yield beads_section(comparison)
    yield Section("What differs", **differences_content(comparison))
    yield budgets_section(comparison)
    if comparison.causes:
        yield causes_section(comparison)
    yield verdicts_section(comparison)
    yield values_section(comparison)
    yield Section(
        "Versions", table=Table(["", "version"], [list(item) for item in package_versions().items()]), folded=True
    )


def limits_figure(comparison: ComparedRuns) -> Callable[[], Figure] | None:
    """Return the chart of the limits that the runs use; None where no run is judged."""
    if all(verdict.unjudged for verdict in comparison.verdicts):
        return None
    rows = max(len(verdict.rows) for verdict in comparison.verdicts)
    return drawn_plot(draw_limit_use, comparison, *bars_size(rows * len(comparison.runs)))


def _facts(comparison: ComparedRuns) -> list[tuple[str, str, str]]:
    facts = []
    for name, verdict, part in zip(comparison.names, comparison.verdicts, comparison.budgets["contour"], strict=True):
        if part is not None:
            facts.append(
                (
                    f"Contour error, {name}",
                    f"{_RMS.text(part.rms)} rms",
                    f"max {_MAX.text(part.max)}; {verdict.headline}",
                )
            )
    for name, apart in list(zip(comparison.names, comparison.apart, strict=True))[1:]:
        if apart is not None and apart.length:
            label = (
                "Difference at the same place" if len(comparison.runs) == 2 else f"{name} less {comparison.names[0]}"
            )
            remark = f"max {_MAX.text(apart.max)}, over {apart.length:.1f} mm of path"
            facts.append((label, f"{_RMS.text(apart.rms)} rms", remark))
    return facts


def differences_content(comparison: ComparedRuns) -> dict[str, Any]:
    """Return text and table of what differs between the jobs, for a section."""
    notes = [f"{note[0].upper()}{note[1:]}." for note in comparison.notes]
    if not comparison.differences:
        return {"text": ["The jobs, machines and servos do not differ.", *notes]}
    caption = "Values that are not the same in all runs; those of machine and servo follow from the job"
    heads, rows = difference_cells(comparison)
    return {"text": notes, "table": Table(heads, rows, caption)}


def beads_section(comparison: ComparedRuns, title: str = "Beads and errors") -> Section:
    """Return the section of the beads over one another, and of the errors: the page's viewer, and figures for print."""
    extents = np.array([plan_extent(run.analysis) for run in comparison.runs]).max(axis=0)
    height = view_height(float(extents[0]), float(extents[1]), _PLAN)
    return Section(
        title,
        viewer=OverlayData(comparison).text(),
        still=[
            drawn_plot(draw_overlaid_plan, comparison, _PLAN, height),
            drawn_plot(draw_overlaid_errors, comparison, *errors_size(comparison)),
        ],
    )


def errors_size(comparison: ComparedRuns) -> tuple[float, float]:
    """Return width and height of the plot of the errors [inch]."""
    return _PLOT_WIDTH, 2.6 + _PANEL * len(list(drawn_links(comparison)))


def bars_size(bars: int) -> tuple[float, float]:
    """Return width and height of a plot of so many bars [inch]."""
    return _PLAN, 1.2 + _GROUP * bars


def budgets_section(comparison: ComparedRuns) -> Section:
    """Return the section of the error budgets beside one another, on one scale."""
    bars = len(comparison.budgets) * len(comparison.runs)
    return Section(
        "Error budgets",
        "Errors are normal to the requested path; a link locates the error on the chain and is not its cause.",
        figure=drawn_plot(draw_compared_budgets, comparison, *bars_size(bars)),
        table=budgets_table(comparison),
    )


def budgets_table(comparison: ComparedRuns) -> Table:
    """Return the table of the error budgets beside one another."""
    heads: list[str | Column] = ["link", "span"]
    for size in PART_COLUMNS:
        heads += [Column(f"{size.head}, {name}", size.form) for name in comparison.names]
    heads += [f"change of rms, {name}" for name in comparison.names[1:]]
    rows = []
    for link, parts in comparison.budgets.items():
        cells = [None if part is None else size.in_unit(size.get(part)) for size in PART_COLUMNS for part in parts]
        rms = [None if part is None else part.rms for part in parts]
        changes = [size_change(rms[0], size) for size in rms[1:]]
        rows.append([link, DESCRIPTIONS[link], *cells, *changes])
    return Table(heads, rows, "Error normal to the requested path by link, of every run")


def causes_section(comparison: ComparedRuns) -> Section:
    """Return the section of what causes are worth in every run."""
    heads: list[str | Column] = ["cause", *(Column(f"{name} [{WORTH.unit}]", WORTH.form) for name in comparison.names)]
    rows = [[cause, *map(WORTH.in_unit, worth)] for cause, worth in comparison.causes.items()]
    bars = len(comparison.causes) * len(comparison.runs)
    return Section(
        "Causes",
        "Worth is the rms contour error of the job minus that without the cause. Effects do not add up.",
        figure=drawn_plot(draw_compared_causes, comparison, *bars_size(bars)),
        table=Table(heads, rows, "What each cause is worth of the rms contour error"),
    )


def verdicts_section(comparison: ComparedRuns) -> Section:
    """Return the section of the verdicts' checks beside one another."""
    lines = [f"{name}: {verdict.headline}" for name, verdict in zip(comparison.names, comparison.verdicts, strict=True)]
    return Section("Verdicts", lines, table=checks_table(comparison.names, comparison.checks))


def checks_table(names: Sequence[str], checks: Sequence[CheckChange]) -> Table | None:
    """Return the table of the verdicts' checks beside one another; None without any."""
    heads, rows = check_cells(names, checks)
    caption = f"Checks of the verdict; a change is counted from {names[0]}; ▲ better, ▼ worse"
    return Table(heads, rows, caption) if rows else None


def values_section(comparison: ComparedRuns) -> Section:
    """Return the section of every value of the runs, a table for each group."""
    tables = []
    for group in dict.fromkeys(value.group for value in comparison.values):
        heads, rows = value_cells(comparison, group, large_only=False)
        tables.append(Table(heads, rows, group))
    return Section("Values", table=tables, folded=True)


# `compare_runs`: which of several runs is better, by how much, and what differs between their jobs.


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
    if runs < FEWEST_RUNS:
        raise InputError(f"compare: {runs} run: name another to compare it with, or a log with --measured FILE")
    if runs > MOST_RUNS:
        raise InputError(
            f"compare: {runs} runs: must be {FEWEST_RUNS} to {MOST_RUNS}, as more lines cannot be told apart"
        )


def _job_name(run: Run | SavedRun | RunResults) -> str:
    job = getattr(run, "job", None)
    return "run" if job is None else str(job.name)


def difference_cells(comparison: ComparedRuns) -> Cells:
    """Return the table of what differs between the jobs."""
    rows = [[difference.kind, difference.key, *difference.texts] for difference in comparison.differences]
    return ["of", "value", *comparison.names], rows


def budget_cells(comparison: ComparedRuns) -> Cells:
    """Return the table of the rms error of every link [µm]."""
    rows = []
    for link, parts in comparison.budgets.items():
        sizes = [None if part is None else part.rms for part in parts]
        changes = [size_change(sizes[0], size) for size in sizes[1:]]
        rows.append([link, *map(ERROR.number, sizes), *changes])
    return ["link", *comparison.names, *_changes(comparison.names)], rows


def cause_cells(comparison: ComparedRuns) -> Cells:
    """Return the table of what each cause is worth [µm]; without rows where causes are not known."""
    rows = [[cause, *map(WORTH.number, worth)] for cause, worth in comparison.causes.items()]
    return ["cause", *comparison.names], rows


def check_cells(names: Sequence[str], checks: Sequence[CheckChange]) -> Cells:
    """Return the table of the checks of verdicts."""
    return ["of", "check", "limit", *names, *_changes(names)], [_check_row(check) for check in checks]


def _changes(names: Sequence[str]) -> list[str]:
    return ["change"] if len(names) == 2 else [f"change, {name}" for name in names[1:]]


def _check_row(check: CheckChange) -> list[str]:
    unit = f" [{check.unit}]" if check.unit else ""
    numbers = range(len(check.checks))
    cells = map(check.cell, numbers)
    return [check.row, f"{check.quantity}{unit}", check.limit, *cells, *map(check.change_text, numbers[1:])]


def value_cells(comparison: ComparedRuns, group: str, *, large_only: bool) -> Cells:
    """Return heads and rows of the table of a group's values, as text."""
    heads = ["value", *comparison.names, *_changes(comparison.names)]
    rows = [
        [value.quantity.head, *value.texts, *(value.change_text(run) for run in range(1, len(comparison.runs)))]
        for value in comparison.values
        if value.group == group and not (large_only and not value.is_large)
    ]
    return heads, rows


def size_change(before: float | None, after: float | None) -> str:
    """Return the change of an error [mm] in µm and in percent."""
    if before is None or after is None:
        return NOTHING
    change = ERROR.number(after - before)
    text = change if change.startswith(MINUS) or change == "0" else f"+{change}"
    return with_share(text, after - before, before)
