"""A table in text: its dialect, heads, units, remarks and rows."""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from gantrysim.tables.units import is_unit

# The dialect of a table in text: the sign between its cells, and the decimal sign.

BLANKS = " "  # any number of blanks or tabs
# A semicolon, a tab or a bar is hardly ever part of a number or a name; a comma may be the decimal sign.
SIGNS = (";", "\t", "|", ",", BLANKS)
GAPS = frozenset(("", "nan", "na", "n/a", "null", "none", "-", "--"))  # cells without a value, in lower case

_POINT = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_COMMA = re.compile(r"[-+]?(?:\d+,\d+|,\d+)(?:[eE][-+]?\d+)?")
_QUOTED = re.compile(r'"([^"]*)"|(\S+)')
_EXAMINED_LINES = 200  # lines
_ROUNDING = 1e-9  # of shares that are equal
_ANY_SIGN = 1e-3  # of a cell: a sign that divides lines without numbers is better than none


class Dialect(NamedTuple):
    """How a line of a table is divided.

    Attributes:
        separator: between cells; `BLANKS` for any number of blanks.
        decimal_comma: whether a comma is the decimal sign.
    """

    separator: str
    decimal_comma: bool = False

    def cells(self, line: str) -> list[str]:
        """Return the cells of a line without their quotes, and without empty ones at its end."""
        if self.separator == BLANKS:
            cells = [quoted or plain for quoted, plain in _QUOTED.findall(line)]
        elif '"' in line:
            cells = [cell.strip() for cell in next(csv.reader([line], delimiter=self.separator, skipinitialspace=True))]
        else:
            cells = [cell.strip() for cell in line.split(self.separator)]
        # a separator at the end of the line
        while len(cells) > 1 and not cells[-1]:
            cells.pop()
        return cells

    def number(self, cell: str) -> float | None:
        """Return the number in a cell, None of one that holds none."""
        if self.decimal_comma:
            if _COMMA.fullmatch(cell):
                return float(cell.replace(",", "."))
            # a point would be between thousands
            if "." in cell:
                return None
        try:
            return float(cell) if "_" not in cell else None
        except ValueError:
            return None


def dialect_of(lines: Sequence[str]) -> Dialect:
    """Return the dialect in which most cells of a table's lines are numbers, the first of `SIGNS` where several are.

    A first line "sep=;", as spreadsheets write it, is followed.

    Args:
        lines: of the table, without remarks and empty ones.
    """
    if lines and lines[0].lower().startswith("sep=") and len(lines[0].rstrip()) == len("sep=;"):
        sign = lines[0].rstrip()[-1]
        return Dialect(sign, _has_decimal_comma(lines[1:], sign))
    best = Dialect(BLANKS, _has_decimal_comma(lines, BLANKS))
    best_share = 0.0
    for sign in SIGNS:
        dialect = Dialect(sign, _has_decimal_comma(lines, sign))
        share = _share_of_numbers(lines, dialect)
        if share > best_share * (1 + _ROUNDING):
            best = dialect
            best_share = share
    return best


def _has_decimal_comma(lines: Sequence[str], sign: str) -> bool:
    # between commas, a comma is within quotes
    cells = [cell for line in lines[:_EXAMINED_LINES] for cell in Dialect(sign).cells(line)]
    return any(map(_COMMA.fullmatch, cells)) and not any("." in cell and _POINT.fullmatch(cell) for cell in cells)


def _share_of_numbers(lines: Sequence[str], dialect: Dialect) -> float:
    """Return the share of numbers among the cells of the lines with the commonest number of cells, 0 of one column."""
    rows = [dialect.cells(line) for line in lines[:_EXAMINED_LINES]]
    counts = Counter(len(row) for row in rows if len(row) > 1)
    if not counts:
        return 0.0
    usual, frequency = counts.most_common(1)[0]
    cells = [cell for row in rows if len(row) == usual for cell in row]
    numbers = sum(dialect.number(cell) is not None or cell.lower() in GAPS for cell in cells)
    return (numbers + _ANY_SIGN) / len(cells) * frequency / len(rows)


