"""The verdict on a run as columns of a study's row."""

from __future__ import annotations

import math
from typing import Any

from gantrysim.base.quantity import Quantity
from gantrysim.results.checks import Check
from gantrysim.results.row import Row as Aspect
from gantrysim.results.verdict import GLUE, MACHINE, PATH, STABILITY, Verdict

ASPECTS = (PATH, GLUE, STABILITY, MACHINE)  # rows of a verdict, in its order

# of the worst check of an aspect
LIMIT_USE = Quantity[Any](
    "limit_use",
    "largest use of a limit",
    "%",
    ".1f",
    "Worst value of the verdict over its limit, or the limit over it where it must be at least that; above 100 % the "
    "run fails",
    (),
    100.0,
)

Columns = dict[str, str | float | None]


def state_column(aspect: str) -> str:
    """Return the name of the column with the state of an aspect: "pass", "warn", "fail" or "not judged"."""
    return f"{aspect}_verdict"


def check_column(aspect: str) -> str:
    """Return the name of the column with the worst check of an aspect in words."""
    return f"{aspect}_check"


def use_column(aspect: str) -> str:
    """Return the name of the column with the largest use of a limit of an aspect [%]."""
    return f"{aspect}_{LIMIT_USE.key}"


def verdict_columns(verdict: Verdict) -> Columns:
    """Return the verdict on a complete run: for each aspect its state, the use of its limit, and its worst check.

    The use is None where nothing is judged, and where a limit of zero is exceeded.
    """
    columns: Columns = {}
    for aspect in verdict.rows:
        worst = _worst(aspect)
        columns[state_column(aspect.name)] = aspect.state
        columns[use_column(aspect.name)] = None if worst is None else LIMIT_USE.content(worst.usage)
        columns[check_column(aspect.name)] = aspect.remark if worst is None else worst.brief
    return columns


def _worst(aspect: Aspect) -> Check | None:
    """Return the judged check with the largest use of its limit; None where nothing is judged."""
    judged = [check for check in aspect.checks if not math.isnan(check.usage)]
    return max(judged, key=lambda check: check.usage, default=None)
