"""The command `gantrysim study`."""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gantrysim.base import signals
from gantrysim.cli.options import AllowCode, JobArgument, Model, Settings, to_write
from gantrysim.cli.terminal import FAULT, INCOMPLETE, count_bar, interruptible, say, show, warn

if TYPE_CHECKING:
    from rich.console import RenderableType

    from gantrysim.report.document import Table
    from gantrysim.study.study import Report, Study

# a command of an answer that names the job in the study's folder
_OF_FOLDER = re.compile(r"(gantrysim (?:improve|study \w+)) (job\.toml)")

# options of every study
Out = Annotated[Path | None, typer.Option(callback=to_write, help="Output folder; by default out/STUDY-JOB.")]
Workers = Annotated[
    int | None,
    typer.Option(min=1, help="Number of parallel workers; by default, and at most, the number of cores."),
]
Backend = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="Where the cases run: loky (processes on this computer, the default), threading, or dask=ADDRESS (workers "
        "of the Dask cluster with the scheduler at ADDRESS).",
    ),
]
Tolerance = Annotated[
    float | None,
    typer.Option(help="Largest permitted value of the metric, in its unit; by default the job's own limits apply."),
]
Metric = Annotated[
    str | None,
    typer.Option(
        "--figure", help="Metric that the tolerance applies to, a column of study.csv; by default contour_max."
    ),
]
Seed = Annotated[int, typer.Option(min=0, help="Seed of the random numbers.")]

study_app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    help="Run a job many times with changed settings and report the effect on the bead.",
)


@study_app.callback()
def _main() -> None:
    """Make each study a subcommand, even if there is only one."""


def carry_out(
    study: Study,
    out: Path | None,
    workers: int | None,
    backend: str | None = None,
    write_more: Callable[[Path], None] | None = None,
) -> Path:
    """Run a study with a progress bar, print question, answer, table and the path of its page; return its folder.

    All is written before anything is printed, which may fail. `write_more` writes further files of a complete folder.

    Exit status 130 after Ctrl-C, with a hint on how to resume, 3 if faults left no case with values, and 1 without the
    report, if that failed.
    """
    from gantrysim.report.folder import REPORT
    from gantrysim.study.run import NoValuesError, StudyInterrupted, run_study
    from gantrysim.study.runner import on_backend

    folder = out if out is not None else Path("out") / f"{study.name}-{study.job.name}"
    try:
        with interruptible() as go_on, on_backend(backend), count_bar(study.name) as advance:

            def progress(done: int, every: int) -> None:
                go_on()
                advance(done, every, study.news)

            outcome = run_study(study, folder, workers=workers, progress=progress)
    except StudyInterrupted as interrupted:
        text = "interrupted: no case was finished, nothing is written"
        if interrupted.done:
            text = f"interrupted: the rows of {interrupted.done} finished cases are kept in {folder}/; "
            text += "run the same command again to resume"
        warn(text)
        raise typer.Exit(signals.status()) from None
    except NoValuesError as error:
        if not error.faulted:
            raise
        warn(str(error), "fault")
        raise typer.Exit(FAULT) from None
    if write_more is not None:
        write_more(folder)
    if outcome.discarded:
        warn(f"note: rows of another study in {folder}/ are discarded: {outcome.discarded}")
    if outcome.resumed:
        warn(f"note: resumed with the rows of {outcome.resumed} cases from an interrupted run")
    _say_report(outcome.report, folder)
    if outcome.failed is None:
        say(f"page: {folder / REPORT}")
    else:
        say(f"written to {folder}/: {', '.join(outcome.written)}")
        warn(f"no report: {outcome.failed}; repeat the command to make it, without running cases again", "error")
        raise typer.Exit(INCOMPLETE)
    return folder


def _say_report(report: Report, folder: Path) -> None:
    """Print question, answer and table; the details are on the page. Files of the folder are named from here."""
    say(report.question, wrap=True, end="\n\n")
    # the page lies beside the job's file, the reader of the terminal does not
    answer = _OF_FOLDER.sub(lambda match: f"{match[1]} {shlex.quote(str(folder / match[2]))}", report.answer)
    say(answer, wrap=True, end="\n\n")
    if report.table is not None:
        say(report.table.caption or "", wrap=True)
        show(_terminal_table(report.table))


