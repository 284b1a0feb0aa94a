"""Rows of different lengths in one array, one for each place."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats


class Rows:
    """Rows of numbers of different lengths, each followed by zeros.

    Args:
        places: number of rows, empty at first.

    Attributes:
        values: (places, longest + 1): the last column is zero.
        counts: lengths, (places,).
    """

    def __init__(self, places: int) -> None:
        self.values: Floats = np.zeros((places, 1))
        self.counts: NDArray[np.int64] = np.zeros(places, np.int64)

    def put(self, place: int, row: Floats) -> None:
        """Replace a row."""
        count = len(row)
        if count >= self.values.shape[1]:
            larger = np.zeros((len(self.values), count + 1))
            larger[:, : self.values.shape[1]] = self.values
            self.values = larger
        self.values[place, :count] = row
        self.values[place, count:] = 0.0
        self.counts[place] = count

    def at(self, columns: NDArray[np.int64]) -> Floats:
        """Return the value of each row in a column of its own, zero behind its end, (places,)."""
        values: Floats = self.values[np.arange(len(columns)), np.minimum(columns, self.values.shape[1] - 1)]
        return values
