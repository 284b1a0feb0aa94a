"""The command `gantrysim run`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from gantrysim.bead import Bead
from gantrysim.cli.options import Model, Settings
from gantrysim.cli.tables import links_table, outcome_table
from gantrysim.cli.terminal import FAULT, interruptible, say, share_bar, show, warn
from gantrysim.job.job import Job
from gantrysim.metrics.analysis import Analysis
from gantrysim.metrics.budget import Budget


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
    from gantrysim import plots, render
    from gantrysim.report import folder as report
    from gantrysim.report.page import headline, write_run_page

    loaded = Job.load(job, settings or (), model, servo)
    folder = out if out is not None else Path("out") / loaded.name
    no_video = None
    with interruptible("nothing is written") as go_on, report.output_folder(folder) as scratch:
        with share_bar("simulate", go_on) as advance:
            record = loaded.run(advance)
        analysis = Analysis(record)
        budget = Budget(analysis)
        bead = Bead(record, loaded.bead, analysis)
        laid = bead.values if bead.nominal > 0 else None
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
    show(outcome_table(record, analysis.values, laid))
    say(headline(budget), wrap=True)
    for note in loaded.notes:
        say(f"note: {note}")
    if no_video:
        warn(no_video)
    say(f"written to {folder}/: {', '.join(written)}")
    if record.fault is not None:
        warn(str(record.fault), "fault")
        raise typer.Exit(FAULT)
