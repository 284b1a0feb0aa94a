"""Which of several runs is the best, by which of the verdict's checks, and by how much, in a sentence or two.

A run is better than another whose verdict has the larger burden (`gantrysim.results.score`), and between two of the
same burden, as of passes, whose worst check uses the larger share of its limit. Checks that both judge count.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from gantrysim.compare.runs.compared_run import FEWEST
from gantrysim.compare.runs.differences import BETTER, WORSE, CheckChange, JobDifference
from gantrysim.results.checks import FAIL, PASS
from gantrysim.results.score import CAP, burden_of_usages
from gantrysim.results.verdict import Verdict

_EQUAL = 1e-6  # of a burden or a usage, below which two are the same
_LISTED = 3  # checks and keys that a sentence names


def ranks_of(first: Verdict, second: Verdict) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return burden and worst usage of two verdicts, over the checks that both judge; the lower the better.

    A check that only one of them judges, as those of the bead where the other lays none, would count against a run
    for having been judged.
    """
    tables = [_usages(verdict) for verdict in (first, second)]
    ranks = []
    for verdict, usages in zip((first, second), tables, strict=True):
        shared = [usage for name, usage in usages.items() if all(name in table for table in tables)]
        burden = math.inf if verdict.fault else burden_of_usages(shared) + _unchecked_failures(verdict)
        ranks.append((burden, max(shared, default=0.0)))
    return ranks[0], ranks[1]


def _usages(verdict: Verdict) -> dict[str, float]:
    """Return the usages of the checks that are judged, by name."""
    checks = [check for row in verdict.rows for check in row.checks]
    return {check.name: min(check.usage, CAP) for check in checks if not math.isnan(check.usage)}


def _unchecked_failures(verdict: Verdict) -> float:
    """Return the burden of rows that fail without a check, as where no glue comes out."""
    return burden_of_usages(CAP for row in verdict.rows if row.fails_without_check)


def is_better(first: Verdict, second: Verdict) -> bool:
    """Return whether a verdict is better than another."""
    for value, rival in zip(*ranks_of(first, second), strict=True):
        if value != rival and not math.isclose(value, rival, rel_tol=_EQUAL, abs_tol=_EQUAL):
            return value < rival
    return False


def best_of(verdicts: Sequence[Verdict]) -> int | None:
    """Return the number of the verdict that is better than all others; None where there is none."""
    for number, verdict in enumerate(verdicts):
        if all(is_better(verdict, other) for k, other in enumerate(verdicts) if k != number):
            return number
    return None


def answer(
    names: Sequence[str],
    verdicts: Sequence[Verdict],
    checks: Sequence[CheckChange],
    differences: Sequence[JobDifference],
    are_same: bool,
) -> str:
    """Return which run is the best, by what, by how much, and what differs between the jobs.

    Args:
        names: of the runs.
        verdicts: on them.
        checks: of the verdicts, beside one another.
        differences: between the jobs.
        are_same: whether no value of the runs differs.
    """
    what = _differences_text(differences)
    if are_same:
        return f"{_listed_names(names)} are the same: no value differs. {what}"
    best = best_of(verdicts)
    if best is None:
        states = "; ".join(f"{name} {verdict.headline}" for name, verdict in zip(names, verdicts, strict=True))
        sentences = [f"None is better than the others by its verdict: {states}."]
        if len(names) == FEWEST:
            sentences += _unjudged_rows(names, verdicts, 0, 1)
        return " ".join([*sentences, what])
    others = [number for number in range(len(verdicts)) if number != best]
    # of several, the one that comes closest
    rival = min(others, key=lambda number: ranks_of(verdicts[number], verdicts[best])[0])
    begin = f"{names[best]} is better than {names[rival]}" if len(names) == 2 else _of_several(names, best, rival)
    sentences = [f"{begin}: {_states(names, verdicts, best, rival)}{_gain(checks, best, rival)}."]
    losses = _losses(checks, best, rival)
    if losses:
        sentences.append(f"But worse: {losses}.")
    sentences += _unjudged_rows(names, verdicts, best, rival)
    return " ".join([*sentences, what])


