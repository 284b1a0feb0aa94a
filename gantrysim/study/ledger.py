"""The finished rows of a study under way, on disk: what an interrupted study has done is not done again."""

from __future__ import annotations

import json
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO

from gantrysim.errors import InputError
from gantrysim.study.cases import Row

__all__ = ["LEDGER", "Ledger"]

LEDGER = ".study-progress.jsonl"


class Ledger:
    """A file of lines of JSON, one for each finished case, after a first one that says whose they are.

    A line is written as soon as its case is finished. The last one may have been cut off by whatever ended the
    study; it is forgotten.

    Args:
        folder: that the file lies in, or None for one that is kept in memory alone.
        identity: what the rows depend on besides their cases, and whose they are; plain JSON.

    Attributes:
        kept: number of rows that an earlier start has left.
        discarded: what kind of rows were found that are another study's, in words, or None.
    """

    def __init__(self, folder: Path | None, identity: dict[str, Any]) -> None:
        self._rows: dict[str, Row] = {}
        self._file = None if folder is None else folder / LEDGER
        self._identity = identity
        self._stream: BinaryIO | None = None
        self.discarded: str | None = None
        self.kept = 0

    def __enter__(self) -> Ledger:
        if self._file is None:
            return self
        good = self._read()
        self.kept = len(self._rows)
        try:
            self._file.parent.mkdir(parents=True, exist_ok=True)
            self._stream = self._file.open("r+b" if good else "wb")
            self._stream.truncate(good)
            self._stream.seek(good)
        except OSError as error:
            raise InputError(f"--out {self._file.parent}: cannot be written: {error.strerror}") from None
        if not good:
            self._write(self._identity)
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        if self._stream is not None:
            self._stream.close()
            self._stream = None

    def __contains__(self, key: str) -> bool:
        return key in self._rows

    def __getitem__(self, key: str) -> Row:
        return self._rows[key]

    def __len__(self) -> int:
        return len(self._rows)

    def add(self, key: str, row: Row) -> None:
        """Keep a finished row."""
        self._rows[key] = row
        self._write([key, row])

    def remove(self) -> None:
        """Delete the file: the study is complete."""
        if self._file is not None:
            self._file.unlink(missing_ok=True)

    def _write(self, content: object) -> None:
        if self._stream is not None:
            self._stream.write(json.dumps(content, allow_nan=False).encode() + b"\n")
            self._stream.flush()

    def _read(self) -> int:
        """Take over the rows of an earlier start, and return how many bytes of the file are whole lines of them."""
        assert self._file is not None
        try:
            content = self._file.read_bytes()
        except FileNotFoundError:
            return 0
        good = 0
        for number, line in enumerate(content.splitlines(keepends=True)):
            try:
                if not line.endswith(b"\n"):
                    break
                found = json.loads(line)
                if number == 0:
                    if found != self._identity:
                        self.discarded = _differs(found, self._identity)
                        return 0
                else:
                    key, row = found
                    self._rows[str(key)] = dict(row)
            except (ValueError, TypeError):
                break
            good += len(line)
        return good


def _differs(found: Any, identity: dict[str, Any]) -> str:
    """Say in what the owner of the rows found is another."""
    if not isinstance(found, dict):
        return "they are no study's"
    keys = [key for key in {**identity, **found} if found.get(key) != identity.get(key)]
    return f"they differ in {', '.join(keys)}"
