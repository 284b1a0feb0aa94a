"""A row of a verdict."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from gantrysim.results.checks import FAIL, ORDER, PASS, SYMBOLS, UNJUDGED, Check, worst


@dataclass(frozen=True)
class Row:
    """The verdict on one aspect of a run.

    Attributes:
        name: "path", "glue", "stability" or "machine".
        checks: values against their limits, the worst first.
        remark: what else there is to say.
        values: further numbers for summary.json.
        state: "pass", "warn", "fail", or "not judged".
    """

    name: str
    checks: tuple[Check, ...] = ()
    remark: str = ""
    values: dict[str, Any] = field(default_factory=dict)
    state: str = UNJUDGED

    @classmethod
    def of(cls, name: str, checks: Sequence[Check], remark: str = "", values: dict[str, Any] | None = None) -> Row:
        """Return the row of some checks, whose state is that of the worst."""
        ordered = tuple(sorted(checks, key=lambda check: -math.inf if math.isnan(check.usage) else -check.usage))
        return cls(name, ordered, remark, values or {}, worst([check.state for check in checks]))

    @property
    def symbol(self) -> str:
        """The state as a shape."""
        return SYMBOLS[self.state]

    @property
    def worst_check(self) -> Check | None:
        """The check that the row's state is due to; None where no check is judged, or the remark says why it fails."""
        judged = [check for check in self.checks if check.state == self.state]
        return None if self.state == UNJUDGED else next(iter(judged), None)

    @property
    def severity(self) -> tuple[int, float]:
        """Order of rows by what is worst: by state, then by the largest share of a limit that a check uses."""
        usages = [check.usage for check in self.checks if not math.isnan(check.usage)]
        return ORDER.index(self.state), math.inf if self.fails_without_check else max(usages, default=0.0)

    @property
    def fails_without_check(self) -> bool:
        """Whether it fails, but none of its checks does: the remark says why, as where no glue comes out."""
        return self.state == FAIL and all(check.state != FAIL for check in self.checks)

    @property
    def texts(self) -> tuple[str, ...]:
        """The worst check, the others that do not pass, and the remark, which is first if it says why the row fails."""
        shown = tuple(str(check) for k, check in enumerate(self.checks) if k == 0 or check.state != PASS)
        remark = (self.remark,) if self.remark else ()
        return (*remark, *shown) if self.fails_without_check else (*shown, *remark)

    def content(self) -> dict[str, Any]:
        """Return the row for JSON."""
        return {
            "state": self.state,
            "remark": self.remark,
            **self.values,
            "checks": [check.content() for check in self.checks],
        }
