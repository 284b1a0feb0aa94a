"""docs/tuning.md: the comparison with other searches is what its rows give, without a gap."""

import csv
import itertools
import runpy
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
PAGE = (ROOT / "docs/tuning.md").read_text(encoding="utf-8")
OWN, SEEDS = "gantrysim tune", ("1", "2")
# largest ratios of the metric of gantrysim's own search to the best other, as published
BEHIND_IN_RUNS = 1.015  # in either seed
BEHIND_IN_TIME = 1.01


@pytest.fixture(scope="module")
def script():
    return runpy.run_path(str(ROOT / "scripts/compare_tuners.py"))


@pytest.fixture(scope="module")
def rows():
    with (ROOT / "docs/tuning.csv").open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="module")
def by_kind(script, rows):
    return {kind: [row for row in rows if row["kind"] == kind] for kind in script["KINDS"]}


def test_every_cell_of_the_comparisons_is_filled_from_its_rows(script, by_kind):
    methods = (OWN, *script["OTHERS"])
    runs, seconds = by_kind.values()
    cells = [(row["job"], row["start"], row["method"], row["seed"], row["budget"]) for row in runs]
    assert sorted(cells) == sorted(itertools.product(script["JOBS"], script["TABLE"], methods, SEEDS, ("100",)))
    cells = [((row["job"], row["start"]), row["method"], row["seed"], row["budget"]) for row in seconds]
    assert sorted(cells) == sorted(itertools.product(script["CASES"], methods, ("1",), ("5", "10")))
    for kind, own_rows in by_kind.items():
        assert script["with_table"](PAGE, own_rows) == PAGE
        assert {row["machines"] for row in own_rows} == {"1"}
        section = PAGE.partition(script["BEGIN"][kind])[2].partition(script["END"])[0]
        lines = section.strip().splitlines()[2:]
        assert len(lines) == {"runs": 9, "cpu_s": 20}[kind]
        for line in lines:
            assert all(cell.strip() for cell in line.split("|")[1:-1])


def test_no_case_of_the_comparison_by_time_is_in_that_by_runs(script):
    assert not set(script["CASES"]) & set(itertools.product(script["JOBS"], script["TABLE"]))
    assert len(set(script["CASES"])) == 10


def test_no_other_method_is_ahead_of_the_search_by_more_than_published(by_kind):
    for (kind, rows), behind in zip(by_kind.items(), (BEHIND_IN_RUNS, BEHIND_IN_TIME), strict=True):
        found = {}
        for row in rows:
            cell = found.setdefault((row["job"], row["start"], row["budget"], row["seed"]), {})
            cell[row["method"]] = float(row["metric"])
        assert len(found) == {"runs": 18, "cpu_s": 20}[kind]
        assert max(cell.pop(OWN) / min(cell.values()) for cell in found.values()) <= behind
