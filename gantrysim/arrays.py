"""Arrays of numbers: their type, and the inner product of rows."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def dot(a: Floats, b: Floats) -> Floats:
    """Scalar products of vectors, row by row, (n,)."""
    return np.einsum("ij,ij->i", a, b)
