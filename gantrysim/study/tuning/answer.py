"""The answer of a tuning: whether better gains were found, and what the verdict is with them."""

from __future__ import annotations

from collections.abc import Sequence

from gantrysim.results.verdict import Verdict
from gantrysim.study.acceptance import Acceptance, Scope, improve_command
from gantrysim.study.cases import OK, Row
from gantrysim.study.tuning.candidates import RANKS, Candidate
from gantrysim.study.tuning.objective import METRICS, case_of, micrometres
from gantrysim.study.tuning.search import History
from gantrysim.study.tuning.servo import TUNED
from gantrysim.study.tuning.study import TuningStudy
from gantrysim.study.verdict_columns import verdict_columns

_FEASIBLE = 1  # rank of a candidate that keeps all limits


def question(study: TuningStudy) -> str:
    """Return the question."""
    return f"Which gains minimise the {METRICS[study.metric]}?"


def answer(study: TuningStudy, rows: Sequence[Row]) -> str:
    """Return the metric at the start and tuned, in one sentence with what to do and what the verdict is then."""
    history = study.history(rows)
    name = f"{METRICS[study.metric]}, {machines(study)}"
    if history.best is history.start:
        return f"No better gains found: {name}, stays at {rated(study, history.start)}{_verdict(study, history)}."
    change = f"{name}, is {rated(study, history.best)} instead of {rated(study, history.start)}"
    if history.best.order(0.01 * study.ripple)[0] != _FEASIBLE:
        return f"No gains within the limits of the search found: with the best of the others the {change}."
    return f"Run with --servo {TUNED}: the {change}{_verdict(study, history)}."


def machines(study: TuningStudy) -> str:
    """Return the machines of which the worst counts, in words."""
    return f"worst of {study.robust + 1} machines" if study.robust else "job's machine"


def rated(study: TuningStudy, candidate: Candidate) -> str:
    """Return the metric of a candidate, with the constraint that it misses."""
    rank = candidate.order(0.01 * study.ripple)[0]
    return micrometres(candidate.metric) + (f" ({RANKS[rank]})" if rank in (2, 3) else "")


def _verdict(study: TuningStudy, history: History) -> str:
    """Return the verdict on the job with the best gains, a clause."""
    servo = history.best.servo
    run = study.run(servo)
    if run.fault is not None:
        return f"; the job's own machine ends in a fault: {run.fault}"
    verdict = Verdict.of(case_of(study.job, servo, None).job(), run)
    acceptance = Acceptance.of({"status": OK, **verdict_columns(verdict)})
    assert acceptance is not None  # the run is complete
    scope = Scope.of([acceptance])
    if acceptance.keeps(scope.aspects):
        return f"; the job then keeps {scope.words}, with {scope.usage(acceptance)}{scope.remark(acceptance)}"
    return (
        f"; the job then still fails ({acceptance.failures(scope.aspects)}), and {improve_command(study.job)} tries "
        "what else can be changed"
    )
