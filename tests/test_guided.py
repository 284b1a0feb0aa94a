"""Searches, guided by coverage, for inputs that break a reader of a user's files: a short one and longer ones."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from support.guided import TARGETS

GUIDED = Path(__file__).parent / "support" / "guided.py"
RUNS, MANY = 600, 30_000


def searched(name, runs, folder):
    """The number of inputs tried, none of which broke the reader."""
    pytest.importorskip("atheris")
    command = [sys.executable, str(GUIDED), name, str(runs), str(folder)]
    same = {"PYTHONHASHSEED": "0"} if runs == RUNS else {}  # the same inputs at every run of the tests
    done = subprocess.run(command, env={**os.environ, **same}, capture_output=True, text=True, check=False)
    found = re.search(r"Done (\d+) runs", done.stderr)
    assert done.returncode == 0, done.stderr[-3000:]
    assert found is not None
    return int(found[1])


@pytest.mark.soak
def test_no_input_breaks_a_reader(tmp_path):
    assert searched("all", RUNS, tmp_path) >= RUNS
    assert not list(tmp_path.iterdir())


@pytest.mark.soak
def test_the_seeds_of_every_reader_are_inputs():
    for name, target in TARGETS.items():
        assert target.seeds(), name


@pytest.mark.soak
@pytest.mark.parametrize("name", TARGETS)
def test_no_input_of_a_long_search_breaks_a_reader(name, tmp_path, record_property):
    record_property("attack", f"{name}: inputs from a coverage-guided search")
    record_property("tries", searched(name, MANY, tmp_path))
