"""The job of a run on its page, as a file to repeat it; of a long program the first and the last lines."""

from __future__ import annotations

from gantrysim.job.job import Job
from gantrysim.report.document import Section

_WHOLE = 4000  # lines of a job that the page shows whole
_ENDS = 500  # lines shown of either end of a longer one
_REPEAT = "Save as a file for gantrysim run to repeat this run bit for bit."


def job_section(job: Job) -> Section:
    """Return the section with a job's TOML; a long program would make the page larger than all its figures."""
    text = job.toml()
    lines = text.split("\n")
    if len(lines) <= _WHOLE:
        return Section("Job", _REPEAT, code=text)
    missing = len(lines) - 2 * _ENDS
    shown = [*lines[:_ENDS], f"# ... {missing:,} lines are in job.toml only ...", *lines[-_ENDS:]]
    note = (
        f"The first and last {_ENDS} of {len(lines):,} lines, with those of the program: {missing:,} lines between are "
        "left out. job.toml beside this page is whole, and repeats this run bit for bit."
    )
    return Section("Job", note, code="\n".join(shown))
