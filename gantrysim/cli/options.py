"""Options common to several commands."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from gantrysim.base.errors import InputError, expanded_path, finite_of, plane_point, space_point
from gantrysim.base.files import complete, pending

JobArgument = Annotated[str, typer.Argument(metavar="JOB", help="Built-in job, TOML file, or program file.")]
Model = Annotated[
    str | None,
    typer.Option(
        "--machine", "--model", help="Machine to use instead of the job's: built-in, an MJCF file or a machine table."
    ),
]
Settings = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Override a value of the job, as in --set loop_period=0.01."),
]
ServoFile = Annotated[
    Path | None,
    typer.Option(
        help="TOML file with a table \\[servo] of values that replace the job's, such as tuned.toml of gantrysim tune."
    ),
]
Reader = Annotated[
    str | None,
    typer.Option(
        help="Controller that reads a program file, such as linuxcnc or mine.py:Class; by default chosen by the "
        "file's suffix."
    ),
]
Speed = Annotated[float | None, typer.Option(help="Speed of the program's fastest motion \\[mm/s].")]
At = Annotated[
    str | None, typer.Option("--at", metavar="X,Y[,Z]", help="Position of the program's origin on the work \\[mm].")
]
Rotate = Annotated[float | None, typer.Option(help="Rotation of the program about its origin \\[deg].")]
Scale = Annotated[float | None, typer.Option(help="Scale factor for the program's lengths.")]
ZDown = Annotated[bool | None, typer.Option("--z-down", help="Read the program's z as a depth, positive downwards.")]
StopAfter = Annotated[
    float | None,
    typer.Option(
        metavar="SECONDS", help="Stop a Trio BASIC program that is still running at this time, such as an endless one."
    ),
]
AllowCode = Annotated[
    bool,
    typer.Option(
        "--allow-code",
        help="Run the Python code that the job file names, a law or a controller; without this option, only a job in "
        "the current folder may run its code.",
    ),
]
LogPeriod = Annotated[
    float | None,
    typer.Option(help="Sampling period, for a log without time or with rounded time stamps \\[s].", show_default=False),
]
Camera = Annotated[
    str | None,
    typer.Option(
        help="overview, top, side, or nozzle, which follows the tip; by default overview, or the whole machine if "
        "it has no cameras."
    ),
]
FilmCamera = Annotated[
    str | None,
    typer.Option(
        help="overview, top, side, or nozzle, which follows the tip; by default one that frames the bead, after "
        "one second of the whole machine."
    ),
]
Colour = Annotated[
    str | None,
    typer.Option(help="Colour the bead by: verdict (in tolerances), width, error (the contour error), or plain."),
]


def named_columns(columns: Sequence[str]) -> dict[str, str]:
    """Return the columns of a log by quantity, from options such as 'x position=MPOS AXIS(0) [mm]'.

    Raises:
        InputError: a text without a quantity or a column.
    """
    named = {}
    for column in columns:
        name, equals, head = column.partition("=")
        if not equals or not head.strip():
            raise InputError(f"--column {column!r}: must be NAME=COLUMN, as in 'x position=MPOS AXIS(0) [mm]'")
        named[" ".join(name.split())] = head
    return named


def to_write(context: typer.Context, folder: Path | None) -> Path | None:
    """Return an output folder after completing what a killed command left in it: the job file may lie there."""
    if folder is not None and pending(target := expanded_path(folder).absolute()):
        from gantrysim.report.folder import RUN_OUTPUT, STUDY_FILES

        complete(target, f"--out {folder}", RUN_OUTPUT.files if context.info_name == "run" else STUDY_FILES)
    return folder


def with_stop(settings: list[str] | None, stop_after: float | None) -> list[str]:
    """Return the settings of a job, with the stop time of its program if one is given."""
    stop = [] if stop_after is None else [f"program.stop_after={stop_after!r}"]
    return [*(settings or ()), *stop]


def placement(
    origin: str | None, rotate: float | None, scale: float | None, z_down: bool | None = None
) -> dict[str, float]:
    """Return the attributes of a `Placement` that are given."""
    given: dict[str, float] = {}
    if origin is not None:
        parts = [finite_of("--at", part, "mm") for part in origin.split(",")]
        if len(parts) not in (2, 3):
            raise InputError(f"--at {origin}: must be X,Y or X,Y,Z [mm]")
        if len(parts) == len("xyz"):
            given["x"], given["y"], given["z"] = space_point("--at", parts)
        else:
            given["x"], given["y"] = plane_point("--at", parts)
    others = (("rotate", rotate), ("scale", scale), ("z_down", z_down))
    given |= {name: value for name, value in others if value is not None}
    return given
