"""The command `gantrysim view`."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Annotated

import typer

from gantrysim.cli.options import Colour, Model, Settings
from gantrysim.cli.terminal import FAULT, warn
from gantrysim.errors import InputError, positive

if TYPE_CHECKING:
    from gantrysim.job.job import Job
    from gantrysim.run import Fault


def view(
    shown: Annotated[
        str,
        typer.Argument(
            metavar="RUN_DIR|JOB",
            help="Folder of a run, to be replayed; or a built-in job or a TOML file, to be run live.",
            show_default=False,
        ),
    ],
    camera: Annotated[
        str | None,
        typer.Option(help="overview, top, side or nozzle; by default overview, or all of a machine that has none."),
    ] = None,
    colour: Colour = "plain",
    speed: Annotated[float, typer.Option(help="Seconds of the run in a second.")] = 1.0,
    model: Model = None,
    settings: Settings = None,
) -> None:
    """Open MuJoCo's viewer on a saved run that plays, or on a job that runs live, with the bead growing.

    A live run may be pushed: a double click chooses a body, Ctrl and a drag with the right button pushes it, with the
    left one twists it.

    Keys: Space pauses and goes on; Left and Right go a second back and forward in a saved run; Up and Down double and
    halve the speed; Home or Backspace go to the start, and run a job anew; [ and ] change the camera, Esc frees it; F1
    lists the viewer's own.

    Exit status: 0 when the window is closed, 2 for bad input or where there is no display, 3 where a fault ended a live
    run, 130 after Ctrl-C.
    """
    from gantrysim.job.job import Job
    from gantrysim.view.display import check_display

    positive("speed", speed)
    folder = Path(shown).expanduser()
    saved = _is_saved(shown, folder)
    if saved and (model is not None or settings):
        raise InputError(f"run {shown}: is replayed as it was; --model and --set are for a job that runs live")
    check_display()
    fault = None
    if saved:
        _replay(folder, camera, colour, speed)
    else:
        fault = _live(Job.load(shown, settings or (), model), camera, colour, speed)
    if fault is not None:
        warn(str(fault), "fault")
        raise typer.Exit(FAULT)


def _is_saved(shown: str, folder: Path) -> bool:
    """Return whether a folder is meant, or a job."""
    from gantrysim.job.job import builtin_jobs
    from gantrysim.report.folder import RUN

    if folder.is_file():  # a job, or by mistake another file of a run
        return folder.suffix != ".toml" and (folder.parent / RUN).is_file()
    return (folder / RUN).is_file() or (folder.is_dir() and shown not in builtin_jobs())


def _replay(folder: Path, camera: str | None, colour: str, speed: float) -> None:
    from gantrysim.render.scene import Scene
    from gantrysim.report.saved import SavedRun
    from gantrysim.view.player import Player
    from gantrysim.view.source import Replay
    from gantrysim.view.window import ViewerWindow, WindowClosedError

    saved = SavedRun.load(folder)
    if saved.changed:
        warn(f"machine {saved.machine.name} has changed since it ran: what is shown of it is as it is now")
    scene = Scene(saved.machine, saved.run, saved.job.bead, colour=colour)
    with suppress(WindowClosedError), _undisturbed() as stopped:
        window = ViewerWindow(scene, camera)
        try:
            Player(saved.job.name, scene, Replay(saved.run), window, speed=speed).play(stopped)
        finally:
            window.close()


def _live(job: Job, camera: str | None, colour: str, speed: float) -> Fault | None:
    from gantrysim.engine.simulation import Simulation
    from gantrysim.render.colours import scale_for
    from gantrysim.render.scene import Scene
    from gantrysim.view.player import Player
    from gantrysim.view.push import STIFFNESS, Bodies
    from gantrysim.view.source import Live
    from gantrysim.view.window import ViewerWindow, WindowClosedError

    machine = job.built_machine
    simulation = Simulation.of(
        machine,
        job.built_servo,
        job.setpoints,
        physics_step=job.simulation.physics_step,
        dispenser=job.dispenser,
    )
    # the bead needs as many rings as one laid without error, and the colours a scale that fits the run to come
    follower = job.follow()
    scale = scale_for(colour, [follower if colour == "plain" else job.run()], [job.bead])
    scene = Scene(machine, follower, job.bead, colour=colour, scale=scale)
    scene.model.vis.map.stiffness = max(scene.model.vis.map.stiffness, STIFFNESS)
    bodies = Bodies(scene.model, simulation.model)
    with suppress(WindowClosedError), _undisturbed() as stopped:
        window = ViewerWindow(scene, camera)
        try:
            player = Player(job.name, scene, Live(simulation), window, bodies=bodies, speed=speed)
            return player.play(stopped)
        finally:
            window.close()
    return None


@contextmanager
def _undisturbed() -> Iterator[Callable[[], bool]]:
    """Hold Ctrl-C and a polite kill back until the block's end; what is given tells whether one came.

    An exception in the midst of opening or closing a window would leave its thread to draw what is freed.
    """
    came = False

    def remember(_number: int, _frame: FrameType | None) -> None:
        nonlocal came
        came = True

    before = {number: signal.signal(number, remember) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield lambda: came
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    if came:
        raise KeyboardInterrupt
