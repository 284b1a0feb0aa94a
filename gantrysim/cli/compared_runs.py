"""What `gantrysim compare RUN RUN` does: runs beside one another, in tables and a page."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from gantrysim.base.errors import InputError, expanded
from gantrysim.cli.terminal import say, show

if TYPE_CHECKING:
    from rich.table import Table

    from gantrysim.compare.runs.compared_runs import ComparedRuns


def compare_folders(folders: Sequence[Path], out: Path) -> None:
    """Compare saved runs, print what differs, and write the page into a folder.

    Raises:
        InputError: a folder that holds no run, or that is given twice.
    """
    from gantrysim.compare.runs.compared_run import names_of_folders
    from gantrysim.compare.runs.run_comparison import check_number, compare_runs
    from gantrysim.compare.runs.runs_page import OUTPUT, REPORT, SUMMARY
    from gantrysim.report.saved import SavedRun

    check_number(len(folders))
    places = [expanded(folder).resolve() for folder in folders]
    for number, place in enumerate(places):
        if place in places[:number]:
            raise InputError(f"run {folders[number]}: is given twice; name the folder of another run")
    OUTPUT.check(out)
    saved = [SavedRun.load(folder) for folder in folders]
    comparison = compare_runs(*saved, names=names_of_folders(folders))
    comparison.report(out)
    show_comparison(comparison)
    say(f"written to {out}/: {REPORT}, {SUMMARY}")


def show_comparison(comparison: ComparedRuns) -> None:
    """Print the answer, what differs, checks, error budgets, causes, values that differ, and notes."""
    say(comparison.sentence, wrap=True)
    for table in comparison_tables(comparison):
        show(table)
    for note in comparison.notes:
        say(f"note: {note}", wrap=True)


def comparison_tables(comparison: ComparedRuns) -> list[Table]:
    """Return the tables of a comparison; those without rows are left out."""
    from gantrysim.compare.runs.runs_tables import (
        budget_cells,
        cause_cells,
        check_cells,
        difference_cells,
        value_cells,
    )
    from gantrysim.compare.runs.value_changes import LARGE

    first = comparison.names[0]
    judged = f"checks of the verdict; changes against {first}"
    named = [
        ("what differs", 2, difference_cells(comparison)),
        (judged, 3, check_cells(comparison.names, comparison.checks)),
        ("error normal to the requested path, rms [µm]", 1, budget_cells(comparison)),
        ("worth of causes, of the rms contour error [µm]", 1, cause_cells(comparison)),
    ]
    for group in dict.fromkeys(value.group for value in comparison.values):
        title = f"{group.lower()}: values that differ by {100 * LARGE:.0f} % or more"
        named.append((title, 1, value_cells(comparison, group, large_only=True)))
    return [_table(title, heads, rows, texts) for title, texts, (heads, rows) in named if rows]


def _table(title: str, heads: Sequence[str], rows: Sequence[Sequence[str]], texts: int) -> Table:
    """Return a table whose first columns are text, and whose others are numbers."""
    from rich.markup import escape
    from rich.table import Table

    table = Table(title=escape(title), title_justify="left", box=None, padding=(0, 1, 0, 0))
    for number, head in enumerate(heads):
        table.add_column(escape(head), justify="left" if number < texts else "right")
    for row in rows:
        table.add_row(*map(escape, row))
    return table
