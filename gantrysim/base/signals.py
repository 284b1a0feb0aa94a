"""Signals that end a command: Ctrl-C, SIGTERM, and SIGHUP of a closed terminal."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

ENDING = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))
_PARENT_INTERVAL = 0.5  # between two checks that a parent is alive [s]

Handler = Callable[[int, FrameType | None], object]

_came: list[int] = []  # signals that `interrupt` has taken, in order


def interrupt(number: int, _frame: FrameType | None = None) -> None:
    """Raise KeyboardInterrupt, as a handler of any of the signals; `status` remembers the first."""
    _came.append(number)
    raise KeyboardInterrupt


def status() -> int:
    """Return the exit status of an interrupted command: 128 and the number of the signal, as shells have it."""
    return 128 + (_came[0] if _came else signal.SIGINT)


def forget() -> None:
    """Forget the signals of an earlier command in this process."""
    _came.clear()


def heed() -> None:
    """Let `interrupt` handle the signals from now on."""
    _set(interrupt)


def leave() -> None:
    """Let a signal end this process at once, as nothing is left to be done."""
    _set(signal.SIG_DFL)


@contextmanager
def handled(handler: Handler) -> Iterator[None]:
    """Let a function handle the signals inside the block, in the main thread alone."""
    before = _set(handler)
    try:
        yield
    finally:
        # Ctrl-C last: it would end the restoring of the others
        for number, earlier in reversed(before.items()):
            signal.signal(number, earlier)


@contextmanager
def ending_at_once() -> Iterator[None]:
    """Let a signal end this process inside the block, which imports modules: some lose or replace an exception."""

    def end(number: int, _frame: FrameType | None) -> None:
        os.write(2, b"interrupted: nothing is written\n")
        os._exit(128 + number)

    with handled(end):
        yield


@contextmanager
def deferred() -> Iterator[Callable[[], bool]]:
    """Defer signals to the end of the block, and give a function that returns whether one has arrived."""
    came: list[int] = []
    with handled(lambda number, _: came.append(number)):
        yield lambda: bool(came)
    if came:
        signal.raise_signal(came[0])


@contextmanager
def blocked() -> Iterator[None]:
    """Let processes started in the block ignore Ctrl-C and SIGHUP, which a terminal sends to them too.

    They inherit the mask of this thread from their first instruction on. A signal to this process is not lost: another
    thread takes it for Python, or it arrives at the end of the block.
    """
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGHUP})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def end_with(parent: int) -> None:
    """End this process soon after its parent, even if that has ended already; else a worker could wait for ever.

    Args:
        parent: process number.
    """

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(_PARENT_INTERVAL)
        os._exit(1)

    threading.Thread(target=watch, name="parent", daemon=True).start()


def _set(handler: Handler | signal.Handlers) -> dict[int, Handler | int | None]:
    """Set a handler of all the signals and return the earlier ones; a SIGHUP that nohup ignores stays ignored."""
    if threading.current_thread() is not threading.main_thread():
        return {}
    ignored = {number for number in ENDING if number != signal.SIGINT and signal.getsignal(number) is signal.SIG_IGN}
    return {number: signal.signal(number, handler) for number in ENDING if number not in ignored}
