"""The report of one run."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path

from gantrysim.job.basis import Basis
from gantrysim.job.job import Job
from gantrysim.job.margins import LOW_MARGIN
from gantrysim.job.steps import run_notes
from gantrysim.machine.machine import Machine
from gantrysim.metrics.error_quantities import TORQUE_RIPPLE
from gantrysim.report.answer import Answer, Remedy
from gantrysim.report.causes import causes_section, glue_causes_section
from gantrysim.report.document import Changes, Column, Section, Table
from gantrysim.report.drawn_page import DrawnPage, draw_page
from gantrysim.report.figures import Figures, section_name
from gantrysim.report.plots.bead import draw_laid
from gantrysim.report.scatter import scatter_section
from gantrysim.report.sections import (
    bead_section,
    budget_section,
    dots_section,
    drawn_plot,
    errors_section,
    faults_section,
    path_section,
    spacing_section,
)
from gantrysim.report.summary import versions
from gantrysim.results.quantities import TORQUE_RIPPLE_PERCENT
from gantrysim.results.run_results import AxisLoop, RunResults
from gantrysim.servo.gains import GAINS
from gantrysim.servo.laws import LAW_PARAMETERS
from gantrysim.servo.laws.selection import Laws, words
from gantrysim.servo.request import NOTCH
from gantrysim.servo.servo import Servo
from gantrysim.servo.stability.margins import GAIN_MARGIN, MARGINS, NO_LOOP, Margins

# The order of a run's report: what one asks first comes first, details are folded.

# is it good enough, where and how, what spoils it, what to change
_STILL_SIZE = (6.6, 5.2)  # picture of the bead, in print and where scripts do not run [inch]
_FIRST_SECTIONS = (
    "Verdict",
    "Deliberate faults",
    "Bead and path",
    "Error budget",
    "Causes",
    "Causes of the glue's error",
    "What to change",
)


def in_order(sections: Iterable[Section]) -> list[Section]:
    """Return the sections in the order of `_FIRST_SECTIONS`, then all others as they come, folded."""
    given = list(sections)
    first = sorted(
        (section for section in given if section.title in _FIRST_SECTIONS),
        key=lambda part: _FIRST_SECTIONS.index(part.title),
    )
    details = [replace(section, folded=True) for section in given if section.title not in _FIRST_SECTIONS]
    return [*first, *details]


def verdict_section(results: RunResults, remedy: Remedy | None = None) -> Section:
    """Return the section of the verdict, the page's first screen: the answer beside the bead, and all checks folded."""
    verdict = results.verdict
    caption = "A value above 80 % of its limit is a warning; limits are given by [tolerance] in the job, or defaults"
    heads = ["verdict", "of", "worst value and its limit"]
    table = None if verdict.unjudged else Table(heads, verdict.cells, caption, folded="All values and limits")
    return Section(
        "Verdict", table=table, still=drawn_plot(draw_laid, results, *_STILL_SIZE), answer=Answer.of(results, remedy)
    )


# The job of a run on its page, as a file to repeat it; of a long program the first and the last lines.

_WHOLE_JOB_LINES = 4000  # lines of a job that the page shows whole
_ENDS = 500  # lines shown of either end of a longer one
_REPEAT = "Save as a file for gantrysim run to repeat this run bit for bit."


def job_section(job: Job) -> Section:
    """Return the section with a job's TOML; a long program would make the page larger than all its figures."""
    text = job.toml()
    lines = text.split("\n")
    if len(lines) <= _WHOLE_JOB_LINES:
        return Section("Job", _REPEAT, code=text)
    missing = len(lines) - 2 * _ENDS
    shown = [*lines[:_ENDS], f"# ... {missing:,} lines are in job.toml only ...", *lines[-_ENDS:]]
    note = (
        f"The first and last {_ENDS} of {len(lines):,} lines, with those of the program: {missing:,} lines between are "
        "left out. job.toml beside this page is whole, and repeats this run bit for bit."
    )
    return Section("Job", note, code="\n".join(shown))


# The section of a run's report on its servo: gains, stability margins, torque ripple.


def servo_section(results: RunResults) -> Section:
    """Return the section of the servo of a job on the machine of its run."""
    job = results.basis
    machine = results.machine
    margins = job.margins
    reason = job.servo_reason
    law = job.built_servo.laws.names
    named = [] if law == Laws.names else [f"Law: {words(law)}."]
    return Section(
        "Servo",
        [_text(machine, margins), *named, f"{reason[0].upper()}{reason[1:]}."],
        table=[_gains(machine, job.built_servo), _margins(results.loops)],
    )


def _margins(loops: dict[str, AxisLoop]) -> Table:
    # the smaller of two that are shown
    shown = [quantity for quantity in MARGINS if quantity is not GAIN_MARGIN]
    ripples = (TORQUE_RIPPLE, TORQUE_RIPPLE_PERCENT)
    columns: list[str | Column] = ["axis", *map(Column.of, shown), *map(Column.of, ripples)]
    rows = [
        [
            axis,
            *(quantity.in_unit(quantity.get(loop.margins)) for quantity in shown),
            *(quantity.in_unit(quantity.get(loop)) for quantity in ripples),
        ]
        for axis, loop in loops.items()
    ]
    return Table(
        columns,
        rows,
        "Stability margins at the home position, without Coulomb friction; with all it moves: for a factor on the "
        "gains of all axes that move each other; torque ripple while the dispenser is on",
    )


