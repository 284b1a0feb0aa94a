"""Numbers as short text: columns of a page as 16-bit integers or differences of 8 bits, in base64."""

from __future__ import annotations

import base64
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats

MISSING = 65535  # code of a missing value
STEPS = 65534  # of a column's range; a value is wrong by half a step at most
_DIFFERENCE = 127  # largest difference of 8 bits
_JUMP = -128  # in place of a larger one


def encoded(values: Floats) -> dict[str, Any]:
    """Return numbers as 16-bit codes.

        value = offset + scale * code,        scale = (largest - smallest) / 65534

    A decoded value differs from the true one by at most scale / 2, 0.0008 % of the column's range. NaN has the
    code 65535. Where it is shorter, differences of neighbouring codes are stored instead, from 0 to the first one on, a
    byte each; -128 stands for a larger difference, and the next of the jumps is the code there.

    Args:
        values: (n,); NaN where there is none.

    Returns:
        "kind", "u16" or "d8"; "offset", "scale"; "data", and of "d8" "jumps", base64 of little-endian integers.
    """
    known = np.isfinite(values)
    low = float(values[known].min()) if known.any() else 0.0
    high = float(values[known].max()) if known.any() else 0.0
    step = (high - low) / STEPS
    scale = step if step > 0 else 1.0  # of a constant column
    codes = np.full(values.size, MISSING, np.int64)
    codes[known] = np.rint((values[known] - low) / scale).astype(np.int64)
    numbers = {"offset": low, "scale": scale}
    differences = np.diff(codes, prepend=0)
    jump = np.abs(differences) > _DIFFERENCE
    if 2 * np.count_nonzero(jump) < codes.size:
        differences[jump] = _JUMP
        return {
            "kind": "d8",
            **numbers,
            "data": _text(differences.astype("i1")),
            "jumps": _text(codes[jump].astype("<u2")),
        }
    return {"kind": "u16", **numbers, "data": _text(codes.astype("<u2"))}


def encoded_ascending(values: NDArray[np.intp]) -> dict[str, Any]:
    """Return ascending integers exactly: the first one, and differences of 16 bits, all one where "data" is empty.

    Differences above 65535 do not occur between the rows of a page, see `gantrysim.report.thinning`.
    """
    differences = np.diff(values)
    data = "" if np.all(differences == 1) else _text(differences.astype("<u2"))
    return {"kind": "ascending", "first": int(values[0]), "data": data}


def encoded_runs(values: NDArray[Any]) -> dict[str, Any]:
    """Return integers that seldom change exactly, as values and how often each follows in a row."""
    starts = np.concatenate([[0], np.flatnonzero(np.diff(values)) + 1])
    counts = np.diff(np.append(starts, values.size))
    return {"kind": "runs", "values": values[starts].astype(int).tolist(), "counts": counts.tolist()}


def _text(values: NDArray[Any]) -> str:
    return base64.b64encode(values.tobytes()).decode("ascii")
