"""Write the tables of docs/laws.md: the study of laws on four jobs."""

import re
import tempfile
from pathlib import Path

from gantrysim import Job
from gantrysim.report.document import Table
from gantrysim.study.laws import LawsStudy
from gantrysim.study.run import run_study

PAGE = Path(__file__).parent.parent / "docs" / "laws.md"
PLACE = re.compile(r"(<!-- written by scripts/laws_page.py -->\n).*?(<!-- end -->)", re.DOTALL)
JOBS = ("softmc-arc", "an225", "trio-basic", "stage-outline")


def markdown(table: Table) -> str:
    """Return a table of a report as one of the page."""
    rules = [" --: " if numeric else " --- " for numeric in table.numeric]
    rows = [table.heads, *table.cells]
    lines = ["| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |" for cells in rows]
    return "\n".join([lines[0], "|" + "|".join(rules) + "|", *lines[1:]])


def folded(summary: str, table: Table) -> str:
    """Return a table that opens from a line."""
    return f'<details markdown="1">\n<summary>{summary}</summary>\n\n{markdown(table)}\n\n</details>\n\n'


def tables(name: str) -> str:
    """Return answer and tables of the study of a job."""
    study = LawsStudy(Job.load(name))
    with tempfile.TemporaryDirectory() as folder:
        report = run_study(study, Path(folder)).report
    first, second = report.tables
    notes = [note for note in report.details.notes if note.startswith(("Law ", "The last"))]
    return (
        f"### `{name}`\n\n{report.answer}\n\n"
        + folded("All laws, with their margins and verdict", first)
        + folded(second.caption, second)
        + "".join(f"{note}\n" for note in notes)
    )


if __name__ == "__main__":
    written = "\n" + "\n".join(tables(name) for name in JOBS) + "\n"
    PAGE.write_text(PLACE.sub(lambda place: place[1] + written + place[2], PAGE.read_text()), encoding="utf-8")
