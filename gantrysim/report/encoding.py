"""Numbers as short text: columns of a page as 16-bit integers or differences of 8 bits, in base64."""

from __future__ import annotations

import base64
import gzip
import math
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.columns import blocks
from gantrysim.base.jit import jit

MISSING_CODE = 65535  # code of a missing value
RANGE_STEPS = 65534  # of a column's range; a value is wrong by half a step at most
_LARGEST_DIFFERENCE = 127  # largest difference of 8 bits
_JUMP_CODE = -128  # in place of a larger one


def packed(text: str) -> str:
    """Return a text compressed by gzip, in base64, which a page expands; the same text gives the same characters."""
    return _text(gzip.compress(text.encode("utf-8"), mtime=0))


def encoded_numbers(values: Floats, resolution: float = 0.0) -> dict[str, Any]:
    """Return numbers as 16-bit codes.

        value = offset + scale * code,        scale = (largest - smallest) / n,        n = 65534 or less

    A decoded value differs from the true one by at most scale / 2: 0.0008 % of the column's range, or half of the
    resolution where that is more. The least and the largest value are exact. NaN has the code 65535. Where it is
    shorter, differences of neighbouring codes are stored instead, from 0 to the first one on, a byte each; -128 stands
    for a larger difference, and the next of the jumps is the code there.

    Args:
        values: (n,); NaN where there is none.
        resolution: finer steps than this show nothing, and only make a page large; in the unit of the values.

    Returns:
        "kind", "u16" or "d8"; "offset", "scale"; "data", and of "d8" "jumps", base64 of little-endian integers.
    """
    known = np.isfinite(values)
    low = float(values[known].min()) if known.any() else 0.0
    high = float(values[known].max()) if known.any() else 0.0
    steps = min(math.ceil((high - low) / resolution), RANGE_STEPS) if resolution > 0 else RANGE_STEPS
    step = (high - low) / max(steps, 1)
    scale = step if step > 0 else 1.0  # of a constant column
    codes = np.full(values.size, MISSING_CODE, np.int64)
    codes[known] = np.rint((values[known] - low) / scale).astype(np.int64)
    numbers = {"offset": low, "scale": scale}
    differences = np.diff(codes, prepend=0)
    jump = np.abs(differences) > _LARGEST_DIFFERENCE
    if 2 * np.count_nonzero(jump) < codes.size:
        differences[jump] = _JUMP_CODE
        return {
            "kind": "d8",
            **numbers,
            "data": _text(differences.astype("i1").tobytes()),
            "jumps": _text(codes[jump].astype("<u2").tobytes()),
        }
    return {"kind": "u16", **numbers, "data": _text(codes.astype("<u2").tobytes())}


def encoded_ascending(values: NDArray[np.intp]) -> dict[str, Any]:
    """Return ascending integers exactly: the first one, and differences of 16 bits, all one where "data" is empty.

    Differences above 65535 do not occur between the rows of a page, whose number is bounded above.
    """
    differences = np.diff(values)
    data = "" if np.all(differences == 1) else _text(differences.astype("<u2").tobytes())
    return {"kind": "ascending", "first": int(values[0]), "data": data}


def encoded_runs(values: NDArray[Any]) -> dict[str, Any]:
    """Return integers that seldom change exactly, as values and how often each follows in a row."""
    starts = np.concatenate([[0], np.flatnonzero(np.diff(values)) + 1])
    counts = np.diff(np.append(starts, values.size))
    return {"kind": "runs", "values": values[starts].astype(int).tolist(), "counts": counts.tolist()}


def _text(content: bytes) -> str:
    return base64.b64encode(content).decode("ascii")


# Thinning of columns to the rows that a page shows, so that the extremes of every column remain.

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
