"""Terminal output, progress bars, interrupts and exit statuses of the commands."""

from __future__ import annotations

import codecs
import re
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from textwrap import wrap as wrapped_lines
from types import FrameType
from typing import TYPE_CHECKING, Any, Literal

from rich.cells import cell_len
from rich.console import Console, RenderableType
from rich.markup import escape
from rich.measure import Measurement
from rich.progress import (
    BarColumn,
    Progress,
    ProgressColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.table import Column as RichColumn
from rich.table import Table

from gantrysim.base import quantity, signals
from gantrysim.base.progress import when_compiling

if TYPE_CHECKING:
    from gantrysim.report.document import Table as PageTable

# exit statuses; an interrupted command has signals.status()
INPUT_ERROR = 2
FAULT = 3  # a fault ended the run, or all runs of a study
OUT_OF_TOLERANCE = 4  # the verdict is as bad as --fail-on names, or worse
INCOMPLETE = 1  # all is written but a plot, a report or a video that failed
NOT_IDENTIFIED = 1  # a log shows no value of one of its axes

_PATIENCE = 0.1  # until a lost interrupt is raised again [s]

# what is printed where the terminal's encoding lacks a character
_PLAIN = str.maketrans(
    {
        "µ": "u",
        "·": "*",
        "×": "x",
        "²": "2",
        "³": "3",
        "°": "deg",
        "→": "->",
        "–": "-",
        "…": "...",
        "−": "-",
        "∞": "inf",
        "✓": "+",
        "✗": "x",
    }
)

# characters of a file that would command the terminal; rich drops the other ones
_CONTROLS = {code: f"\\x{code:02x}" for code in (*range(7), *range(14, 32), *range(127, 160))}

_WIDEST = 10_000  # characters of a table
_LONGEST_CELL = 16  # characters of a cell of a table that does not wrap
_WIDEST_HEAD = 10  # characters of a line of a head, but for longer words
# stands for a space at which no line ends: a letter of the user's own, as rich breaks lines at no-break spaces too
_JOINT = "\ue000"
# spaces at the end of a line, before the codes that end its colours
_TRAILING = re.compile(r" +((?:\x1b\[[0-9;]*m)*)$", re.MULTILINE)
# without emoji, as mine.py:Ring: in a message is no picture of a ring
_output = Console(soft_wrap=False, emoji=False)
_messages = Console(stderr=True, emoji=False)


def spell_out() -> None:
    """Print characters that the encoding of standard output and error lacks by others, as "um" for "µm"."""

    def spelled(error: UnicodeError) -> tuple[str, int]:
        if not isinstance(error, UnicodeEncodeError):
            raise error
        text = error.object[error.start : error.end].translate(_PLAIN)
        return text.encode("ascii", "replace").decode("ascii"), error.end

    codecs.register_error("gantrysim", spelled)
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="gantrysim")


def plain_table(content: PageTable) -> Table:
    """Return a table of a page for the terminal."""
    return text_table(content.heads, content.cells, content.numeric, content.caption or "")


def text_table(heads: Sequence[str], rows: Sequence[Sequence[str]], numeric: Sequence[bool], title: str) -> Table:
    """Return a table of texts for the terminal; columns of prose wrap."""
    table = Table(title=escape(title), title_justify="left", box=None, padding=(0, 1, 0, 0))
    for k, (head, is_number) in enumerate(zip(heads, numeric, strict=True)):
        is_prose = not is_number and is_prose_column(rows, k)
        justify: Literal["left", "right"] = "right" if is_number else "left"
        # a head stands above its unit
        parts = head.replace(" [", "\n[").split("\n")
        lines = [line for part in parts for line in wrapped_lines(part, _WIDEST_HEAD, break_long_words=False)]
        table.add_column(escape("\n".join(lines)), justify=justify, no_wrap=not is_prose)
    for row in rows:
        table.add_row(*(escape(unbreakable_text(cell)) for cell in row))
    return table


def is_prose_column(rows: Sequence[Sequence[str]], column: int) -> bool:
    """Return whether a column of a table has cells that wrap."""
    return any(len(row[column]) > _LONGEST_CELL for row in rows)


def columns() -> int:
    """Return the width of the terminal in characters."""
    return _output.width


def fits(content: RenderableType) -> bool:
    """Return whether a table fits the terminal with its longest words whole."""
    if isinstance(content, Table):
        _keep_words(content)
    return _least_width(content) <= _output.width


def show(content: RenderableType) -> None:
    """Print a table or another rich renderable whole.

    A table too wide for the terminal is printed without rules and wide gaps; where it still is, its lines run on.
    """
    if isinstance(content, Table):
        _keep_words(content)
        if _least_width(content) > _output.width:
            content.box = None
            content.padding = (0, 1, 0, 0)
        _widen_columns(content, _output.width - _least_width(content))
    width = _least_width(content)
    _write(content, _output if width <= _output.width else Console(width=width, emoji=False), crop=False)


def _least_width(content: RenderableType) -> int:
    return Measurement.get(_output, _output.options.update(width=_WIDEST), content).minimum


def _keep_words(table: Table) -> None:
    """Give columns the width of their longest word, or line where they do not wrap; rich would cut words and lines."""
    for column in table.columns:
        if column.min_width is None and column.overflow != "fold":
            column.min_width = _longest(column, wrapped=not column.no_wrap)


