"""The process that simulates: one, started anew where it does not let go of an older request, or where it ended."""

from __future__ import annotations

import multiprocessing
import os
import queue
import tempfile
import threading
import time
import traceback
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, NamedTuple

from gantrysim.base.errors import text_of
from gantrysim.base.progress import when_compiling
from gantrysim.base.signals import blocked, end_with
from gantrysim.live.draft import Request

PATIENCE = 2.0  # with an older request, which ends at its next report of progress [s]
_LONG_PATIENCE = 120.0  # while the process imports, or compiles once for this machine [s]
_POLL_INTERVAL = 0.1  # [s]
_FAREWELL = 10.0  # in which the process keeps what it has compiled [s]
_LAST_REQUEST = 1 << 62  # number of the last request


class Message(NamedTuple):
    """Part of an answer.

    Attributes:
        number: of the request.
        kind: "begun", "text", "controls", "margins", "progress", "result", "proposals", "written", "film", "code",
            "refused" or "done".
        content: by name.
    """

    number: int
    kind: str
    content: dict[str, Any]


class Worker:
    """The process, and the thread that listens to it.

    Args:
        receive: called with each message, from that thread.
        allow_code: path of the file whose code may run; empty for none.
    """

    def __init__(self, receive: Callable[[Message], None], allow_code: str = "") -> None:
        self._receive = receive
        self._allow_code = allow_code
        self._context = multiprocessing.get_context("spawn")
        self._lock = threading.Lock()
        self._request: Request | None = None  # the newest, until it is done
        self._asked = 0.0
        self._is_begun = True
        self._is_closed = False
        self._patience = _LONG_PATIENCE
        self._process: Any = None
        self._start()
        threading.Thread(target=self._watch, name="patience", daemon=True).start()

    @property
    def process_id(self) -> int:
        """Number of the process."""
        return int(self._process.pid)

    def ask(self, request: Request) -> None:
        """Send a request, which ends an older one."""
        with self._lock:
            self._request = request
            self._asked = time.monotonic()
            self._is_begun = False
            self._send(request)

    def close(self) -> None:
        """End the process, which keeps what it has compiled unless it takes too long."""
        with self._lock:
            self._is_closed = True
            self._send(Request(_LAST_REQUEST, "end"))
        self._process.join(_FAREWELL)
        self._process.kill()
        self._process.join()

    def _send(self, request: Request) -> None:
        # where the process has ended, its listener says so and starts another
        with suppress(OSError):
            self._pipe.send(request)

    def _start(self) -> None:
        self._patience = _LONG_PATIENCE
        self._pipe, other = self._context.Pipe()
        arguments = (other, os.getpid(), self._allow_code)
        self._process = self._context.Process(target=work, args=arguments, name="simulations", daemon=True)
        with blocked():
            self._process.start()
        other.close()
        listener = (self._pipe, self._process)
        threading.Thread(target=self._listen, args=listener, name="listener", daemon=True).start()

    def _listen(self, pipe: Connection, process: Any) -> None:
        while True:
            try:
                message = pipe.recv()
            except (EOFError, OSError):
                break
            with self._lock:
                self._note(message)
            self._receive(message)
        self._restart(process)

    def _note(self, message: Message) -> None:
        if message.kind == "compiling":
            self._patience = _LONG_PATIENCE
        if message.kind in ("ready", "done"):
            self._patience = PATIENCE
            self._asked = time.monotonic()
        newest = self._request
        if newest is not None and message.number == newest.number:
            self._is_begun = True
            if message.kind == "done":
                self._request = None

    def _restart(self, process: Any) -> None:
        """Start another process in place of one that ended by itself, and say what its request came to."""
        with self._lock:
            if self._is_closed or process is not self._process:
                return
            lost = self._request
            self._request = None
            process.join()
            self._start()
        if lost is not None:
            text = f"the simulation ended with status {process.exitcode}: too little memory, or a defect"
            self._receive(Message(lost.number, "refused", {"text": text, "line": 0, "word": "", "task": lost.task}))
            self._receive(Message(lost.number, "done", {}))

    def _watch(self) -> None:
        """Replace a process that has not begun the newest request in time."""
        while not self._is_closed:
            time.sleep(_POLL_INTERVAL)
            with self._lock:
                is_late = self._request is not None and not self._is_begun
                if self._is_closed or not is_late or time.monotonic() - self._asked < self._patience:
                    continue
                self._process.kill()
                self._start()
                assert self._request is not None
                self._asked = time.monotonic()
                self._send(self._request)


def work(pipe: Connection, parent: int, allow_code: str) -> None:
    """Answer requests until the parent ends, as the main function of the process."""
    end_with(parent)
    from gantrysim.live.studio import StaleError, Studio

    requests: queue.SimpleQueue[Request] = queue.SimpleQueue()
    sending = threading.Lock()

    def send(number: int, kind: str, content: dict[str, Any]) -> None:
        with sending:
            pipe.send(Message(number, kind, content))

    when_compiling(lambda sentence: send(0, "compiling", {"text": sentence}))
    with tempfile.TemporaryDirectory(prefix="gantrysim-live-") as scratch:
        studio = Studio(Path(scratch), allow_code)
        threading.Thread(target=_receive, args=(pipe, studio, requests), name="requests", daemon=True).start()
        send(0, "ready", {})
        while True:
            request = requests.get()
            if request.task == "end":
                return
            if request.number != studio.newest:
                continue
            if request.task == "stop":
                # else nobody would know that the older request has ended, and this process would be replaced
                send(request.number, "done", {"task": request.task})
                continue
            send(request.number, "begun", {"task": request.task})
            try:
                studio.answer(request, partial(send, request.number))
            except StaleError:
                continue
            except (Exception, SystemExit) as error:
                traceback.print_exc()
                refusal = {"text": text_of(error), "line": 0, "word": "", "task": request.task}
                send(request.number, "refused", refusal)
            send(request.number, "done", {"task": request.task})


def _receive(pipe: Connection, studio: Any, requests: queue.SimpleQueue[Request]) -> None:
    """Take requests while one is being answered, so that the newest ends it."""
    while True:
        try:
            request = pipe.recv()
        except (EOFError, OSError):
            os._exit(0)
        studio.newest = request.number
        studio.arrived.set()
        requests.put(request)
