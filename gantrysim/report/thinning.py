"""Thinning of columns to the rows that a page shows, so that the extremes of every column remain."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.columns import blocks
from gantrysim.base.jit import jit

MOST_ROWS = 20_000
_GAP = 65_535  # largest distance of rows, which 16 bits hold
_CHANGES = 4  # changes of state are kept where they are less than one of so many rows


def shown_rows(
    rows: int,
    columns: Iterable[tuple[NDArray[np.intp] | None, Floats]],
    count: int,
    states: Iterable[NDArray[np.generic]] = (),
    most: int = MOST_ROWS,
) -> NDArray[np.intp]:
    """Return the rows to show: all, or of each bucket the first and last, and every column's least and largest.

    The rows around changes of state are shown too, unless these are too many.

    Args:
        rows: number of rows.
        columns: one after the other, so that only one needs to be in memory: the rows of its values, ascending, None
            for all; and its values, NaN where there is none.
        count: number of columns.
        states: values by row, (rows,).
        most: largest number of rows shown, about.

    Returns:
        Ascending, (m,), the first and the last row among them.
    """
    if rows <= most:
        return np.arange(rows)
    size = min(-(-rows * (2 + 2 * count) // most), _GAP)
    shown = np.zeros(rows, np.bool_)
    shown[::size] = True
    shown[size - 1 :: size] = True
    shown[-1] = True
    for places, values in columns:
        for block, inside in _blocks(places, values.size):
            _mark_extremes(shown, inside, values[block], size)
    for state in states:
        changes = np.flatnonzero(np.diff(state))
        if changes.size < most // _CHANGES:
            shown[changes] = True
            shown[changes + 1] = True
    return np.flatnonzero(shown)


def _blocks(places: NDArray[np.intp] | None, rows: int) -> Iterator[tuple[slice, NDArray[np.intp]]]:
    for block in blocks(rows):
        yield block, np.arange(block.start, block.stop) if places is None else places[block]


@jit
def _mark_extremes(shown: NDArray[np.bool_], places: NDArray[np.intp], values: Floats, size: int) -> None:
    """Mark in place the rows of the least and the largest value of each bucket of so many rows."""
    k = 0
    while k < values.size:
        bucket = places[k] // size
        low = high = -1
        while k < values.size and places[k] // size == bucket:
            if not np.isnan(values[k]):
                if low < 0 or values[k] < values[low]:
                    low = k
                if high < 0 or values[k] > values[high]:
                    high = k
            k += 1
        if low >= 0:
            shown[places[low]] = True
            shown[places[high]] = True
