"""The columns of a table, by name, as numbers in the units of the package."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError, unknown_text
from gantrysim.tables.text_table import BLANKS, GAPS, Dialect, TextTable
from gantrysim.tables.units import NUMBER, SUFFIXES, TIME, factor, is_unit, name_and_unit

# Where a quantity stands in a table, as a user writes it: COLUMN, COLUMN[UNIT], COLUMN*FACTOR UNIT.

_FORMS = "COLUMN, COLUMN[UNIT], COLUMN*FACTOR, COLUMN/DIVISOR or COLUMN*FACTOR UNIT"
# the blanks are not at the end of a repetition, so that the time is linear in the text's length
_SCALED = re.compile(rf"([*/])\s*({NUMBER})\s*([^\s*/\d][^*/]*)?")


class Source(NamedTuple):
    """Where a quantity stands in a table.

    Attributes:
        column: name, or number from 1.
        scale: factor on the values, besides their unit.
        unit: of the values; empty for that in the column's name, or the quantity's own.
    """

    column: str
    scale: float = 1.0
    unit: str = ""

    @classmethod
    def parse(cls, key: str, text: str) -> Source:
        """Return the source that a text gives, as "I*0.0302 N·m" of a current and the torque constant of its motor.

        Args:
            key: quantity, for errors.
            text: name of a column, a factor or a divisor, a unit; the unit may stand in brackets.

        Raises:
            InputError: no column, or a factor that is 0 or not finite.
        """
        column, unit = name_and_unit(text)
        # brackets other than these belong to the name, as in MPOS AXIS(0)
        if not text.rstrip().endswith("]"):
            column = text.strip()
            unit = ""
        factor = 1.0
        place = max(column.rfind("*"), column.rfind("/"))
        scaled = _SCALED.fullmatch(column[place:].rstrip()) if place >= 0 else None
        if scaled:
            column = column[:place]
            factor = float(scaled[2])
            if scaled[1] == "/":
                factor = 1 / factor if factor else 0.0
            unit = unit or (scaled[3] or "").strip()
        if not column.strip():
            raise InputError(f"{key}={text}: must be {_FORMS}")
        if not 0 < abs(factor) < float("inf"):
            raise InputError(f"{key}={text}: factor of {factor:g}: must be finite and other than 0")
        return cls(column.strip(), factor, unit)


SAMPLES = "samples"  # unit of a time in sample periods
_SHOWN = 30  # characters of a wrong cell
_CLOCK = re.compile(r"(?:(\d{1,3}):)?(\d{1,2}):(\d{1,2}(?:\.\d+)?)")  # hours, minutes, seconds


@dataclass(frozen=True)
class ColumnTable:
    """The columns of a table.

    Attributes:
        label: names the table in errors.
        columns: of numbers by name, each (n,); nan where a cell is empty.
        texts: columns of other content by name, n cells each.
        units: those that the table gives, by column.
        period: of its samples, where it gives one [s].
        lost: whether samples are missing, so that its rows are no time.
        remarks: lines of text besides its rows.
        order: names of all columns as the table has them; by default those of numbers first.
        aliases: names by further names of the same columns.
    """

    label: str
    columns: Mapping[str, Floats]
    units: Mapping[str, str]
    texts: Mapping[str, Sequence[str]] = field(default_factory=dict)
    period: float | None = None
    lost: bool = False
    remarks: tuple[str, ...] = ()
    order: tuple[str, ...] = ()
    aliases: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not self.order:
            object.__setattr__(self, "order", (*self.columns, *self.texts))

    @property
    def rows(self) -> int:
        """Number of its rows."""
        return len(next(iter((*self.columns.values(), *self.texts.values()))))

    def values(self, source: Source, kind: str, further: Mapping[str, float] | None = None) -> Floats:
        """Return a quantity in the unit of the package, (n,); nan in gaps.

        Args:
            source: where it stands.
            kind: unit that the quantity has, one of `KINDS`.
            further: factors of units that depend on the machine or the log, as counts, samples or "‰".

        Raises:
            InputError: no such column, one of text, or a unit of another kind.
        """
        name = self._name(source.column)
        if name in self.texts:
            if kind == TIME:
                return _instants(f"{self.label}: column {name}", self.texts[name]) * source.scale
            cells = [cell for cell in self.texts[name] if cell.lower() not in GAPS]
            wrong = next(filter(_is_word, cells), None)
            if wrong is None:
                raise InputError(
                    f"{self.label}: column {name} has {cells[0][:_SHOWN]!r}: must have the decimal sign of the other "
                    "columns"
                )
            raise InputError(f"{self.label}: column {name} has {wrong[:_SHOWN]!r}, which is not a number")
        unit = source.unit or self.units.get(name, kind)
        scale = factor(unit, kind, f"{self.label}: column {name}", further)
        return self.columns[name] * (scale * source.scale)

    def unit_of(self, column: str) -> str:
        """Return the unit that the table gives for a column, "" for none.

        Raises:
            InputError: no such column.
        """
        return self.units.get(self._name(column), "")

    def _name(self, column: str) -> str:
        """Return the name of a column that is given by its name or its number."""
        known = self.order
        if f"{column} (2)" in known:
            raise InputError(f"{self.label}: two columns are named {column}: name it by its number, from 1")
        if column in known:
            return column
        if column in self.aliases:
            return self.aliases[column]
        if column.isdecimal() and 0 < int(column) <= len(self.order):
            return self.order[int(column) - 1]
        names = dict(zip(known, known, strict=True)) | dict(self.aliases)
        folded = {names[name] for name in names if name.casefold() == column.casefold()}
        if len(folded) == 1:
            return folded.pop()
        bare = name_and_unit(column)[0]
        if bare in known:
            return bare
        raise InputError(f"{self.label}: {unknown_text('column', column, names)}")


def numbered_columns(label: str, table: TextTable) -> ColumnTable:
    """Return the columns of a table in text; without heads they are named 1, 2, ...

    A column is one of text if most of its cells are, or if it has no number; else another cell than a number or a gap
    is refused.

    Args:
        label: names the table in errors.
        table: in text.

    Raises:
        InputError: no rows, a row with another number of cells, or a cell in a column of numbers that is none.
    """
    if not table.rows:
        raise InputError(f"{label}: has no rows")
    width = len(table.heads) or len(table.dialect.cells(table.rows[0][1]))
    plain = _plain(table, width)
    if plain is not None:
        columns: dict[int, Floats] = dict(enumerate(plain))
        texts: dict[int, list[str]] = {}
    else:
        columns, texts = _mixed_columns(label, table, width)
    names, units = _named_columns(table, width)
    return ColumnTable(
        label,
        {names[k]: values for k, values in columns.items()},
        {names[k]: unit for k, unit in units.items()},
        {names[k]: cells for k, cells in texts.items()},
        remarks=table.remarks,
        order=tuple(names),
        aliases={alias: name for alias, name in zip(table.aliases, names, strict=False) if alias not in names},
    )


def _plain(table: TextTable, width: int) -> Floats | None:
    """Return the columns of a table of nothing but finite numbers, (width, n), read by NumPy as that is far quicker."""
    dialect = table.dialect
    lines = [line for _, line in table.rows]
    if dialect.decimal_comma:
        # a point would be between thousands
        if dialect.separator == "," or any("." in line for line in lines):
            return None
        lines = [line.replace(",", ".") for line in lines]
    try:
        values = np.loadtxt(
            lines, delimiter=None if dialect.separator == " " else dialect.separator, comments=None, ndmin=2
        )
    except ValueError:
        return None
    return values.T if values.shape == (len(lines), width) and np.isfinite(values).all() else None


def _mixed_columns(label: str, table: TextTable, width: int) -> tuple[dict[int, Floats], dict[int, list[str]]]:
    """Return the columns of numbers and those of text, by their places."""
    rows = table.split()
    for row, (_, line) in zip(rows, table.rows, strict=True):
        if len(row.cells) > width:
            raise InputError(f"{label}: line {row.line} has {len(row.cells)} columns, must have {width}")
        if len(row.cells) < width:
            missing = width - len(row.cells)
            # rows of LabVIEW end before the comment
            comments = bool(table.heads) and table.heads[-1] == "Comment"
            is_last_alone = missing == 1 and len(rows) > 1 and (comments or _ends_in_gaps(table, width))
            if not (is_last_alone or _has_all_separators(table, line, width)):
                raise InputError(f"{label}: line {row.line} has {len(row.cells)} columns, must have {width}")
            row.cells.extend([""] * missing)
    columns: dict[int, Floats] = {}
    texts: dict[int, list[str]] = {}
    for k in range(width):
        cells = [row.cells[k] for row in rows]
        parsed = [_value(table.dialect, cell) for cell in cells]
        words = sum(value is None for value in parsed)
        numbers = sum(value is not None and not np.isnan(value) for value in parsed)
        if words > numbers and (2 * words > len(cells) or not numbers):
            texts[k] = cells
            continue
        for row, value in zip(rows, parsed, strict=True):
            if value is None or abs(value) == np.inf:
                head = table.heads[k] if table.heads else str(k + 1)
                raise InputError(f"{label}: line {row.line}: {head} = {row.cells[k][:_SHOWN]!r} is not a finite number")
        columns[k] = np.array(parsed, float)
    return columns, texts


def _ends_in_gaps(table: TextTable, width: int) -> bool:
    """Return whether the separator shows that a missing last cell is an empty one."""
    return any(
        line.rstrip(" ").endswith(table.dialect.separator) and _has_all_separators(table, line, width)
        for _, line in table.rows
    )


def _has_all_separators(table: TextTable, line: str, width: int) -> bool:
    """Return whether a line has a separator between all columns, so that cells missing at its end are empty ones."""
    separator = table.dialect.separator
    return separator != " " and line.count(separator) == width - 1


def _is_word(cell: str) -> bool:
    """Return whether a cell is neither a number, with a point or a comma, nor a gap."""
    numbers = [Dialect(BLANKS, comma).number(cell) for comma in (False, True)]
    return cell.lower() not in GAPS and numbers == [None, None]


def _value(dialect: Dialect, cell: str) -> float | None:
    return np.nan if cell.lower() in GAPS else dialect.number(cell)


def _named_columns(table: TextTable, width: int) -> tuple[list[str], dict[int, str]]:
    """Return the names of the columns, each once, and the units by their places."""
    heads = table.heads or tuple(str(k + 1) for k in range(width))
    names: list[str] = []
    units: dict[int, str] = {}
    for k, head in enumerate(heads):
        name, unit = name_and_unit(head)
        # the number of an axis, as in MPOS AXIS(0), or words, as in Position (actual)
        if unit.isdecimal() or (head.rstrip().endswith(")") and not is_unit(unit)):
            name = head.strip()
            unit = ""
        if not unit:
            _, underscore, suffix = head.rpartition("_")
            unit = suffix if underscore and suffix in SUFFIXES else ""
        if k < len(table.units):
            unit = table.units[k].strip().strip("[]()") or unit
        if unit:
            units[k] = unit
        base = name or str(k + 1)
        copy = 2
        name = base
        # a name that is given twice gets a number, as a column that nobody asks for does no harm
        while name in names:
            name = f"{base} ({copy})"
            copy += 1
        names.append(name)
    return names, units


def _instants(label: str, cells: Sequence[str]) -> Floats:
    """Return instants that are written as dates or clock times, from the first of them [s]."""
    cells = [cell.replace(",", ".") for cell in cells]
    try:
        instants = np.array([cell.replace(" ", "T", 1).rstrip("Z") for cell in cells], "datetime64[ns]")
    except ValueError:
        clock = [_CLOCK.fullmatch(cell) for cell in cells]
        if not all(clock):
            raise InputError(f"{label} has {cells[0][:_SHOWN]!r}: must be numbers, dates or hh:mm:ss") from None
        seconds = np.array(
            [3600 * float(part[1] or 0) + 60 * float(part[2]) + float(part[3]) for part in clock if part is not None]
        )
        return seconds - seconds[0]
    seconds = (instants - instants[0]) / np.timedelta64(1, "ns") * 1e-9
    return np.asarray(seconds, float)
