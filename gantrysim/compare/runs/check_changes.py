"""The checks of several verdicts beside one another."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from gantrysim.base.quantity import NOTHING, number_text
from gantrysim.results.checks import SYMBOLS, UNJUDGED, Check, finite
from gantrysim.results.verdict import Verdict

BETTER = "better"
WORSE = "worse"
SAME = "same"
MARKS = {BETTER: "▲", WORSE: "▼", SAME: "="}


@dataclass(frozen=True)
class CheckChange:
    """A value of the verdict in every run, against its limit.

    Attributes:
        row: of the verdict.
        checks: of each run; None where it has none.
    """

    row: str
    checks: tuple[Check | None, ...]

    @property
    def known(self) -> Check:
        """The first check there is."""
        return next(check for check in self.checks if check is not None)

    @property
    def quantity(self) -> str:
        """What is measured; where runs have several words for it, as too wide and too narrow, all of them."""
        return " / ".join(dict.fromkeys(check.quantity for check in self.checks if check is not None))

    @property
    def limit(self) -> str:
        """The limit in words; where runs have several, all of them."""
        texts = []
        for check in self.checks:
            if check is not None:
                bound = "at least" if check.at_least else "at most"
                texts.append(f"{bound} {self.number(check.limit)}")
        return " / ".join(dict.fromkeys(texts))

    @property
    def unit(self) -> str:
        """Unit of values and limits; empty for a ratio."""
        return self.known.unit

    def number(self, value: float) -> str:
        """Return a value without its unit."""
        return number_text(value, self.known.form)

    def value(self, run: int) -> float:
        """Return the value of a run, nan where it is unknown."""
        check = self.checks[run]
        return math.nan if check is None else check.value

    def cell(self, run: int) -> str:
        """Return the value of a run with its state as a shape."""
        check = self.checks[run]
        return NOTHING if check is None else f"{self.number(check.value)} {SYMBOLS[check.state]}"

    def change(self, run: int) -> float:
        """Return the value of a run less that of the first one."""
        return self.value(run) - self.value(0) if math.isfinite(self.value(run) - self.value(0)) else math.nan

    def judgement(self, run: int, against: int = 0) -> str:
        """Return `BETTER`, `WORSE` or `SAME` of a run against another, as shown; empty where one is unknown."""
        new = self.value(run)
        old = self.value(against)
        if math.isnan(new) or math.isnan(old):
            return ""
        if new == old or self.number(new - old) == "0":
            return SAME
        return BETTER if (new > old) == self.known.at_least else WORSE

    def change_text(self, run: int) -> str:
        """Return the change against the first run, and whether that is better or worse, by a shape and in a word."""
        judgement = self.judgement(run)
        if not judgement:
            return NOTHING
        if judgement == SAME:
            return f"{MARKS[SAME]} {SAME}"
        size = number_text(self.change(run), f"+{self.known.form}")
        return f"{size} {MARKS[judgement]} {judgement}"

    def content(self) -> dict[str, Any]:
        """Return the check of all runs for JSON."""
        return {
            "row": self.row,
            "name": self.known.name,
            "quantity": self.quantity,
            "unit": self.unit,
            "bound": "at least" if self.known.at_least else "at most",
            "limits": [None if check is None else finite(check.limit) for check in self.checks],
            "values": [finite(self.value(run)) for run in range(len(self.checks))],
            "states": [UNJUDGED if check is None else check.state for check in self.checks],
            "changes": [finite(self.change(run)) for run in range(len(self.checks))],
            "judgements": [self.judgement(run) or None for run in range(len(self.checks))],
        }


def check_changes(verdicts: Sequence[Verdict]) -> Iterator[CheckChange]:
    """Yield the checks of verdicts, row by row, in the order in which they come first."""
    for row in dict.fromkeys(row.name for verdict in verdicts for row in verdict.rows):
        tables = [{check.name: check for check in verdict[row].checks} for verdict in verdicts]
        for name in dict.fromkeys(name for table in tables for name in table):
            yield CheckChange(row, tuple(table.get(name) for table in tables))
