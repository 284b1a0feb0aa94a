"""The order of a run's report: what one asks first comes first, details are folded."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from gantrysim.report.document import Section

# is it good enough, where and how, what spoils it, what to change
_FIRST = ("Verdict", "Deliberate faults", "Bead and path", "Summary", "Error budget", "Causes", "What to change")


def in_order(sections: Iterable[Section]) -> list[Section]:
    """Return the sections in the order of `_FIRST`, then all others as they come, folded."""
    given = list(sections)
    first = sorted((section for section in given if section.title in _FIRST), key=lambda part: _FIRST.index(part.title))
    details = [replace(section, folded=True) for section in given if section.title not in _FIRST]
    return [*first, *details]
