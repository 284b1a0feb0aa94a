"""The verdict's section of a report."""

from __future__ import annotations

from gantrysim.report.document import Section, Table
from gantrysim.results.verdict import Verdict


def verdict_section(verdict: Verdict) -> Section:
    """Return the section of the verdict: a row per value that it shows."""
    if verdict.unjudged:
        return Section("Verdict", verdict.headline)
    rows = [
        [f"{row.symbol} {row.state}" if k == 0 else "", row.name if k == 0 else "", text]
        for row in verdict.rows
        for k, text in enumerate(row.texts)
    ]
    caption = "A value above 80 % of its limit is a warning; limits are given by [tolerance] in the job, or defaults"
    return Section(
        "Verdict", verdict.headline, table=Table(["verdict", "of", "worst value and its limit"], rows, caption)
    )