_HEAD_LINES = 100  # in which the rows may begin: programs of oscilloscopes write a long preamble
_REMARK = "#"
_LONGEST_UNIT = 10  # characters of one that is not known


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
        aliases: other names of the columns, from a second line of heads; empty without one.
    """

    dialect: Dialect
    heads: tuple[str, ...]
    units: tuple[str, ...]
    rows: Sequence[tuple[int, str]]
    remarks: tuple[str, ...]
    breaks: tuple[int, ...]
    aliases: tuple[str, ...] = ()

    @classmethod
    def of(cls, text: str) -> TextTable:
        """Return the table in a text.

        Lines that begin with # are remarks; the last of them before the rows may hold the heads, as NumPy and KiCad
        write them. Lines before the heads are remarks too. The heads are the last line before the first in which all
        columns of numbers hold numbers; a line of units may follow them, and after it a line of short names.
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
        heads, units, aliases = _heads(preamble, lines[begin:], dialect)
        if not preamble and lines[begin:]:
            before = [remark for number, remark in remarks if number < lines[begin][0]]
            heads = _heads_in_remark(before, dialect.cells(lines[begin][1]), dialect)
        used = sum(map(bool, (preamble, units, aliases)))
        unread = [line for _, line in preamble[: len(preamble) - used]]
        notes = (*(remark for _, remark in remarks), *unread)
        return cls(dialect, heads, units, lines[begin:], notes, tuple(breaks), aliases)

    def split(self) -> list[Row]:
        """Return the rows, divided into cells."""
        return [Row(number, self.dialect.cells(line)) for number, line in self.rows]


def _first_row(lines: Sequence[tuple[int, str]], dialect: Dialect) -> int:
    """Return the index of the first line with values: one in which all columns of numbers hold numbers, or gaps."""
    rows = [dialect.cells(line) for _, line in lines[: _EXAMINED_LINES + _HEAD_LINES]]
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
    # without any number, the first line has the heads
    return 1


def _is_numeric(cells: Sequence[str], dialect: Dialect) -> bool:
    numbers = sum(dialect.number(cell) is not None for cell in cells)
    gaps = sum(cell.lower() in GAPS for cell in cells)
    return numbers > 0 and 2 * (numbers + gaps) > len(cells)


def _is_value(cell: str, dialect: Dialect) -> bool:
    return dialect.number(cell) is not None or cell.lower() in GAPS


def _heads(
    preamble: Sequence[tuple[int, str]], rows: Sequence[tuple[int, str]], dialect: Dialect
) -> tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...]]:
    """Return heads, units and further names from the lines before the rows."""
    lines = [line for _, line in preamble[-3:]]
    if not lines:
        return (), (), ()
    last = tuple(dialect.cells(lines[-1]))
    width = len(dialect.cells(rows[0][1])) if rows else len(last)
    if len(lines) > 1:
        above = tuple(dialect.cells(lines[-2]))
        units = _units_below(above, lines[-1], dialect)
        if units and len(above) >= width:
            return above, units, ()
    if len(lines) > 2:
        names = tuple(dialect.cells(lines[-3]))
        units = _units_below(names, lines[-2], dialect)
        if units and len(names) == len(last) >= width:
            return names, units, last
    return last, (), ()


def _units_below(names: Sequence[str], line: str, dialect: Dialect) -> tuple[str, ...]:
    """Return the units in the line below names, one for each of them; () where the line is none of units.

    Programs write units that no list has, as "0.1%" or "kpulse": more than half of them must be known.
    """
    units = dialect.cells(line)
    missing = len(names) - len(units)
    # empty cells at the end of the line
    if missing > 0 and dialect.separator != BLANKS and line.count(dialect.separator) >= len(names) - 1:
        units += [""] * missing
    if len(units) != len(names) or _are_units(names):
        return ()
    return tuple(units) if _are_units(units) else ()


def _are_units(cells: Sequence[str]) -> bool:
    given = [cell for cell in cells if cell]
    known = sum(is_unit(cell) for cell in given)
    others = [cell for cell in given if not is_unit(cell)]
    bracketed = all(cell[0] + cell[-1] in ("[]", "()") for cell in given)
    short = all(len(cell) <= _LONGEST_UNIT and BLANKS not in cell for cell in others)
    return bool(given) and (bracketed or (short and 2 * known > len(given)))


def _heads_in_remark(remarks: Sequence[str], cells: Sequence[str], dialect: Dialect) -> tuple[str, ...]:
    """Return the heads in the last remark before the rows, where it has as many words as they have cells."""
    if not remarks:
        return ()
    heads = tuple(dialect.cells(remarks[-1]))
    return heads if len(heads) == len(cells) > 1 else ()
