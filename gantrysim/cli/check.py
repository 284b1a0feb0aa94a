"""The command `gantrysim check`."""

from __future__ import annotations

from typing import Annotated

import typer

from gantrysim.cli.options import AllowCode, At, Model, Reader, Rotate, Scale, Settings, Speed, placement
from gantrysim.cli.terminal import say, show, stage


def check(
    job: Annotated[str, typer.Argument(help="Built-in job, TOML file, or program file.", show_default=False)],
    model: Model = None,
    settings: Settings = None,
    controller: Reader = None,
    speed: Speed = None,
    origin: At = None,
    rotate: Rotate = None,
    scale: Scale = None,
    allow_code: AllowCode = False,
) -> None:
    """Read and plan a job or a program file without simulating it: length, time, extents, what was ignored.

    Exit status: 0 for a program that its machine can run, 2 for one that is refused, with file and line.
    """
    from gantrysim.cli.tables import plan_table
    from gantrysim.job.job import Job

    with stage("program"):
        loaded = Job.load(
            job,
            settings or (),
            model,
            controller=controller,
            placement=placement(origin, rotate, scale),
            speed=speed,
            allow_code=allow_code,
        )
        plan = loaded.plan()
    show(plan_table(loaded.name, plan))
    for fault in loaded.faults:
        say(f"fault on purpose: {fault}", wrap=True)
    for note in loaded.notes:
        say(f"note: {note}")
