"""MuJoCo's warnings, which go to a file in the working folder unless they are taken."""

from __future__ import annotations

import ctypes
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import mujoco

from gantrysim.base import signals

_lock = threading.Lock()  # guards the two below
_blocks = 0  # that take the warnings
_loud: Any = None  # what took them before the first of these
_thread = threading.local()  # .heard: warnings in the innermost `quiet` of this thread


def heard(text: bytes) -> None:
    """Keep a warning for the block of this thread that asks for it; called by C code."""
    said = getattr(_thread, "heard", None)
    if said is not None:
        said.append(text)


_WARNING_HANDLER = ctypes.CFUNCTYPE(None, ctypes.c_char_p)(heard)


def silence(blocks: int) -> None:
    """Take MuJoCo's warnings for one block more, 1, or one less, -1."""
    global _blocks, _loud
    with _lock:
        if not _blocks:
            _loud = mujoco.get_mju_user_warning()
            mujoco.set_mju_user_warning(_WARNING_HANDLER)
        _blocks += blocks
        if not _blocks:
            mujoco.set_mju_user_warning(_loud)


@contextmanager
def quiet() -> Iterator[list[str]]:
    """Take MuJoCo's warnings in a block; they are in the list when it has ended."""
    texts: list[bytes] = []
    said: list[str] = []
    # C code that calls `heard` would swallow an interrupt
    with signals.deferred():
        before = getattr(_thread, "heard", None)
        silence(1)
        _thread.heard = texts
        try:
            yield said
        finally:
            _thread.heard = before
            silence(-1)
            said += [" ".join(text.decode(errors="replace").split()) for text in texts]
