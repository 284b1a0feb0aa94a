"""Files of the workbench: the jobs of an opened folder, those dropped into the page, and those that are saved."""

from __future__ import annotations

import re
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import numpy as np

from gantrysim.base.errors import InputError, unknown
from gantrysim.base.files import replaced_file
from gantrysim.base.input_files import decoded_text, read_text
from gantrysim.job.loading import builtin_jobs
from gantrysim.job.programs import suffixes
from gantrysim.tables.binary import binary_reader
from gantrysim.tables.column_table import ColumnTable
from gantrysim.tables.reading import table_of_text

LONGEST_UPLOAD = 1 << 25  # [bytes]
_MOST_UPLOADS = 50  # kept; the oldest goes
_MOST_LISTED = 500  # files of a folder
_JOB = ".toml"
_FILMS = ".films"  # no dropped file begins with a point
_NAME = re.compile(r"[^\w .+-]")
_LONGEST_NAME = 100  # characters


def _is_job(file: Path) -> bool:
    """Return whether a file seems to be a job's: TOML with a table of its program."""
    try:
        return file.suffix.lower() == _JOB and "[program" in read_text(file, errors="replace", most=LONGEST_UPLOAD)
    except (OSError, InputError):
        return False


_RECORD = ".npz"
_POINTS_SUFFIX = ".csv"  # a program's points, or a log
_HEAD = 1 << 16  # of a table, by which it is told [bytes]
_TIME_COLUMNS = ("time_s", "time", "t")
_LEAST_ROWS = 8  # of a log
_OF_AXES = ("commanded", "encoder", "nozzle", "pcmd", "pfb")


def is_trace(name: str, content: bytes) -> bool:
    """Return whether a file is a record or a log, not a program or a job.

    A table whose name ends as that of a program's points is a log where it has a column of time that rises, or of
    positions by the names of links.
    """
    suffix = Path(name).suffix.lower()
    if suffix == _RECORD or binary_reader(content[:_HEAD]) is not None:
        return True
    if suffix == _JOB or (suffix in suffixes() and suffix != _POINTS_SUFFIX):
        return False
    head = decoded_text(content[:_HEAD], "replace")
    if len(content) > _HEAD:
        head = head.rpartition("\n")[0]
    try:
        table = table_of_text(head, name)
    except InputError:
        return False
    if table.rows < _LEAST_ROWS or len(table.columns) < 2:
        return False
    return suffix != _POINTS_SUFFIX or _is_log(table)


def _is_log(table: ColumnTable) -> bool:
    times = [values for name, values in table.columns.items() if name.lower() in _TIME_COLUMNS]
    if any(np.all(np.diff(values) > 0) for values in times):
        return True
    return table.period is not None or any(name.lower().startswith(_OF_AXES) for name in table.columns)


class Saved(NamedTuple):
    """A job file that was written, and what stood in it before; None where there was none."""

    file: Path
    before: str | None


class Store:
    """The files.

    Args:
        folder: that is opened: its jobs are listed, and jobs are saved in it.
        scratch: temporary folder for what is dropped into the page.

    Attributes:
        films: folder of the films that are made.
    """

    def __init__(self, folder: Path, scratch: Path) -> None:
        self.folder = folder
        self.films = scratch / _FILMS
        self._scratch = scratch
        self._uploads: list[Path] = []
        self._unlisted: set[Path] = set()

    def names(self) -> dict[str, list[str]]:
        """Return the names of the jobs that can be opened: files of the folder, dropped ones, and built-in ones."""
        programs = set(suffixes())
        files = (
            file
            for file in sorted(self.folder.iterdir())
            if file.is_file() and (file.suffix.lower() in programs or _is_job(file))
        )
        return {
            "folder": [file.name for file in islice(files, _MOST_LISTED)],
            "dropped": [file.name for file in self._uploads if file not in self._unlisted],
            "built-in": builtin_jobs(),
        }

    def path(self, kind: str, name: str) -> str:
        """Return the path of a job by a name that `names` lists.

        Raises:
            InputError: another name.
        """
        listed = self.names().get(kind, [])
        if name not in listed:
            raise unknown("job", name, listed)
        if kind == "dropped":
            return str(next(file for file in self._uploads if file.name == name))
        return name if kind == "built-in" else str(self.folder / name)

    def take(self, name: str, content: bytes, *, is_listed: bool = True) -> str:
        """Keep a file that was dropped into the page, in a folder of its own, and return its path.

        Args:
            name: of the file as the browser gives it.
            content: of the file.
            is_listed: whether it is a job or program, that `names` lists.

        Raises:
            InputError: a file that is too long.
        """
        if len(content) > LONGEST_UPLOAD:
            raise InputError(f"{name[:_LONGEST_NAME]}: is longer than {LONGEST_UPLOAD:,} bytes")
        plain = _NAME.sub("_", name.replace("\\", "/").rpartition("/")[2])[-_LONGEST_NAME:].strip(". ") or "program.txt"
        file = self._scratch / plain
        file.write_bytes(content)
        self._uploads = [*(other for other in self._uploads if other != file), file]
        self._unlisted.discard(file)
        if not is_listed:
            self._unlisted.add(file)
        while len(self._uploads) > _MOST_UPLOADS:
            self._uploads.pop(0).unlink(missing_ok=True)
        return str(file)

    def save(self, name: str, text: str) -> Saved:
        """Write a job file into the folder.

        Raises:
            InputError: a name that is no file name of a job, or a file that cannot be written.
        """
        stem = name.removesuffix(_JOB)
        if not stem or _NAME.search(stem) or stem.startswith(".") or len(stem) > _LONGEST_NAME:
            raise InputError(f"file name {name[:_LONGEST_NAME]!r}: must be letters, digits, spaces and any of _ . + -")
        file = self.folder / f"{stem}{_JOB}"
        before = read_text(file) if file.is_file() else None
        with replaced_file(file) as partial:
            partial.write_text(text, encoding="utf-8")
        return Saved(file, before)

    def restore(self, saved: Saved) -> None:
        """Put back what stood in a file before it was saved."""
        if saved.before is None:
            saved.file.unlink(missing_ok=True)
            return
        with replaced_file(saved.file) as partial:
            partial.write_text(saved.before, encoding="utf-8")
