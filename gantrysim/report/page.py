"""The report of one run."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

from gantrysim.job.steps import run_notes
from gantrysim.report.causes import causes_section
from gantrysim.report.document import Section, Table
from gantrysim.report.drawn_page import DrawnPage, draw_page
from gantrysim.report.figures import Figures
from gantrysim.report.headline import headline
from gantrysim.report.job_section import job_section
from gantrysim.report.order import in_order
from gantrysim.report.scatter import scatter_section
from gantrysim.report.sections import (
    bead_section,
    budget_section,
    errors_section,
    faults_section,
    path_section,
    spacing_section,
    summary_facts,
)
from gantrysim.report.servo import servo_section
from gantrysim.report.summary import versions
from gantrysim.report.verdict import verdict_section
from gantrysim.results.run_results import RunResults


def write_run_page(
    file: str | os.PathLike[str],
    results: RunResults,
    video: str | os.PathLike[str] | None = None,
    progress: Callable[[float], None] | None = None,
) -> None:
    """Write the report of a run as one HTML file.

    Args:
        file: to be written.
        results: of the run, with its bead.
        video: MP4 file that is included where it exists.
        progress: called with the completed share.
    """
    run_page(results, video, progress).write(file)


def run_page(
    results: RunResults,
    video: str | os.PathLike[str] | None = None,
    progress: Callable[[float], None] | None = None,
    changes: Section | None = None,
    figures: Mapping[str, Figures] | None = None,
) -> DrawnPage:
    """Return the report of a run with its figures drawn, ready to be written.

    Args:
        results: of the run, with its bead.
        video: MP4 file that is included where it exists when the page is written.
        progress: called with the completed share.
        changes: section on what to change in the job, which a room above this one makes.
        figures: of `sections_with_figures` of these results, drawn ahead; None to draw them here.
    """
    run = results.budget.analysis.run
    job = results.job
    return draw_page(
        f"{job.name} on {results.machine.name}",
        f"{job.program['controller']}, servo period {1e3 * run.period:g} ms",
        in_order(run_sections(results, None if video is None else Path(video), changes)),
        warning=_warning(results),
        progress=progress,
        figures=figures,
    )


def _warning(results: RunResults) -> str | None:
    """Return what stands above the whole page: a fault, or that the errors contradict one another."""
    run = results.budget.analysis.run
    if run.fault is not None:
        return f"Fault: {run.fault}. All values are up to the fault."
    return results.verdict.contradiction or None


def sections_with_figures(results: RunResults) -> list[Section]:
    """Return the sections of a run's report that have figures, which `figures_ahead` draws."""
    return [section for section in in_order(run_sections(results)) if section.has_figures]


def run_sections(results: RunResults, video: Path | None = None, changes: Section | None = None) -> Iterator[Section]:
    """Yield the sections of a run's report, see `run_page`."""
    job = results.job
    machine = results.machine
    budget = results.budget
    bead = results.bead
    analysis = budget.analysis
    run = analysis.run
    yield verdict_section(results.verdict)
    yield Section("Summary", headline(budget, results.causes), facts=summary_facts(budget))
    if run.injected:
        yield faults_section(run, results.losses)
    yield budget_section(budget, machine)
    if results.causes is not None:
        yield causes_section(results.causes)
    if changes is not None:
        yield changes
    if results.scatter is not None:
        yield scatter_section(results.scatter)
    yield path_section(results, video)
    if analysis.spacing.distance.size:
        yield spacing_section(analysis)
    if bead is not None and bead.nominal > 0:
        yield bead_section(bead)
    yield errors_section(analysis)
    yield servo_section(results)
    if notes := run_notes(job, run):
        yield Section("Notes", notes)
    yield job_section(job)
    yield Section("Versions", table=Table(["", "version"], [list(item) for item in versions(machine).items()]))
