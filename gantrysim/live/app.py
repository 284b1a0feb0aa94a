"""The server of the workbench: its page, uploads, and a WebSocket for each tab."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from importlib.resources import files
from pathlib import Path
from typing import Any

from starlette.applications import Starlette
from starlette.requests import ClientDisconnect, Request
from starlette.responses import FileResponse, PlainTextResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from gantrysim.base.errors import GantryError
from gantrysim.live.consent import Code, Terminal
from gantrysim.live.packing import NOTHING, message
from gantrysim.live.store import LONGEST_UPLOAD, Store, is_trace
from gantrysim.live.workbench import Workbench, version_of
from gantrysim.live.worker import Message, Worker
from gantrysim.results.colours import css_variables

_LONGEST_QUEUE = 2000  # messages that wait for a tab, which is then closed
_WATCH_INTERVAL = 0.3  # between two looks at the file that is followed [s]
_NOT_FOUND = 404
_TOO_LONG = 413
_TRY_AGAIN = 1013  # code with which the WebSocket of a slow tab is closed
_WEB = files("gantrysim.live") / "web"
_REPORT = files("gantrysim.report")
# what the page consists of: type, and the files one after the other
_ASSETS = {
    "/": ("text/html; charset=utf-8", [_WEB / "index.html"]),
    "/workbench.js": ("text/javascript; charset=utf-8", [_WEB / "workbench.min.js"]),
    "/workbench.css": (
        "text/css; charset=utf-8",
        [
            _REPORT / "page.css",
            _REPORT / "web" / "uplot.css",
            _REPORT / "web" / "viewer.css",
            _WEB / "workbench.css",
        ],
    ),
}


class Hub:
    """The workbench, its worker and its tabs.

    Args:
        folder: that is opened.
        path: of the job that is shown first.
        scratch: temporary folder.
        allow_code: whether the code that this job names may run.
        terminal: on which is asked whether other code may run; None for none.
    """

    def __init__(
        self,
        folder: Path,
        path: str,
        scratch: Path,
        *,
        allow_code: bool = False,
        terminal: Terminal | None = None,
    ) -> None:
        self._terminal = terminal
        self._questions: set[asyncio.Task[None]] = set()
        self._tabs: set[asyncio.Queue[tuple[str, dict[str, Any]]]] = set()
        self._allow_code = path if allow_code else ""
        self._worker: Worker | None = None
        self._store = Store(folder, scratch)
        self._path = path

    @asynccontextmanager
    async def running(self, _: Starlette | None = None) -> AsyncIterator[None]:
        """Run the worker, and follow the file, in the block."""
        loop = asyncio.get_running_loop()

        def receive(message: Message) -> None:
            # the loop may have ended first
            with suppress(RuntimeError):
                loop.call_soon_threadsafe(self.workbench.receive, message)

        worker = Worker(receive, self._allow_code)
        ask_for_code = None if self._terminal is None else self._ask_for_code
        self.workbench = Workbench(self._store, self._path, worker.ask, self._tell, ask_for_code)
        self.workbench.start()
        following = asyncio.create_task(self._follow())
        try:
            yield
        finally:
            for task in (following, *self._questions):
                task.cancel()
            worker.close()

    def _tell(self, kind: str, content: dict[str, Any]) -> None:
        for tab in self._tabs:
            if tab.qsize() < _LONGEST_QUEUE:
                tab.put_nowait((kind, content))

    def _ask_for_code(self, code: Code, answered: Callable[[bool], None]) -> None:
        async def ask() -> None:
            assert self._terminal is not None
            answered(await self._terminal.ask(code.question))

        question = asyncio.create_task(ask())
        self._questions.add(question)
        question.add_done_callback(self._questions.discard)

    async def _follow(self) -> None:
        """Take over what is saved to the open file, once it has stood for a moment."""
        seen = 0
        while True:
            await asyncio.sleep(_WATCH_INTERVAL)
            draft = self.workbench.draft
            version = version_of(draft.path) if draft.version else 0
            if version and version != draft.version and version == seen:
                self.workbench.reload()
            seen = version

    async def upload(self, request: Request) -> Response:
        """Keep a file that was dropped into the page, and open it, or lay it beside the run."""
        content = bytearray()
        with suppress(ClientDisconnect):
            async for part in request.stream():
                content += part
                if len(content) > LONGEST_UPLOAD:
                    return PlainTextResponse(f"longer than {LONGEST_UPLOAD:,} bytes\n", _TOO_LONG)
            name = request.query_params.get("name", "")
            is_beside = is_trace(name, bytes(content))
            path = self._store.take(name, bytes(content), is_listed=not is_beside)
            if is_beside:
                self.workbench.lay_beside(path)
            else:
                self.workbench.open(path)
        return PlainTextResponse("")

    async def film(self, request: Request) -> Response:
        """Return the film that was made, of which a browser asks for parts."""
        film = self.workbench.film(request.query_params.get("number", ""))
        if film is None:
            return PlainTextResponse("no such film\n", _NOT_FOUND)
        file, name = film
        return FileResponse(file, filename=f"{name}{file.suffix}", content_disposition_type="inline")

    async def tab(self, socket: WebSocket) -> None:
        """Serve a tab: send what it needs to show, and do what it asks for."""
        await socket.accept()
        queue: asyncio.Queue[tuple[str, dict[str, Any]]] = asyncio.Queue()
        for entry in self.workbench.messages():
            queue.put_nowait(entry)
        queue.put_nowait(("result", {}))
        self._tabs.add(queue)
        sender = asyncio.create_task(self._send(socket, queue))
        try:
            while True:
                self._do(await socket.receive_text(), queue)
        except (WebSocketDisconnect, RuntimeError, KeyError):
            pass
        finally:
            self._tabs.discard(queue)
            sender.cancel()

    def _do(self, text: str, queue: asyncio.Queue[tuple[str, dict[str, Any]]]) -> None:
        try:
            order = json.loads(text)
            if not isinstance(order, dict):
                raise TypeError("must be an object")
            self.workbench.do(order)
        except (GantryError, ValueError, TypeError, RecursionError, OSError) as error:
            queue.put_nowait(("remark", {"text": str(error)}))

    async def _send(self, socket: WebSocket, queue: asyncio.Queue[tuple[str, dict[str, Any]]]) -> None:
        parts = NOTHING
        with suppress(WebSocketDisconnect, RuntimeError):
            while True:
                kind, content = await queue.get()
                if queue.qsize() >= _LONGEST_QUEUE - 1:
                    await socket.close(_TRY_AGAIN)
                if kind != "result":
                    await socket.send_text(json.dumps({"kind": kind, **content}, default=str))
                elif self.workbench.head:
                    await socket.send_bytes(message(self.workbench.head, self.workbench.parts, parts))
                    parts = self.workbench.parts


async def asset(request: Request) -> Response:
    """Return a part of the page."""
    kind, parts = _ASSETS[request.url.path]
    variables = css_variables() if kind.startswith("text/css") else ""
    return Response(variables + "".join(part.read_text(encoding="utf-8") for part in parts), media_type=kind)


async def space_asset(_: Request) -> Response:
    """Return the script of the 3-D view, which a page asks for when it first shows one."""
    script = (_REPORT / "web" / "viewer3d.min.js.gz").read_bytes()
    return Response(script, media_type="text/javascript; charset=utf-8", headers={"Content-Encoding": "gzip"})


def app_of(hub: Hub) -> Starlette:
    """Return the application of a hub, without its guard."""
    routes = [
        *(Route(path, asset) for path in _ASSETS),
        Route("/viewer3d.js", space_asset),
        Route("/film", hub.film),
        Route("/upload", hub.upload, methods=["POST"]),
        WebSocketRoute("/socket", hub.tab),
    ]
    return Starlette(routes=routes, lifespan=hub.running)
