"""One number for a verdict, by which changes of a job are compared.

    burden = sum over the rows of ln(max(u, 0.8) / 0.8),    u = min(usage of the row's worst check, 1000)

A verdict that passes has the burden 0, as a usage up to 80 % of the limit is a pass. A ratio counts the same in every
row: halving the path's worst value is worth as much as halving the bead's. The cap keeps a usage without bound, as that
of an unstable loop, finite and comparable: a row weighs at most ln(1250) = 7.1. A row that is not judged weighs
nothing; one that fails without a check, as where no glue comes out, weighs as much as the cap. A run that ends in a
fault, or is refused, has the burden inf, which is worse than all.
"""

from __future__ import annotations

import math

from gantrysim.results.checks import FAIL, NEAR
from gantrysim.results.row import Row
from gantrysim.results.verdict import Verdict

CAP = 1000.0  # of a usage


def usage_of(row: Row) -> float:
    """Return the usage of a row's worst check, nan where none is judged; `CAP` for a failure without a check."""
    usages = [check.usage for check in row.checks if not math.isnan(check.usage)]
    if usages:
        return max(usages)
    return CAP if row.state == FAIL else math.nan


def row_burden(row: Row) -> float:
    """Return what a row adds to the burden of its verdict."""
    usage = usage_of(row)
    return 0.0 if math.isnan(usage) else math.log(min(max(usage, NEAR), CAP) / NEAR)


def burden_of(verdict: Verdict) -> float:
    """Return the burden of a verdict, inf for a run that ended in a fault."""
    return math.inf if verdict.fault else sum(row_burden(row) for row in verdict.rows)
