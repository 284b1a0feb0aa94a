"""Memory seen by compiled functions."""

from __future__ import annotations

import numba
import numpy as np

from gantrysim.engine.native.pointers import leading


def test_leading_numbers_of_an_array_are_a_tuple():
    rows = np.random.default_rng(5).normal(size=(3, 6))
    taken = numba.njit(lambda rows, k: (leading(rows[k], 4), leading(rows[k], 6)))(rows, 1)
    assert taken == (tuple(rows[1, :4]), tuple(rows[1]))
