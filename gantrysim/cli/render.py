"""The command `gantrysim render`."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated

import typer

from gantrysim.base.errors import InputError, expanded_path, positive
from gantrysim.cli.options import Colour, FilmCamera
from gantrysim.cli.terminal import interruptible, say, share_bar, warn

_COMPARISON = "comparison"

Folders = Annotated[
    list[Path],
    typer.Argument(
        metavar="RUN_DIR", help="Folder of a run; two or four runs are compared side by side.", show_default=False
    ),
]
Size = Annotated[
    str | None,
    typer.Option(
        metavar="WxH",
        help="Width and height of the film, even numbers for MP4; by default 1280x720, for four runs 1920x1080.",
    ),
]
FilmSpeed = Annotated[
    float | None,
    typer.Option(help="Seconds of the run per second of film; by default 1, or more to keep the film below a minute."),
]
Moment = Annotated[
    float | None, typer.Option("--at", metavar="SECONDS", help="Draw a single picture at this time of the run.")
]
Labels = Annotated[
    list[str] | None,
    typer.Option(help="Label of a run, given once per run; by default the values in which the jobs differ."),
]
PictureFile = Annotated[
    Path | None,
    typer.Option(
        help="File to write: .mp4, .gif, or .png for a single picture, at the end unless --at is given; by default "
        "render.mp4 in the run's folder, or comparison.mp4 beside the first of several, and .png with --at."
    ),
]


def render(
    folders: Folders,
    camera: FilmCamera = None,
    size: Size = None,
    fps: Annotated[float, typer.Option(help="Frames per second.")] = 25.0,
    speed: FilmSpeed = None,
    colour: Colour = None,
    moment: Moment = None,
    label: Labels = None,
    gif: Annotated[bool, typer.Option("--gif", help="Write a GIF instead of an MP4.")] = False,
    poster: Annotated[bool, typer.Option("--poster", help="Write the last frame as PNG instead of a film.")] = False,
    out: PictureFile = None,
) -> None:
    """Draw saved runs: a film or a picture of the machine and its bead, with readout and error strip.

    Nothing is simulated again. Two or four runs are shown side by side at the same time, with one scale for their
    errors; a run that ends before the others keeps its last picture.

    Exit status: 0 on success, 2 for bad input or without OpenGL, 130 after Ctrl-C.
    """
    from gantrysim.render.encoding import FILMS, film_rate
    from gantrysim.render.film import COUNTS, Film, Take
    from gantrysim.render.header import labels_of
    from gantrysim.report.folder import SavedRun

    if len(folders) not in COUNTS:
        raise InputError(f"number of runs = {len(folders)}: must be 1, 2 or 4")
    if label and len(label) != len(folders):
        raise InputError(f"number of labels = {len(label)}: must be {len(folders)}, one per run")
    positive("frames per second", fps, "1/s")
    if speed is not None:
        positive("speed of the film", speed)
    pixels = None if size is None else size_of(size)
    target = _target(folders, out, _suffix(out, moment, gif, poster))
    with interruptible() as go_on:
        runs = [SavedRun.load(folder) for folder in folders]
        for run in runs:
            if run.changed:
                warn(f"note: machine {run.machine.name} has changed since {run.folder} was run")
        names = label or labels_of(runs)
        replaced = [run for run in runs if expanded_path(run.folder).absolute() == target.absolute().parent]

        def check() -> None:
            go_on()
            for run in replaced:
                if not run.is_current:
                    raise InputError(f"run {run.folder}: has been run again meanwhile: render it again")

        takes = [
            Take(run.machine, run.run, name, run.job.bead, run.run.known_verdict)
            for run, name in zip(runs, names, strict=True)
        ]
        with Film(takes, camera=camera, size=pixels, colour=colour) as film:
            if target.suffix.lower() not in FILMS:
                check()
                film.save_picture(target, moment)
                content = "picture"
            else:
                with share_bar("render", check) as advance:
                    frames = film.save(target, fps=fps, speed=speed, progress=advance)
                content = f"{frames} frames, {frames / film_rate(target, fps):.1f} s"
    say(f"written to {target}: {content}")


def size_of(text: str) -> tuple[int, int]:
    """Return the width and height in a text such as "960x720".

    Raises:
        InputError: the text is not of this form.
    """
    size = re.fullmatch(r"(\d{1,9})[x×](\d{1,9})", text.strip())
    if size is None:
        raise InputError(f"--size {text}: must be width x height in pixels, as in 960x720")
    return int(size[1]), int(size[2])


def _target(folders: list[Path], out: Path | None, suffix: str) -> Path:
    """Return the file to be written; its suffix is the given one, unless its name says otherwise."""
    from gantrysim.report.folder import RENDER

    if out is not None:
        return expanded_path(out)
    first = expanded_path(folders[0])
    if len(folders) == 1:
        return first / f"{RENDER}{suffix}"
    return (first if first.name and first.name != ".." else first.resolve()).parent / f"{_COMPARISON}{suffix}"


def _suffix(out: Path | None, moment: float | None, gif: bool, poster: bool) -> str:
    """Return the suffix of the file to be written.

    Raises:
        InputError: options that ask for files of different kinds, or a file of another kind.
    """
    from gantrysim.render.encoding import FILMS, PICTURES

    mp4, animation = FILMS
    (picture,) = PICTURES
    wanted = {"--gif": animation if gif else "", "--poster": picture if poster else ""}
    if moment is not None:
        wanted[f"--at {moment:g}"] = picture
    if out is not None:
        suffix = out.suffix.lower()
        if suffix not in (*FILMS, *PICTURES):
            raise InputError(f"--out {out}: suffix = {out.suffix!r}: must be {', '.join(FILMS)} or {picture}")
        wanted[f"--out {out}"] = suffix
    kinds = {option: suffix for option, suffix in wanted.items() if suffix}
    if len(set(kinds.values())) > 1:
        texts = " and ".join(f"{option} ({suffix})" for option, suffix in kinds.items())
        raise InputError(f"{texts}: must ask for files of one kind; --at and --poster draw a single picture")
    if poster and moment is not None:
        raise InputError(f"--poster with --at {moment:g}: the poster is the last frame; leave one of them out")
    return next(iter(kinds.values()), mp4)
