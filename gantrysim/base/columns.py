"""Tables with a row per tick, computed in blocks of rows; long runs keep them in temporary files.

An array of a file is mapped at each access, so that it takes memory only while it is in use.
"""

from __future__ import annotations

import math
import tempfile
import weakref
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import fields
from typing import Any, Generic, TypeVar, cast, overload

import numpy as np
from numpy.typing import NDArray

from gantrysim.base import memory
from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError

BLOCK = 16_384  # rows that are computed at a time

_Array = TypeVar("_Array", bound=NDArray[Any])
_Table = TypeVar("_Table")


class _File:
    """A temporary file without a name, closed with its last user."""

    def __init__(self) -> None:
        self.raw = tempfile.TemporaryFile(buffering=0)  # noqa: SIM115  closed below
        weakref.finalize(self, self.raw.close)


class Stored:
    """An array in a temporary file.

    Args:
        file: that holds it.
        dtype: of the array.
        shape: of the array.
        offset: of its first byte.
    """

    def __init__(self, file: _File, dtype: np.dtype[Any], shape: tuple[int, ...], offset: int) -> None:
        self._file = file
        self.dtype = dtype
        self.shape = shape
        self._offset = offset

    def array(self) -> NDArray[Any]:
        """Return the array, read-only."""
        if 0 in self.shape:
            return np.empty(self.shape, self.dtype)
        return np.memmap(self._file.raw, self.dtype, "r", self._offset, self.shape).view(np.ndarray)

    def __reduce__(self) -> tuple[Any, ...]:
        return np.array, (self.array(),)


class Column(Generic[_Array]):
    """An attribute of a frozen dataclass that is an array, or is read from one in a file."""

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    @overload
    def __get__(self, table: None, owner: type) -> Column[_Array]: ...
    @overload
    def __get__(self, table: object, owner: type) -> _Array: ...
    def __get__(self, table: object | None, owner: type) -> Column[_Array] | _Array:
        if table is None:
            # so that the dataclass takes it for no default
            raise AttributeError(self._name)
        value = table.__dict__[self._name]
        return cast(_Array, value.array() if isinstance(value, Stored) else value)

    def __set__(self, table: object, value: _Array | Stored) -> None:
        table.__dict__[self._name] = value


class OptionalColumn(Column[_Array]):
    """A column that may be missing: None, the default."""

    def __get__(self, table: object | None, owner: type) -> _Array | None:  # type: ignore[override]
        if table is None or table.__dict__[self._name] is None:
            return None
        return super().__get__(table, owner)

    def __set__(self, table: object, value: _Array | Stored | None) -> None:
        table.__dict__[self._name] = value


class FileTable:
    """Columns that are written block by block to one temporary file, which goes with the last user of a column.

    Args:
        most: rows that it can have.
        columns: type of each column, and shape of its rows.

    Raises:
        InputError: the file cannot be made or written.
    """

    def __init__(self, most: int, columns: Mapping[str, tuple[np.dtype[Any], tuple[int, ...]]]) -> None:
        self._columns = dict(columns)
        self._offsets = dict[str, int]()
        offset = 0
        for name, (dtype, tail) in columns.items():
            self._offsets[name] = offset
            offset += -(-most * dtype.itemsize * int(np.prod(tail, dtype=np.int64)) // 64) * 64
        with _writing():
            self._file = _File()

    def write(self, first: int, blocks: Mapping[str, NDArray[Any]]) -> None:
        """Write blocks of some columns from a row on."""
        for name, block in blocks.items():
            dtype, tail = self._columns[name]
            row = dtype.itemsize * int(np.prod(tail, dtype=np.int64))
            unwritten = memoryview(cast(Any, np.ascontiguousarray(block, dtype).reshape(-1).view(np.uint8)))
            with _writing():
                self._file.raw.seek(self._offsets[name] + first * row)
                while unwritten:
                    unwritten = unwritten[self._file.raw.write(unwritten) :]

    def first_rows(self, rows: int) -> dict[str, Stored]:
        """Return the first rows of all columns."""
        return {
            name: Stored(self._file, dtype, (rows, *tail), self._offsets[name])
            for name, (dtype, tail) in self._columns.items()
        }


def blocks(rows: int) -> Iterator[slice]:
    """Yield the blocks of so many rows, at least one."""
    for first in range(0, max(rows, 1), BLOCK):
        yield slice(first, min(first + BLOCK, rows))


def by_blocks(function: Callable[[slice], _Array], rows: int) -> _Array:
    """Return what a function returns for each block of so many rows, joined, in memory."""
    if rows <= BLOCK:
        return function(slice(0, rows))
    every = blocks(rows)
    first = function(next(every))
    joined = np.empty((rows, *first.shape[1:]), first.dtype)
    joined[:BLOCK] = first
    for block in every:
        joined[block] = function(block)
    return cast(_Array, joined)


def extent(function: Callable[[slice], Floats], rows: int) -> float:
    """Return the extent of the values that a function returns for blocks of so many rows, 0 where there are none."""
    low = math.inf
    high = -math.inf
    for block in blocks(rows):
        values = function(block)
        low = min(low, float(values.min(initial=math.inf)))
        high = max(high, float(values.max(initial=-math.inf)))
    return max(high - low, 0.0)


def table_by_blocks(parts: Iterator[_Table], rows: int) -> _Table:
    """Join tables, dataclasses with columns alone, the same ones each; in memory, or for a long run in a file.

    Args:
        parts: the tables in their order, at least one.
        rows: that they have together, at most.
    """
    first = next(parts)
    names = [field.name for field in fields(cast(Any, first)) if getattr(first, field.name) is not None]
    if rows <= memory.LONG_RUN:
        every = [first, *parts]
        if len(every) == 1:
            return first
        return type(first)(**{name: np.concatenate([getattr(part, name) for part in every]) for name in names})
    samples = {name: np.asarray(getattr(first, name)) for name in names}
    table = FileTable(rows, {name: (sample.dtype, sample.shape[1:]) for name, sample in samples.items()})
    written = 0
    part: _Table | None = first
    while part is not None:
        content = {name: getattr(part, name) for name in names}
        table.write(written, content)
        written += len(content[names[0]])
        part = next(parts, None)
    return type(first)(**table.first_rows(written))


def array_of(value: NDArray[Any] | Stored) -> NDArray[Any]:
    """Return an array itself, or the one stored in a file."""
    return value.array() if isinstance(value, Stored) else value


@contextmanager
def _writing() -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise InputError(
            f"temporary file in {tempfile.gettempdir()}: cannot be written ({error.strerror}); "
            "set TMPDIR to a folder with more room"
        ) from None
