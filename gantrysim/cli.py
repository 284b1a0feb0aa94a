"""The command `gantrysim`."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

import gantrysim
from gantrysim.bead import Bead, BeadFigures
from gantrysim.errors import GantryError
from gantrysim.job import Job
from gantrysim.metrics import THOUSANDTH, Analysis, Figures, Spread
from gantrysim.run import Run
from gantrysim.study.commands import study_app

__all__ = ["app", "main"]

_INPUT_ERROR = 2
_FAULT = 3

app = typer.Typer(
    add_completion=False,
    pretty_exceptions_enable=False,
    help="Simulate a gantry that lays glue, and see which link of its chain was how far off.",
)
app.add_typer(study_app, name="study")
_output = Console(soft_wrap=False)
_messages = Console(stderr=True)


@app.callback(invoke_without_command=True)
def _main(
    context: typer.Context,
    version: Annotated[bool, typer.Option("--version", help="Print the version and stop.")] = False,
) -> None:
    if version:
        typer.echo(gantrysim.__version__)
    elif context.invoked_subcommand is None:
        typer.echo(context.get_help())


@app.command()
def run(
    job: Annotated[str, typer.Argument(help="A built-in job or a TOML file.")] = "an225",
    out: Annotated[Path | None, typer.Option(help="Folder to write into; by default out/ and the job's name.")] = None,
    model: Annotated[
        str | None, typer.Option(help="Machine to take instead of the job's: a name or an MJCF file.")
    ] = None,
    settings: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="Change a value of the job, as in --set loop_period=0.01."),
    ] = None,
    video: Annotated[bool, typer.Option(help="Write video.mp4.")] = True,
) -> None:
    """Run a job: simulate it, print its figures, and write record, plots, summary, report and video.

    Exit status: 0 after a whole run, 2 for bad input, 3 where a fault ended the run.
    """
    from gantrysim import plots, render, report
    from gantrysim.page.run import write_run_page

    loaded = Job.load(job, settings or (), model)
    folder = out if out is not None else Path("out") / loaded.name
    no_video = None
    with report.output_folder(folder) as scratch:
        with _progress("simulate") as advance:
            record = loaded.run(advance)
        analysis = Analysis(record)
        bead = Bead(record, loaded.bead, analysis)
        laid = bead.figures if bead.nominal > 0 else None
        report.write_run(scratch, loaded, loaded.built_machine, record, analysis.figures, laid)
        with _progress("plot") as advance:
            plots.save_plots(analysis, scratch / report.PLOTS, bead=bead, progress=advance)
        if video:
            try:
                with _progress("video") as advance:
                    render.save_video(
                        loaded.built_machine, record, scratch / report.VIDEO, bead=loaded.bead, progress=advance
                    )
            except render.NoOpenGLError as error:
                no_video = f"no video: {error}"
        with _progress("report") as advance:
            write_run_page(scratch / report.REPORT, loaded, loaded.built_machine, bead, scratch / report.VIDEO, advance)
        written = sorted(item.name for item in scratch.iterdir())
    _output.print(*_tables(loaded, record, analysis.figures, laid), sep="\n")
    for note in loaded.notes:
        _output.print(escape(f"note: {note}"), soft_wrap=True, highlight=False)
    if no_video:
        _messages.print(escape(no_video), soft_wrap=True, highlight=False)
    _output.print(escape(f"written to {folder}/: {', '.join(written)}"), soft_wrap=True, highlight=False)
    if record.fault is not None:
        _messages.print(f"[bold red]fault[/]: {escape(str(record.fault))}", soft_wrap=True, highlight=False)
        raise typer.Exit(_FAULT)


@app.command()
def info() -> None:
    """List the built-in machines and jobs, and the servo's settings with the gains that follow from them."""
    from gantrysim import info

    for table in (info.machines_table(), info.jobs_table(), info.settings_table(), info.gains_table()):
        _output.print(table)


