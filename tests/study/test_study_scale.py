"""A study of thousands of runs on a cluster of this machine keeps its workers busy and its memory flat."""

import runpy
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / "scripts/scale_out.py"
RUNS = 3000
FIRST = 1 / 3  # share of the runs after which all is loaded


@pytest.mark.soak
def test_a_study_of_thousands_of_runs_keeps_its_workers_busy_and_its_memory_flat(record_property):
    pytest.importorskip("distributed")
    record_property("attack", "runs of one study on a cluster, whose workers must stay busy and whose memory flat")
    record_property("tries", RUNS)
    seen = runpy.run_path(str(SCRIPT))["scaled_out"](RUNS, FIRST)
    assert seen["busy"] >= 0.95
    # rows are written as they come: at most a lot of each worker is not yet on disk
    assert seen["rows_on_disk"] == seen["done_at_half"]
    # a row's values take half of its line of text, and what Dask has in this process up to two thirds; rows that are
    # held as dicts take three times the line
    assert seen["study_bytes_per_row"] < 1.5 * seen["ledger_bytes_per_row"]
    before = seen["memory_first"]["others"]
    after = seen["memory_last"]["others"]
    assert len(before) == len(after)
    assert sum(after) <= 1.02 * sum(before)
