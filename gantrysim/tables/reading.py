"""Any table from its file, whatever program has written it."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from gantrysim.base.errors import InputError, expanded_path
from gantrysim.base.input_files import opened_file, read_text
from gantrysim.tables.binary import binary_reader
from gantrysim.tables.column_table import ColumnTable, numbered_columns
from gantrysim.tables.text_table import BLANKS, Dialect, TextTable
from gantrysim.tables.units import NUMBER

# Logs of controllers that are no tables of rows: LinuxCNC's halscope, and dumps of the TABLE of Trio controllers.

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
    # the last line alone may be cut
    if max(map(len, columns.values())) > shortest + 1:
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
    values = list(_dumped_samples(label, lines))
    if not values or len(values) % blocks:
        raise InputError(f"{label}: has {len(values)} values, which are not {blocks} blocks of one length")
    columns = np.array(values).reshape(blocks, -1)
    return ColumnTable(label, {str(k): column for k, column in enumerate(columns, 1)}, {})


def _dumped_samples(label: str, lines: Sequence[str]) -> Iterator[float]:
    for line in lines:
        statement = _STATEMENT.fullmatch(line)
        cells = re.split(r"[\s,;]+", (statement[1] if statement else line).strip())
        for cell in cells[1:] if statement else cells:
            value = _number(cell)
            if value is None or not np.isfinite(value):
                raise InputError(f"{label}: {cell[:_SHOWN]!r} is not a finite number")
            yield value


_LOST_SAMPLES = "overrun"  # line of halsampler where samples are missing
_HEAD = 4096  # bytes by which a format is recognised


def read_table(file: str | Path, blocks: int = 0) -> ColumnTable:
    """Return the columns of a table.

    Read are: text of any dialect (separated by semicolon, tab, bar, comma or blanks; with a decimal comma where the
    separator is none; quotes; a mark of the byte order; lines with #; a preamble; a line of units), Parquet, MATLAB,
    MCAP; the output of LinuxCNC's halsampler, which has no names; a file of halscope, whose first line gives the
    period; and a dump of the TABLE of a Trio controller, where SCOPE leaves one block of samples after the other.
    A unit in brackets after a name, or after its last underscore, is taken over.

    Args:
        file: to be read.
        blocks: number of blocks of a TABLE dump; 0 for any other file.

    Raises:
        InputError: no such file, or a line that cannot be read.
    """
    label = str(file)
    path = expanded_path(file)
    try:
        with opened_file(path, label) as stream:
            reader = binary_reader(stream.read(_HEAD))
        if reader is not None:
            return reader(path, label)
        if path.suffix == ".npz":
            raise InputError(f"{label}: is the record of a run: gantrysim export {label} writes it as a table")
        text = read_text(path, errors="replace", label=label)
    except OSError as error:
        raise InputError(f"{label}: cannot be read: {error.strerror}") from None
    return table_of_text(text, label, blocks)


def table_of_text(text: str, label: str, blocks: int = 0) -> ColumnTable:
    """Return the columns of a table in text; arguments and errors as of `read_table`."""
    if "\0" in text[:_HEAD]:
        raise InputError(f"{label}: is neither text nor a Parquet, MATLAB or MCAP file")
    lines = [(k, line.strip()) for k, line in enumerate(text.removeprefix("\ufeff").splitlines(), 1)]
    rows = [(k, line) for k, line in lines if line and not line.startswith("#")]
    if not rows:
        raise InputError(f"{label}: is empty")
    if blocks:
        return table_dump(label, [line for _, line in rows], blocks)
    period = halscope_period(rows[0][1])
    if period is not None:
        return halscope_table(label, rows[1:], period)
    lost = any(line == _LOST_SAMPLES for _, line in rows)
    # an empty line in their place keeps the numbers of the lines
    kept_text = "\n".join("" if line.strip() == _LOST_SAMPLES else line for line in text.splitlines()) if lost else text
    return replace(numbered_columns(label, TextTable.of(kept_text)), lost=lost)
