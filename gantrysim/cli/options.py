"""Options that several commands take."""

from __future__ import annotations

from typing import Annotated

import typer

Model = Annotated[str | None, typer.Option(help="Machine to use instead of the job's: built-in or an MJCF file.")]
Settings = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Override a value of the job, as in --set loop_period=0.01."),
]
Colour = Annotated[str, typer.Option(help="Colour the bead by: plain, width, or error (the contour error).")]
