"""The command `gantrysim`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

import gantrysim
from gantrysim.bead import Bead
from gantrysim.budget import Budget
from gantrysim.errors import GantryError
from gantrysim.job import Job
from gantrysim.metrics import Analysis
from gantrysim.options import Model, Settings
from gantrysim.render.commands import render as render_command
from gantrysim.study.commands import study_app
from gantrysim.tables import links_table, outcome_table
from gantrysim.terminal import FAULT, INPUT_ERROR, INTERRUPTED, interruptible, say, share_bar, show, warn
from gantrysim.tuning.commands import tune
from gantrysim.view.commands import view

__all__ = ["app", "main"]


class _Commands(TyperGroup):
    """The commands, which say that they were interrupted: typer itself would end without a word."""

    def invoke(self, ctx: Any) -> Any:
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt as interrupt:
            warn(": ".join(["interrupted", *map(str, interrupt.args)]))
            raise typer.Exit(INTERRUPTED) from None


app = typer.Typer(
    cls=_Commands,
    add_completion=False,
    pretty_exceptions_enable=False,
    help="Simulate a gantry that lays glue, and see which link of its chain was how far off.",
)
app.add_typer(study_app, name="study")
app.command()(tune)
app.command("render")(render_command)
app.command()(view)


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
    model: Model = None,
    settings: Settings = None,
    servo: Annotated[
        Path | None,
        typer.Option(
            help="TOML file whose table \\[servo] is taken instead of the job's, as the tuned.toml of gantrysim tune."
        ),
    ] = None,
    video: Annotated[bool, typer.Option(help="Write video.mp4.")] = True,
    drawn: Annotated[bool, typer.Option("--report/--no-report", help="Write report.html and the plots.")] = True,
) -> None:
    """Run a job: simulate it, print its figures, and write record, plots, summary, report and video.

    Exit status: 0 after a whole run, 2 for bad input, 3 where a fault ended the run, 130 after Ctrl-C, which
    leaves the folder as it was.
    """
    from gantrysim import plots, render, report
    from gantrysim.page.run import headline, write_run_page

    loaded = Job.load(job, settings or (), model, servo)
    folder = out if out is not None else Path("out") / loaded.name
    no_video = None
    with interruptible("nothing is written") as go_on, report.output_folder(folder) as scratch:
        with share_bar("simulate", go_on) as advance:
            record = loaded.run(advance)
        analysis = Analysis(record)
        budget = Budget(analysis)
        bead = Bead(record, loaded.bead, analysis)
        laid = bead.figures if bead.nominal > 0 else None
        report.write_run(scratch, loaded, loaded.built_machine, budget, laid)
        if drawn:
            with share_bar("plot", go_on) as advance:
                plots.save_plots(analysis, scratch / report.PLOTS, bead=bead, progress=advance)
        if video:
            try:
                with share_bar("video", go_on) as advance:
                    render.save_video(
                        loaded.built_machine,
                        record,
                        scratch / report.VIDEO,
                        bead=loaded.bead,
                        label=loaded.name,
                        progress=advance,
                    )
            except render.NoOpenGLError as error:
                no_video = f"no video: {error}"
        if drawn:
            page, film = scratch / report.REPORT, scratch / report.VIDEO
            with share_bar("report", go_on) as advance:
                write_run_page(page, loaded, loaded.built_machine, bead, film, advance)
        written = sorted(item.name for item in scratch.iterdir() if item.is_file() or any(item.iterdir()))
    show(links_table(loaded.name, loaded.built_machine, budget))
    show(outcome_table(record, analysis.figures, laid))
    say(headline(budget), wrap=True)
    for note in loaded.notes:
        say(f"note: {note}")
    if no_video:
        warn(no_video)
    say(f"written to {folder}/: {', '.join(written)}")
    if record.fault is not None:
        warn(str(record.fault), "fault")
        raise typer.Exit(FAULT)


@app.command()
def info() -> None:
    """List the built-in machines and jobs, the settings of servo and glue, and the servo's gains that follow."""
    from gantrysim import info

    for table in (
        info.machines_table(),
        info.jobs_table(),
        info.settings_table(),
        info.glue_table(),
        info.gains_table(),
        info.margins_table(),
    ):
        show(table)


def main() -> None:
    """Run the command; bad input, in its words or in its values, is one line and exit status 2."""
    try:
        status = app(standalone_mode=False)
    except (GantryError, typer.TyperException) as error:
        text = error.format_message() if hasattr(error, "format_message") else str(error)
        warn(text, "error")
        status = INPUT_ERROR
    except OSError as error:
        where = f" ({error.filename})" if error.filename else ""
        warn(f"{error.strerror}{where}", "error")
        status = INPUT_ERROR
    sys.exit(status)
