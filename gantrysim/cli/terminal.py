"""What the commands have in common at the terminal: what they say, progress bars, interrupts, exit statuses."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

from rich.console import Console, RenderableType
from rich.markup import escape
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

# exit statuses
INPUT_ERROR = 2
FAULT = 3  # a fault ended the run, or every run of a study
INTERRUPTED = 130  # as shells have it after Ctrl-C

_output = Console(soft_wrap=False)
_messages = Console(stderr=True)


def show(content: RenderableType) -> None:
    """Print a table, or whatever rich draws."""
    _output.print(content)


def say(text: str, *, wrap: bool = False, end: str = "\n") -> None:
    """Print a text as it is.

    Args:
        text: to be printed.
        wrap: whether lines end at the terminal's width: prose, not lines that others read.
        end: what follows it.
    """
    _output.print(escape(text), soft_wrap=not wrap, highlight=False, end=end)


def warn(text: str, kind: str = "") -> None:
    """Print a line to the standard error, headed by what kind of failure it tells, as "error" or "fault"."""
    head = f"[bold red]{kind}[/]: " if kind else ""
    _messages.print(f"{head}{escape(text)}", soft_wrap=True, highlight=False)


@contextmanager
def share_bar(task: str, go_on: Callable[[], None] = lambda: None) -> Iterator[Callable[[float], None]]:
    """Show a progress bar inside the block; what is given is called with the share that is done, 0 to 1.

    Args:
        task: what is done.
        go_on: called each time before, as that of `interruptible`.
    """
    with _bars(TextColumn("{task.percentage:3.0f} %"), TimeRemainingColumn()) as bars:
        bar = bars.add_task(task, total=1.0)

        def advance(share: float) -> None:
            go_on()
            bars.update(bar, completed=share)

        yield advance


@contextmanager
def count_bar(task: str) -> Iterator[Callable[[int, int, str], None]]:
    """Show a progress bar inside the block.

    What is given is called with the number done, that of all, and a few words of news, which may be none.
    """
    columns = (MofNCompleteColumn(), TimeElapsedColumn(), TextColumn("left"), TimeRemainingColumn())
    with _bars(*columns, TextColumn("{task.fields[news]}")) as bars:
        bar = bars.add_task(task, total=None, news="")
        yield lambda done, every, news: bars.update(bar, completed=done, total=every, news=news)


def _bars(*columns: ProgressColumn) -> Progress:
    shown = (TextColumn("{task.description:9}"), BarColumn(), *columns)
    return Progress(*shown, console=_messages, transient=True, disable=not _messages.is_terminal)


@contextmanager
def interruptible(left: str = "") -> Iterator[Callable[[], None]]:
    """Have a polite kill end the block as Ctrl-C does: workers stopped, rows kept.

    What is given raises the interrupt once more: the first is lost where it meets code that cannot pass it on, such as
    a finaliser, which then says nothing of it. Code that makes another error of it, as ctypes does where it converts
    arguments, is seen through.

    Args:
        left: what an interrupt leaves behind, for the command's last words.
    """
    asked = False
    words = (left,) if left else ()

    def interrupt(_number: int, _frame: FrameType | None) -> None:
        nonlocal asked
        asked = True
        raise KeyboardInterrupt(*words)

    def go_on() -> None:
        if asked:
            raise KeyboardInterrupt(*words)

    def unraisable(lost: Any) -> None:
        if not asked:
            tell(lost)

    tell, sys.unraisablehook = sys.unraisablehook, unraisable
    before = {number: signal.signal(number, interrupt) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield go_on
    except Exception:
        go_on()
        raise
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        sys.unraisablehook = tell
