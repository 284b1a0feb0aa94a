"""The command `gantrysim check`."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gantrysim.cli.options import (
    AllowCode,
    At,
    JobArgument,
    Model,
    Reader,
    Rotate,
    Scale,
    Settings,
    Speed,
    StopAfter,
    ZDown,
    placement,
    with_stop,
)
from gantrysim.cli.terminal import say, show, stage

if TYPE_CHECKING:
    from gantrysim.job.job import Job


def check(
    job: JobArgument,
    model: Model = None,
    settings: Settings = None,
    controller: Reader = None,
    speed: Speed = None,
    origin: At = None,
    rotate: Rotate = None,
    scale: Scale = None,
    z_down: ZDown = None,
    stop_after: StopAfter = None,
    allow_code: AllowCode = False,
) -> None:
    """Read and plan a job or a program file without simulating it: length, time, extents, ignored words.

    If a program leaves the travel or is faster than the machine, its extents are shown before it is refused.

    Exit status: 0 for a program that the machine can run, 2 for one that is refused, with file and line.
    """
    from gantrysim.base.errors import InputError
    from gantrysim.cli.tables import plan_table
    from gantrysim.job.job import Job
    from gantrysim.job.plan import glue_note, speed_note

    with stage("program"):
        loaded = Job.load(
            job,
            with_stop(settings, stop_after),
            model,
            controller=controller,
            placement=placement(origin, rotate, scale, z_down),
            speed=speed,
            allow_code=allow_code,
        )
        try:
            plan = loaded.plan()
        except InputError:
            _show_extents(loaded)
            raise
    show(plan_table(loaded.name, plan))
    for fault in loaded.faults:
        say(f"deliberate fault: {fault}", wrap=True)
    shortfall = None if speed is None else speed_note(plan, speed)
    for note in filter(None, (*loaded.notes, glue_note(plan), shortfall)):
        say(f"note: {note}")


def _show_extents(job: Job) -> None:
    """Show what a refused job would command, where that can be computed."""
    from gantrysim.base.errors import InputError
    from gantrysim.cli.tables import plan_table
    from gantrysim.job.plan import plan_of

    name = job.program["controller"]
    try:
        plan = plan_of(job.built_machine, name, job.setpoints, job.controller, is_checked=False)
    except InputError:
        return
    show(plan_table(job.name, plan))
