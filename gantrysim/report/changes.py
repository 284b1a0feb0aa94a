"""What a search for changes in a job has found."""

from __future__ import annotations

from dataclasses import dataclass

from gantrysim.report.answer import Remedy
from gantrysim.report.document import Section


@dataclass(frozen=True)
class Changes:
    """What a search for changes in a job has found.

    Attributes:
        remedy: in short, for the first screen.
        section: in full.
    """

    remedy: Remedy
    section: Section