def _unjudged_rows(names: Sequence[str], verdicts: Sequence[Verdict], best: int, rival: int) -> Iterator[str]:
    """Yield which rows only one of two runs judges, and why: they do not count."""
    for number, other in ((best, rival), (rival, best)):
        for row in verdicts[number].rows:
            if not verdicts[number].fault and not row.checks and verdicts[other][row.name].checks:
                yield f"The {row.name} is not compared: {names[number]} has none judged ({row.remark})."


def _of_several(names: Sequence[str], best: int, rival: int) -> str:
    return f"{names[best]} is the best of {len(names)} runs, {names[rival]} the next"


def _states(names: Sequence[str], verdicts: Sequence[Verdict], best: int, rival: int) -> str:
    """Return both states in words."""
    for number in (best, rival):
        if verdicts[number].fault:
            other = best if number == rival else rival
            return f"{names[number]} ended in a fault, {names[other]} did not"
    states = verdicts[best].state, verdicts[rival].state
    if states[0] == states[1]:
        return {PASS: "both pass", FAIL: "both fail"}.get(states[0], "both come close to a limit")
    return f"verdict {states[0]} against {states[1]}"


def _gain(checks: Sequence[CheckChange], best: int, rival: int) -> str:
    """Return the check in which the best run gains most, with both values and the limit."""
    better = [check for check in checks if check.judgement(best, rival) == BETTER]
    if not better:
        return ""
    largest = max(better, key=lambda check: _weight(check, best, rival))
    return f"; {_values(largest, best, rival)}"


def _losses(checks: Sequence[CheckChange], best: int, rival: int) -> str:
    """Return the checks in which the best run is worse and does not pass, the largest first."""
    worse = [check for check in checks if check.judgement(best, rival) == WORSE and not _passes(check, best)]
    worse.sort(key=lambda check: _weight(check, rival, best), reverse=True)
    texts = [_values(check, best, rival) for check in worse[:_LISTED]]
    if len(worse) > _LISTED:
        texts.append(f"{len(worse) - _LISTED} further checks")
    return "; ".join(texts)


def _passes(check: CheckChange, run: int) -> bool:
    judged = check.checks[run]
    return judged is not None and judged.state == PASS


def _values(check: CheckChange, best: int, rival: int) -> str:
    unit = f" {check.unit}" if check.unit else ""
    values = f"{check.number(check.value(best))} against {check.number(check.value(rival))}{unit}"
    return f"{check.quantity}: {values} ({check.limit}{unit})"


def _weight(check: CheckChange, better: int, worse: int) -> float:
    """Return by how much a check's use of its limit falls, as a logarithm; failures count before passes."""
    usages = []
    for number in (worse, better):
        judged = check.checks[number]
        usage = math.nan if judged is None else judged.usage
        usages.append(min(max(usage, 1 / CAP), CAP) if not math.isnan(usage) else 1.0)
    over = max(math.log(max(usages[0], 0.8) / max(usages[1], 0.8)), 0.0)
    return over + 1e-3 * math.log(usages[0] / usages[1])


def _differences_text(differences: Sequence[JobDifference]) -> str:
    """Return what differs between the jobs: the keys; without any, what else does."""
    if not differences:
        return "Their jobs, machines and servos do not differ."
    given = [difference for difference in differences if difference.kind == "job" or difference.key == "machine"]
    shown = given or list(differences)
    texts = [str(difference) for difference in shown[:_LISTED]]
    further = len(differences) - len(texts)
    if further:
        texts.append(f"{further} further value{'s' if further > 1 else ''}")
    return f"What differs: {'; '.join(texts)}."


def _listed_names(names: Sequence[str]) -> str:
    return f"{', '.join(names[:-1])} and {names[-1]}"
