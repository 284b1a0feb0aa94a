"""The finished rows of a study under way, on disk: what an interrupted study has done is not done again."""

from __future__ import annotations

import json
import os
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO

from gantrysim.errors import InputError
from gantrysim.study.cases import Row

try:
    import fcntl
except ImportError:  # where the system has none, as Windows, nothing is locked
    fcntl = None  # type: ignore[assignment]

LEDGER = ".study-progress.jsonl"


class Ledger:
    """A file of lines of JSON, one for each finished case, after a first one that says whose they are.

    A line is written as soon as its case is finished. The last one may have been cut off by whatever ended the
    study; it is forgotten. While the ledger is open its file is locked, so that no other study works in the folder;
    the system takes the lock from a process that ends, however that may be. A ledger that is closed without any row
    leaves nothing, not even a folder that was not there before.

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
        self._made: list[Path] = []
        self.discarded: str | None = None
        self.kept = 0

    def __enter__(self) -> Ledger:
        if self._file is None:
            return self
        folder = self._file.parent
        self._made = [parent for parent in (folder, *folder.parents) if not parent.exists()]
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self._stream = _locked(self._file)
            good = self._read(self._stream.read())
            self._stream.truncate(good)
            self._stream.seek(good)
            self.kept = len(self._rows)
            if not good:
                self._write(self._identity)
        except BlockingIOError:
            raise InputError(f"--out {folder}: another study is at work in this folder") from None
        except OSError as error:
            self._leave()
            raise InputError(f"--out {folder}: cannot be written: {error.strerror}") from None
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        if not self._rows:
            self.remove()
        if self._stream is not None:
            self._stream.close()
            self._stream = None
        if not self._rows:
            self._leave()

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
        """Delete the file and forget the rows: the study is complete, or there is nothing to be kept of it."""
        self._rows = {}
        if self._file is None or self._stream is None:
            return
        if fcntl is None:  # such a system deletes no open file
            self._stream.close()
        self._file.unlink(missing_ok=True)
        self._stream.close()  # the lock with it, after the file
        self._stream = None

    def _leave(self) -> None:
        """Remove the folders that this ledger has made, those that are empty."""
        for parent in self._made:
            with suppress(OSError):
                parent.rmdir()

    def _write(self, content: object) -> None:
        if self._stream is not None:
            self._stream.write(json.dumps(content, allow_nan=False).encode() + b"\n")
            self._stream.flush()

    def _read(self, content: bytes) -> int:
        """Take over the rows of an earlier start, and return how many bytes of the file are whole lines of them."""
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


def _locked(file: Path) -> BinaryIO:
    """Open a file for reading and writing, made if need be, that no other process has locked, and lock it.

    Raises:
        BlockingIOError: another process has.
    """
    while True:
        stream = os.fdopen(os.open(file, os.O_RDWR | os.O_CREAT, 0o666), "r+b")
        if fcntl is None:
            return stream
        try:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            stream.close()
            raise
        except OSError:  # a file system without locks
            return stream
        with suppress(FileNotFoundError):
            if os.path.samestat(os.fstat(stream.fileno()), file.stat()):
                return stream
        stream.close()  # its owner has deleted it between the two calls


def _differs(found: Any, identity: dict[str, Any]) -> str:
    """Say in what the owner of the rows found is another."""
    if not isinstance(found, dict):
        return "they are no study's"
    keys = [key for key in {**identity, **found} if found.get(key) != identity.get(key)]
    return f"they differ in {', '.join(keys)}"
