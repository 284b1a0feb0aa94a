"""A table in text: its dialect, heads, units, remarks and rows."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from gantrysim.tables.dialect import GAPS, Dialect, dialect_of
from gantrysim.tables.units import is_unit

_EXAMINED = 200  # rows, for which columns hold numbers
_HEAD_LINES = 100  # in which the rows may begin: programs of oscilloscopes write a long preamble
_REMARK = "#"


class Row(NamedTuple):
    """A row of a table.

    Attributes:
        line: its number in the file, from 1.
        cells: without quotes.
    """

    line: int
    cells: list[str]


@dataclass(frozen=True)
class TextTable:
    """A table in text.

    Attributes:
        dialect: how its lines are divided.
        heads: of its columns; empty where it has none.
        units: from a line of units below the heads; empty where there is none.
        rows: its lines (number, text) from the first with values.
        remarks: lines beginning with #, without it, and the lines before the heads.
        breaks: numbers of its empty lines.
    """

    dialect: Dialect
    heads: tuple[str, ...]
    units: tuple[str, ...]
    rows: Sequence[tuple[int, str]]
    remarks: tuple[str, ...]
    breaks: tuple[int, ...]

    @classmethod
    def of(cls, text: str) -> TextTable:
        """Return the table in a text.

        Lines that begin with # are remarks; the last of them before the rows may hold the heads, as NumPy and KiCad
        write them. Lines before the heads are remarks too. The heads are the last line before the first in which all
        columns of numbers hold numbers; a line of units may follow them.
        """
        lines: list[tuple[int, str]] = []
        remarks: list[tuple[int, str]] = []
        breaks: list[int] = []
        for number, line in enumerate(text.removeprefix("\ufeff").splitlines(), 1):
            stripped = line.strip()
            if not stripped:
                breaks.append(number)
            elif stripped.startswith(_REMARK):
                remarks.append((number, stripped.lstrip(_REMARK).strip()))
            else:
                lines.append((number, stripped if "\t" not in line else line.rstrip("\r\n")))
        dialect = dialect_of([line for _, line in lines])
        if lines and lines[0][1].lower().startswith("sep="):
            del lines[0]
        begin = _first_row(lines, dialect)
        preamble = lines[:begin]
        heads, units = _heads(preamble, lines[begin:], dialect)
        if not preamble and lines[begin:]:
            before = [remark for number, remark in remarks if number < lines[begin][0]]
            heads = _heads_in_remark(before, dialect.cells(lines[begin][1]), dialect)
        used = (1 if preamble else 0) + (1 if units else 0)
        unread = [line for _, line in preamble[: len(preamble) - used]]
        notes = (*(remark for _, remark in remarks), *unread)
        return cls(dialect, heads, units, lines[begin:], notes, tuple(breaks))

    def split(self) -> list[Row]:
        """Return the rows, divided into cells."""
        return [Row(number, self.dialect.cells(line)) for number, line in self.rows]


def _first_row(lines: Sequence[tuple[int, str]], dialect: Dialect) -> int:
    """Return the index of the first line with values: one in which all columns of numbers hold numbers, or gaps."""
    rows = [dialect.cells(line) for _, line in lines[: _EXAMINED + _HEAD_LINES]]
    counts = Counter(map(len, rows))
    if not counts:
        return 0
    width = max(counts, key=lambda count: (counts[count], count))
    usual = [row for row in rows if len(row) == width]
    numeric = [_is_numeric([row[k] for row in usual[len(usual) // 2 :]], dialect) for k in range(width)]
    for index, row in enumerate(rows[:_HEAD_LINES]):
        pairs = list(zip(row, numeric, strict=False))
        wrong = any(is_number and not _is_value(cell, dialect) for cell, is_number in pairs)
        holds_number = any(is_number and dialect.number(cell) is not None for cell, is_number in pairs)
        # a line of a preamble, "Model;X500", has fewer cells than the table, or no number where it has them
        all_numbers = len(row) > 1 and all(dialect.number(cell) is not None for cell in row)
        if all_numbers or (not wrong and holds_number and len(row) * 2 > width):
            return index
    return 1  # without any number, the first line has the heads


def _is_numeric(cells: Sequence[str], dialect: Dialect) -> bool:
    numbers = sum(dialect.number(cell) is not None for cell in cells)
    gaps = sum(cell.lower() in GAPS for cell in cells)
    return numbers > 0 and 2 * (numbers + gaps) > len(cells)


def _is_value(cell: str, dialect: Dialect) -> bool:
    return dialect.number(cell) is not None or cell.lower() in GAPS


def _heads(
    preamble: Sequence[tuple[int, str]], rows: Sequence[tuple[int, str]], dialect: Dialect
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return heads and units from the lines before the rows."""
    if not preamble:
        return (), ()
    last = tuple(dialect.cells(preamble[-1][1]))
    width = len(dialect.cells(rows[0][1])) if rows else len(last)
    if len(preamble) > 1:
        above = tuple(dialect.cells(preamble[-2][1]))
        if len(above) == len(last) >= width and all(map(is_unit, last)) and not all(map(is_unit, above)):
            return above, last
    return last, ()


def _heads_in_remark(remarks: Sequence[str], cells: Sequence[str], dialect: Dialect) -> tuple[str, ...]:
    """Return the heads in the last remark before the rows, where it has as many words as they have cells."""
    if not remarks:
        return ()
    heads = tuple(dialect.cells(remarks[-1]))
    return heads if len(heads) == len(cells) > 1 else ()
