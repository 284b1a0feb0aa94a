"""`serve`: run the workbench until it is interrupted."""

from __future__ import annotations

import socket
import tempfile
from collections.abc import Callable
from contextlib import closing, suppress
from pathlib import Path

import uvicorn

from gantrysim.base.errors import InputError, expanded_path, unknown
from gantrysim.job.loading import builtin_jobs
from gantrysim.live.app import Hub, app_of
from gantrysim.live.consent import Terminal
from gantrysim.live.guard import TOKEN, Guard, is_wildcard
from gantrysim.live.store import LONGEST_UPLOAD

LOOPBACK = "127.0.0.1"


def serve(
    job: str, announce: Callable[[str], None], host: str = LOOPBACK, port: int = 0, *, allow_code: bool = False
) -> None:
    """Serve the workbench until it is interrupted.

    Args:
        job: built-in job, job or program file, which is followed on disk, or folder of jobs.
        announce: called with the address to open, once the server listens.
        host: address to bind to: the loopback address admits this machine alone.
        port: to bind to; 0 for any that is free.
        allow_code: whether the code that the job names may run.

    Raises:
        InputError: an unknown job, or an address that cannot be bound to.
    """
    folder, path = opened(job)
    with closing(_bound(host, port)) as listener, tempfile.TemporaryDirectory(prefix="gantrysim-live-") as scratch:
        number = listener.getsockname()[1]
        terminal = Terminal()
        asking = terminal if terminal.is_interactive else None
        hub = Hub(folder, path, Path(scratch), allow_code=allow_code, terminal=asking)
        guard = Guard(app_of(hub), host, number)
        config = uvicorn.Config(
            guard,
            log_level="error",
            access_log=False,
            ws_max_size=LONGEST_UPLOAD,
            # columns of 8 and 16 bits shrink by a third, which takes longer than to send them
            ws_per_message_deflate=False,
            lifespan="on",
        )
        named = LOOPBACK if is_wildcard(host) else f"[{host}]" if ":" in host else host
        announce(f"http://{named}:{number}/?{TOKEN}={guard.token}")
        with suppress(KeyboardInterrupt):
            uvicorn.Server(config).run(sockets=[listener])


def opened(job: str) -> tuple[Path, str]:
    """Return the folder that is opened, and the path or name of the job that is shown first.

    Raises:
        InputError: neither a built-in job, nor a file or folder.
    """
    if job in builtin_jobs():
        return Path.cwd(), job
    path = expanded_path(job).absolute()
    if path.is_dir():
        return path, builtin_jobs()[0]
    if not path.exists():
        raise unknown("job", job, builtin_jobs())
    return path.parent, str(path)


def _bound(host: str, port: int) -> socket.socket:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listener = socket.socket(family, socket.SOCK_STREAM)
    try:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind((host, port))
        listener.listen()
    except (OSError, OverflowError) as error:
        listener.close()
        raise InputError(f"--host {host} --port {port}: cannot be bound: {error}") from None
    return listener
