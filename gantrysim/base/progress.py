"""Progress of a long call: a function of the caller's, or a bar of text in a terminal or a notebook."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from typing import TextIO, TypeVar

from gantrysim.base.errors import InputError, short_text

Progress = Callable[[float], None] | bool | None  # what callers give

COMPILING = "compiling what it computes with, once for this machine: some 25 s for a run"

_listeners: list[Callable[[str], None]] = []
_sentences: list[str] = []

_WIDTH = 30  # of the bar [characters]
_Share = TypeVar("_Share", bound=Callable[[float], None])


@contextmanager
def shown_progress(task: str, progress: _Share | bool | None) -> Iterator[_Share | Callable[[float], None] | None]:
    """Yield the function to call with the completed share, 0 to 1; None where no progress is wanted.

    Args:
        task: in a word, shown before the bar.
        progress: a function, which is yielded as it is; True for a bar of text, in a terminal on the standard error and
            in a notebook in its output, and nowhere else; False or None for none.

    Raises:
        InputError: none of these.
    """
    if progress is None or progress is False:
        yield None
    elif progress is True:
        stream = _stream()
        if stream is None:
            yield None
        else:
            _announce_compiling()
            yield from _bar(task, stream)
    elif callable(progress):
        yield progress
    else:
        raise InputError(f"progress = {short_text(progress)}: must be True, False or a function of the completed share")


def _stream() -> TextIO | None:
    """Return where a bar is shown: a notebook's output, a terminal, or nowhere."""
    # a notebook, which shows the standard error as a failure
    if "ipykernel" in sys.modules:
        return sys.stdout
    return sys.stderr if sys.stderr is not None and sys.stderr.isatty() else None


def _bar(task: str, stream: TextIO) -> Iterator[Callable[[float], None]]:
    """Yield the function that draws a bar; it goes again at the end. A carriage return works in notebooks too."""
    drawn = -1

    def advance(share: float) -> None:
        nonlocal drawn
        percent = int(100 * share)
        if percent != drawn:
            drawn = percent
            full = round(_WIDTH * share)
            stream.write(f"\r{task} {'#' * full}{'.' * (_WIDTH - full)} {percent:3} %")
            stream.flush()

    try:
        yield advance
    finally:
        stream.write("\r" + " " * (len(task) + _WIDTH + 7) + "\r")
        stream.flush()


@cache
def _announce_compiling() -> None:
    """Print a line where this process compiles what no cache holds, which takes seconds."""

    def announce(sentence: str) -> None:
        stream = _stream()
        if stream is not None:
            stream.write(f"\r{sentence}\n")
            stream.flush()

    when_compiling(announce)


def when_compiling(tell: Callable[[str], None]) -> None:
    """Call a function with a sentence where this process compiles with an empty cache: once it does, or now."""
    _listeners.append(tell)
    for sentence in _sentences:
        tell(sentence)


def tell_compiling(sentence: str) -> None:
    """Tell those who wait for it that this process begins to compile."""
    _sentences.append(sentence)
    for tell in _listeners:
        tell(sentence)
