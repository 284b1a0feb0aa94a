"""Defers Ctrl-C over a few lines that must not be left half done."""

from __future__ import annotations

import signal
import threading

# the C functions below signal.signal and getsignal, which spend 4 µs a call on enumerations
from _signal import getsignal as _getsignal  # type: ignore[import-not-found]
from _signal import signal as _setsignal
from collections.abc import Callable, Iterable
from types import CodeType, FrameType
from typing import Any

_held: list[Interrupts] = []  # of the main thread, from `hold` to `release`


def deliver() -> None:
    """Pass interrupts that are deferred on to their previous handler, in the main thread."""
    if threading.current_thread() is threading.main_thread():
        for one in tuple(_held):
            one.deliver()


class Interrupts:
    """Defers Ctrl-C while given functions run, until they call `deliver`; elsewhere it acts as usual.

    Python raises it in the main thread, between any two bytecodes, the first of a `finally` or an `__exit__` included.
    So from `hold` to `release` a handler of this class stands before the present one, and looks at the stack. In other
    threads, and where no handler in Python is set, there is nothing to defer.

    Args:
        within: code of methods in which, and in whose callees, interrupts are deferred.
        at: code of functions in which, but not in whose callees, interrupts are deferred.
    """

    def __init__(self, within: Iterable[CodeType], at: Iterable[CodeType] = ()) -> None:
        self._within, self._at = frozenset(within), frozenset(at)
        self._owner: object = None
        self._previous: Callable[[int, FrameType | None], Any] | None = None
        self._came = False

    def hold(self, owner: object) -> None:
        """Begin; to be called from one of the methods.

        Args:
            owner: object of the methods; others of its class may run in between.
        """
        if threading.current_thread() is threading.main_thread():
            previous = _getsignal(signal.SIGINT)
            if callable(previous):
                self._owner, self._previous = owner, previous
                _held.append(self)
                _setsignal(signal.SIGINT, self._interrupted)

    def deliver(self) -> None:
        """Pass a deferred interrupt to the previous handler, which as a rule raises KeyboardInterrupt."""
        if self._came and self._previous is not None:
            self._came = False
            self._previous(signal.SIGINT, None)

    def release(self) -> None:
        """End, and deliver; the caller must have nothing left to do."""
        if self._previous is not None:
            if _getsignal(signal.SIGINT) == self._interrupted:  # and not one that was set since
                _setsignal(signal.SIGINT, self._previous)
            self._owner = None
            _held.remove(self)
            self.deliver()

    def _interrupted(self, number: int, frame: FrameType | None) -> None:
        outer = frame
        while outer is not None and not self._is_own(outer):
            outer = outer.f_back
        if outer is not None or (frame is not None and frame.f_code in self._at):
            self._came = True
        elif self._previous is not None:
            self._previous(number, frame)

    def _is_own(self, frame: FrameType) -> bool:
        return frame.f_code in self._within and frame.f_locals.get("self") is self._owner
