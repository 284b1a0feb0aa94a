"""What the command line shows of a run: its answer on one screen, and tables of the error budget and the results."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from rich.markup import escape
from rich.table import Table
from rich.text import Text

from gantrysim.base.quantity import Quantity, number_text
from gantrysim.cli.terminal import say, show, terminal_width, unbreakable_text
from gantrysim.glue.bead import BeadValues
from gantrysim.job.loaded import CHOSEN
from gantrysim.job.margins import LOW_MARGIN
from gantrysim.job.plan import Plan
from gantrysim.machine.machine import Machine
from gantrysim.metrics.analysis import THOUSANDTH, Analysis
from gantrysim.metrics.budget import DESCRIPTIONS, Budget
from gantrysim.metrics.error_quantities import END_POINT, FOLLOWING
from gantrysim.metrics.parts import CORNER, ERROR, PART_COLUMNS, PartValues
from gantrysim.report.answer import Answer
from gantrysim.report.rows import bead_notes, bead_rows, dot_rows, motion_rows
from gantrysim.results.checks import FAIL, PASS, UNJUDGED, WARN
from gantrysim.results.glue import DotVerdict
from gantrysim.results.verdict import Verdict
from gantrysim.servo.stability.margins import GAIN_MARGIN, NO_LOOP, PHASE_MARGIN, Margins

_MB = 1e6
_SHOWN_REST = 0.01  # time at rest with glue [s]; less is the begin of a bead

TABLE_LINES = 25  # lines of 80 columns

_STYLES = {PASS: "green", WARN: "yellow", FAIL: "bold red", UNJUDGED: ""}
_LABEL = 9  # columns of "spoilt by"
_PASTED = 8  # lines to paste; more are left to `gantrysim show FOLDER levers`
_INDENT = "  "
_CONTINUED_LINE = " \\"  # a line of a shell
# of a choice: without its reason, how to choose otherwise, and details
_DETAILS_BEGIN = re.compile(r" \(|, (?![xyz] )")
_COLUMNS = ("state", "row")  # before the text


def links_table(name: str, machine: Machine, budget: Budget) -> Table:
    """Return the error budget of a run of the job `name`, a row per link of the chain."""
    run = budget.analysis.run
    values = budget.values
    until = "" if run.fault is None else ", until the fault"
    title = escape(f"{name} on {run.machine}: error normal to the path [{ERROR.unit}]{until}")
    table = Table(title=title, title_justify="left")
    table.add_column("link", no_wrap=True)
    for column in PART_COLUMNS:
        table.add_column(column.label, justify="right", no_wrap=True)
    table.add_column("span")

    def add(label: str, part: PartValues, span: str = "") -> None:
        cells = [_cell(column, column.get(part)) for column in PART_COLUMNS]
        table.add_row(label, *cells, span)

    for link, part in values.parts.items():
        add(link, part, DESCRIPTIONS[link])
        if link == "servo":
            for axis, axis_part in budget.servo_by_axis(machine).items():
                add(f"  by {axis}", budget.values_of(axis_part))
    if values.corner is not None:
        add(CORNER, values.corner, DESCRIPTIONS[CORNER])
    table.add_section()
    contour = values.contour
    x, y, _ = (number_text(coordinate, ".1f") for coordinate in contour.point)
    add("contour", contour, DESCRIPTIONS["contour"])
    table.caption = "links show where on the chain the error lies, not what causes it\n"
    table.caption += "share of the mean square contour error; a negative share offsets others\n"
    table.caption += f"largest contour error at t = {number_text(contour.time, '.2f')} s, x = {x}, y = {y} mm"
    table.caption_justify = "left"
    return table


def verdict_table(verdict: Verdict) -> Table:
    """Return the verdict on a complete run, a row per value that it shows."""
    table = Table.grid(padding=(0, 2, 0, 0))
    table.title = escape(f"verdict {verdict.headline}")
    table.title_justify = "left"
    table.add_column(no_wrap=True)
    table.add_column(no_wrap=True)
    table.add_column(overflow="fold")
    for head, name, text in verdict.cells:
        table.add_row(head, name, escape(unbreakable_text(text)))
    return table


def outcome_table(
    analysis: Analysis, bead: BeadValues | None, margins: tuple[Margins, ...] | None, dots: Sequence[DotVerdict] = ()
) -> Table:
    """Return the results of a run: following errors, stability, spacing, speed, and bead and dots where there are."""
    run = analysis.run
    values = analysis.values
    table = Table.grid(padding=(0, 2))
    for axis, unit in zip(run.axes, run.units, strict=True):
        following = FOLLOWING.of_axis(axis, THOUSANDTH[unit])
        error = values.following[axis]
        table.add_row(following.label, following.text(error.rms), f"max {following.text(error.max)}")
    if margins is not None and any(axis_margins != NO_LOOP for axis_margins in margins):
        axis, axis_margins = min(zip(run.axes, margins, strict=True), key=lambda pair: pair[1].least_gain)
        number = GAIN_MARGIN.text(axis_margins.least_gain)
        table.add_row(GAIN_MARGIN.label, number, f"of {axis}, {_judged_margins(axis_margins)}")
    for row in motion_rows(analysis):
        table.add_row(*row)
    ends = zip(END_POINT, "xyz", values.end_point, strict=True)
    places = ", ".join(f"{coordinate} {end.number(place)}" for end, coordinate, place in ends)
    table.add_row("end point", "", f"{places} mm")
    if bead is not None:
        for row in (*bead_rows(bead), *bead_notes(bead)):
            table.add_row(*row)
    for row in dot_rows(dots):
        table.add_row(*row)
    return table


def _span(low: float, high: float, form: str) -> str:
    return f"{number_text(low, form)} to {number_text(high, form)}"


def plan_table(name: str, plan: Plan) -> Table:
    """Return what a job commands: lengths, time and extents."""
    table = Table.grid(padding=(0, 2))
    table.title = escape(f"{name}: {plan.controller} on {plan.machine}, not simulated")
    table.title_justify = "left"
    table.add_row("requested path", f"{plan.length:z.3f} mm", "")
    standing = f", and {plan.standing_time:z.2f} s at rest" if plan.standing_time > _SHOWN_REST else ""
    table.add_row("commanded path length", f"{plan.way:z.3f} mm", f"{plan.glue:z.3f} mm with glue{standing}")
    table.add_row("time", f"{plan.duration:z.3f} s", f"at most {plan.speed:z.2f} mm/s")
    files = f", {plan.files / _MB:z.0f} MB of temporary files" if plan.files else ""
    table.add_row(
        "run",
        f"{plan.ticks} ticks",
        f"{plan.ticks * plan.period:z.3f} s of machine time; about {plan.memory / _MB:z.0f} MB of memory{files}",
    )
    for k, axis in enumerate("xyz"):
        least, largest = plan.box[:, k]
        table.add_row(f"tip {axis}", f"{_span(least, largest, '.3f')} mm", "")
    for axis, extent in plan.travel.items():
        low, high = extent.bounds
        unit = plan.units[axis]
        fastest = plan.speeds[axis]
        table.add_row(
            f"axis {axis}",
            f"{_span(extent.least, extent.largest, '.3f')} {unit}",
            f"of {_span(low, high, 'g')}; at most {fastest.largest:.4g} of {fastest.bounds[1]:.4g} {unit}/s",
        )
    return table


def _judged_margins(margins: Margins) -> str:
    if not margins.stable:
        return "unstable"
    low = f"low, below {LOW_MARGIN:g}" if margins.least_gain < LOW_MARGIN else "the smallest"
    return f"{low}; {PHASE_MARGIN.label} {number_text(margins.phase, '.0f')} {PHASE_MARGIN.unit}"


def _cell(column: Quantity[Any], value: float) -> str:
    """Return a cell of a table whose title has the unit of all columns but ratios."""
    return column.number(value) if column.unit == ERROR.unit else column.text(value)


def show_verdict(answer: Answer) -> None:
    """Print the verdict: a line for each row, or why none is judged."""
    heading = f"verdict {answer.headline}"
    if not answer.rows:
        say(heading, wrap=True)
        return
    show(Text(heading, _STYLES[answer.state]))
    table = Table.grid(padding=(0, 2, 0, 0))
    for _ in _COLUMNS:
        table.add_column(no_wrap=True)
    table.add_column(overflow="fold")
    for row in answer.rows:
        where = f": {row.place}" if row.place and row.state != PASS else ""
        where += f" ({row.also.partition(' its')[0]} it)" if row.state == WARN and row.also else ""
        state = Text(f"{row.symbol} {row.state}", _STYLES[row.state])
        table.add_row(state, row.name, Text(unbreakable_text(f"{row.text}{where}")))
    show(table)


def show_cause(answer: Answer, headline: str) -> None:
    """Print what spoils a run, as its page does, or its error where nothing does."""
    if answer.state == PASS or not answer.rows or not answer.spoilt:
        _show_rows([("error" if answer.state == PASS else "spoilt by", headline)])
        return
    also = [("", answer.also_spoilt)] if answer.also_spoilt else []
    _show_rows([("spoilt by", answer.spoilt), *also])


def show_choice(notes: Sequence[str], folder: str) -> None:
    """Print in a few words what was chosen for a program that is given alone; nothing where nothing was.

    Args:
        notes: of the run, the one on what was chosen among them.
        folder: of the run.
    """
    for note in notes:
        if note.startswith(CHOSEN):
            choices = [_DETAILS_BEGIN.split(choice)[0] for choice in note.removeprefix(CHOSEN).split("; ")]
            _show_rows([("chosen", f"{'; '.join(choices)}: gantrysim show {folder} notes")])


def show_change(changes: Mapping[str, Any], folder: str) -> None:
    """Print the best change with what it costs, the lines to paste, and the verdict with it.

    Args:
        changes: what `gantrysim.report.answer.Remedy` holds.
        folder: of the run.
    """
    _show_rows([("change", changes["change"])])
    lines = list(option_lines(changes["options"])) or changes["lines"].rstrip().splitlines()
    if len(lines) > _PASTED:
        _show_rows([("paste", f"{len(lines)} lines: gantrysim show {folder} levers")])
    elif lines:
        say(f"paste into the {'command line' if changes['options'] else 'job file'}:")
        say("\n".join(_INDENT + line for line in lines))
    if changes["outcome"]:
        _show_rows([("then", changes["outcome"])])


def option_lines(options: Sequence[str]) -> Iterator[str]:
    """Yield options on lines of a shell, each but the last continued."""
    line = ""
    width = terminal_width() - len(_INDENT) - len(_CONTINUED_LINE)
    for word in options:
        option = word if word.startswith("--") else f"--{word}"
        if line and len(line) + 1 + len(option) > width:
            yield f"{line}{_CONTINUED_LINE}"
            line = option
        else:
            line = f"{line} {option}".strip()
    if line:
        yield line


def _show_rows(rows: Sequence[tuple[str, str]]) -> None:
    table = Table.grid(padding=(0, 2, 0, 0))
    table.add_column(no_wrap=True, style="bold", width=_LABEL)
    table.add_column(overflow="fold")
    for name, text in rows:
        table.add_row(name, Text(unbreakable_text(text)))
    show(table)
