"""The answer of a run on one screen: verdict, what spoils it, the best change with its cost, and where the page is."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from rich.table import Table
from rich.text import Text

from gantrysim.cli.terminal import columns, say, show, unbreakable_text
from gantrysim.job.loaded import CHOSEN
from gantrysim.report.answer import Answer
from gantrysim.results.checks import FAIL, PASS, UNJUDGED, WARN

LONGEST = 25  # lines of 80 columns

_STYLES = {PASS: "green", WARN: "yellow", FAIL: "bold red", UNJUDGED: ""}
_PASTED = 8  # lines to paste; more are left to `gantrysim show FOLDER levers`
_INDENT = "  "
_CONTINUED = " \\"  # a line of a shell
_BEGINNING = re.compile(r" \(|, (?![xyz] )")  # of a choice: without its reason, how to choose otherwise, and details
_COLUMNS = ("state", "row")  # before the text


def show_verdict(answer: Answer) -> None:
    """Print the verdict: a line for each row, or why none is judged."""
    heading = f"verdict {answer.headline}"
    if not answer.rows:
        say(heading, wrap=True)
        return
    show(Text(heading, _STYLES[answer.state]))
    table = Table.grid(padding=(0, 2, 0, 0))
    for _ in _COLUMNS:
        table.add_column(no_wrap=True)
    table.add_column(overflow="fold")
    for row in answer.rows:
        where = f": {row.place}" if row.place and row.state != PASS else ""
        state = Text(f"{row.symbol} {row.state}", _STYLES[row.state])
        table.add_row(state, row.name, Text(unbreakable_text(f"{row.text}{where}")))
    show(table)


def show_cause(answer: Answer, headline: str) -> None:
    """Print what spoils a run, or its error where nothing does."""
    _show_rows([("error" if answer.state == PASS else "cause", headline)])


def show_choice(notes: Sequence[str], folder: str) -> None:
    """Print in a few words what was chosen for a program that is given alone; nothing where nothing was.

    Args:
        notes: of the run, the one on what was chosen among them.
        folder: of the run.
    """
    for note in notes:
        if note.startswith(CHOSEN):
            choices = [_BEGINNING.split(choice)[0] for choice in note.removeprefix(CHOSEN).split("; ")]
            _show_rows([("chosen", f"{'; '.join(choices)}: gantrysim show {folder} notes")])


def show_change(changes: Mapping[str, Any], folder: str) -> None:
    """Print the best change with what it costs, the lines to paste, and the verdict with it.

    Args:
        changes: what `gantrysim.report.answer.Remedy` holds.
        folder: of the run.
    """
    _show_rows([("change", changes["sentence"])])
    lines = list(option_lines(changes["options"])) or changes["lines"].rstrip().splitlines()
    if len(lines) > _PASTED:
        _show_rows([("paste", f"{len(lines)} lines: gantrysim show {folder} levers")])
    elif lines:
        say(f"paste into the {'command line' if changes['options'] else 'job file'}:")
        say("\n".join(_INDENT + line for line in lines))
    if changes["outcome"]:
        _show_rows([("then", changes["outcome"]), ("", changes["values"])])


def option_lines(options: Sequence[str]) -> Iterator[str]:
    """Yield options on lines of a shell, each but the last continued."""
    line = ""
    width = columns() - len(_INDENT) - len(_CONTINUED)
    for word in options:
        option = word if word.startswith("--") else f"--{word}"
        if line and len(line) + 1 + len(option) > width:
            yield f"{line}{_CONTINUED}"
            line = option
        else:
            line = f"{line} {option}".strip()
    if line:
        yield line


def _show_rows(rows: Sequence[tuple[str, str]]) -> None:
    table = Table.grid(padding=(0, 2, 0, 0))
    table.add_column(no_wrap=True, style="bold", width=7)
    table.add_column(overflow="fold")
    for name, text in rows:
        table.add_row(name, Text(unbreakable_text(text)))
    show(table)
