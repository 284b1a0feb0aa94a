"""The answer of a study of laws: the cheapest law that keeps the job's limits, or the one that comes nearest."""

from __future__ import annotations

from gantrysim.study.acceptance import Acceptance, Scope, improve_command, settings_text
from gantrysim.study.cases import Row
from gantrysim.study.laws.study import LawsStudy

QUESTION = "Which law of the servo does this job need?"


def laws_answer(study: LawsStudy, nominal: dict[str, Row]) -> str:
    """Return the answer from the rows of the laws on the nominal machine that have values, by law."""
    judged = judged_laws(study, nominal)
    if not judged:
        return "No law has a run that was judged by the job's tolerance, so none is recommended."
    scope = Scope.of(judged.values())
    sufficient = [law for law, acceptance in judged.items() if acceptance.keeps(scope.aspects)]
    if not sufficient:
        return _none(study, judged, scope)
    law = sufficient[0]
    cheapest = f"the cheapest of {len(judged)} laws that keeps {scope.words}, with {scope.usage(judged[law])}"
    remark = scope.remark(judged[law])
    present = _present(study)
    if present in sufficient and present != law:
        usage = f"{judged[present].use(scope.aspects):.3g} % used"
        return (
            f"{law} ({_change(study, law)}) is {cheapest}{remark}; the job's own law {present} keeps the same limits, "
            f"with {usage}, and need not change."
        )
    verb = "Keep" if present == law else "Set"
    return f"{verb} {_change(study, law)}: {law} is {cheapest}{remark}."


def judged_laws(study: LawsStudy, nominal: dict[str, Row]) -> dict[str, Acceptance]:
    """Return the verdicts by law, the cheapest law first: with the fewest parts, then in the order of the ladder."""
    judged = {}
    for rung in sorted(study.ladder, key=lambda rung: len(rung.law)):  # a stable sort: the ladder's order remains
        acceptance = Acceptance.of(nominal[rung.name]) if rung.name in nominal else None
        if acceptance is not None:
            judged[rung.name] = acceptance
    return judged


def _none(study: LawsStudy, judged: dict[str, Acceptance], scope: Scope) -> str:
    nearest = min(judged, key=lambda law: judged[law].use(scope.aspects))
    present = _present(study)
    against = ""
    if present in judged and present != nearest:
        against = f", and the job's own law {present} has {scope.excess(judged[present])}"
    return (
        f"None of {len(judged)} laws keeps {scope.words}: {nearest} ({_change(study, nearest)}) comes nearest, at "
        f"{scope.excess(judged[nearest])}{against}; {improve_command(study.job)} tries what else can be changed."
    )


def _change(study: LawsStudy, law: str) -> str:
    return settings_text(study.overrides(*next(rung for rung in study.ladder if rung.name == law)))


def _present(study: LawsStudy) -> str:
    """Return the rung that is the job's own law; empty if it has another."""
    names = study.job.built_servo.laws.names
    return next((rung.name for rung in study.ladder if rung.law == names and rung.integral == 1), "")
