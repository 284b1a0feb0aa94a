"""A function that remembers its last result returns that of its own arguments, from any thread."""

import threading

import numpy as np
import pytest

from gantrysim.base.arrays import LastCall, at_rows, extremes, lengths, read_only_view, scaled_rows


def test_the_last_result_is_that_of_the_same_arguments():
    calls = []
    double = LastCall(lambda values: (calls.append(1), 2 * values)[1])
    first = np.arange(3.0)
    assert double(first) is double(first.copy())
    first += 1.0
    assert double(first).tolist() == [2.0, 4.0, 6.0]
    assert len(calls) == 2


def test_another_thread_does_not_replace_the_result_between_comparison_and_return():
    rows = [np.full(50, float(value)) for value in range(2)]
    remembered = LastCall(lambda values: values[:1].copy())
    compare = np.array_equal
    entered = threading.Event()
    replaced = threading.Event()

    def slow(left, right):
        equal = compare(left, right)
        if threading.current_thread() is not threading.main_thread():
            entered.set()
            assert replaced.wait(10.0)
        return equal

    remembered(rows[0])
    results = []
    thread = threading.Thread(target=lambda: results.append(float(remembered(rows[0])[0])))
    try:
        np.array_equal = slow
        thread.start()
        assert entered.wait(10.0)
        remembered(rows[1])
    finally:
        np.array_equal = compare
        replaced.set()
        thread.join()
    assert results == [0.0]


def test_a_view_that_is_seen_cannot_be_written_to():
    array = np.zeros(3)
    view = read_only_view(array)
    assert view.base is array
    assert not view.flags.writeable
    assert array.flags.writeable


def test_the_extremes_are_those_of_every_column():
    rows = np.random.default_rng(3).normal(size=(50, 3))
    assert np.array_equal(extremes(rows), [rows.min(axis=0), rows.max(axis=0)])
    assert not np.signbit(extremes(np.array([[-0.0], [-0.0]]))).any()
    assert np.isnan(extremes(np.array([[1.0], [np.nan], [2.0]]))).all()


@pytest.mark.parametrize("columns", [2, 3])
def test_lengths_are_numpys_norms(columns):
    vectors = np.random.default_rng(4).normal(size=(500, columns)) * np.logspace(-8, 3, 500)[:, None]
    assert np.array_equal(lengths(vectors), np.linalg.norm(vectors, axis=1))
    assert np.array_equal(lengths(np.asfortranarray(vectors)), np.linalg.norm(vectors, axis=1))


def test_vectors_are_scaled_row_by_row():
    rng = np.random.default_rng(6)
    vectors = rng.normal(size=(40, 3))
    factors = rng.normal(size=40)
    assert np.array_equal(scaled_rows(vectors, factors), vectors * factors[:, None])
    alike = np.broadcast_to(vectors[0], (40, 3))
    assert np.array_equal(scaled_rows(alike, factors), vectors[0] * factors[:, None])


@pytest.mark.parametrize("rows", [[], [4], [2, 3, 4], [0, 1, 3], [0, 0, 2], [9]])
def test_rows_are_those_of_their_indices(rows):
    array = np.random.default_rng(5).normal(size=(10, 3))
    found = at_rows(array, np.array(rows, np.intp))
    assert np.array_equal(found, array[rows] if rows else np.zeros((0, 3)))
    follow = len(rows) > 0 and rows == list(range(rows[0], rows[-1] + 1))
    assert np.shares_memory(found, array) == follow
