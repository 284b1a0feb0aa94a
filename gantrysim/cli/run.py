"""The command `gantrysim run`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from gantrysim.cli.options import At, Model, Reader, Rotate, Scale, Settings, Speed, placement
from gantrysim.cli.terminal import FAULT, interruptible, say, share_bar, show, warn
from gantrysim.errors import InputError


def run(
    job: Annotated[str, typer.Argument(help="Built-in job, TOML file, or program file.")] = "an225",
    out: Annotated[Path | None, typer.Option(help="Output folder; by default out/ and the job's name.")] = None,
    model: Model = None,
    settings: Settings = None,
    servo: Annotated[
        Path | None,
        typer.Option(help="TOML file whose table \\[servo] replaces the job's, such as tuned.toml of gantrysim tune."),
    ] = None,
    causes: Annotated[
        bool, typer.Option("--causes", help="Run the job again with one cause of error at a time switched off.")
    ] = False,
    controller: Reader = None,
    speed: Speed = None,
    at: At = None,
    rotate: Rotate = None,
    scale: Scale = None,
    video: Annotated[bool, typer.Option(help="Write video.mp4.")] = True,
    with_report: Annotated[bool, typer.Option("--report/--no-report", help="Write report.html and the plots.")] = True,
) -> None:
    """Simulate a job, print its error budget, and write record, summary, plots, report and video.

    The error budget says where on the chain the error lies. With --causes, a second table says what caused it: the job
    is run again with one cause at a time switched off (program, sampling, counts, friction, winding, compliance), and
    the change of the error is what that cause is worth.

    Exit status: 0 for a complete run, 2 for bad input, 3 for a run that ended in a fault, 130 after Ctrl-C, which
    leaves the output folder unchanged.
    """
    from gantrysim.bead import Bead
    from gantrysim.cli.tables import causes_table, links_table, outcome_table
    from gantrysim.job.causes import causes_of
    from gantrysim.job.job import Job
    from gantrysim.metrics.analysis import Analysis
    from gantrysim.metrics.budget import Budget
    from gantrysim.plots import save_plots
    from gantrysim.render import NoOpenGLError, save_video
    from gantrysim.report.folder import PLOTS, REPORT, VIDEO, output_folder, write_run
    from gantrysim.report.headline import headline
    from gantrysim.report.page import write_run_page

    loaded = Job.load(
        job,
        settings or (),
        model,
        servo,
        controller=controller,
        placement=placement(at, rotate, scale),
        speed=speed,
    )
    machine = loaded.built_machine
    folder = out if out is not None else Path("out") / loaded.name
    no_video = None
    with interruptible("nothing is written") as go_on, output_folder(folder) as scratch:
        with share_bar("simulate", go_on) as advance:
            record = loaded.run(advance)
        if record.fault is not None and not record.dispense.any():
            raise InputError(f"nothing to evaluate, the run ended before the dispenser was on: {record.fault}")
        analysis = Analysis(record)
        budget = Budget(analysis)
        bead = Bead(record, loaded.bead, analysis)
        laid = bead.values if bead.nominal > 0 else None
        found = None
        if causes and record.fault is None:
            with share_bar("causes", go_on) as advance:
                found = causes_of(loaded, record, advance)
        write_run(scratch, loaded, machine, budget, laid, found)
        if with_report:
            with share_bar("plot", go_on) as advance:
                save_plots(analysis, scratch / PLOTS, bead=bead, progress=advance)
        if video:
            try:
                with share_bar("video", go_on) as advance:
                    save_video(machine, record, scratch / VIDEO, bead=loaded.bead, label=loaded.name, progress=advance)
            except NoOpenGLError as error:
                no_video = f"no video: {error}"
        if with_report:
            with share_bar("report", go_on) as advance:
                write_run_page(scratch / REPORT, loaded, machine, bead, scratch / VIDEO, advance, found)
        written = sorted(item.name for item in scratch.iterdir() if item.is_file() or any(item.iterdir()))
    show(links_table(loaded.name, machine, budget))
    if found is not None:
        show(causes_table(found))
    show(outcome_table(record, analysis.values, laid, loaded.margins))
    say(headline(budget), wrap=True)
    say(f"servo: {loaded.servo_reason}", wrap=True)
    for note in loaded.notes:
        say(f"note: {note}")
    if no_video:
        warn(no_video)
    say(f"written to {folder}/: {', '.join(written)}")
    if record.fault is not None:
        if causes:
            say("note: no causes, they are those of a complete run")
        warn(str(record.fault), "fault")
        raise typer.Exit(FAULT)
