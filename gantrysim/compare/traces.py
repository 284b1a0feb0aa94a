"""Logs of real machines read as columns: CSV, halsampler, halscope, and TABLE dumps of Trio controllers."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import dropwhile
from pathlib import Path
from typing import NamedTuple

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError, expanded, positive, unknown
from gantrysim.base.heads import name_and_unit
from gantrysim.base.patterns import NUMBER
from gantrysim.base.toml_files import read_text, read_toml

# factors to s, mm and deg
UNITS = {
    "s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9,
    "mm": 1.0, "um": 1e-3, "µm": 1e-3, "nm": 1e-6, "m": 1e3, "in": 25.4,
    "deg": 1.0, "mdeg": 1e-3, "rad": 180 / np.pi,
}  # fmt: skip
SAMPLES = "samples"  # unit of a time in sample periods

_SUFFIXES = ("s", "ms", "us", "mm", "um", "deg")  # units that may end a name without brackets, as in "time_ms"
_NUMBER = re.compile(NUMBER)
_PERIOD = re.compile(rf"Sampling period is ({NUMBER}) ns\s*")
_LOST = "overrun"  # line of halsampler where samples are missing
_SHOWN = 30  # characters of a wrong cell


class Source(NamedTuple):
    """Where a quantity stands in a log.

    Attributes:
        column: name, or number from 1.
        scale: factor on the values, besides their unit.
        unit: of the values; empty for that in the column's name, or the quantity's own.
    """

    column: str
    scale: float = 1.0
    unit: str = ""


@dataclass(frozen=True)
class Log:
    """The columns of a log.

    Attributes:
        label: names the log in errors.
        columns: by name, each (n,).
        units: those that the log gives, by column.
        period: of its samples, where it gives one [s].
        lost: whether samples are missing, so that its rows are no time.
    """

    label: str
    columns: Mapping[str, Floats]
    units: Mapping[str, str]
    period: float | None = None
    lost: bool = False

    def values(self, source: Source, kind: str, period: float | None) -> Floats:
        """Return a quantity in s, mm or deg.

        Args:
            source: where it stands.
            kind: "s", or the unit "mm" or "deg" that the quantity has.
            period: of the samples, for a time in samples [s].

        Raises:
            InputError: no such column, or a unit of another kind.
        """
        numbered = list(self.columns)
        name = source.column
        if name not in self.columns and name.isdecimal() and 0 < int(name) <= len(numbered):
            name = numbered[int(name) - 1]
        if name not in self.columns:
            raise unknown(f"column of {self.label}", source.column, self.columns)
        unit = source.unit or self.units.get(name, kind)
        if unit == SAMPLES and kind == "s" and period is not None:
            return self.columns[name] * period * source.scale
        known = {"s": ("s", "ms", "us", "µs", "ns"), "deg": ("deg", "mdeg", "rad")}
        allowed = known.get(kind, ("mm", "um", "µm", "nm", "m", "in"))
        if unit not in allowed:
            raise InputError(f"{self.label}: column {name} is in {unit!r}: must be in {', '.join(allowed)}")
        return self.columns[name] * (UNITS[unit] * source.scale)


@dataclass(frozen=True)
class Assignment:
    """Which columns of a log are which quantities.

    Attributes:
        columns: by quantity: time; x, y, z of the nozzle; commanded.AXIS and encoder.AXIS.
        period: of the samples, for a log without time [s].
        blocks: columns of a TABLE dump, one block after the other.
    """

    columns: Mapping[str, Source]
    period: float | None = None
    blocks: int = 0

    @classmethod
    def parse(cls, text: str) -> Assignment:
        """Return the mapping of a text "time=t,x=px*0.001,y=py[um]", or of a TOML file with a table [columns].

        Raises:
            InputError: no such file, or a text that is none.
        """
        if "=" not in text:
            content = read_toml(expanded(text), f"--columns {text}")
            table = content.pop("columns", None)
            if not isinstance(table, dict) or not content.keys() <= {"period", "blocks"}:
                raise InputError(f"--columns {text}: must have a table [columns], and may have period and blocks")
            period = content.get("period")
            blocks = content.get("blocks", 0)
            if not isinstance(blocks, int):
                raise InputError(f"--columns {text}: blocks = {blocks!r}: must be a whole number")
            given = None if period is None else positive("period", period, "s")
            return cls({key: _source(key, str(value)) for key, value in table.items()}, given, blocks)
        pairs = [part.partition("=") for part in text.split(",")]
        return cls({key.strip(): _source(key, value) for key, _, value in pairs})


def _source(key: str, text: str) -> Source:
    column = text.strip()
    unit = ""
    factor = 1.0
    if column.endswith("]"):
        bracket = column.find("[", column.rfind("]", 0, -1) + 1)
        if bracket > 0:
            unit = column[bracket + 1 : -1]
            column = column[:bracket]
    name, star, number = column.rpartition("*")
    if star and name and _NUMBER.fullmatch(number):
        column = name
        factor = float(number)
    if not column:
        raise InputError(f"--columns {key}={text}: must be COLUMN, COLUMN*FACTOR or COLUMN[UNIT]")
    return Source(column.strip(), factor, unit)


def read_log(file: str | Path, blocks: int = 0) -> Log:
    """Return the columns of a log.

    Read are: CSV with a line of names or without, its columns separated by comma, semicolon, tab or blanks, lines with
    # left out, a unit in brackets after a name taken over; the output of LinuxCNC's halsampler, which has no names; a
    file of halscope, whose first line gives the period; and a dump of the TABLE of a Trio controller, where SCOPE
    leaves one block of samples after the other.

    Args:
        file: to be read.
        blocks: number of blocks of a TABLE dump; 0 for any other file.

    Raises:
        InputError: no such file, or a line that cannot be read.
    """
    label = str(file)
    try:
        lines = read_text(expanded(file), errors="replace").splitlines()
    except OSError as error:
        raise InputError(f"{label}: cannot be read: {error.strerror}") from None
    rows = [(k, line.strip()) for k, line in enumerate(lines, 1) if line.strip() and not line.lstrip().startswith("#")]
    if not rows:
        raise InputError(f"{label}: is empty")
    period = _PERIOD.fullmatch(rows[0][1] + " ")
    if blocks:
        return _table_dump(label, [line for _, line in rows], blocks)
    if period:
        return _halscope(label, rows[1:], 1e-9 * float(period[1]))
    return _csv(label, rows)


def _csv(label: str, rows: list[tuple[int, str]]) -> Log:
    separator = next((candidate for candidate in ";\t," if candidate in rows[0][1]), None)
    comma = separator == ";" and any("," in line for _, line in rows[1:3])  # as the decimal sign
    lines = [(k, line.replace(",", ".") if comma else line) for k, line in rows if line != _LOST]
    first = _cells(lines[0][1], separator) if lines else []
    if not first:
        raise InputError(f"{label}: has no columns")
    named = any(_number(cell) is None for cell in first)
    names = first if named else [str(k) for k in range(1, len(first) + 1)]
    if len(lines) == named:
        raise InputError(f"{label}: has no rows")
    values = _numbers(label, lines[named:], separator, names)
    units: dict[str, str] = {}
    plain = []
    for name in names:
        bare, unit = name_and_unit(name)
        _, underscore, suffix = name.rpartition("_")
        plain.append(bare)
        if unit:
            units[bare] = unit
        elif underscore and suffix in _SUFFIXES:
            units[bare] = suffix
    if len(set(plain)) < len(plain):
        raise InputError(f"{label}: two columns have one name: {', '.join(plain)}")
    return Log(label, dict(zip(plain, values.T, strict=True)), units, lost=len(lines) < len(rows))


def _numbers(label: str, lines: list[tuple[int, str]], separator: str | None, names: list[str]) -> Floats:
    """Return the numbers of lines, (n, columns); those that NumPy does not read as they are, one by one."""
    try:
        values = np.loadtxt([line for _, line in lines], delimiter=separator, comments=None, ndmin=2)
        if values.shape == (len(lines), len(names)) and np.isfinite(values).all():
            return values
    except ValueError:
        pass
    values = np.empty((len(lines), len(names)))
    for row, (k, line) in enumerate(lines):
        cells = _cells(line, separator)
        if len(cells) != len(names):
            raise InputError(f"{label}: line {k} has {len(cells)} columns, must have {len(names)}")
        for column, cell in enumerate(cells):
            value = _number(cell)
            if value is None or not np.isfinite(value):
                raise InputError(f"{label}: line {k}: {names[column]} = {cell[:_SHOWN]!r} is no finite number")
            values[row, column] = value
    return values


def _halscope(label: str, rows: list[tuple[int, str]], period: float) -> Log:
    """Read lines of pairs, the channel's name and its value."""
    columns: dict[str, list[float]] = {}
    for k, line in rows:
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
    return Log(label, {name: np.array(values[:shortest]) for name, values in columns.items()}, {}, period)


