"""docs/tuning.md: the comparison with other searches is what its rows give, without a gap."""

import csv
import itertools
import runpy
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs/tuning.md").read_text(encoding="utf-8")
OWN, SEEDS, BUDGETS = "gantrysim tune", ("1", "2"), ("100", "300")
BEHIND = 1.032  # largest ratio of the metric of gantrysim's own search to the best other, in either seed, as published


@pytest.fixture(scope="module")
def script():
    return runpy.run_path(str(ROOT / "scripts/compare_tuners.py"))


@pytest.fixture(scope="module")
def rows():
    with (ROOT / "docs/tuning.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def test_every_cell_of_the_comparison_is_filled_from_its_rows(script, rows):
    assert script["with_table"](PAGE, rows) == PAGE
    methods = (OWN, *script["OTHERS"])
    cells = [(row["job"], row["start"], row["method"], row["seed"], row["budget"]) for row in rows]
    assert sorted(cells) == sorted(itertools.product(script["JOBS"], script["STARTS"], methods, SEEDS, BUDGETS))
    assert {row["machines"] for row in rows} == {"1"}
    lines = PAGE.partition(script["BEGIN"])[2].strip().splitlines()[2:-1]
    assert len(lines) == 3 * 3 * 2
    for line in lines:
        assert all(cell.strip() for cell in line.split("|")[1:-1])


def test_no_other_method_is_ahead_of_the_search_by_more_than_published(rows):
    found = {}
    for row in rows:
        cell = found.setdefault((row["job"], row["start"], row["budget"], row["seed"]), {})
        cell[row["method"]] = float(row["metric"])
    assert len(found) == 36
    assert max(cell.pop(OWN) / min(cell.values()) for cell in found.values()) <= BEHIND
