"""The command `gantrysim compare`."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import typer

from gantrysim.base.errors import InputError, expanded_path, finite_of
from gantrysim.cli.terminal import say, show, warn

if TYPE_CHECKING:
    from rich.table import Table

    from gantrysim.compare.comparison import Comparison
    from gantrysim.compare.measured import Trace
    from gantrysim.compare.runs.compared_runs import ComparedRuns
    from gantrysim.record.run import Run
    from gantrysim.report.folder import SavedRun


# What `gantrysim compare RUN RUN` does: runs beside one another, in tables and a page.


def compare_folders(folders: Sequence[Path], out: Path, *, is_whole: bool) -> None:
    """Compare saved runs, print what differs, and write the page into a folder.

    Raises:
        InputError: a folder that holds no run, or that is given twice.
    """
    from gantrysim.compare.runs.compared_run import names_of_folders
    from gantrysim.compare.runs.runs_page import OUTPUT, REPORT, SUMMARY, check_number, compare_runs
    from gantrysim.report.folder import SavedRun

    check_number(len(folders))
    places = [expanded_path(folder).resolve() for folder in folders]
    for number, place in enumerate(places):
        if place in places[:number]:
            raise InputError(f"run {folders[number]}: is given twice; name the folder of another run")
    OUTPUT.check(out)
    saved = [SavedRun.load(folder) for folder in folders]
    comparison = compare_runs(*saved, names=names_of_folders(folders))
    comparison.report(out)
    show_comparison(comparison, is_whole=is_whole)
    say(f"written to {out}/: {REPORT}, {SUMMARY}")


def show_comparison(comparison: ComparedRuns, *, is_whole: bool) -> None:
    """Print the answer and what differs, on one screen or as a whole with all tables and notes.

    On one screen stand the keys that differ, the checks of which one run does not pass, and the contour error.
    """
    say(comparison.sentence, wrap=True)
    if is_whole:
        for table in comparison_tables(comparison):
            show(table)
        for note in comparison.notes:
            say(f"note: {note}", wrap=True)
        return
    for table in _tables_of_screen(comparison):
        show(table)


_KEYS = 6  # that differ, on one screen
_CHECKS = 9  # likewise


def _tables_of_screen(comparison: ComparedRuns) -> Iterator[Table]:
    """Yield the tables of a comparison on one screen."""
    from gantrysim.compare.runs.runs_page import budget_cells, check_cells, difference_cells

    heads, keys = difference_cells(comparison)
    if keys:
        further = f"; {len(keys) - _KEYS} further ones are on the page" if len(keys) > _KEYS else ""
        yield _table_of_texts(f"what differs{further}", heads, keys[:_KEYS], 2)
    runs = range(1, len(comparison.runs))
    checks = [check for check in comparison.checks if any(check.is_critical(run) for run in runs)]
    if checks:
        title = f"checks that a run does not pass; changes against {comparison.names[0]}"
        heads, rows = check_cells(comparison.names, checks[:_CHECKS])
        yield _table_of_texts(title, heads, rows, 3)
    heads, rows = budget_cells(comparison)
    yield _table_of_texts("error normal to the requested path, rms [µm]", heads, rows[-1:], 1)


def comparison_tables(comparison: ComparedRuns) -> list[Table]:
    """Return the tables of a comparison; those without rows are left out."""
    from gantrysim.compare.runs.differences import LARGE_CHANGE
    from gantrysim.compare.runs.runs_page import (
        budget_cells,
        cause_cells,
        check_cells,
        difference_cells,
        value_cells,
    )

    first = comparison.names[0]
    judged = f"checks of the verdict; changes against {first}"
    named = [
        ("what differs", 2, difference_cells(comparison)),
        (judged, 3, check_cells(comparison.names, comparison.checks)),
        ("error normal to the requested path, rms [µm]", 1, budget_cells(comparison)),
        ("worth of causes, of the rms contour error [µm]", 1, cause_cells(comparison)),
    ]
    for group in dict.fromkeys(value.group for value in comparison.values):
        title = f"{group.lower()}: values that differ by {100 * LARGE_CHANGE:.0f} % or more"
        named.append((title, 1, value_cells(comparison, group, large_only=True)))
    return [_table_of_texts(title, heads, rows, texts) for title, texts, (heads, rows) in named if rows]


def _table_of_texts(title: str, heads: Sequence[str], rows: Sequence[Sequence[str]], texts: int) -> Table:
    """Return a table whose first columns are text, and whose others are numbers."""
    from rich.markup import escape
    from rich.table import Table

    table = Table(title=escape(title), title_justify="left", box=None, padding=(0, 1, 0, 0))
    for number, head in enumerate(heads):
        table.add_column(escape(head), justify="left" if number < texts else "right")
    for row in rows:
        table.add_row(*map(escape, row))
    return table


_SUMMARY = "compare.json"
_HEADS = ("measured\nrms", "\n95 %", "\nmax", "simulated\nrms", "\n95 %", "\nmax", "difference\nrms", "\nmax")

Measured = Annotated[
    Path | None,
    typer.Option(
        help="Log of the real machine, for one RUN: CSV, softMC's RECORD, LinuxCNC's halsampler or halscope, or a "
        "TABLE dump; or a record that Run.save wrote, or the folder of a run.",
        show_default=False,
    ),
]
Columns = Annotated[
    str | None,
    typer.Option(
        help="Columns of the log: time=t\\[ms],x=px,y=py*0.001 of the nozzle, commanded.x=..., encoder.x=..., "
        "demand.x=... or torque.x=... for axes; or a TOML file with a table \\[columns]."
    ),
]
Period = Annotated[float | None, typer.Option(help="Sampling period, for a log without time \\[s].")]
Align = Annotated[
    str,
    typer.Option(
        help="How the trace is aligned: path, at equal places, or time, at equal times; offset, rotation: fitted "
        "too, where the data show them; or none."
    ),
]
Contrast = Annotated[
    bool, typer.Option("--contrast/--no-contrast", help="Simulate the machine without friction, too, for contrast.")
]
Circle = Annotated[
    str | None,
    typer.Option(metavar="RADIUS[,X,Y]", help="Also evaluate a circular test, about X, Y in the work frame \\[mm]."),
]


def compare(
    runs: Annotated[
        list[Path],
        typer.Argument(
            metavar="RUN...",
            help="Output folders of gantrysim run: two to four, or one with --measured.",
            show_default=False,
        ),
    ],
    measured: Measured = None,
    columns: Columns = None,
    period: Period = None,
    blocks: Annotated[int, typer.Option(min=0, help="Blocks of a Trio TABLE dump.")] = 0,
    align: Align = "path,offset,rotation",
    circle: Circle = None,
    contrast: Contrast = True,
    out: Annotated[
        Path | None, typer.Option(help="Output folder; by default the folder compare in the first RUN.")
    ] = None,
    verbose: Annotated[bool, typer.Option("--verbose", "-v", help="Print every table of two runs or more.")] = False,
) -> None:
    """Compare saved runs with each other, or one run with a measured trace.

    For two runs or more, it states which verdict is better, by how much, and how the jobs differ, and shows what keeps
    a run from its limits; with -v, errors, budgets, causes and values stand side by side, as on the page. Errors are
    compared at the same distance along the path if all runs request the same path, otherwise over time.

    With --measured, it shows both error budgets and the part of the error that the model does not explain, beside that
    of the same machine without friction, and following error and torque of each axis over time. The trace is aligned at
    equal places of the path, whatever its speed, and in position as far as its data show an offset. Its samples are not
    interpolated: the simulation is evaluated at their places. Links that are not measured are not compared, and do not
    count as explained.

    The output folder holds report.html and compare.json.

    Exit status: 0, 2 for bad input.
    """
    folder = out if out is not None else runs[0] / "compare"
    # the run's folder may come from elsewhere
    if out is None and expanded_path(folder).is_symlink():
        raise InputError(f"run {runs[0]}: {folder.name} in it is a link: name the output folder with --out")
    if measured is not None:
        if len(runs) > 1:
            raise InputError(f"--measured {measured}: is compared with one run, {len(runs)} are given")
        _compare_log(runs[0], measured, Log(columns, period, blocks, align, circle, contrast), folder)
        return
    given = {"--columns": columns, "--period": period, "--blocks": blocks or None, "--circle": circle}
    for option, value in given.items():
        if value is not None:
            raise InputError(f"{option}: describes a log: needs --measured FILE")

    compare_folders(runs, folder, is_whole=verbose)


class Log(NamedTuple):
    """Options that describe a log and its comparison."""

    columns: str | None
    period: float | None
    blocks: int
    align: str
    circle: str | None
    contrast: bool


def _compare_log(run: Path, measured: Path, options: Log, folder: Path) -> None:
    """Compare a saved run with a measured trace."""
    from gantrysim.compare.compare_quantities import FREQUENCY, PEAK_SIZE
    from gantrysim.compare.comparison import Comparison
    from gantrysim.compare.page import (
        OVERLAY,
        REPORT,
        SPECTRUM,
        alignment_text,
        headline,
        save_comparison,
        write_comparison_page,
    )
    from gantrysim.report.folder import Output, SavedRun, output_folder

    saved = SavedRun.load(run)
    trace = _trace(measured, options, saved.run)
    what = tuple(part.strip() for part in options.align.split(",") if part.strip() not in ("", "none"))
    wrong, reason = _contrast(saved) if options.contrast else (None, "")
    comparison = Comparison.of(trace, saved.run, saved.machine, what, wrong)
    content = {"run": str(run), "measured": str(measured), **comparison.summary()}
    if options.circle is not None:
        radius, centre = _circle(options.circle)
        content["circle"] = comparison.circle(radius, centre)
    with output_folder(folder, Output("comparison", _SUMMARY, (_SUMMARY, OVERLAY, SPECTRUM, REPORT))) as scratch:
        (scratch / _SUMMARY).write_text(json.dumps(content, indent=2, allow_nan=False) + "\n", encoding="utf-8")
        written = [_SUMMARY, *save_comparison(comparison, scratch), REPORT]
        write_comparison_page(scratch / REPORT, comparison, saved.job.name, measured.name, content.get("circle"))
    show(_table(comparison))
    if comparison.over_time:
        show(_over_time_table(comparison))
    if options.circle is not None:
        show(_circle_table(content["circle"]))
    say(headline(comparison), wrap=True)
    say(alignment_text(comparison), wrap=True)
    for peak in comparison.peaks:
        say(f"unexplained at {FREQUENCY.text(peak.frequency)}: {PEAK_SIZE.text(peak.rms)} rms")
    if saved.changed:
        warn(f"note: machine {saved.machine.name} has changed since the run")
    for note in (*comparison.notes, *([reason] if reason else [])):
        say(f"note: {note}", wrap=True)
    say(f"written to {folder}/: {', '.join(written)}")


def _trace(measured: Path, options: Log, run: Run) -> Trace:
    """Return the trace of a log, or of the record of a run."""
    from dataclasses import replace

    from gantrysim.compare.measured import Assignment, Trace
    from gantrysim.record.run import Run
    from gantrysim.record.run_file import RUN
    from gantrysim.tables.reading import read_table

    file = expanded_path(measured)
    record = file / RUN if file.is_dir() else file
    if record.suffix == ".npz":
        for option, value in (
            ("--columns", options.columns),
            ("--period", options.period),
            ("--blocks", options.blocks),
        ):
            if value:
                raise InputError(f"{option}: describes a log, {measured} is the record of a run")
        try:
            return Trace.of_run(Run.load(record), run)
        except InputError as error:
            raise InputError(f"--measured {measured}: {error}") from None
    given = Assignment({}) if options.columns is None else Assignment.parse(options.columns)
    if options.period is not None:
        given = replace(given, period=options.period)
    return Trace.of(read_table(measured, options.blocks or given.blocks), given, run)


def _contrast(saved: SavedRun) -> tuple[Run | None, str]:
    """Return the run of the machine without friction, or why there is none."""
    from gantrysim.compare.over_time import frictionless_run
    from gantrysim.job.code import named_code

    try:
        if code := named_code({"servo": {"law": saved.job.servo.law}}):
            # a folder may come from anyone: what it names is not run
            raise InputError(f"its servo is code of its own, {', '.join(code)}")
        return frictionless_run(saved.run, saved.machine, saved.job.built_servo), ""
    except InputError as error:
        return None, f"the machine without friction is not simulated beside the run: {error}"


def _circle(text: str) -> tuple[float, tuple[float, float]]:
    parts = text.split(",")
    if len(parts) not in (1, 3):
        raise InputError(f"--circle {text}: must be RADIUS or RADIUS,X,Y [mm]")
    radius, *centre = (finite_of("--circle", part, "mm") for part in parts)
    return radius, (centre[0], centre[1]) if centre else (0.0, 0.0)


def _table(comparison: Comparison) -> Table:
    from rich.table import Table

    from gantrysim.metrics.parts import ERROR

    table = Table(title="error normal to the path [µm]", title_justify="left", box=None, padding=(0, 1, 0, 0))
    table.add_column("link", no_wrap=True)
    for column in _HEADS:
        table.add_column(column, justify="right", no_wrap=True)
    table.add_column("span", overflow="fold")
    budgets = [budget.values for budget in (comparison.measured, comparison.simulated)]
    for name in (*comparison.parts, "contour"):
        cells = []
        for values in budgets:
            part = values.contour if name == "contour" else values.parts[name]
            cells += [part.rms, part.p95, part.max]
        difference = comparison.unexplained[name]
        numbers = map(ERROR.number, (*cells, difference.rms, difference.max))
        table.add_row(name, *numbers, comparison.parts.get(name, "requested path to the last link measured"))
    table.caption = "difference: of the errors at the same place, lateral and vertical"
    table.caption_justify = "left"
    return table


def _over_time_table(comparison: Comparison) -> Table:
    from rich.table import Table

    from gantrysim.compare.page import thousandths

    table = Table(title="over time, all samples", title_justify="left", box=None, padding=(0, 1, 0, 0))
    table.add_column("", no_wrap=True)
    for column in (*(head for head in _HEADS if "95 %" not in head), "no friction\nrms"):
        table.add_column(column, justify="right", no_wrap=True)
    for row in comparison.over_time:
        cells = [row.measured, row.simulated, row.difference]
        numbers = [thousandths(value) for size in cells for value in (size.rms, size.max)]
        wrong = "" if row.frictionless is None else thousandths(row.frictionless.rms)
        table.add_row(f"{row.axis} {row.quantity} \\[{row.unit}]", *numbers, wrong)
    if comparison.frictionless is not None:
        table.caption = "no friction: difference between the trace and the same machine without friction"
        table.caption_justify = "left"
    return table


def _circle_table(values: dict[str, dict[str, float]]) -> Table:
    from rich.table import Table

    table = Table(title="circular test", title_justify="left")
    table.add_column("value")
    for name in values:
        table.add_column(name, justify="right")
    for key in values["measured"]:
        table.add_row(key, *(f"{row[key]:.2f}" for row in values.values()))
    return table
