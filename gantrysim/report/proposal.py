"""What to change in a job: the best combination of levers in brief, and the section of a page on all of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from gantrysim.report.document import Section


@dataclass(frozen=True)
class Proposal:
    """What to change in a job.

    Attributes:
        sentence: the best combination, and what remains where it does not pass.
        cost: what it takes, and the duration before and after; empty where nothing is changed.
        options: for the command line, after those with which the job was loaded; none where they cannot express it.
        lines: of the job file, likewise.
        then: verdict with it, and the values that fail without it; empty where nothing is changed.
        passes: whether the verdict is then a pass.
        section: of a page, with all levers.
    """

    sentence: str
    cost: str
    options: tuple[str, ...]
    lines: str
    then: str
    passes: bool
    section: Section

    def content(self) -> dict[str, Any]:
        """Return it for JSON without the section."""
        return {
            "sentence": self.sentence,
            "cost": self.cost,
            "options": list(self.options),
            "lines": self.lines,
            "then": self.then,
            "passes": self.passes,
        }
