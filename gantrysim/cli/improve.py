"""The command `gantrysim improve`."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gantrysim.base.errors import InputError, expanded_path
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
    with_stop,
)
from gantrysim.cli.terminal import FAULT, count_bar, interruptible, say, show

if TYPE_CHECKING:
    from gantrysim.remedy.improvement import Improvement

Apply = Annotated[
    Path | None,
    typer.Option("--apply", metavar="FILE", help="Write the improved job to this TOML file, for gantrysim run FILE."),
]
Out = Annotated[
    Path | None,
    typer.Option(
        help="Folder for report.html, with the proposed changes and a comparison of the runs before and after."
    ),
]
WithFastest = Annotated[
    bool | None,
    typer.Option(
        "--fastest/--no-fastest",
        help="Also search for the fastest program that is as good as the best combination; on by default if the job "
        "has a tolerance.",
    ),
]
ByPlace = Annotated[
    bool | None,
    typer.Option(
        "--by-place/--no-by-place",
        help="Also search for a speed of each stretch of the program; on by default if the best combination passes and "
        "takes more than 5 % longer than the job. --apply and --out write the program.",
    ),
]
Threads = Annotated[
    int | None, typer.Option(metavar="N", help="Maximum number of threads; by default one for each core.")
]
OnlyLevers = Annotated[
    list[str] | None,
    typer.Option("--lever", metavar="NAME", help="Lever to try; repeat the option for several; by default all."),
]

_JOB_SUFFIX = ".toml"


def improve(
    job: JobArgument = "an225",
    model: Model = None,
    settings: Settings = None,
    servo: ServoFile = None,
    controller: Reader = None,
    speed: Speed = None,
    origin: At = None,
    rotate: Rotate = None,
    scale: Scale = None,
    z_down: ZDown = None,
    stop_after: StopAfter = None,
    apply: Apply = None,
    out: Out = None,
    fastest: WithFastest = None,
    by_place: ByPlace = None,
    lever: OnlyLevers = None,
    workers: Threads = None,
    allow_code: AllowCode = False,
) -> None:
    """Find out what to change in a job so that its verdict becomes a pass.

    Every lever that verdict and causes suggest is simulated alone, and then in the best combination: flow by speed, lag
    compensation and leads of the dispenser, laws and gains of the servo, acceleration, program loop, corner rounding,
    needle height, speed, and different hardware if settings are not enough. A table shows the effect of each lever on
    every row of the verdict, the duration of the run, and the cost of the lever; the lines to paste follow. If nothing
    meets the tolerance, a sentence states what prevents it.

    Exit status: 0, 2 for bad input, 3 for a run that ends in a fault, 130 after Ctrl-C.
    """
    from gantrysim.job.job import Job
    from gantrysim.remedy.improve import improve as improved

    file = None if apply is None else _file_of_job(apply)
    if out is not None:
        from gantrysim.compare.runs.runs_page import OUTPUT

        OUTPUT.check(out)
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
    loaded.check_fit()
    with interruptible() as go_on, count_bar("improve") as advance:

        def progress(done: int, known: int, name: str) -> None:
            go_on()
            advance(done, known, name)

        improvement = improved(
            loaded, levers=lever, workers=workers, fastest=fastest, by_place=by_place, progress=progress
        )
    is_whole = not improvement.verdict.fault
    written = list(_write_outputs(improvement, file, out)) if is_whole else []  # before anything is told
    _show(improvement)
    if not is_whole:
        raise typer.Exit(FAULT)
    for line in written:
        say(line)


def _write_outputs(improvement: Improvement, file: Path | None, out: Path | None) -> Iterator[str]:
    """Write the improved job and the page where they are wanted; yield what is said of each."""
    from gantrysim.base.files import replaced_file

    # which may be refused, before anything is written
    by_place = list(_written_by_place(improvement, file, out))
    if file is not None:
        with replaced_file(file) as partial:
            partial.write_text(improvement.job.toml(), encoding="utf-8")
        yield f"written to {file}: gantrysim run {file}"
    if out is not None and improvement.changes_anything:
        from gantrysim.remedy.report import write_improvement

        yield f"written to {write_improvement(improvement, out)}"
    elif out is not None:
        yield f"nothing is written to {out}/: there is no run to compare with"
    yield from by_place


def _written_by_place(improvement: Improvement, file: Path | None, out: Path | None) -> Iterator[str]:
    """Write the program with speeds by place beside the improved job and the page; yield what is said of it."""
    from gantrysim.remedy.by_place import BY_PLACE, SpeedByPlace, write_by_place

    by_place = improvement.by_place
    if not isinstance(by_place, SpeedByPlace):
        return
    stems = [file.with_name(f"{file.stem}-{BY_PLACE}")] if file is not None else []
    stems += [expanded_path(out) / BY_PLACE] if out is not None else []
    for stem in stems:
        job, *program = write_by_place(by_place, stem, improvement.base)
        yield f"written to {job}: gantrysim run {job}"
        yield from (f"written to {path}: the program for the controller" for path in program)
    if not stems:
        yield "speed by place: --apply FILE or --out FOLDER writes the program"


def _file_of_job(file: Path) -> Path:
    """Return the file to write a job to, or raise InputError for one that is no job file."""
    import tomllib

    from gantrysim.base.input_files import read_text

    path = expanded_path(file)
    if path.suffix != _JOB_SUFFIX:
        raise InputError(f"--apply {file}: must end in {_JOB_SUFFIX}, as a job file does")
    if not path.exists():
        return path
    try:
        content = tomllib.loads(read_text(path))
    except (OSError, tomllib.TOMLDecodeError, InputError):
        content = {}
    if "program" not in content:
        raise InputError(f"--apply {file}: exists and is not a job file; give another name")
    return path


def _show(improvement: Improvement) -> None:
    from gantrysim.cli.show import show_section
    from gantrysim.cli.tables import verdict_table
    from gantrysim.remedy.report import change_section

    if improvement.verdict.unjudged:
        say(str(improvement.verdict), wrap=True)
        say(improvement.sentence, wrap=True)
        return
    show(verdict_table(improvement.verdict))
    show_section(change_section(improvement).content())
    if improvement.changes_anything:
        show(verdict_table(improvement.improved))
