"""The answer of a machine study: the yield and its lever, or that the nominal machine itself fails."""

from __future__ import annotations

from collections.abc import Sequence

from gantrysim.machine.tolerances import in_words
from gantrysim.study.acceptance import Acceptance, improve_command
from gantrysim.study.cases import Row
from gantrysim.study.criterion import Criterion, JobCriterion
from gantrysim.study.machine.study import MachineStudy
from gantrysim.study.machine.yields import Influence, Yield, yield_of

QUESTION = "How many machines of this build will meet the tolerance?"
_PER_CENT = 100.0


def machine_answer(study: MachineStudy, rows: Sequence[Row], influence: Influence, halves: tuple[float, float]) -> str:
    """Return the answer.

    Args:
        study: the study.
        rows: of the nominal machine and all others.
        influence: of the factor with the largest.
        halves: yield of the machines above and below the median of that factor [%].
    """
    nominal = rows[0]
    criterion = study.criterion_of(nominal)
    estimate = yield_of(sum(criterion.within(row) for row in rows[1:]), len(rows) - 1)
    share = _share(estimate, criterion, nominal)
    if failure := nominal_failure(criterion, nominal):
        return (
            f"The nominal machine itself fails ({failure}), so tolerances of the build are not the lever: first run "
            f"{improve_command(study.job)}; as it is, {share}."
        )
    if estimate.within == estimate.count:
        return f"{share}; nothing of the build needs to change."
    return f"{share}; {_lever(influence, halves)}."


def nominal_failure(criterion: Criterion, nominal: Row) -> str:
    """Return what the nominal machine fails; empty where it keeps the tolerance.

    By the job's own limits it must keep all of them, though the others are compared by those of the motion alone.
    """
    acceptance = Acceptance.of(nominal)
    if isinstance(criterion, JobCriterion) and acceptance is not None:
        return acceptance.failures()
    return "" if criterion.within(nominal) else criterion.failure(nominal)


def _share(estimate: Yield, criterion: Criterion, row: Row) -> str:
    low = _PER_CENT * estimate.low
    high = _PER_CENT * estimate.high
    return (
        f"{estimate.within} of {estimate.count} machines keep {criterion.limit(row)}, a yield of "
        f"{_PER_CENT * estimate.share:.1f} % (95 % confidence: {low:.1f} to {high:.1f} %)"
    )


def _lever(influence: Influence, halves: tuple[float, float]) -> str:
    if not influence.clear:
        return "no factor of the build has a significant influence, so none is known to be a lever"
    above, below = halves
    side = "low" if influence.coefficient > 0 else "high"
    return (
        f"the lever is {in_words(influence.factor)}, to be kept {side}: {below:.0f} % of the machines below its median "
        f"keep the limit, {above:.0f} % above"
    )
