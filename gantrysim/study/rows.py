"""The rows of a study in little memory: as bytes of their values, until one is asked for."""

from __future__ import annotations

import pickle
from collections.abc import Iterable, Sequence
from typing import overload

from gantrysim.study.cases import Row, Value

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
