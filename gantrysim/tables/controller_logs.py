"""Logs of controllers that are no tables of rows: LinuxCNC's halscope, and dumps of the TABLE of Trio controllers."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

import numpy as np

from gantrysim.base.errors import InputError
from gantrysim.base.patterns import NUMBER
from gantrysim.tables.column_table import ColumnTable
from gantrysim.tables.dialect import BLANKS, Dialect

_PERIOD = re.compile(rf"Sampling period is ({NUMBER}) ns\s*")
_STATEMENT = re.compile(r"TABLE\s*\((.*)\)", re.IGNORECASE)
_SHOWN = 30  # characters of a wrong cell
_number = Dialect(BLANKS).number


def halscope_period(line: str) -> float | None:
    """Return the period that the first line of a file of halscope gives [s], None of any other line."""
    match = _PERIOD.fullmatch(line.strip() + " ")
    return None if match is None else 1e-9 * float(match[1])


def halscope_table(label: str, lines: Sequence[tuple[int, str]], period: float) -> ColumnTable:
    """Return the columns of lines of pairs, a channel's name and its value.

    Args:
        label: names the file in errors.
        lines: number and text of those after the first.
        period: of the samples [s].

    Raises:
        InputError: a line of anything else, or channels with different numbers of samples.
    """
    columns: dict[str, list[float]] = {}
    for k, line in lines:
        cells = line.split()
        pairs = list(zip(cells[::2], map(_number, cells[1::2]), strict=False))
        if len(cells) % 2 or any(value is None for _, value in pairs):
            raise InputError(f"{label}: line {k}: must be names and values of channels: {line[:_SHOWN]!r}")
        for name, value in pairs:
            columns.setdefault(name, []).append(float(value or 0.0))
    if not columns:
        raise InputError(f"{label}: has no rows")
    shortest = min(map(len, columns.values()))
    if max(map(len, columns.values())) > shortest + 1:  # the last line alone may be cut
        counts = ", ".join(f"{name} {len(values)}" for name, values in columns.items())
        raise InputError(f"{label}: its channels have different numbers of samples: {counts}")
    content = {name: np.array(values[:shortest]) for name, values in columns.items()}
    return ColumnTable(label, content, {}, period=period)


def table_dump(label: str, lines: Sequence[str], blocks: int) -> ColumnTable:
    """Return numbers, or statements TABLE(first, value, ...), as blocks of one length, which SCOPE leaves.

    Args:
        label: names the file in errors.
        lines: of the file.
        blocks: number of blocks.

    Raises:
        InputError: a cell that is no number, or numbers that are not so many blocks.
    """
    values = list(_dumped(label, lines))
    if not values or len(values) % blocks:
        raise InputError(f"{label}: has {len(values)} values, which are not {blocks} blocks of one length")
    columns = np.array(values).reshape(blocks, -1)
    return ColumnTable(label, {str(k): column for k, column in enumerate(columns, 1)}, {})


def _dumped(label: str, lines: Sequence[str]) -> Iterator[float]:
    for line in lines:
        statement = _STATEMENT.fullmatch(line)
        cells = re.split(r"[\s,;]+", (statement[1] if statement else line).strip())
        for cell in cells[1:] if statement else cells:
            value = _number(cell)
            if value is None or not np.isfinite(value):
                raise InputError(f"{label}: {cell[:_SHOWN]!r} is not a finite number")
            yield value
