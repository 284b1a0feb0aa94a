"""The ledger: finished rows of a running study on disk, from which an interrupted study resumes."""

from __future__ import annotations

import hashlib
import json
import pickle
from collections import Counter, defaultdict
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from itertools import chain
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO, overload

from gantrysim.base.errors import GantryError, InputError, text_of
from gantrysim.base.files import ANY_FILE, held_folder, open_regular
from gantrysim.study.cases import OK, Case, Row, Value

# The rows of a study in little memory: as bytes of their values, until one is asked for.

Tags = tuple[tuple[str, Value], ...]


class RowStore:
    """Rows in the order in which they were added.

    A row as a dict takes ten times the memory of its values; the names of its columns are held once for all rows that
    have the same.
    """

    def __init__(self) -> None:
        self._columns: list[tuple[str, ...]] = []  # of each row
        self._values: list[bytes] = []
        self._known: dict[tuple[str, ...], tuple[str, ...]] = {}

    def __len__(self) -> int:
        return len(self._values)

    def add(self, row: Row) -> int:
        """Add a row and return its index."""
        columns = tuple(row)
        self._columns.append(self._known.setdefault(columns, columns))
        self._values.append(pickle.dumps(tuple(row.values()), pickle.HIGHEST_PROTOCOL))
        return len(self._values) - 1

    def row(self, index: int) -> Row:
        """Return a row, as it was added; a new dict."""
        return dict(zip(self._columns[index], pickle.loads(self._values[index]), strict=True))


class TaggedRows(Sequence[Row]):
    """The rows of a study's cases, in the order of the cases: their tags, then their values; each a new dict.

    Args:
        store: of the values.
        entries: tags of each case, and index of its row in the store.
    """

    def __init__(self, store: RowStore, entries: Iterable[tuple[Tags, int]] = ()) -> None:
        self._store = store
        self._entries = list(entries)

    def __len__(self) -> int:
        return len(self._entries)

    @overload
    def __getitem__(self, index: int) -> Row: ...
    @overload
    def __getitem__(self, index: slice) -> TaggedRows: ...
    def __getitem__(self, index: int | slice) -> Row | TaggedRows:
        if isinstance(index, slice):
            return TaggedRows(self._store, self._entries[index])
        tags, place = self._entries[index]
        return {**dict(tags), **self._store.row(place)}

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Sequence) or len(other) != len(self):
            return False
        return all(row == other_row for row, other_row in zip(self, other, strict=True))

    __hash__ = None  # type: ignore[assignment]  # as of a list

    def __repr__(self) -> str:
        return repr(list(self))

    def extend(self, other: TaggedRows) -> None:
        """Add rows of the same study."""
        if other._store is not self._store:
            raise ValueError("rows of another study: must have one store")
        self._entries += other._entries


LEDGER = ".study-progress.jsonl"
_CHECKSUM_DIGITS = 16  # digits of a checksum
_LINE_LENGTH = 1 << 26  # line [bytes]
_LARGEST_NUMBER = 1e100  # number of a row, in any unit


