"""What the commands print: texts, tables and progress bars; and how they end, by interrupts and exit statuses."""

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

# Exit statuses. An interrupted command ends with `signals.status()`.

# all is written but a plot, a report or a video that failed
INCOMPLETE = 1
# a log shows no value of one of its axes
NOT_IDENTIFIED = 1
INPUT_ERROR = 2
# a fault ended the run, or all runs of a study
FAULT = 3
# the verdict is as bad as --fail-on names, or worse
OUT_OF_TOLERANCE = 4

# Characters.

# what is printed where the terminal's encoding lacks a character
_SPELLINGS = str.maketrans(
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
# characters of a file that would command the terminal, as they are printed; rich drops the other ones
_CONTROLS = {code: f"\\x{code:02x}" for code in (*range(7), *range(14, 32), *range(127, 160))}
# stands for a space at which no line ends: a letter of the user's own, as rich breaks lines at no-break spaces too
_UNBREAKABLE_SPACE = "\ue000"
# spaces at the end of a line, before the codes that end its colours
_TRAILING_SPACES = re.compile(r" +((?:\x1b\[[0-9;]*m)*)$", re.MULTILINE)

# Sizes of a table, in characters.

# the width at which a table is measured, wider than any
_MEASURED_WIDTH = 10_000
# a column with a longer cell is prose, and wraps
_LONGEST_CELL = 16
# a line of a head, but for longer words
_WIDEST_HEAD = 10

# time after which an interrupt that was lost is raised again [s]
_LOST_INTERRUPT_WAIT = 0.1

# without emoji: in a message, mine.py:Ring: is no picture of a ring
_output = Console(soft_wrap=False, emoji=False)
_messages = Console(stderr=True, emoji=False)


def spell_out() -> None:
    """Print characters that the encoding of standard output and error lacks by others, as "um" for "µm"."""

    def spelled(error: UnicodeError) -> tuple[str, int]:
        if not isinstance(error, UnicodeEncodeError):
            raise error
        text = error.object[error.start : error.end].translate(_SPELLINGS)
        return text.encode("ascii", "replace").decode("ascii"), error.end

    codecs.register_error("gantrysim", spelled)
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="gantrysim")


# Texts.


def say(text: str, *, wrap: bool = False, end: str = "\n") -> None:
    """Print a text without markup, wrapped at the terminal's width where it is prose that no program reads."""
    plain = text.translate(_CONTROLS)
    if wrap:
        plain = unbreakable_text(plain)
    _write(escape(plain), _output, soft_wrap=not wrap, highlight=False, end=end)


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


def unbreakable_text(text: str) -> str:
    """Return a text whose numbers stay on a line with their units and names when it is wrapped."""
    return quantity.joined(text, _UNBREAKABLE_SPACE)


def _write(content: RenderableType, console: Console, **options: Any) -> None:
    """Write what a console makes of a renderable to the standard output, without spaces at the ends of lines."""
    with console.capture() as capture:
        console.print(content, **options)
    text = _TRAILING_SPACES.sub(r"\1", capture.get())
    _output.file.write(text.replace(_UNBREAKABLE_SPACE, " "))
    _output.file.flush()


# Tables.


def plain_table(content: PageTable) -> Table:
    """Return a table of a page for the terminal."""
    return text_table(content.heads, content.cells, content.numeric, content.caption or "")


def text_table(heads: Sequence[str], rows: Sequence[Sequence[str]], numeric: Sequence[bool], title: str) -> Table:
    """Return a table of texts for the terminal; columns of prose wrap."""
    table = Table(title=escape(title), title_justify="left", box=None, padding=(0, 1, 0, 0))
    for number, (head, is_numeric) in enumerate(zip(heads, numeric, strict=True)):
        justify: Literal["left", "right"] = "right" if is_numeric else "left"
        wraps = not is_numeric and is_prose_column(rows, number)
        table.add_column(escape(_wrapped_head(head)), justify=justify, no_wrap=not wraps)
    for row in rows:
        table.add_row(*(escape(unbreakable_text(cell)) for cell in row))
    return table


def _wrapped_head(head: str) -> str:
    """Return a head in short lines, above its unit."""
    parts = head.replace(" [", "\n[").split("\n")
    lines: list[str] = []
    for part in parts:
        lines += wrapped_lines(part, _WIDEST_HEAD, break_long_words=False)
    return "\n".join(lines)


def is_prose_column(rows: Sequence[Sequence[str]], column: int) -> bool:
    """Return whether a column of a table has cells that wrap."""
    return any(len(row[column]) > _LONGEST_CELL for row in rows)


def terminal_width() -> int:
    """Return the width of the terminal in characters."""
    return _output.width


def fits(content: RenderableType) -> bool:
    """Return whether a table fits the terminal with its longest words whole."""
    if isinstance(content, Table):
        _keep_words(content)
    return _smallest_width(content) <= _output.width


