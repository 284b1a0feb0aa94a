"""The section of a report on what to change."""

from __future__ import annotations

from gantrysim.job.job import Job
from gantrysim.remedy.improve import improve, worst_rows
from gantrysim.remedy.improvement import USAGE_NOTE, Improvement
from gantrysim.remedy.outcome import Outcome
from gantrysim.report.document import Section, Table
from gantrysim.results.checks import PASS
from gantrysim.results.verdict import Verdict

TITLE = "What to change"


def changes_of(job: Job, verdict: Verdict) -> Section | None:
    """Return the section for the two worst rows of the verdict on a job's run.

    None for a verdict that is a pass, and for a run with faults, whose cause is known.
    """
    if verdict.state == PASS or verdict.fault or job.faults:
        return None
    return change_section(improve(job, rows=worst_rows(Outcome(verdict)), fastest=False))


def change_section(improvement: Improvement) -> Section:
    """Return the section "What to change": the result in words, what each lever gains, and the lines to paste."""
    texts = [improvement.sentence]
    if improvement.changes_anything:
        texts.append("; ".join(improvement.gains))
    if improvement.fastest is not None:
        texts.append(f"{improvement.fastest}.")
    table = None
    if improvement.trials:
        table = Table(improvement.heads, improvement.rows, f"Each lever simulated alone, then combined; {USAGE_NOTE}")
    lines = "\n".join(f"# {place}\n{text.rstrip()}\n" for place, text in improvement.lines.items())
    return Section(TITLE, texts, table=table, code=lines or None)
