"""Rows that are held as bytes are the dicts that were added, in less memory."""

import json
import math
import random
import tracemalloc

import pytest

from gantrysim.study.ledger import RowStore, TaggedRows

ROW = {
    "status": "ok",
    "whole": 3,
    "number": 0.1,
    "zero": -0.0,
    "flag": True,
    "none": None,
    "curve": [1.0, 2.5],
    "µ": "µm",
}
OTHER = {"status": "refused: no"}


@pytest.fixture
def rows():
    store = RowStore()
    entries = [((("value", k), ("tag", "x")), store.add(row)) for k, row in enumerate([ROW, OTHER, ROW])]
    return TaggedRows(store, [*entries, entries[0]])


def test_a_row_is_what_was_added_in_its_types_and_order(rows):
    expected = [{"value": k, "tag": "x", **row} for k, row in enumerate([ROW, OTHER, ROW])]
    expected.append(expected[0])
    assert rows == expected == list(rows)
    assert [json.dumps(row) for row in rows] == [json.dumps(row) for row in expected]
    assert math.copysign(1.0, rows[0]["zero"]) == -1.0
    assert rows[-1] == rows[0]
    assert rows != expected[:-1]
    assert rows != [*expected[:-1], OTHER]
    assert repr(rows) == repr(expected)


def test_a_part_of_the_rows_is_rows_too(rows):
    assert rows[1:3] == list(rows)[1:3]
    assert isinstance(rows[1:3], TaggedRows)
    assert len(rows[::-1]) == 4
    with pytest.raises(IndexError):
        rows[4]


def test_a_change_of_a_row_that_was_given_out_changes_no_other(rows):
    rows[0]["status"] = "changed"
    rows[0]["curve"].append(9.0)
    assert rows[0] == {"value": 0, "tag": "x", **ROW}


def test_rows_of_one_study_are_joined_and_of_others_are_not(rows):
    joined = rows[:1]
    joined.extend(rows[1:])
    assert joined == rows
    with pytest.raises(ValueError, match="one store"):
        joined.extend(TaggedRows(RowStore()))


def test_a_row_takes_a_quarter_of_the_memory_of_its_dict():
    rng = random.Random(5)
    names = [f"column_{k}_um" for k in range(70)]

    def taken(hold):
        tracemalloc.start()
        held = hold()
        size, _ = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        assert len(held) == 300
        return size

    def dicts():
        return [{name: rng.random() for name in names} for _ in range(300)]

    def stored():
        store = RowStore()
        for _ in range(300):
            store.add({name: rng.random() for name in names})
        return store

    assert taken(stored) < taken(dicts) / 4
