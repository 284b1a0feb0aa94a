"""One number for a verdict, by which changes of a job are compared.

    burden = sum over the checks of all rows of ln(max(u, 0.8) / 0.8),    u = min(usage of the check, 1000)

A verdict that passes has the burden 0, as a usage up to 80 % of the limit is a pass. A ratio counts the same in every
check: halving the path's worst value is worth as much as halving the bead's. All checks count, not only the worst of a
row: a check without measure, as of a bead that the needle ploughs, would hide what a lever does to the bead's width.
The cap keeps a usage without bound, as that of an unstable loop, finite and comparable: a check weighs at most
ln(1250) = 7.1, and where its limit is 0, as for a ploughed bead, ln(1 + value in its unit) / 4 more, so that a change
which prevents most of it counts, and one that hardly changes it does not. One that is not judged weighs nothing; a row
that fails without a check, as where no glue comes out, weighs as much as the cap. A run that ends in a fault, or is
refused, has the burden inf, which is worse than all.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

from gantrysim.results.checks import FAIL, NEAR_LIMIT, Row
from gantrysim.results.verdict import Verdict

CAP = 1000.0  # of a usage
_OF_ZERO = 0.25  # weight of the size of a value whose limit is 0


def usage_of(row: Row) -> float:
    """Return the usage of a row's worst check, nan where none is judged; `CAP` for a failure without a check."""
    return max(_counted_usages(row), default=math.nan)


def usages_of(row: Row) -> list[float]:
    """Return the usages of a row's checks that are judged."""
    return [check.usage for check in row.checks if not math.isnan(check.usage)]


def _counted_usages(row: Row) -> list[float]:
    return [*usages_of(row), *([CAP] if row.fails_without_check else [])]


def row_burden(row: Row) -> float:
    """Return what a row adds to the burden of its verdict."""
    without_bound = (check for check in row.checks if check.limit == 0 and check.state == FAIL)
    return burden_of_usages(_counted_usages(row)) + _OF_ZERO * sum(math.log1p(check.value) for check in without_bound)


def burden_of_usages(usages: Iterable[float]) -> float:
    """Return what checks with these usages add to the burden of their verdict."""
    return sum(math.log(min(max(usage, NEAR_LIMIT), CAP) / NEAR_LIMIT) for usage in usages)


def burden_of(verdict: Verdict) -> float:
    """Return the burden of a verdict, inf for a run that is not judged."""
    return math.inf if verdict.unjudged else sum(row_burden(row) for row in verdict.rows)
