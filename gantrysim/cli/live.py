"""The command `gantrysim live`."""

from __future__ import annotations

from typing import Annotated

import typer

from gantrysim.cli.options import AllowCode
from gantrysim.cli.terminal import say, warn

_LOOPBACK = "127.0.0.1"


def live(
    job: Annotated[
        str, typer.Argument(help="Built-in job, TOML file or program file, which is followed on disk, or a folder.")
    ] = "an225",
    host: Annotated[
        str, typer.Option(help="Address to bind to; by default only this machine can connect.")
    ] = _LOOPBACK,
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port to bind to; 0 for any that is free.")] = 0,
    browser: Annotated[bool, typer.Option(help="Open the page in the browser.")] = True,
    allow_code: AllowCode = False,
) -> None:
    """Open a workbench in the browser: edit the program, move a slider, and see bead and verdict follow.

    The job is simulated anew at every change, first by the compiled loop, then by MuJoCo. A file is followed on disk:
    what an editor saves is shown at once. Nothing is written before "save" or "report" is pressed.

    Code of its own that another job names, a law or a controller, runs only after a yes on this terminal.

    The page needs the address that is printed, with its token; nobody without it can connect.

    Exit status: 0 when the server is ended, by Ctrl-C; 2 for bad input.
    """
    from gantrysim.base.extras import extra

    with extra("live", "gantrysim live"):
        from gantrysim.live.serving import serve

    def announce(address: str) -> None:
        say(f"gantrysim live: {address}")
        say("Ctrl-C ends it")
        if browser:
            import webbrowser

            webbrowser.open(address)

    if host != _LOOPBACK:
        warn(f"note: bound to {host}: whoever has the address with its token can connect, unencrypted")
    serve(job, announce, host, port, allow_code=allow_code)