def _widen_columns(table: Table, spare: int) -> None:
    """Share the characters that are spare among the columns that wrap: those that need least first, as names by prose.

    rich shrinks them in proportion to their width alone, so that those with long words would not fit.
    """
    wrapping = [column for column in table.columns if not column.no_wrap and column.min_width is not None]
    needs = sorted(
        (_longest(column, wrapped=False) - (column.min_width or 0), number) for number, column in enumerate(wrapping)
    )
    if sum(need for need, _ in needs) <= spare:
        return
    for k, (need, number) in enumerate(needs):
        share = min(need, max(spare, 0) // (len(needs) - k))
        spare -= share
        wrapping[number].width = (wrapping[number].min_width or 0) + share


def _longest(column: RichColumn, wrapped: bool) -> int:
    """Return the length of the longest line of a column, or of its longest word."""
    cells = [_output.render_str(cell).plain for cell in (column.header, *column.cells) if isinstance(cell, str)]
    pieces = [piece for cell in cells for piece in (cell.split() if wrapped else cell.splitlines())]
    return max(map(cell_len, pieces), default=0)


def say(text: str, *, wrap: bool = False, end: str = "\n") -> None:
    """Print a text without markup, wrapped at the terminal's width where it is prose that no program reads."""
    plain = text.translate(_CONTROLS)
    _write(
        escape(unbreakable_text(plain)) if wrap else escape(plain),
        _output,
        soft_wrap=not wrap,
        highlight=False,
        end=end,
    )


def unbreakable_text(text: str) -> str:
    """Return a text whose numbers stay on a line with their units and names when it is wrapped."""
    return quantity.joined(text, _JOINT)


def _write(content: RenderableType, console: Console, **options: Any) -> None:
    """Write what a console makes of a renderable to the standard output, without spaces at the ends of lines."""
    with console.capture() as capture:
        console.print(content, **options)
    _output.file.write(_TRAILING.sub(r"\1", capture.get()).replace(_JOINT, " "))
    _output.file.flush()


def warn(text: str, kind: str = "") -> None:
    """Print a line to the standard error, headed by the kind of failure, such as "error" or "fault"."""
    head = f"[bold red]{kind}[/]: " if kind else ""
    _messages.print(f"{head}{escape(text.translate(_CONTROLS))}", soft_wrap=True, highlight=False)


@cache
def tell_compiling() -> None:
    """Print a line to a terminal when this process begins to compile, which takes seconds."""

    def tell(sentence: str) -> None:
        if _messages.is_terminal:
            warn(sentence)

    when_compiling(tell)


@contextmanager
def share_bar(task: str, go_on: Callable[[], None] = lambda: None) -> Iterator[Callable[[float], None]]:
    """Show a progress bar during the block; yields a function to call with the completed share, 0 to 1.

    `go_on` is called before each update, see `interruptible`.
    """
    with _bars(TextColumn("{task.percentage:3.0f} %"), TimeRemainingColumn()) as bars:
        bar = bars.add_task(task, total=1.0)
        most = 0.0

        def advance(share: float) -> None:
            nonlocal most
            go_on()
            most = max(most, share)
            bars.update(bar, completed=most)

        yield advance


@contextmanager
def count_bar(task: str) -> Iterator[Callable[[int, int, str], None]]:
    """Show a progress bar during the block; yields a function to call with number done, total and a short status."""
    columns = (TextColumn("{task.fields[count]}"), TimeElapsedColumn(), TextColumn("{task.fields[news]}"))
    with _bars(*columns) as bars:
        bar = bars.add_task(task, total=None, count="", news="")
        most = 0.0

        def advance(done: int, every: int, news: str) -> None:
            # the number known to be left grows while it runs: the bar then waits, and does not go back
            nonlocal most
            most = max(most, done / every if every else 0.0)
            bars.update(bar, completed=most, total=1.0, count=f"{done} of {every}", news=news)

        yield advance


@contextmanager
def stage(task: str) -> Iterator[None]:
    """Show a moving bar and the elapsed time during a block whose share done is not known."""
    with _bars(TimeElapsedColumn()) as bars:
        bars.add_task(task, total=None)
        yield


def _bars(*columns: ProgressColumn) -> Progress:
    shown = (TextColumn("{task.description:9}"), BarColumn(), *columns)
    return Progress(*shown, console=_messages, transient=True, disable=not _messages.is_terminal)


@contextmanager
def interruptible() -> Iterator[Callable[[], None]]:
    """Let SIGTERM and SIGHUP end the block as Ctrl-C does; yields a function that raises a pending interrupt again.

    An interrupt is lost in code that cannot propagate it, such as a finaliser, which is then not reported; it is raised
    again soon after. Where code turns it into another error, as ctypes does when converting arguments, the block still
    ends as interrupted.
    """
    signals.forget()
    received: list[int] = []
    timers: list[threading.Timer] = []

    def interrupt(number: int, frame: FrameType | None) -> None:
        received.append(number)
        signals.interrupt(number, frame)

    def go_on() -> None:
        if received:
            raise KeyboardInterrupt

    def unraisable(lost: Any) -> None:
        if not received:
            report(lost)
        elif issubclass(lost.exc_type, KeyboardInterrupt) and hasattr(signal, "pthread_kill"):  # not on Windows
            timer = threading.Timer(_PATIENCE, signal.pthread_kill, (threading.main_thread().ident, received[0]))
            timer.daemon = True
            timer.start()
            timers.append(timer)

    report = sys.unraisablehook
    sys.unraisablehook = unraisable
    try:
        with signals.handled(interrupt):
            try:
                yield go_on
            except Exception:
                go_on()
                raise
            finally:
                for timer in timers:
                    timer.cancel()
    finally:
        sys.unraisablehook = report
