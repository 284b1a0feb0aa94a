"""A value that is computed beside the rest of a command, in a copy of its process."""

from __future__ import annotations

import ctypes
import gc
import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from gantrysim.base import signals

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

Value = TypeVar("Value")

_THREADS = Path("/proc/self/task")
_PATIENCE = 120.0  # until a value is given up, and computed otherwise [s]
_END_WITH_PARENT = 1  # option PR_SET_PDEATHSIG of Linux's prctl


@contextmanager
def beside(compute: Callable[[], Value]) -> Iterator[Callable[[], Value | None]]:
    """Compute a value beside the block, in a copy of this process that ends with the block.

    Yields a function that waits for the value and returns it; None where there is no copy, or computing has failed.
    The copy has all objects of this process, at no cost of memory as long as neither changes them. It prints nothing.

    Args:
        compute: returns the value, which is pickled.
    """
    if not _can_copy():
        yield lambda: None
        return
    import multiprocessing  # slow to import

    receiver, sender = multiprocessing.Pipe(duplex=False)
    process = multiprocessing.get_context("fork").Process(
        target=_compute_and_send, args=(compute, sender, os.getpid()), daemon=True
    )
    try:
        with suppress(OSError), signals.blocked(), sender:  # where no process is left, nothing is sent either
            process.start()
        yield lambda: _received(receiver)
    finally:
        if process.pid is not None:
            process.kill()
            process.join()
        receiver.close()


def _can_copy() -> bool:
    """Return whether a copy is safe and of use: it would wait for ever for a lock that another thread holds.

    macOS has frameworks that refuse to work in a copy.
    """
    is_alone = sys.platform == "linux" and _THREADS.is_dir() and len(list(_THREADS.iterdir())) == 1
    return is_alone and len(os.sched_getaffinity(0)) > 1


def _compute_and_send(compute: Callable[[], Value], sender: Connection, parent: int) -> None:
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    ctypes.CDLL(None).prctl(_END_WITH_PARENT, signal.SIGKILL)
    if os.getppid() != parent:  # ended before it could take this process with it
        return
    gc.freeze()  # looking for cycles among the parent's objects would copy them all
    try:
        value = compute()
    except BaseException:  # a value that is missing is computed again where its error can be reported
        return
    sender.send(value)


def _received(receiver: Connection) -> Value | None:
    try:
        value: Value | None = receiver.recv() if receiver.poll(_PATIENCE) else None
    except (EOFError, OSError):
        return None
    return value
