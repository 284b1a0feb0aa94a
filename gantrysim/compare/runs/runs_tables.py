"""The tables of a comparison as text, for the terminal and the page: heads and rows of cells."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from gantrysim.base.quantity import MINUS, NOTHING, Quantity
from gantrysim.compare.runs.compared_runs import ComparedRuns
from gantrysim.compare.runs.differences import CheckChange, with_share
from gantrysim.job.causes import CELL_FORM
from gantrysim.metrics.parts import ERROR

# effects are often smaller than the decimals of `ERROR`
WORTH: Quantity[Any] = replace(ERROR, form=CELL_FORM)

Cells = tuple[list[str], list[list[str]]]


def difference_cells(comparison: ComparedRuns) -> Cells:
    """Return the table of what differs between the jobs."""
    rows = [[difference.kind, difference.key, *difference.texts] for difference in comparison.differences]
    return ["of", "value", *comparison.names], rows


def budget_cells(comparison: ComparedRuns) -> Cells:
    """Return the table of the rms error of every link [µm]."""
    rows = []
    for link, parts in comparison.budgets.items():
        sizes = [None if part is None else part.rms for part in parts]
        changes = [size_change(sizes[0], size) for size in sizes[1:]]
        rows.append([link, *map(ERROR.number, sizes), *changes])
    return ["link", *comparison.names, *_changes(comparison.names)], rows


def cause_cells(comparison: ComparedRuns) -> Cells:
    """Return the table of what each cause is worth [µm]; without rows where causes are not known."""
    rows = [[cause, *map(WORTH.number, worth)] for cause, worth in comparison.causes.items()]
    return ["cause", *comparison.names], rows


def check_cells(names: Sequence[str], checks: Sequence[CheckChange]) -> Cells:
    """Return the table of the checks of verdicts."""
    return ["of", "check", "limit", *names, *_changes(names)], [_check_row(check) for check in checks]


def _changes(names: Sequence[str]) -> list[str]:
    return ["change"] if len(names) == 2 else [f"change, {name}" for name in names[1:]]


def _check_row(check: CheckChange) -> list[str]:
    unit = f" [{check.unit}]" if check.unit else ""
    numbers = range(len(check.checks))
    cells = map(check.cell, numbers)
    return [check.row, f"{check.quantity}{unit}", check.limit, *cells, *map(check.change_text, numbers[1:])]


def value_cells(comparison: ComparedRuns, group: str, *, large_only: bool) -> Cells:
    """Return heads and rows of the table of a group's values, as text."""
    heads = ["value", *comparison.names, *_changes(comparison.names)]
    rows = [
        [value.quantity.head, *value.texts, *(value.change_text(run) for run in range(1, len(comparison.runs)))]
        for value in comparison.values
        if value.group == group and not (large_only and not value.is_large)
    ]
    return heads, rows


def size_change(before: float | None, after: float | None) -> str:
    """Return the change of an error [mm] in µm and in percent."""
    if before is None or after is None:
        return NOTHING
    change = ERROR.number(after - before)
    text = change if change.startswith(MINUS) or change == "0" else f"+{change}"
    return with_share(text, after - before, before)
