"""Arrays of numbers: their type, products of rows, spans of a mask."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def dot(a: Floats, b: Floats) -> Floats:
    """Scalar products of vectors, row by row, (n,)."""
    return np.einsum("ij,ij->i", a, b)


def spans(mask: NDArray[np.bool_]) -> NDArray[np.intp]:
    """First index of every run of True, and the first after it, (k, 2)."""
    return np.flatnonzero(np.diff(mask, prepend=False, append=False)).reshape(-1, 2)
