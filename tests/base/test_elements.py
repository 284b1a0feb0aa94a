"""One element of an array is read and written as NumPy does, and with the machine code of numba's own way."""

import re

import numba
import numpy as np
import pytest
from numba.core.caching import NullCache

from gantrysim.base import elements, pipeline
from gantrysim.base.jit import jit

GRID = np.random.default_rng(5).normal(size=(6, 7))
CUBE = np.random.default_rng(6).normal(size=(3, 4, 5))
ARRAYS = {
    "C": GRID,
    "F": np.asfortranarray(GRID),
    "strided": GRID[::2, ::3],
    "reversed": GRID[::-1, ::-1],
    "integers": np.arange(30, dtype=np.int16).reshape(5, 6),
    "booleans": GRID > 0,
    "complex": GRID + 1j,
}


def read(array, i, k):
    return array[i, k]


def write(array, i, k, value):
    array[i, k] = value


@pytest.mark.parametrize("name", ARRAYS)
@pytest.mark.parametrize("kind", [np.int64, np.int8, np.uint16])
def test_an_element_is_numpys(name, kind):
    array = ARRAYS[name]
    places = [(0, 0), (1, 2), (2, 1)] + [(-1, 0), (1, -1), (-2, -2)] * (kind != np.uint16)
    for place in places:
        i, k = (kind(number) for number in place)
        assert jit(read)(array, i, k) == array[place]
        written = array.copy(order="K")
        jit(write)(written, i, k, 1)
        expected = array.copy(order="K")
        expected[place] = 1
        assert np.array_equal(written, expected)


def test_an_index_of_several_kinds_and_a_number_that_is_cast():
    @jit
    def swap(cube, row, i, k):
        cube[i, 1, k] = row[k]
        row[k] = cube[0, i, -1]
        return cube[i, 1, k]

    cube = CUBE.astype(np.float32)
    row = np.arange(5)
    assert swap(cube, row, np.uint8(2), -2) == 3
    assert cube[2, 1, 3] == 3
    assert row.tolist() == [0, 1, 2, int(np.float32(CUBE[0, 2, 4])), 4]


def test_rows_records_and_slices_are_left_to_numba():
    points = np.zeros(3, dtype=[("x", float), ("y", float, (2,))])
    points["x"] = 1, 2, 3
    points["y"] = CUBE[0, :3, :2]

    @jit
    def sums(points, grid):
        total = 0.0
        for k in range(len(points)):
            total += points[k].x * points[k].y[1]
        return total + grid[1][2] + grid[1:, 3][-1]

    expected = 0.0
    for k in range(3):
        expected += points[k]["x"] * points[k]["y"][1]
    assert sums(points, GRID) == expected + GRID[1, 2] + GRID[-1, 3]


def smooth(grid, into):
    for i in range(1, grid.shape[0] - 1):
        for k in range(grid.shape[1]):
            into[i - 1, k] = grid[i - 1, k] + 2.0 * grid[i, k] + grid[i + 1, k - 1]


def _machine_code():
    compiled = jit(smooth)
    compiled._cache = NullCache()  # code from a cache cannot be looked at
    compiled(GRID, np.empty((4, 7)))
    (text,) = compiled.inspect_asm().values()
    lines = [line.strip() for line in text.splitlines() if re.match(r"\t[a-z]", line)]
    return [re.sub(r"_ZN\w+|\d{9,}", "name or address", line) for line in lines]


def test_the_machine_code_is_that_of_numbas_elements(monkeypatch):
    ours = _machine_code()
    monkeypatch.setattr(elements, "MAKERS", {})
    assert len(ours) > 100
    assert ours == _machine_code()


def test_numba_checks_bounds_where_it_is_asked_to():
    checked = numba.njit(pipeline_class=pipeline.WHOLE, boundscheck=True)(read)
    assert checked(GRID, 1, 2) == GRID[1, 2]
    with pytest.raises(IndexError):
        checked(GRID, 6, 0)
