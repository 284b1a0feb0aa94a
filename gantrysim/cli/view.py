"""The command `gantrysim view`."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gantrysim.base.errors import InputError, expanded_path, positive
from gantrysim.base.signals import deferred
from gantrysim.cli.options import AllowCode, Camera, Colour, Model, Settings
from gantrysim.cli.terminal import FAULT, warn

if TYPE_CHECKING:
    from gantrysim.job.job import Job
    from gantrysim.record.run_file import Fault
    from gantrysim.render.view.source import Playback

_PLAIN_COLOUR = "plain"  # colour of the bead: `gantrysim.render.colours.PLAIN`, which takes long to import


def view(
    shown: Annotated[
        str,
        typer.Argument(
            metavar="RUN_DIR|JOB",
            help="Folder of a run to replay; or a built-in job or TOML file to run live.",
            show_default=False,
        ),
    ],
    camera: Camera = None,
    colour: Colour = None,
    speed: Annotated[float, typer.Option(help="Seconds of the run per second.")] = 1.0,
    model: Model = None,
    settings: Settings = None,
    allow_code: AllowCode = False,
) -> None:
    """Open a window to replay a saved run or to run a job live, with the growing bead.

    Drag with the left button to turn the view, with the right one to move it; the wheel zooms.

    The machine of a live run can be disturbed: double-click a body to select it, then hold Ctrl and drag with the right
    button to push it, or with the left button to twist it.

    Keys: Space pauses and resumes; Left and Right jump by one second in a saved run; Up doubles and Down halves the
    speed; Home or Backspace returns to the start of a saved run or restarts a live one; [ and ] switch the camera, Esc
    frees it.

    Exit status: 0 when the window is closed, 2 for bad input or without a display, 3 if a fault ended a live run, 130
    after Ctrl-C.
    """
    from gantrysim.job.job import Job
    from gantrysim.render.view.window import check_display

    positive("speed", speed)
    folder = expanded_path(shown)
    saved = _is_saved(shown, folder)
    if saved and (model is not None or settings):
        raise InputError(f"run {shown}: a saved run cannot be changed; --model and --set apply to live jobs only")
    check_display()
    if saved:
        _replay(folder, camera, colour or _PLAIN_COLOUR, speed)
        return
    fault = _live(Job.load(shown, settings or (), model, allow_code=allow_code), camera, colour or _PLAIN_COLOUR, speed)
    if fault is not None:
        warn(str(fault), "fault")
        raise typer.Exit(FAULT)


def _is_saved(shown: str, folder: Path) -> bool:
    """Return whether the argument is a run's folder rather than a job."""
    from gantrysim.job.loading import builtin_jobs
    from gantrysim.record.run_file import RUN

    # a job, or by mistake another file of a run
    if folder.is_file():
        return folder.suffix != ".toml" and (folder.parent / RUN).is_file()
    return (folder / RUN).is_file() or (folder.is_dir() and shown not in builtin_jobs())


def _replay(folder: Path, camera: str | None, colour: str, speed: float) -> None:
    from gantrysim.render.scene import Scene
    from gantrysim.render.view.source import Playback, Replay
    from gantrysim.report.folder import SavedRun

    saved = SavedRun.load(folder)
    if saved.changed:
        warn(f"note: machine {saved.machine.name} has changed since {folder} was run; its present model is shown")
    scene = Scene(saved.machine, saved.run, saved.job.bead, colour=colour)
    _play(Playback(saved.job.name, scene, Replay(saved.run)), camera, speed)


def _live(job: Job, camera: str | None, colour: str, speed: float) -> Fault | None:
    from gantrysim.engine.simulation import Simulation
    from gantrysim.render.colours import chosen_colour, scale_for
    from gantrysim.render.scene import Scene
    from gantrysim.render.view.source import STIFFNESS, Bodies, Live, Playback

    simulation = Simulation.of(
        job.built_machine,
        job.built_servo,
        job.setpoints,
        physics_step=job.simulation.physics_step,
        dispenser=job.dispenser,
        faults=job.faults,
    )
    # the bead gets the rings of an ideal run, and the colours a scale that fits the run to come
    follower = job.follow()
    run = follower if colour == _PLAIN_COLOUR else job.run()
    colour = chosen_colour(colour, [run])
    scale = scale_for(colour, [run], [job.bead])
    scene = Scene(job.built_machine, follower, job.bead, colour=colour, scale=scale)
    scene.model.vis.map.stiffness = max(scene.model.vis.map.stiffness, STIFFNESS)
    bodies = Bodies(scene.model, simulation.model)
    return _play(Playback(job.name, scene, Live(simulation), bodies), camera, speed)


def _play(playback: Playback, camera: str | None, speed: float) -> Fault | None:
    """Play a run in a window and return the fault that ended a live run."""
    from gantrysim.render.view.player import Player
    from gantrysim.render.view.window import ViewerWindow, WindowClosedError

    # Ctrl-C ends the play between two pictures, so that the window is closed
    with suppress(WindowClosedError), deferred() as stopped:
        window = ViewerWindow(playback.scene, camera)
        try:
            return Player(playback, window, speed=speed).play(stopped)
        finally:
            window.close()
    return None
