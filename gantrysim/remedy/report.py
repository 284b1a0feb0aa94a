"""The section of a report on what to change."""

from __future__ import annotations

from gantrysim.remedy.improvement import USAGE_NOTE, Improvement
from gantrysim.report.document import Section, Table

TITLE = "What to change"


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
