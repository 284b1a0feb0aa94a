"""The section of a report on what to change."""

from __future__ import annotations

from gantrysim.job.job import Job
from gantrysim.remedy.improve import improve, worst_rows
from gantrysim.remedy.improvement import USAGE, Improvement
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
    """Return the section "What to change": the result, the levers combined, lines to paste, and each lever alone."""
    texts = [improvement.sentence]
    if improvement.changes_anything:
        texts.append("; ".join(improvement.gains))
    if improvement.fastest is not None:
        texts.append(f"{improvement.fastest}.")
    tables = []
    if improvement.combination:
        rows = [improvement.rows[0], *improvement.combined_rows]
        tables.append(Table(improvement.heads, rows, _caption(f"{USAGE}; each lever with those before it")))
    if improvement.trials:
        rows = [improvement.rows[0], *improvement.trial_rows]
        title = f"Each lever alone: {len(improvement.trials)} runs"
        tables.append(Table(improvement.heads, rows, _caption(USAGE), folded=title))
    lines = "\n".join(f"# {place}\n{text.rstrip()}\n" for place, text in improvement.lines.items())
    return Section(TITLE, texts, table=tables or None, code=lines or None)


def _caption(text: str) -> str:
    return text[0].upper() + text[1:]
