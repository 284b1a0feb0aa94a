"""The command `gantrysim study`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gantrysim.cli.options import Model, Settings
from gantrysim.cli.terminal import FAULT, INTERRUPTED, count_bar, interruptible, say, warn

if TYPE_CHECKING:
    from gantrysim.study.study import Study

# what every study's command takes
JobArgument = Annotated[str, typer.Argument(metavar="JOB", help="A built-in job or a TOML file.")]
Out = Annotated[
    Path | None, typer.Option(help="Folder to write into; by default out/, the study's name and the job's.")
]
Workers = Annotated[
    int | None,
    typer.Option(min=1, help="Cases run at once; by default, and at most, as many as there are cores."),
]
Backend = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="Where they run: loky, processes on this machine, is the default; threading; dask=ADDRESS, the workers of "
        "a Dask cluster, by its scheduler's address.",
    ),
]
Tolerance = Annotated[float, typer.Option(help="Largest value of the figure that will do, in its unit.")]
Figure = Annotated[str, typer.Option(help="Figure of a run that the tolerance is for, as study.csv names it.")]
Seed = Annotated[int, typer.Option(min=0, help="Of the random numbers.")]
_TOLERANCE = 50.0  # [µm]

study_app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    help="Run a job many times with something changed, and see what it does to the bead.",
)


@study_app.callback()
def _main() -> None:
    """Keep the studies' names words of the command, be there one or many."""


def carry_out(study: Study, out: Path | None, workers: int | None, backend: str | None = None) -> None:
    """Carry out a study with a progress bar, print its findings and say what was written.

    Exit status 130 where it is interrupted, with a word of how to go on, and 3 where faults have left no figures.
    """
    from gantrysim.study.backends import on_backend
    from gantrysim.study.checks import NoValuesError
    from gantrysim.study.study import StudyInterrupted, run_study

    folder = out if out is not None else Path("out") / f"{study.name}-{study.job.name}"
    try:
        with interruptible() as go_on, on_backend(backend), count_bar(study.name) as advance:

            def each(done: int, every: int) -> None:
                go_on()
                advance(done, every, getattr(study, "news", ""))

            outcome = run_study(study, folder, workers=workers, progress=each)
    except StudyInterrupted as interrupted:
        text = "interrupted: no case was finished, nothing is kept"
        if interrupted.done:
            text = f"interrupted: the rows of {interrupted.done} finished cases are kept in {folder}/; "
            text += "the same command goes on from there"
        warn(text)
        raise typer.Exit(INTERRUPTED) from None
    except NoValuesError as none:
        if not none.faulted:
            raise
        warn(str(none), "fault")
        raise typer.Exit(FAULT) from None
    if outcome.discarded:
        warn(f"note: {folder}/ held the rows of another start, which were not taken: {outcome.discarded}")
    if outcome.kept:
        warn(f"note: the rows of {outcome.kept} cases were there from an interrupted start")
    for paragraph in outcome.findings:
        say(paragraph, wrap=True, end="\n\n")
    say(f"written to {folder}/: {', '.join(outcome.written)}")


@study_app.command()
def loop(
    job: JobArgument = "an225",
    out: Out = None,
    model: Model = None,
    settings: Settings = None,
    workers: Workers = None,
    backend: Backend = None,
) -> None:
    """Show how fast the program's loop and the servo must be, and how fine the encoder.

    Sweeps the loop's period, the interpreter's time, the servo period, the encoder's resolution and the physics step,
    and holds what comes out against closed forms.
    """
    from gantrysim.job.job import Job
    from gantrysim.study.loop import LoopStudy

    carry_out(LoopStudy(Job.load(job, settings or (), model)), out, workers, backend)


@study_app.command()
def speed(
    job: JobArgument = "fanuc-spiral",
    tolerance: Tolerance = _TOLERANCE,
    figure: Figure = "contour_max",
    out: Out = None,
    model: Model = None,
    settings: Settings = None,
    workers: Workers = None,
    backend: Backend = None,
) -> None:
    """Find the fastest path speed at which a job keeps to a tolerance.

    Sweeps two octaves to both sides of the program's own speed, then narrows the bracket. Faults count as not within.
    """
    from gantrysim.job.job import Job
    from gantrysim.study.speed import SpeedStudy

    carry_out(SpeedStudy(Job.load(job, settings or (), model), tolerance, figure), out, workers, backend)


@study_app.command()
def machine(
    job: JobArgument = "fanuc-spiral",
    tolerance: Tolerance = _TOLERANCE,
    figure: Figure = "contour_max",
    samples: Annotated[int, typer.Option(help="Number of machines.")] = 128,
    spread: Annotated[
        str,
        typer.Option(
            help="How far machines differ: payload=KG, and for friction, viscous, stiffness and motor_constant a "
            "share, as in friction=0.5 for factors of 1/1.5 to 1.5; 0 for what does not differ."
        ),
    ] = "",
    seed: Seed = 1,
    out: Out = None,
    model: Model = None,
    settings: Settings = None,
    workers: Workers = None,
    backend: Backend = None,
) -> None:
    """Draw many machines that differ, and tell how many keep to a tolerance and what matters.

    The servo of each keeps the gains of the nominal machine.
    """
    from gantrysim.job.job import Job
    from gantrysim.study.machine import MachineStudy, Tolerances

    loaded = Job.load(job, settings or (), model)
    carry_out(MachineStudy(loaded, tolerance, figure, samples, Tolerances.parse(spread), seed), out, workers, backend)


@study_app.command()
def circle(
    model: Annotated[str, typer.Option("--machine", help="A built-in machine, or an MJCF file.")] = "xy",
    radius: Annotated[float, typer.Option(help="Of the circle [mm].")] = 50.0,
    path_speed: Annotated[float, typer.Option("--speed", help="Along it [mm/s].")] = 100.0,
    out: Out = None,
    settings: Settings = None,
    workers: Workers = None,
    backend: Backend = None,
) -> None:
    """Run a circle both ways and draw the circular-test chart, in the manner of ISO 230-4."""
    from gantrysim.study.circle import CircleStudy

    study = CircleStudy(model, radius, path_speed, tuple(settings or ()))
    carry_out(
        study, out if out is not None else Path("out") / f"circle-{study.job.built_machine.name}", workers, backend
    )


@study_app.command()
def repeat(
    job: JobArgument = "softmc-arc",
    repeats: Annotated[int, typer.Option(help="Number of repeats.")] = 10,
    friction: Annotated[float, typer.Option(help="Scatter of the friction, a standard deviation, relative.")] = 0.03,
    seed: Seed = 1,
    out: Out = None,
    model: Model = None,
    settings: Settings = None,
    workers: Workers = None,
    backend: Backend = None,
) -> None:
    """Repeat a job as real repeats differ: path accuracy and repeatability, in the manner of ISO 9283."""
    from gantrysim.job.job import Job
    from gantrysim.study.repeat import RepeatStudy

    loaded = Job.load(job, settings or (), model)
    carry_out(RepeatStudy(loaded, repeats=repeats, friction=friction, seed=seed), out, workers, backend)
