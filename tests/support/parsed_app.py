"""The command `gantrysim` for many calls in one process."""

from functools import cache

import typer

from gantrysim.cli.main import app


@cache
def parsed_app():
    """The command with the parameters of all its functions, which typer reads anew at each call."""
    return typer.main.get_command(app)
