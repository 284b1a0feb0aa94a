"""Any table from its file, whatever program has written it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from gantrysim.base.errors import InputError, expanded
from gantrysim.base.input_files import opened
from gantrysim.base.toml_files import read_text
from gantrysim.tables.binary import binary_reader
from gantrysim.tables.column_table import ColumnTable, numbered
from gantrysim.tables.controller_logs import halscope_period, halscope_table, table_dump
from gantrysim.tables.text_table import TextTable

_LOST = "overrun"  # line of halsampler where samples are missing
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
    path = expanded(file)
    try:
        with opened(path, label) as stream:
            reader = binary_reader(stream.read(_HEAD))
        if reader is not None:
            return reader(path, label)
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
    lost = any(line == _LOST for _, line in rows)
    # an empty line in their place keeps the numbers of the lines
    kept_text = "\n".join("" if line.strip() == _LOST else line for line in text.splitlines()) if lost else text
    return replace(numbered(label, TextTable.of(kept_text)), lost=lost)
