"""Options that several commands take, each described once."""

from __future__ import annotations

from typing import Annotated

import typer

Model = Annotated[str | None, typer.Option(help="Machine to take instead of the job's: a name or an MJCF file.")]
Settings = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Change a value of the job, as in --set loop_period=0.01."),
]
Colour = Annotated[str, typer.Option(help="What the bead's colour tells: plain, width, or error, the contour error.")]
