"""Tables with a row per tick: columns in memory or in a file, computed block by block."""

import dataclasses
import gc
import itertools
import pickle
import tempfile
import weakref

import numpy as np
import pytest

from gantrysim.base import columns, memory
from gantrysim.base.arrays import Floats
from gantrysim.base.columns import Column, FileTable, by_blocks, extent, table_by_blocks
from gantrysim.base.errors import InputError


@dataclasses.dataclass(frozen=True)
class Pair:
    number: Column[Floats] = Column()
    point: Column[Floats] = Column()


ROWS = 1000
NUMBER, POINT = np.arange(1.0 * ROWS), np.random.default_rng(1).normal(size=(ROWS, 3))


def parts(edges):
    return (Pair(NUMBER[low:high], POINT[low:high]) for low, high in itertools.pairwise(edges))


@pytest.fixture
def in_a_file(monkeypatch):
    monkeypatch.setattr(memory, "LONG_RUN", ROWS - 1)


def test_a_column_holds_what_it_was_given_and_cannot_be_set():
    pair = Pair(NUMBER, POINT)
    assert pair.number is NUMBER
    assert dataclasses.replace(pair, point=POINT[:0]).number is NUMBER
    with pytest.raises(dataclasses.FrozenInstanceError):
        pair.number = POINT
    with pytest.raises(TypeError, match="point"):
        Pair(NUMBER)


@pytest.mark.parametrize("edges", [[0, ROWS], [0, 1, 2, ROWS], [0, 400, 400, 700, ROWS]])
@pytest.mark.parametrize("kept", [ROWS, ROWS - 1])
def test_parts_are_joined_in_memory_and_in_a_file(monkeypatch, edges, kept):
    monkeypatch.setattr(memory, "LONG_RUN", kept)
    joined = table_by_blocks(parts(edges), ROWS)
    assert isinstance(vars(joined)["point"], np.ndarray) == (kept == ROWS)
    np.testing.assert_array_equal(joined.number, NUMBER)
    np.testing.assert_array_equal(joined.point, POINT)


@pytest.mark.parametrize("block", [1, 7, ROWS])
def test_an_extent_is_that_of_all_blocks(monkeypatch, block):
    monkeypatch.setattr(columns, "BLOCK", block)
    assert extent(lambda rows: POINT[rows, 2], ROWS) == np.ptp(POINT[:, 2])
    some = POINT[:, 2] > 1.0
    assert extent(lambda rows: POINT[rows, 2][some[rows]], ROWS) == np.ptp(POINT[some, 2])
    assert extent(lambda rows: POINT[rows, 2][:0], ROWS) == 0.0


def test_fewer_rows_than_there_might_have_been(in_a_file):
    joined = table_by_blocks(parts([0, 3, 9]), ROWS)
    np.testing.assert_array_equal(joined.point, POINT[:9])
    nothing = table_by_blocks(parts([0, 0]), ROWS)
    assert nothing.number.shape == (0,)
    assert nothing.point.shape == (0, 3)


def test_an_array_of_a_file_is_read_only_and_outlives_its_table(in_a_file):
    array = table_by_blocks(parts([0, ROWS]), ROWS).point
    gc.collect()
    assert not array.flags.writeable
    np.testing.assert_array_equal(array, POINT)


def test_a_table_of_a_file_is_pickled_as_arrays(in_a_file):
    back = pickle.loads(pickle.dumps(table_by_blocks(parts([0, 500, ROWS]), ROWS)))
    assert isinstance(vars(back)["number"], np.ndarray)
    np.testing.assert_array_equal(back.number, NUMBER)


def test_a_file_is_closed_with_the_last_user_of_its_columns():
    table = FileTable(ROWS, {"number": (np.dtype(float), ())})
    table.write(0, {"number": NUMBER})
    file, stored = weakref.ref(table._file.raw), table.first_rows(ROWS)["number"]
    del table
    gc.collect()
    np.testing.assert_array_equal(stored.array(), NUMBER)
    del stored
    gc.collect()
    assert file() is None or file().closed


def test_blocks_may_be_written_in_any_order():
    table = FileTable(ROWS, {"number": (np.dtype(float), ()), "point": (np.dtype(float), (3,))})
    table.write(600, {"point": POINT[600:], "number": NUMBER[600:]})
    table.write(0, {"number": NUMBER[:600], "point": np.asfortranarray(POINT[:600])})
    np.testing.assert_array_equal(table.first_rows(ROWS)["number"].array(), NUMBER)
    np.testing.assert_array_equal(table.first_rows(ROWS)["point"].array(), POINT)


@pytest.mark.parametrize("size", [1, 7, ROWS - 1, ROWS, 2 * ROWS])
def test_a_function_of_blocks_sees_every_row_once(monkeypatch, size):
    monkeypatch.setattr(columns, "BLOCK", size)
    np.testing.assert_array_equal(by_blocks(lambda block: POINT[block], ROWS), POINT)
    assert by_blocks(lambda block: POINT[block], 0).shape == (0, 3)


def test_a_folder_without_room_is_named(monkeypatch, in_a_file):
    monkeypatch.setattr(tempfile, "tempdir", "/nowhere")
    with pytest.raises(
        InputError, match=r"^temporary file in /nowhere: cannot be written \(No such file or directory\);"
    ):
        table_by_blocks(parts([0, ROWS]), ROWS)