def _terminal_table(table: Table) -> RenderableType:
    from rich.box import SIMPLE_HEAD
    from rich.markup import escape
    from rich.table import Table as TerminalTable

    shown = TerminalTable(box=SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
    columns = zip(*table.cells, strict=True)
    for head, numeric, cells in zip(table.heads, table.numeric, columns, strict=True):
        longest = max(len(word) for cell in (head, *cells) for word in cell.split())
        shown.add_column(escape(head), justify="right" if numeric else "left", min_width=longest)
    for row in table.cells:
        shown.add_row(*map(escape, row))
    return shown


@study_app.command()
def loop(
    job: JobArgument = "an225",
    out: Out = None,
    model: Model = None,
    settings: Settings = None,
    workers: Workers = None,
    backend: Backend = None,
    allow_code: AllowCode = False,
) -> None:
    """Find how fast the program loop and the servo must be, and how fine the encoder.

    Sweeps the loop period, interpreter time, servo period, encoder resolution and physics step, and compares the
    results with closed forms.
    """
    from gantrysim.job.job import Job
    from gantrysim.study.loop import LoopStudy

    carry_out(LoopStudy(Job.load(job, settings or (), model, allow_code=allow_code)), out, workers, backend)


@study_app.command()
def speed(
    job: JobArgument = "fanuc-spiral",
    tolerance: Tolerance = None,
    metric: Metric = None,
    out: Out = None,
    model: Model = None,
    settings: Settings = None,
    workers: Workers = None,
    backend: Backend = None,
    allow_code: AllowCode = False,
) -> None:
    """Find the fastest path speed at which a job stays within a tolerance.

    Sweeps two octaves on both sides of the programmed speed, then narrows the bracket. Faults count as out of
    tolerance.
    """
    from gantrysim.job.job import Job
    from gantrysim.study.speed import SpeedStudy

    carry_out(
        SpeedStudy(Job.load(job, settings or (), model, allow_code=allow_code), tolerance, metric),
        out,
        workers,
        backend,
    )


@study_app.command()
def machine(
    job: JobArgument = "fanuc-spiral",
    tolerance: Tolerance = None,
    metric: Metric = None,
    samples: Annotated[int, typer.Option(help="Number of machines.")] = 128,
    spread: Annotated[
        str,
        typer.Option(
            help="Spread of the machines: payload=KG, and for friction, viscous, stiffness and motor_constant a "
            "fraction, as in friction=0.5 for factors from 1/1.5 to 1.5; 0 for no variation."
        ),
    ] = "",
    seed: Seed = 1,
    out: Out = None,
    model: Model = None,
    settings: Settings = None,
    workers: Workers = None,
    backend: Backend = None,
    allow_code: AllowCode = False,
) -> None:
    """Estimate the yield of a job over many differing machines, and find the dominant factor.

    Every machine runs with the servo gains of the nominal one.
    """
    from gantrysim.job.job import Job
    from gantrysim.study.machine import MachineStudy, Tolerances

    loaded = Job.load(job, settings or (), model, allow_code=allow_code)
    carry_out(MachineStudy(loaded, tolerance, metric, samples, Tolerances.parse(spread), seed), out, workers, backend)


@study_app.command()
def circle(
    model: Annotated[str, typer.Option("--machine", help="Built-in machine, MJCF file or machine table.")] = "xy",
    radius: Annotated[float, typer.Option(help="Radius of the circle \\[mm].")] = 50.0,
    path_speed: Annotated[float, typer.Option("--speed", help="Path speed \\[mm/s].")] = 100.0,
    out: Out = None,
    settings: Settings = None,
    workers: Workers = None,
    backend: Backend = None,
) -> None:
    """Run a circle in both directions and draw the chart of the circular test, after ISO 230-4."""
    from gantrysim.study.circle import CircleStudy

    study = CircleStudy(model, radius, path_speed, tuple(settings or ()))
    carry_out(
        study, out if out is not None else Path("out") / f"circle-{study.job.built_machine.name}", workers, backend
    )


@study_app.command()
def repeat(
    job: JobArgument = "softmc-arc",
    repeats: Annotated[int, typer.Option(help="Number of repeats.")] = 10,
    friction: Annotated[float, typer.Option(help="Relative standard deviation of the friction.")] = 0.03,
    seed: Seed = 1,
    out: Out = None,
    model: Model = None,
    settings: Settings = None,
    workers: Workers = None,
    backend: Backend = None,
    allow_code: AllowCode = False,
) -> None:
    """Repeat a job with realistic variation: path accuracy and repeatability, after ISO 9283."""
    from gantrysim.job.job import Job
    from gantrysim.study.repeat import RepeatStudy

    loaded = Job.load(job, settings or (), model, allow_code=allow_code)
    carry_out(RepeatStudy(loaded, repeats=repeats, friction=friction, seed=seed), out, workers, backend)


@study_app.command()
def laws(
    job: JobArgument = "softmc-arc",
    payload: Annotated[float, typer.Option(help="Mass added to the machine for the sensitivity test \\[kg].")] = 0.5,
    friction: Annotated[float, typer.Option(help="Factor on the machine's friction for the sensitivity test.")] = 1.5,
    out: Out = None,
    model: Model = None,
    settings: Settings = None,
    workers: Workers = None,
    backend: Backend = None,
    allow_code: AllowCode = False,
) -> None:
    """Compare the servo's laws on a job, each against PD.

    Tracking, peaks at reversals, contour error, torque ripple, margins, and sensitivity to payload and friction.
    """
    from gantrysim.job.job import Job
    from gantrysim.study.laws import LawsStudy

    carry_out(
        LawsStudy(Job.load(job, settings or (), model, allow_code=allow_code), payload, friction), out, workers, backend
    )