def show(content: RenderableType) -> None:
    """Print a table or another rich renderable whole.

    A table too wide for the terminal is printed without rules and wide gaps; where it still is, its lines run on.
    """
    if isinstance(content, Table):
        _keep_words(content)
        if _smallest_width(content) > _output.width:
            content.box = None
            content.padding = (0, 1, 0, 0)
        _widen_columns(content, _output.width - _smallest_width(content))
    width = _smallest_width(content)
    console = _output if width <= _output.width else Console(width=width, emoji=False)
    _write(content, console, crop=False)


def _smallest_width(content: RenderableType) -> int:
    return Measurement.get(_output, _output.options.update(width=_MEASURED_WIDTH), content).minimum


def _keep_words(table: Table) -> None:
    """Give columns the width of their longest word, or line where they do not wrap; rich would cut words and lines."""
    for column in table.columns:
        if column.min_width is None and column.overflow != "fold":
            column.min_width = _longest_line(column) if column.no_wrap else _longest_word(column)


def _widen_columns(table: Table, spare: int) -> None:
    """Share the characters that are spare among the columns that wrap: those that need least first, as names by prose.

    rich shrinks them in proportion to their width alone, so that those with long words would not fit.
    """
    wrapping = [column for column in table.columns if not column.no_wrap and column.min_width is not None]
    # what each lacks to hold its longest line, the least first
    needs = sorted((_longest_line(column) - (column.min_width or 0), k) for k, column in enumerate(wrapping))
    if sum(need for need, _ in needs) <= spare:
        return
    waiting = len(needs)
    for need, k in needs:
        share = min(need, max(spare, 0) // waiting)
        wrapping[k].width = (wrapping[k].min_width or 0) + share
        spare -= share
        waiting -= 1


def _longest_line(column: RichColumn) -> int:
    """Return the length of the longest line of a column's head and cells."""
    return max((cell_len(line) for cell in _cells(column) for line in cell.splitlines()), default=0)


def _longest_word(column: RichColumn) -> int:
    """Return the length of the longest word of a column's head and cells."""
    return max((cell_len(word) for cell in _cells(column) for word in cell.split()), default=0)


def _cells(column: RichColumn) -> list[str]:
    """Return the texts of a column, its head first, without their markup."""
    return [_output.render_str(cell).plain for cell in (column.header, *column.cells) if isinstance(cell, str)]


# Progress bars.


@contextmanager
def share_bar(task: str, go_on: Callable[[], None] = lambda: None) -> Iterator[Callable[[float], None]]:
    """Show a progress bar during the block; yields a function to call with the completed share, 0 to 1.

    `go_on` is called before each update, see `interruptible`.
    """
    with _bars(TextColumn("{task.percentage:3.0f} %"), TimeRemainingColumn()) as bars:
        bar = bars.add_task(task, total=1.0)
        furthest = 0.0

        def advance(share: float) -> None:
            nonlocal furthest
            go_on()
            furthest = max(furthest, share)
            bars.update(bar, completed=furthest)

        yield advance


@contextmanager
def count_bar(task: str) -> Iterator[Callable[[int, int, str], None]]:
    """Show a progress bar during the block; yields a function to call with number done, total and a short status."""
    columns = (TextColumn("{task.fields[count]}"), TimeElapsedColumn(), TextColumn("{task.fields[status]}"))
    with _bars(*columns) as bars:
        bar = bars.add_task(task, total=None, count="", status="")
        furthest = 0.0

        def advance(done: int, total: int, status: str) -> None:
            # the total grows as more is found to be done: the bar then waits, and does not go back
            nonlocal furthest
            furthest = max(furthest, done / total if total else 0.0)
            bars.update(bar, completed=furthest, total=1.0, count=f"{done} of {total}", status=status)

        yield advance


@contextmanager
def stage(task: str) -> Iterator[None]:
    """Show a moving bar and the elapsed time during a block whose share done is not known."""
    with _bars(TimeElapsedColumn()) as bars:
        bars.add_task(task, total=None)
        yield


def _bars(*columns: ProgressColumn) -> Progress:
    """Return bars with their name and some columns, on a terminal alone."""
    name = TextColumn("{task.description:9}")
    return Progress(name, BarColumn(), *columns, console=_messages, transient=True, disable=not _messages.is_terminal)


# Interrupts.


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
    report = sys.unraisablehook

    def interrupt(number: int, frame: FrameType | None) -> None:
        received.append(number)
        signals.interrupt(number, frame)

    def go_on() -> None:
        if received:
            raise KeyboardInterrupt

    def raise_again(lost: Any) -> None:
        """Take an error that no code could propagate: an interrupt is sent once more, all else is reported."""
        if not received:
            report(lost)
        # Windows cannot send a signal to a thread
        elif issubclass(lost.exc_type, KeyboardInterrupt) and hasattr(signal, "pthread_kill"):
            main_thread = threading.main_thread().ident
            timer = threading.Timer(_LOST_INTERRUPT_WAIT, signal.pthread_kill, (main_thread, received[0]))
            timer.daemon = True
            timer.start()
            timers.append(timer)

    sys.unraisablehook = raise_again
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