@contextmanager
def _progress(task: str) -> Iterator[Callable[[float], None]]:
    columns = (
        TextColumn("{task.description:9}"),
        BarColumn(),
        TextColumn("{task.percentage:3.0f} %"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=_messages, transient=True, disable=not _messages.is_terminal) as progress:
        bar = progress.add_task(task, total=1.0)
        yield lambda share: progress.update(bar, completed=share)


def _tables(job: Job, run: Run, result: Figures, bead: BeadFigures | None = None) -> tuple[Table, Table]:
    """The chain's links from top to bottom, each with its error; and what came out at its end."""
    until = "" if run.fault is None else ", until the fault"
    title = escape(f"{job.name} on {run.machine}: error of each link of the chain{until}")
    links = Table(title=title, title_justify="left")
    links.add_column("link", no_wrap=True)
    links.add_column("rms [µm]", justify="right")
    links.add_column("max [µm]", justify="right")
    links.add_column("from one end of the link to the other")

    def add(label: str, spread: Spread, note: str, unit: str = "") -> None:
        links.add_row(label, f"{1e3 * spread.rms:.1f}{unit}", f"{1e3 * spread.max:.1f}{unit}", note)

    add("generation", result.generation, "requested path to commanded")
    for unit, (name, spread) in zip(run.units, result.tracking.items(), strict=True):
        own = "" if unit == "mm" else f" {THOUSANDTH[unit]}"  # not the columns' unit
        add(f"tracking {name}", spread, "commanded to encoder", own)
    add("tracking along", result.tracking_along, "the same along the path")
    links.add_section()
    add("contour", result.contour, "requested path to nozzle")

    outcome = Table.grid(padding=(0, 2))
    if result.spacing is not None:
        s = result.spacing
        asked = f"std {s.std:.4f}, {s.min:.4f} to {s.max:.4f}"
        if run.requested.turn_spacing is not None:
            asked = f"asked for {run.requested.turn_spacing:g}, {asked}"
        outcome.add_row("spacing of turns", f"{s.mean:.4f} mm", asked)
    v = result.speed
    outcome.add_row("path speed", f"{v.mean:.2f} mm/s", f"{v.min:.2f} to {v.max:.2f}")
    outcome.add_row("path length", f"{result.path_length:.3f} mm", f"in {result.duration:.3f} s{until}")
    outcome.add_row("end point", "", "x {:.4f}, y {:.4f}, z {:.4f} mm".format(*result.end_point))
    if bead is not None:
        _add_bead(outcome, bead)
    return links, outcome


def _add_bead(outcome: Table, bead: BeadFigures) -> None:
    width = bead.width
    outcome.add_row(
        "bead's width",
        f"{width.mean:.3f} mm",
        f"{width.min:.3f} to {width.max:.3f}; section asked for {bead.nominal:.3f} mm²",
    )
    if bead.clearance is not None and bead.coverage is not None:
        between = "gap" if bead.clearance.mean > 0 else "overlap"
        covered = f"{bead.clearance.min:.3f} to {bead.clearance.max:.3f}; {100 * bead.coverage:.1f} % covered"
        outcome.add_row(f"{between} of turns", f"{abs(bead.clearance.mean):.3f} mm", f"clearance {covered}")
    stop = "" if bead.stop is None else f", {bead.stop.mean:+.2f} mm at the stop"
    outcome.add_row("glue late by", f"{bead.start.mean:+.2f} mm", f"at the start{stop}")
    outcome.add_row("volume", f"{bead.laid:.1f} mm³", f"{bead.error_percent:+.2f} % of {bead.asked:.1f} asked for")


def main() -> None:
    """Run the command; bad input, in its words or in its values, is one line and exit status 2."""
    try:
        status = app(standalone_mode=False)
    except (GantryError, typer.TyperException) as error:
        text = error.format_message() if hasattr(error, "format_message") else str(error)
        _messages.print(f"[bold red]error[/]: {escape(text)}", soft_wrap=True, highlight=False)
        status = _INPUT_ERROR
    except OSError as error:
        where = f" ({error.filename})" if error.filename else ""
        _messages.print(f"[bold red]error[/]: {escape(f'{error.strerror}{where}')}", soft_wrap=True, highlight=False)
        status = _INPUT_ERROR
    sys.exit(status)
