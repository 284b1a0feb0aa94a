"""Holds Ctrl-C back over a few lines, for code that would leave things half done."""

from __future__ import annotations

import signal
import threading

# what is under signal.signal and getsignal, in C; to wrap handlers as enumerations takes them 4 µs a call
from _signal import getsignal as _getsignal  # type: ignore[import-not-found]
from _signal import signal as _setsignal
from collections.abc import Callable, Iterable
from types import CodeType, FrameType
from typing import Any


class Interrupts:
    """Ctrl-C that comes in the middle of given functions is remembered, and delivered when they ask for it.

    Everywhere else it does what it always does. Python raises it in the main thread, between any two bytecodes, the
    first of a `finally` or of an `__exit__` included; so a handler that knows these functions stands before the own
    one, from the time they begin to the time when all is undone. In other threads, and where no handler in Python is
    set, there is nothing to hold back.

    Args:
        within: code of methods that no interrupt is raised in, nor in what they call.
        at: code of functions that no interrupt is raised in, but for what they call.
    """

    def __init__(self, within: Iterable[CodeType], at: Iterable[CodeType] = ()) -> None:
        self._within, self._at = frozenset(within), frozenset(at)
        self._owner: object = None
        self._own: Callable[[int, FrameType | None], Any] | None = None
        self._came = False

    def hold(self, owner: object) -> None:
        """Begin; to be called from one of the methods.

        Args:
            owner: whose methods they are; others of its class may be at work inside its own time.
        """
        if threading.current_thread() is threading.main_thread():
            own = _getsignal(signal.SIGINT)
            if callable(own):
                self._owner, self._own = owner, own
                _setsignal(signal.SIGINT, self._interrupted)

    def deliver(self) -> None:
        """Have the own handler see the interrupt that came, if one did; as a rule it raises KeyboardInterrupt."""
        if self._came and self._own is not None:
            self._came = False
            self._own(signal.SIGINT, None)

    def release(self) -> None:
        """End, and deliver; nothing may be left to do for the caller, for from here on an interrupt is raised."""
        if self._own is not None:
            if _getsignal(signal.SIGINT) == self._interrupted:  # and not one that was set since
                _setsignal(signal.SIGINT, self._own)
            self._owner = None
            self.deliver()

    def _interrupted(self, number: int, frame: FrameType | None) -> None:
        outer = frame
        while outer is not None and not self._is_own(outer):
            outer = outer.f_back
        if outer is not None or (frame is not None and frame.f_code in self._at):
            self._came = True
        elif self._own is not None:
            self._own(number, frame)

    def _is_own(self, frame: FrameType) -> bool:
        return frame.f_code in self._within and frame.f_locals.get("self") is self._owner
