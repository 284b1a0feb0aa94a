"""The command `gantrysim run`."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gantrysim.base.errors import text_of
from gantrysim.cli.options import AllowCode, At, Model, Reader, Rotate, Scale, Settings, Speed, placement, to_write
from gantrysim.cli.terminal import FAULT, INCOMPLETE, interruptible, say, share_bar, show, warn

if TYPE_CHECKING:
    from gantrysim.job.job import Job
    from gantrysim.record.run import Run


def run(
    job: Annotated[str, typer.Argument(help="Built-in job, TOML file, or program file.")] = "an225",
    out: Annotated[
        Path | None, typer.Option(callback=to_write, help="Output folder; by default out/ and the job's name.")
    ] = None,
    model: Model = None,
    settings: Settings = None,
    servo: Annotated[
        Path | None,
        typer.Option(help="TOML file whose table \\[servo] replaces the job's, such as tuned.toml of gantrysim tune."),
    ] = None,
    causes: Annotated[
        bool, typer.Option("--causes", help="Run the job again with one cause of error at a time switched off.")
    ] = False,
    repeat: Annotated[
        int | None,
        typer.Option(help="Run the job so many times with other zeros of its encoders; print the figures' scatter."),
    ] = None,
    controller: Reader = None,
    speed: Speed = None,
    origin: At = None,
    rotate: Rotate = None,
    scale: Scale = None,
    video: Annotated[bool, typer.Option(help="Write video.mp4.")] = True,
    allow_code: AllowCode = False,
    with_report: Annotated[bool, typer.Option("--report/--no-report", help="Write report.html and the plots.")] = True,
) -> None:
    """Simulate a job, print its error budget, and write record, summary, plots, report and video.

    The error budget says where on the chain the error lies. With --causes, a second table says what caused it: the job
    is run again with one cause at a time switched off (program, sampling, counts, friction, winding, compliance), and
    the change of the error is what that cause is worth.

    Axes that stick and slip do so by where their encoders' counts fall: figures scatter from one start of the machine
    to the next. With --repeat, the job is run again with the zeros anywhere within a count, and a table gives mean and
    standard deviation of the figures beside those of the job.

    Exit status: 0 for a complete run, 1 if a plot, the report or the video failed while all else is written, 2 for bad
    input, 3 for a run that ended in a fault, 130 after Ctrl-C, which leaves the output folder unchanged.
    """
    from gantrysim.base.memory import LONG
    from gantrysim.job.causes import check_causes
    from gantrysim.job.cost import computing_time
    from gantrysim.job.job import Job
    from gantrysim.job.losses import events
    from gantrysim.job.scatter import check_repeats
    from gantrysim.job.steps import run_notes
    from gantrysim.report.folder import output_folder, write_fault

    loaded = Job.load(
        job,
        settings or (),
        model,
        servo,
        controller=controller,
        placement=placement(origin, rotate, scale),
        speed=speed,
        allow_code=allow_code,
    )
    machine = loaded.built_machine
    loaded.check_fit()
    if causes:
        check_causes(loaded)
    if repeat is not None:
        check_repeats(loaded, repeat)
    folder = out if out is not None else Path("out") / loaded.name
    shown: list[Callable[[], None]] = []
    failed: list[str] = []
    if (count := loaded.setpoints.run_ticks) > LONG:
        warn(f"note: {count:,} servo ticks, about {_lasting(computing_time(loaded))} of computing")
    with interruptible() as go_on, output_folder(folder) as scratch:
        with share_bar("simulate", go_on) as advance:
            record = loaded.run(advance)
        if record.fault is not None and not record.dispense.any():
            write_fault(scratch, loaded, machine, record)
            say("the run ended before the dispenser was on: there are no errors to evaluate")
            for event in events(record) if record.injected else ():
                say(event, wrap=True)
        else:
            shown = _evaluated(
                scratch,
                loaded,
                record,
                go_on,
                failed,
                causes=causes,
                repeat=repeat,
                video=video,
                with_report=with_report,
            )
        written = sorted(item.name for item in scratch.iterdir() if item.is_file() or any(item.iterdir()))
    for show_one in shown:
        show_one()
    say(f"servo: {loaded.servo_reason}", wrap=True)
    for note in run_notes(loaded, record):
        say(f"note: {note}")
    for text in failed:
        warn(text, "error")
    say(f"written to {folder}/: {', '.join(written)}")
    if record.fault is not None:
        if causes:
            say("causes skipped: the run ended in a fault")
        warn(str(record.fault), "fault")
        raise typer.Exit(FAULT)
    if failed:
        raise typer.Exit(INCOMPLETE)


def _lasting(seconds: float) -> str:
    return f"{seconds / 60:.0f} min" if seconds >= 60 else f"{seconds:.0f} s"


def _evaluated(
    scratch: Path,
    job: Job,
    record: Run,
    go_on: Callable[[], None],
    failed: list[str],
    *,
    causes: bool,
    repeat: int | None,
    video: bool,
    with_report: bool,
) -> list[Callable[[], None]]:
    """Write everything that follows from a record; return what is to be shown of it once it is in place.

    A plot, video or report that fails is told in `failed`; the rest is written.
    """
    from gantrysim.bead import Bead
    from gantrysim.cli.tables import causes_table, links_table, losses_table, outcome_table, scatter_table
    from gantrysim.job.causes import causes_of
    from gantrysim.job.losses import Losses
    from gantrysim.job.scatter import scatter_of, scatters
    from gantrysim.metrics.analysis import Analysis
    from gantrysim.metrics.budget import Budget
    from gantrysim.plots import save_plots
    from gantrysim.render import NoOpenGLError, save_video
    from gantrysim.render.encoding import NoEncoderError
    from gantrysim.report.folder import PLOTS, REPORT, SUMMARY, VIDEO, write_run
    from gantrysim.report.headline import headline
    from gantrysim.report.page import write_run_page
    from gantrysim.report.scatter import SCATTER_NOTE, add_to_summary

    machine = job.built_machine
    analysis = Analysis(record)
    budget = Budget(analysis)
    bead = Bead(record, job.bead, analysis)
    laid = bead.values if bead.nominal > 0 else None
    causes_found = losses = None
    shown: list[Callable[[], None]] = []
    if causes and record.fault is None:
        with share_bar("causes", go_on) as advance:
            causes_found = causes_of(job, record, advance)
    if record.injected:
        with share_bar("simulate without faults", go_on) as advance:
            healthy = job.without_faults().run(advance)
        losses = Losses.of(bead, Bead(healthy, job.bead)) if healthy.dispense.any() else None
    write_run(scratch, job, machine, budget, laid, causes_found, losses)
    scatter = None
    if repeat is not None and record.fault is None:
        with share_bar("repeat", go_on) as advance:
            scatter = scatter_of(job, repeat, record=record, progress=advance)
        add_to_summary(scratch / SUMMARY, scatter)

    @contextmanager
    def optional(kind: str) -> Iterator[None]:
        try:
            yield
        except (NoOpenGLError, NoEncoderError) as error:
            missing = f"no {kind}: {error}"
            shown.append(lambda: warn(missing))
        except Exception as error:
            go_on()
            failed.append(f"no {kind}: {text_of(error).replace(f'{scratch}/', '')}")

    if with_report:
        with optional("plot"), share_bar("plot", go_on) as advance:
            save_plots(budget, scratch / PLOTS, bead=bead, progress=advance)
    shown.append(lambda: show(links_table(job.name, machine, budget)))
    if losses is not None:
        cost = losses_table(record, losses)
        shown.append(lambda: show(cost))
    if causes_found is not None:
        table = causes_table(causes_found)
        shown.append(lambda: show(table))
    if scatter is not None:
        spread = scatter_table(scatter)
        shown.append(lambda: show(spread))
    elif record.fault is None and scatters(job):
        shown.append(lambda: say(SCATTER_NOTE, wrap=True))
    shown.append(lambda: show(outcome_table(record, analysis.values, laid, job.margins)))
    shown.append(lambda: say(headline(budget), wrap=True))
    if video:
        with optional("video"), share_bar("video", go_on) as advance:
            save_video(machine, record, scratch / VIDEO, bead=bead, label=job.name, progress=advance)
    if with_report:
        with optional("report"), share_bar("report", go_on) as advance:
            write_run_page(
                scratch / REPORT, job, machine, bead, scratch / VIDEO, advance, causes_found, losses, budget, scatter
            )
    return shown
