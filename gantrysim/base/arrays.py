"""Arrays of numbers: their type, products of rows, spans of a mask, functions that remember a result."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

_Result = TypeVar("_Result")


def dot(a: Floats, b: Floats) -> Floats:
    """Scalar products of vectors, row by row, (n,)."""
    return np.einsum("ij,ij->i", a, b)


def at_rows(array: Floats, rows: NDArray[np.intp]) -> Floats:
    """Return rows of an array, (m, ...), to be read alone: a view where each row follows the one before."""
    return array[as_slice(rows)]


def as_slice(rows: NDArray[np.intp]) -> slice | NDArray[np.intp]:
    """Return rows as a slice where each follows the one before, so that those of an array are a view."""
    if rows.size and rows[-1] - rows[0] == rows.size - 1 and (rows[1:] - rows[:-1] == 1).all():
        return slice(int(rows[0]), int(rows[-1]) + 1)
    return rows


def lengths(vectors: Floats) -> Floats:
    """Lengths of vectors, row by row, (n,); column by column, in a seventh of the time of NumPy's `norm`."""
    squares = vectors[:, 0] ** 2
    for k in range(1, vectors.shape[1]):
        squares += vectors[:, k] ** 2
    return np.sqrt(squares, out=squares)


def scaled_rows(vectors: Floats, factors: Floats) -> Floats:
    """Vectors times factors, row by row, (n, k); column by column, as NumPy's loop over a row has few steps."""
    rows = np.empty(vectors.shape)
    for k in range(vectors.shape[1]):
        np.multiply(vectors[:, k], factors, out=rows[:, k])
    return rows


def extremes(rows: Floats) -> Floats:
    """Least and largest value of each column, (2, columns); zeros are positive.

    Column by column: NumPy's reduction over rows of a few values takes twenty times as long.
    """
    columns = [rows[:, k] for k in range(rows.shape[1])]
    return np.array([[column.min() for column in columns], [column.max() for column in columns]]) + 0.0


def read_only(array: NDArray[Any]) -> NDArray[Any]:
    """Return an array that no one else holds, read-only down to its memory."""
    memory = array.base if isinstance(array.base, np.ndarray) else array
    memory.flags.writeable = array.flags.writeable = False
    return array


def read_only_view(array: NDArray[Any]) -> NDArray[Any]:
    """Return a read-only view of an array.

    Numba compiles a function anew for arrays that are read-only and that are not: this makes them one kind.
    """
    view = array.view()
    view.flags.writeable = False
    return view


def compiled_view(values: NDArray[Any]) -> NDArray[Any]:
    """Return numbers as compiled functions take them: contiguous floats, read-only."""
    return read_only_view(np.ascontiguousarray(values, np.float64))


def spans(mask: NDArray[np.bool_]) -> NDArray[np.intp]:
    """First index of every run of True, and the first after it, (k, 2)."""
    return np.flatnonzero(np.diff(mask, prepend=False, append=False)).reshape(-1, 2)


class LastCall(Generic[_Result]):
    """A function of arrays that remembers its last result, as several methods of a path need it in turn."""

    def __init__(self, function: Callable[..., _Result]) -> None:
        self._function = function
        self._last: tuple[tuple[NDArray[Any], ...], _Result] | None = None

    def __call__(self, *arrays: NDArray[Any]) -> _Result:
        # once, as another thread may replace it between the comparison and the return
        last = self._last
        if last is not None and all(map(np.array_equal, last[0], arrays)):
            return last[1]
        result = self._function(*arrays)
        self._last = tuple(array.copy() for array in arrays), result
        return result
