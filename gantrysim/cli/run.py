"""The command `gantrysim run`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from gantrysim.cli.options import (
    AllowCode,
    At,
    JobArgument,
    Model,
    Reader,
    Rotate,
    Scale,
    ServoFile,
    Settings,
    Speed,
    StopAfter,
    ZDown,
    placement,
    to_write,
    with_stop,
)
from gantrysim.cli.terminal import FAULT, INCOMPLETE, OUT_OF_TOLERANCE, interruptible, say, share_bar, stage, warn

if TYPE_CHECKING:
    from gantrysim.cli.evaluation import Evaluation, Wanted
    from gantrysim.job.job import Job
    from gantrysim.record.run import Run

WithCauses = Annotated[
    bool | None,
    typer.Option(
        "--causes/--no-causes",
        help="Rerun the job with one cause of error switched off at a time; on by default unless the run is long.",
    ),
]
WithChanges = Annotated[
    bool | None,
    typer.Option(
        "--improve/--no-improve",
        help="Simulate changes that may improve the two worst rows of the verdict; on by default unless the verdict "
        "is a pass or the run is long.",
    ),
]
Repeat = Annotated[
    int | None,
    typer.Option(
        help="Rerun the job this many times with shifted encoder zeros, and print the scatter of the results."
    ),
]

FailOn = Annotated[
    Literal["fail", "warn"] | None,
    typer.Option(help="Exit with status 4 if the verdict is fail; with warn, also if it is a warning."),
]

Verbose = Annotated[
    bool,
    typer.Option("--verbose", "-v", help="Print everything: error budget, figures, causes, notes and levers."),
]


def run(
    job: JobArgument = "an225",
    out: Annotated[
        Path | None, typer.Option(callback=to_write, help="Output folder; by default out/NAME, with the job's name.")
    ] = None,
    model: Model = None,
    settings: Settings = None,
    servo: ServoFile = None,
    causes: WithCauses = None,
    improve: WithChanges = None,
    repeat: Repeat = None,
    controller: Reader = None,
    speed: Speed = None,
    origin: At = None,
    rotate: Rotate = None,
    scale: Scale = None,
    z_down: ZDown = None,
    stop_after: StopAfter = None,
    video: Annotated[bool, typer.Option(help="Write video.mp4.")] = True,
    allow_code: AllowCode = False,
    with_report: Annotated[bool, typer.Option("--report/--no-report", help="Write report.html and the plots.")] = True,
    fail_on: FailOn = None,
    verbose: Verbose = False,
) -> None:
    """Simulate a job, print verdict, error budget and causes, and write record, summary, plots, report and video.

    The verdict compares path, glue, stability and machine with their tolerances: those in the job's table
    tolerance, and defaults from machine, needle and bead.

    The error budget shows where in the chain the error arises. A second table shows its causes: the job is rerun with
    one cause switched off at a time (program, sampling, counts, friction, winding, compliance), and the change of the
    error is the effect of that cause. Unless the verdict is a pass, changes that may improve its two worst rows are
    simulated, as by gantrysim improve, and the lines to paste are printed. Causes and improvements are skipped for a
    run with deliberate faults and for one that a fault ended.

    Axes with stick-slip depend on where their encoders' counts fall, so results scatter from one start of the machine
    to the next. With --repeat, the job is rerun with the encoder zeros shifted within a count, and a table lists mean
    and standard deviation of the results beside those of the job.

    Exit status: 0 for a complete run, 1 if a plot, the report or the video failed but all else was written, 2 for bad
    input, 3 for a run that ended in a fault, 4 for a verdict that --fail-on names, 130 after Ctrl-C, which leaves the
    output folder unchanged before the simulation is complete, and keeps its record and summary from then on.
    """
    from gantrysim.base.signals import ending_at_once

    with ending_at_once():
        from gantrysim.cli.evaluation import Wanted
        from gantrysim.job.job import Job
        from gantrysim.job.plan import speed_note

    with stage("program"):
        loaded = Job.load(
            job,
            with_stop(settings, stop_after),
            model,
            servo,
            controller=controller,
            placement=placement(origin, rotate, scale, z_down),
            speed=speed,
            allow_code=allow_code,
        )
        shortfall = None if speed is None else speed_note(loaded.plan(), speed)
    if shortfall:
        warn(f"note: {shortfall}")
    folder = out if out is not None else Path("out") / loaded.name
    simulate_and_show(loaded, folder, Wanted(causes, repeat, video, with_report, fail_on, improve, verbose))


def simulate_and_show(job: Job, folder: Path, wanted: Wanted) -> None:
    """Run a job, write record and summary, print its results as they become known, and write what is drawn of them.

    Raises:
        InputError: a job that does not fit its machine, or whose causes or scatter cannot be had.
        typer.Exit: with the status of `gantrysim run`, unless that is 0.
    """
    from gantrysim.base.memory import LONG_RUN
    from gantrysim.cli.evaluation import Evaluation, computing_time
    from gantrysim.job.causes import check_causes
    from gantrysim.job.scatter import check_repeats
    from gantrysim.report.folder import REPORT, RUN_OUTPUT, write_fault

    with stage("plan"):
        job.check_fit()
    if wanted.causes:
        check_causes(job)
    if wanted.repeat is not None:
        check_repeats(job, wanted.repeat)
    ticks = job.setpoints.run_ticks
    if ticks > LONG_RUN:
        warn(f"note: {ticks:,} servo ticks, about {_lasting(computing_time(job))} of computing")
    evaluation = None
    with interruptible() as go_on, RUN_OUTPUT.held(folder):
        with RUN_OUTPUT.written(folder) as scratch:
            with share_bar("simulate", go_on) as advance:
                record = job.run(advance)
            if record.fault is not None and not record.dispense.any():
                write_fault(scratch, job, job.built_machine, record)
            else:
                evaluation = Evaluation(job, record, wanted, go_on)
                evaluation.write_record(scratch)
        if evaluation is None:
            _show_early_fault(record)
        else:
            _show_and_draw(evaluation, folder)
        written = RUN_OUTPUT.names_in(folder)
    failed = [] if evaluation is None else evaluation.failed
    for text in failed:
        warn(text, "error")
    say(f"written to {folder}/: {', '.join(written)}")
    if evaluation is not None and not wanted.verbose:
        say(f"more: gantrysim show {folder} budget causes figures levers notes", wrap=True)
    if REPORT in written:
        say(str(folder / REPORT))
    fault = str(record.fault) if record.fault is not None else evaluation.results.verdict.stall if evaluation else ""
    if fault:
        warn(fault, "fault")
        raise typer.Exit(FAULT)
    if evaluation is not None and wanted.refuses(evaluation.results.verdict.state):
        raise typer.Exit(OUT_OF_TOLERANCE)
    if failed:
        raise typer.Exit(INCOMPLETE)


def _show_and_draw(evaluation: Evaluation, folder: Path) -> None:
    """Print the results of a run whose record is written, write what is drawn of it, and look for what to change.

    Raises:
        KeyboardInterrupt: an interrupt, which leaves what is written.
    """
    from gantrysim.base.files import ReplacedError
    from gantrysim.report.folder import CHANGED_OUTPUT, SHOWN_OUTPUT

    try:
        evaluation.find(folder)
        with SHOWN_OUTPUT.written(folder) as scratch:
            evaluation.write(scratch)
        if evaluation.propose(folder):
            with CHANGED_OUTPUT.written(folder) as scratch:
                evaluation.write_proposal(scratch, folder)
        if evaluation.wanted.verbose:
            evaluation.show_details()
    except ReplacedError:
        raise
    except KeyboardInterrupt:
        raise KeyboardInterrupt(f"the run is complete, what is known of it is in {folder}/") from None


def _show_early_fault(record: Run) -> None:
    """Print what happened in a run that a fault ended before its dispenser was on."""
    from gantrysim.job.losses import events
    from gantrysim.results.verdict import Verdict

    say(str(Verdict.of_fault(record)), wrap=True)
    say("the run ended before the dispenser was on: there are no errors to evaluate")
    for event in events(record) if record.injected else ():
        say(event, wrap=True)


def _lasting(seconds: float) -> str:
    return f"{seconds / 60:.0f} min" if seconds >= 60 else f"{seconds:.0f} s"
