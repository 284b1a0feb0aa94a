"""Defers Ctrl-C over a few lines that must not be left half done.

A tick that stays MuJoCo's control callback after an interrupt does nothing to other models: their rows lack its magic
number. That is not enough. The callback that the caller had would be missing, and the caller's model run without its
control; MuJoCo's clock and warnings would stay taken; and a lock or a count of users that is left half changed makes
every later run wait for ever. Of 71 interrupts aimed at installing and removing, 35 had such an end.
"""

from __future__ import annotations

import signal
import threading

# the C functions below signal.signal and getsignal, which spend 4 µs a call on enumerations
from _signal import getsignal as _getsignal  # type: ignore[import-not-found]
from _signal import signal as _setsignal
from collections.abc import Callable
from types import CodeType, FrameType
from typing import Any, TypeVar

Function = TypeVar("Function", bound=Callable[..., Any])

_held: list[Interrupts] = []  # of the main thread, from `hold` to `release`
_careful: set[CodeType] = set()  # functions in which, and in whose callees, interrupts are deferred
_called_by_c: set[CodeType] = set()  # functions in which alone they are


def careful(function: Function) -> Function:
    """Defer interrupts in a method and all that it calls, between `Interrupts.hold` of its object and `release`."""
    _careful.add(function.__code__)
    return function


def called_by_c(function: Function) -> Function:
    """Defer interrupts in a function, not in what it calls: the C code that calls it would swallow exceptions."""
    _called_by_c.add(function.__code__)
    return function


def deliver() -> None:
    """Pass interrupts that are deferred on to their previous handler, in the main thread."""
    if threading.current_thread() is threading.main_thread():
        for interrupts in tuple(_held):
            interrupts.deliver()


class Interrupts:
    """Defers Ctrl-C in functions that are `careful` or `called_by_c`, until `deliver`; elsewhere it acts as usual.

    Python raises it in the main thread, between any two bytecodes, the first of a `finally` or an `__exit__` included.
    So from `hold` to `release` a handler of this class stands before the present one, and looks at the stack. In other
    threads, and where no handler in Python is set, there is nothing to defer.
    """

    def __init__(self) -> None:
        self._owner: object = None
        self._previous: Callable[[int, FrameType | None], Any] | None = None
        self._came = False

    def hold(self, owner: object) -> None:
        """Begin; to be called from a careful method.

        Args:
            owner: object of the method; within a run, others of its class may come and go.
        """
        if threading.current_thread() is threading.main_thread():
            previous = _getsignal(signal.SIGINT)
            if callable(previous):
                self._owner = owner
                self._previous = previous
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
        caller = frame
        while caller is not None and not self._is_careful(caller):
            caller = caller.f_back
        if caller is not None or (frame is not None and frame.f_code in _called_by_c):
            self._came = True
        elif self._previous is not None:
            self._previous(number, frame)

    def _is_careful(self, frame: FrameType) -> bool:
        return frame.f_code in _careful and frame.f_locals.get("self") is self._owner
