"""The dialect of a table in text: the sign between its cells, and the decimal sign."""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

BLANKS = " "  # any number of blanks or tabs
# A semicolon, a tab or a bar is hardly ever part of a number or a name; a comma may be the decimal sign.
SIGNS = (";", "\t", "|", ",", BLANKS)
GAPS = frozenset(("", "nan", "na", "n/a", "null", "none", "-", "--"))  # cells without a value, in lower case

_POINT = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_COMMA = re.compile(r"[-+]?(?:\d+,\d+|,\d+)(?:[eE][-+]?\d+)?")
_QUOTED = re.compile(r'"([^"]*)"|(\S+)')
_EXAMINED = 200  # lines
_ROUNDING = 1e-9  # of shares that are equal
_ANY = 1e-3  # of a cell: a sign that divides lines without numbers is better than none


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
        while len(cells) > 1 and not cells[-1]:  # a separator at the end of the line
            cells.pop()
        return cells

    def number(self, cell: str) -> float | None:
        """Return the number in a cell, None of one that holds none."""
        if self.decimal_comma:
            if _COMMA.fullmatch(cell):
                return float(cell.replace(",", "."))
            if "." in cell:  # a point would be between thousands
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
    cells = [cell for line in lines[:_EXAMINED] for cell in Dialect(sign).cells(line)]
    return any(map(_COMMA.fullmatch, cells)) and not any("." in cell and _POINT.fullmatch(cell) for cell in cells)


def _share_of_numbers(lines: Sequence[str], dialect: Dialect) -> float:
    """Return the share of numbers among the cells of the lines with the commonest number of cells, 0 of one column."""
    rows = [dialect.cells(line) for line in lines[:_EXAMINED]]
    counts = Counter(len(row) for row in rows if len(row) > 1)
    if not counts:
        return 0.0
    usual, frequency = counts.most_common(1)[0]
    cells = [cell for row in rows if len(row) == usual for cell in row]
    numbers = sum(dialect.number(cell) is not None or cell.lower() in GAPS for cell in cells)
    return (numbers + _ANY) / len(cells) * frequency / len(rows)
