"""The tables of docs/improve.md are those that its script writes."""

import runpy
from pathlib import Path

from gantrysim.job.loading import builtin_jobs

ROOT = Path(__file__).parent.parent.parent
PAGE = (ROOT / "docs" / "improve.md").read_text(encoding="utf-8")
QUICK = "trio-basic"  # the job whose row is computed again


def test_the_page_is_up_to_date():
    script = runpy.run_path(str(ROOT / "scripts" / "improve_page.py"))
    assert script["levers_table"]() in PAGE, "run python scripts/improve_page.py"
    assert script["line"](script["job_row"](QUICK)) in PAGE, "run python scripts/improve_page.py"


def test_every_built_in_job_passes_or_is_told_why_none_can():
    rows = [line for line in PAGE.partition("## The built-in jobs")[2].splitlines() if line.startswith("| `")]
    assert [row.split("`")[1] for row in rows] == builtin_jobs()
    passing = [row for row in rows if "| ✓ pass |" in row]
    assert len(passing) >= 8
    # of a needle that passes through glue, what prevents it
    told = ("What forbids it is", "lay the bead without crossings", "order them so that none crosses the bead")
    assert all(any(words in row for words in told) for row in rows if row not in passing)