class Ledger:
    """A file of JSON lines: the identity of the study, then one line per finished case.

    A line is written as soon as its case is finished, with a checksum. A last line that was cut off is ignored, and so
    are a damaged one and those after it: their cases are run again. While the ledger is open, its folder is held
    against other commands. A ledger closed without any row leaves nothing, not even a folder that it made.

    Args:
        folder: of the file, or None to keep the rows in memory.
        identity: of the study, all that the rows depend on besides their cases; plain JSON.
        names: of the files that the study writes, see `held`.

    Attributes:
        resumed: number of rows taken over from an earlier run.
        rows: the finished rows, in the order in which they were finished.
        discarded: differences for which earlier rows were not taken over, or None.
    """

    def __init__(self, folder: Path | None, identity: dict[str, Any], names: Collection[str] = ANY_FILE) -> None:
        self.rows = RowStore()
        # of the rows, by their keys
        self._places: dict[str, int] = {}
        # rows of an earlier run, the first of `rows`
        self._taken_over = 0
        self._file = None if folder is None else folder / LEDGER
        self._identity = identity
        self._names = names
        self._stream: BinaryIO | None = None
        self._held = ExitStack()
        self.discarded: str | None = None
        self.resumed = 0

    def __enter__(self) -> Ledger:
        if self._file is None:
            return self
        folder = self._file.parent
        with ExitStack() as stack:
            stack.enter_context(held_folder(folder, f"--out {folder}", self._names))
            try:
                self._stream = stack.enter_context(open_regular(self._file))
                good = self._read(iter(partial(self._stream.readline, _LINE_LENGTH), b""))
                self._stream.truncate(good)
                self._stream.seek(good)
                self.resumed = len(self._places)
                self._taken_over = len(self.rows)
                if not good:
                    self._write(self._identity)
            except OSError as error:
                raise InputError(f"--out {folder}: cannot be written: {error.strerror}") from None
            self._held = stack.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if not self._places:
            self.remove()
        self._held.close()
        self._stream = None

    def __contains__(self, key: str) -> bool:
        return key in self._places

    def __getitem__(self, key: str) -> Row:
        return self.rows.row(self._places[key])

    def __len__(self) -> int:
        return len(self._places)

    def place(self, key: str) -> int:
        """Return the index of a finished row in `rows`."""
        return self._places[key]

    def forget_misfits(self, cases: Iterable[Case]) -> bool:
        """Forget rows of an earlier run that differ from the others in their columns or in the kinds of their values.

        Rows of cases with the same mode and machine have the same columns, and in each the same kind of value or None.
        Where a row of this run shows which, the others must be like it, else like the most of them.

        Args:
            cases: whose rows are in the ledger.

        Returns:
            Whether any row was forgotten, and its case is to be run again.
        """
        if not self._taken_over:
            return False
        alike: defaultdict[tuple[object, ...], list[str]] = defaultdict(list)
        for key, case in {case.key: case for case in cases}.items():
            alike[case.mode, case.machine, self[key]["status"] == OK].append(key)
        misfits = [key for keys in alike.values() for key in self._misfits(keys)]
        for key in misfits:
            del self._places[key]
        self.resumed -= len(misfits)
        return bool(misfits)

    def _misfits(self, keys: list[str]) -> list[str]:
        """Return the keys of rows of an earlier run that differ from the other rows of these keys."""
        old = [key for key in keys if self._places[key] < self._taken_over]
        new = [key for key in keys if self._places[key] >= self._taken_over]
        models = [_kinds(self[key]) for key in new or old]
        columns, _ = Counter(map(tuple, models)).most_common(1)[0]
        counts = {name: Counter(kinds[name] for kinds in models if kinds.get(name)) for name in columns}
        usual = {name: count.most_common(1)[0][0] for name, count in counts.items() if count}
        return [key for key in old if not _fits(_kinds(self[key]), columns, usual)]

    def add(self, key: str, row: Row) -> None:
        """Add a finished row."""
        self._places[key] = self.rows.add(row)
        self._write([key, row, _checksum(key, row)])

    @contextmanager
    def blamed(self) -> Iterator[None]:
        """Name rows of an earlier run as the reason of an error in the block that no row of a study raises.

        Raises:
            InputError: such an error, where rows were taken over.
        """
        try:
            yield
        except (LookupError, TypeError, ValueError, ArithmeticError, AttributeError) as error:
            if not self.resumed or isinstance(error, GantryError):
                raise
            raise InputError(
                f"{self._file}: its rows do not fit the study ({text_of(error)}): remove this file to run all cases"
            ) from None

    def remove(self) -> None:
        """Delete the file and forget the rows: the study is complete, or has no values."""
        # rows that were returned refer to the one before
        self.rows = RowStore()
        self._places = {}
        if self._file is not None and self._stream is not None:
            self._stream.close()
            self._stream = None
            self._file.unlink(missing_ok=True)

    def _write(self, content: object) -> None:
        if self._file is None or self._stream is None:
            return
        try:
            self._stream.write(json.dumps(content, allow_nan=False).encode() + b"\n")
            # a killed process then loses no finished row
            self._stream.flush()
        except OSError as error:  # of a stream, which has no name
            raise InputError(f"{self._file}: cannot be written: {error.strerror}") from None

    def _read(self, lines: Iterable[bytes]) -> int:
        """Take over the rows of an earlier run, and return the length of their complete lines in bytes."""
        good = 0
        for number, line in enumerate(lines):
            try:
                if not line.endswith(b"\n"):
                    break
                content_of_line = json.loads(line)
                if number == 0:
                    if content_of_line != self._identity:
                        self.discarded = _differs(content_of_line, self._identity)
                        return 0
                else:
                    key, row, checksum = content_of_line
                    if checksum != _checksum(key, row) or not _is_row(row):
                        break
                    self._places[key] = self.rows.add(row)
            except (ValueError, TypeError, RecursionError):
                break
            good += len(line)
        return good


def _is_row(row: Any) -> bool:
    """Return whether a value is a row as studies write it: a status and plain values by column, all numbers finite."""
    if not isinstance(row, dict) or not isinstance(row.get("status"), str):
        return False
    values = chain.from_iterable(value if isinstance(value, list) else [value] for value in row.values())
    return all(value is None or isinstance(value, str) or _is_plain(value) for value in values)


def _is_plain(value: Any) -> bool:
    return isinstance(value, int | float) and abs(value) <= _LARGEST_NUMBER


def _kinds(row: Row) -> dict[str, str]:
    """Return the kind of value in each column; empty for None, which any value may be."""
    return {name: "" if value is None else type(value).__name__ for name, value in row.items()}


def _fits(kinds: dict[str, str], columns: tuple[str, ...], usual: dict[str, str]) -> bool:
    """Return whether a row has these columns, each with its usual kind of value."""
    return tuple(kinds) == columns and all(not kind or usual.get(name, kind) == kind for name, kind in kinds.items())


def _checksum(key: str, row: Row) -> str:
    return hashlib.sha256(json.dumps([key, row]).encode()).hexdigest()[:_CHECKSUM_DIGITS]


def _differs(other: Any, identity: dict[str, Any]) -> str:
    """Return the differences of an earlier run's identity, as text."""
    if not isinstance(other, dict):
        return "they are not of a study"
    keys = [key for key in {**identity, **other} if other.get(key) != identity.get(key)]
    return f"they differ in {', '.join(keys)}"
