"""`serve` runs the workbench until it is interrupted, for a browser that may speak to it.

Admitted is a browser that was given the token, under an address of this machine, from its own page. Any page that a
browser shows can send requests to 127.0.0.1, and a foreign name may be made to point there. So every request must name
this server in its Host, and carry a cookie that only the first address, with the token, sets; and one that changes
anything, or opens a WebSocket, must come from the server's own page by its Origin.
"""

from __future__ import annotations

import ipaddress
import secrets
import socket
import tempfile
from collections.abc import Callable
from contextlib import closing, suppress
from pathlib import Path
from typing import Any

import uvicorn
from starlette.datastructures import Headers, QueryParams
from starlette.requests import HTTPConnection
from starlette.responses import PlainTextResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from gantrysim.base.errors import InputError, expanded_path, unknown
from gantrysim.job.loading import builtin_jobs
from gantrysim.live.app import Hub, app_of
from gantrysim.live.consent import Terminal
from gantrysim.live.store import LONGEST_UPLOAD

LOOPBACK = "127.0.0.1"
TOKEN = "token"
_POLICY = 1008  # code with which a WebSocket is closed
_READING = ("GET", "HEAD")
_HEADERS = {
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
}


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
    with (
        closing(_bound_socket(host, port)) as listener,
        tempfile.TemporaryDirectory(prefix="gantrysim-live-") as scratch,
    ):
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


def _bound_socket(host: str, port: int) -> socket.socket:
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


def is_wildcard(host: str) -> bool:
    """Return whether a server bound to an address answers under every address of its machine."""
    return host in ("", "0.0.0.0", "::")


class Guard:
    """Middleware that refuses what does not come from the workbench's own page.

    Args:
        app: answers what is admitted.
        host: address to which the server is bound.
        port: likewise.
    """

    def __init__(self, app: ASGIApp, host: str, port: int) -> None:
        self.token = secrets.token_urlsafe(32)
        self._app = app
        self._host = host
        self._port = port
        self._secret = secrets.token_urlsafe(32)

    @property
    def cookie(self) -> str:
        """Name of the cookie; cookies are shared by all ports of a host."""
        return f"gantrysim_{self._port}"

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        refusal = self._refusal(scope)
        if refusal is None:
            await self._app(scope, receive, self._with_headers(scope, send))
        elif scope["type"] == "websocket":
            await receive()
            await send({"type": "websocket.close", "code": _POLICY, "reason": "refused"})
        else:
            await refusal(scope, receive, self._with_headers(scope, send))

    def _refusal(self, scope: Scope) -> Response | None:
        """Return the response to a request that is not admitted; None for one that is."""
        headers = Headers(scope=scope)
        host = headers.get("host", "")
        if not self._is_own(host):
            return PlainTextResponse("this server has another name\n", 421)
        if scope["type"] == "http" and scope["path"] == "/" and scope["method"] in _READING:
            given = QueryParams(scope["query_string"]).get(TOKEN)
            if given is not None:
                return self._entry_response(given)
        cookie = HTTPConnection(scope).cookies.get(self.cookie, "")
        if not secrets.compare_digest(cookie.encode(), self._secret.encode()):
            return PlainTextResponse("open the address that gantrysim live has printed\n", 403)
        changes = scope["type"] == "websocket" or scope["method"] not in _READING
        if changes and headers.get("origin") != f"http://{host}":
            return PlainTextResponse("the request comes from another page\n", 403)
        return None

    def _entry_response(self, given: str) -> Response:
        if not secrets.compare_digest(given.encode(), self.token.encode()):
            return PlainTextResponse("wrong token: open the address that gantrysim live has printed\n", 403)
        # without the token, which would stay in the browser's history
        response = RedirectResponse("/", 303)
        response.set_cookie(self.cookie, self._secret, httponly=True, samesite="strict", path="/")
        return response

    def _is_own(self, host: str) -> bool:
        """Return whether a Host header names this server: a foreign name that points here does not."""
        name, _, port = host.rpartition(":")
        if port != str(self._port):
            return False
        name = name.strip("[]").lower()
        if name in ("127.0.0.1", "::1", "localhost", self._host.lower()):
            return True
        if not is_wildcard(self._host):
            return False
        try:
            # no name can be made to point to what is an address already
            ipaddress.ip_address(name)
        except ValueError:
            return name == socket.gethostname().lower()
        return True

    def _with_headers(self, scope: Scope, send: Send) -> Send:
        host = Headers(scope=scope).get("host", "")
        policy = (
            "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; media-src 'self'; "
            f"connect-src 'self' ws://{host if self._is_own(host) else ''}; "
            "frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
        )
        added = {**_HEADERS, "Content-Security-Policy": policy}

        async def sent(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers: list[Any] = list(message.get("headers", ()))
                headers += [(name.lower().encode(), value.encode()) for name, value in added.items()]
                message = {**message, "headers": headers}
            await send(message)

        return sent