def _table_dump(label: str, lines: list[str], blocks: int) -> Log:
    """Read numbers, or statements TABLE(first, value, ...), as blocks of one length."""
    values = list(_dumped(label, lines))
    if not values or len(values) % blocks:
        raise InputError(f"{label}: has {len(values)} values, which are not {blocks} blocks of one length")
    columns = np.array(values).reshape(blocks, -1)
    return Log(label, {str(k): column for k, column in enumerate(columns, 1)}, {})


def _dumped(label: str, lines: list[str]) -> Iterator[float]:
    for line in lines:
        statement = re.fullmatch(r"TABLE\s*\((.*)\)", line, re.IGNORECASE)
        cells = re.split(r"[\s,;]+", (statement[1] if statement else line).strip())
        for cell in cells[1:] if statement else cells:
            value = _number(cell)
            if value is None or not np.isfinite(value):
                raise InputError(f"{label}: {cell[:_SHOWN]!r} is no finite number")
            yield value


def _cells(line: str, separator: str | None) -> list[str]:
    cells = [cell.strip().strip('"') for cell in line.split(separator)]
    return list(dropwhile(lambda cell: cell == "", cells[::-1]))[::-1]  # a separator at the end


def _number(cell: str) -> float | None:
    try:
        return float(cell) if "_" not in cell else None
    except ValueError:
        return None
