"""The comparison of two checkouts: what counts as a difference."""

import json
import math
import runpy
from pathlib import Path

import numpy as np
import pytest

SCRIPT = runpy.run_path(str(Path(__file__).parent.parent / "scripts" / "compare_checkouts.py"))


@pytest.mark.parametrize(
    ("before", "after"),
    [
        (0.1, math.nextafter(0.1, 1.0)),
        (0.0, -0.0),
        ([1.0, 2.0], [1.0]),
        ({"x": [1.0]}, {"y": [1.0]}),
        ("rms 3.10 µm", "rms 3.1 µm"),
        ("limit inf", "limit nan"),
        (True, False),
        (None, 1.0),
    ],
)
def test_the_last_bit_counts(before, after, capsys):
    assert not SCRIPT["compared"]("work", {"value": before}, {"value": after})
    assert "differs: value" in capsys.readouterr().out


def test_values_that_either_lacks_are_differences(capsys):
    assert not SCRIPT["compared"]("work", {"value": 1.0}, {})
    assert not SCRIPT["compared"]("work", {}, {"value": 1.0})


def test_nan_equals_nan_and_words_are_told_apart(capsys):
    assert SCRIPT["compared"]("work", {"a": math.nan, "b": "3 runs"}, {"a": math.nan, "b": "3 of them ran"})
    assert "equal but for words: ['b']" in capsys.readouterr().out


def test_names_that_changed_are_compared_and_those_removed_are_not(monkeypatch, capsys):
    lists = SCRIPT["compared"].__globals__
    monkeypatch.setitem(lists, "RENAMED", {"Tuning-v1": "Tuning-v0"})
    monkeypatch.setitem(lists, "REMOVED", ("Tuning-v0",))
    before = {"Tuning-v0 alone.json: values": 1.0, "Tuning-v1 alone.json: values": 2.0}
    assert SCRIPT["compared"]("work", before, {"Tuning-v0 alone.json: values": 2.0})
    assert not SCRIPT["compared"]("work", before, {"Tuning-v0 alone.json: values": 1.0})


def test_files_of_results_are_read_whole(tmp_path):
    column = np.array([0.1, math.nan])
    np.savez(tmp_path / "run.npz", column=column)
    (tmp_path / "summary.json").write_text(json.dumps({"rms": 0.1}))
    (tmp_path / "study.csv").write_text("a,b\n1,2\n3,4\n")
    (tmp_path / "job.toml").write_text("[servo]\nkp = 3\n")
    (tmp_path / "plot.png").write_bytes(b"")
    content = SCRIPT["content"]
    np.testing.assert_array_equal(content(tmp_path / "run.npz")["column"], column)
    assert content(tmp_path / "summary.json") == {"rms": 0.1}
    assert content(tmp_path / "study.csv") == {"a": ["1", "3"], "b": ["2", "4"]}
    assert content(tmp_path / "job.toml") == {"servo": {"kp": 3}}
    assert content(tmp_path / "plot.png") == {}