def _gains(machine: Machine, servo: Servo) -> Table:
    laws = (parameter for parameter in LAW_PARAMETERS if any(servo.per_axis(parameter.name)))
    shown = (*GAINS, *(NOTCH if any(servo.per_axis("notch_frequency")) else ()), *laws)
    # a row for each gain: with a column for each, the table would be wider than the page
    rows = [[gain.name, gain.unit, *servo.per_axis(gain.name)] for gain in shown]
    columns = [Column(f"{axis.name} [{axis.unit}]") for axis in machine.axes]
    return Table(["gain", "unit", *columns], rows, "Gains")


def _text(machine: Machine, margins: tuple[Margins, ...] | None) -> str:
    if margins is None:
        return (
            "Stability margins are unknown: an actuator of the machine has a delay of its own, or the servo a law of "
            "the user's that is not linear."
        )
    by_axis = dict(zip((axis.name for axis in machine.axes), margins, strict=True))
    unstable = [name for name, axis_margins in by_axis.items() if not axis_margins.stable]
    if unstable:
        return f"Unstable, Coulomb friction neglected: {', '.join(unstable)}."
    loops = {name: axis_margins for name, axis_margins in by_axis.items() if axis_margins != NO_LOOP}
    gains = {name: axis_margins.least_gain for name, axis_margins in loops.items()}
    if not gains:
        return "All axes are steppers in open loop: no loop, no margins."
    least = min(gains, key=gains.__getitem__)
    text = f"Axis {least} has the smallest {GAIN_MARGIN.label}: {GAIN_MARGIN.text(gains[least])}"
    if gains[least] < LOW_MARGIN:
        text += f", below {LOW_MARGIN:g}: with another load, or on another machine of this kind, it may be unstable"
    return f"{text}."


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
    changes: Changes | None = None,
    figures: Mapping[str, Figures] | None = None,
) -> DrawnPage:
    """Return the report of a run with its figures drawn, ready to be written.

    Args:
        results: of the run, with its bead.
        video: MP4 file that is included where it exists when the page is written.
        progress: called with the completed share.
        changes: what to change in the job, which a room below this one finds.
        figures: of `sections_with_figures` of these results, drawn ahead; None to draw them here.
    """
    return draw_page(
        *_titles(results),
        in_order(run_sections(results, None if video is None else Path(video), changes)),
        warning=_warning(results),
        progress=progress,
        figures=figures,
    )


def viewer_page(results: RunResults) -> DrawnPage:
    """Return the verdict of a run and the viewer alone, without figures, as a notebook shows them."""
    sections = (verdict_section(results, None), path_section(results))
    title, subtitle = _titles(results)
    return DrawnPage(title, subtitle, [(section_name(part.title), part, []) for part in sections], _warning(results))


def _titles(results: RunResults) -> tuple[str, str]:
    """Return title and subtitle of a run's page."""
    job = results.basis
    run = results.budget.analysis.run
    facts = f"{_program_name(job)}, {float(run.time[-1]):.2f} s, servo period {1e3 * run.period:g} ms"
    return f"{job.name} on {results.machine.name}", facts


def _program_name(job: Basis) -> str:
    """Return the name of a job's controller; without a job, what stands for its program."""
    return str(job.program["controller"]) if isinstance(job, Job) else "setpoints from Python"


def _warning(results: RunResults) -> str | None:
    """Return what stands above the whole page: a fault, or that the errors contradict one another."""
    run = results.budget.analysis.run
    if run.fault is not None:
        return f"Fault: {run.fault}. All values are up to the fault."
    return results.verdict.contradiction or None


def sections_with_figures(results: RunResults) -> list[Section]:
    """Return the sections of a run's report that have figures, which `figures_ahead` draws."""
    return [section for section in in_order(run_sections(results)) if section.has_figures]


def run_sections(results: RunResults, video: Path | None = None, changes: Changes | None = None) -> Iterator[Section]:
    """Yield the sections of a run's report, see `run_page`."""
    job = results.basis
    machine = results.machine
    budget = results.budget
    bead = results.bead
    analysis = budget.analysis
    run = analysis.run
    yield verdict_section(results, None if changes is None else changes.remedy)
    if run.injected:
        yield faults_section(run, results.losses)
    yield budget_section(results)
    if results.causes is not None:
        yield causes_section(results.causes)
    if results.glue_causes is not None:
        yield glue_causes_section(results.glue_causes)
    if changes is not None:
        yield changes.section
    if results.scatter is not None:
        yield scatter_section(results.scatter)
    yield path_section(results, video)
    if analysis.spacing.distance.size:
        yield spacing_section(analysis)
    if bead is not None and bead.nominal > 0:
        yield bead_section(bead)
    if bead is not None and results.dots:
        yield dots_section(bead, results.dots)
    yield errors_section(analysis)
    yield servo_section(results)
    if notes := run_notes(job, run):
        yield Section("Notes", notes)
    if isinstance(job, Job):
        yield job_section(job)
    yield Section("Versions", table=Table(["", "version"], [list(item) for item in versions(machine).items()]))
