"""Runs beside one another: verdicts, differences of their jobs, errors, budgets, causes and values; which is the best.

A run is better than another whose verdict has the smaller burden (`gantrysim.results.score`), and between two of the
same burden, as of passes, whose worst check uses the smaller share of its limit. Checks that both judge count.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.display import Shown
from gantrysim.compare.runs.common_path import Parting, PlaceDifference, Track, difference_at_places, partings_of
from gantrysim.compare.runs.compared_run import FEWEST_RUNS, ComparedRun
from gantrysim.compare.runs.differences import (
    BETTER,
    WORSE,
    CheckChange,
    JobDifference,
    ValueChange,
    check_changes,
    compared_rows,
    differences_of,
    value_changes,
)
from gantrysim.metrics.parts import ERROR_SIZES, Part, PartValues
from gantrysim.results.checks import FAIL, PASS
from gantrysim.results.score import CAP, burden_of_usages
from gantrysim.results.verdict import Verdict

NOTHING_APART = 1e-9  # largest difference of two errors that is rounding [mm]

_EQUAL_BURDENS = 1e-6  # of a burden or a usage, below which two are the same
_NAMED_CHECKS = 3  # checks and keys that a sentence names


@dataclass(frozen=True, eq=False, repr=False)
class ComparedRuns(Shown):
    """Runs beside one another; changes are counted from the first.

    Attributes:
        runs: two to four.
    """

    runs: tuple[ComparedRun, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the runs."""
        return tuple(run.name for run in self.runs)

    @cached_property
    def verdicts(self) -> tuple[Verdict, ...]:
        """Verdict on each run."""
        return tuple(run.results.verdict for run in self.runs)

    @property
    def best(self) -> int | None:
        """Number of the run that is better than all others, from 0; None where there is none."""
        return best_of(self.verdicts)

    @cached_property
    def differences(self) -> tuple[JobDifference, ...]:
        """What differs between the jobs: keys, machine and servo."""
        return differences_of(self.runs)

    @cached_property
    def checks(self) -> tuple[CheckChange, ...]:
        """The checks of the verdicts; none of a run that ended in a fault."""
        return tuple(check_changes(self.verdicts))

    @cached_property
    def values(self) -> tuple[ValueChange, ...]:
        """Every value that a run has."""
        return tuple(value_changes([run.results for run in self.runs]))

    @cached_property
    def partings(self) -> tuple[Parting, ...]:
        """Where requested paths leave the first run's; empty where all are the same."""
        return partings_of([run.run.requested for run in self.runs])

    @property
    def by_path(self) -> bool:
        """Whether the common abscissa is the distance along the requested path, else the time."""
        return not self.partings

    @cached_property
    def tracks(self) -> tuple[Track, ...]:
        """Each run against the common abscissa."""
        return tuple(Track.of(run.analysis, self.by_path) for run in self.runs)

    @cached_property
    def apart(self) -> tuple[PlaceDifference | None, ...]:
        """Difference of each run's contour error and the first one's at the same place; None on another path."""
        if not self.by_path:
            return (None,) * len(self.runs)
        errors = [_across(run.results.budget.contour) for run in self.runs]
        return tuple(
            difference_at_places((self.tracks[0], track), (errors[0], error))
            for track, error in zip(self.tracks, errors, strict=True)
        )

    @cached_property
    def budgets(self) -> dict[str, tuple[PartValues | None, ...]]:
        """The rows of the error budgets by link; None where a run has no such link."""
        tables = [run.results.budget.values.rows for run in self.runs]
        # the whole last, also where only a later run has a link of its own
        links = [name for name in dict.fromkeys(name for table in tables for name in table) if name != "contour"]
        return {name: tuple(table.get(name) for table in tables) for name in (*links, "contour")}

    @cached_property
    def causes(self) -> dict[str, tuple[float | None, ...]]:
        """What causes are worth of the rms contour error [mm]; empty unless they are known of two runs or more."""
        known = [run.causes or {} for run in self.runs]
        if sum(bool(worth) for worth in known) < FEWEST_RUNS:
            return {}
        names = dict.fromkeys(name for worth in known for name in worth)
        return {name: tuple(worth.get(name) for worth in known) for name in names}

    @property
    def are_same(self) -> bool:
        """Whether no value of the runs differs, nor their errors at any place."""
        errors = all(apart is not None and apart.max <= NOTHING_APART for apart in self.apart)
        return errors and all(len(set(change.values)) == 1 for change in self.values)

    @cached_property
    def sentence(self) -> str:
        """Which run is better, by what, by how much, and what differs between the jobs."""
        return answer(self.names, self.verdicts, self.checks, self.differences, self.are_same)

    @property
    def notes(self) -> list[str]:
        """How the runs were laid beside one another, and what cannot be compared."""
        return [*self._path_notes(), *self._run_notes()]

    def _path_notes(self) -> list[str]:
        if self.by_path:
            return ["all runs request the same path: errors are compared at the same distance along it"]
        notes = []
        for parting in self.partings:
            x, y, z = parting.point
            lengths = " against ".join(f"{length:.1f} mm" for length in parting.lengths)
            notes.append(
                f"the path that {self.names[parting.run]} requests leaves that of {self.names[0]} {parting.s:.1f} mm "
                f"from its start, at x = {x:.1f}, y = {y:.1f}, z = {z:.1f} mm ({lengths} long)"
            )
        notes.append(
            "errors are drawn over the time, each from the run's own path; no difference at the same place is given"
        )
        return notes

    def _run_notes(self) -> list[str]:
        notes = []
        for run in self.runs:
            if run.run.fault is not None:
                notes.append(f"{run.name} ended in a fault, and all its values are up to it: {run.run.fault}")
            if run.changed:
                notes.append(f"machine {run.results.machine.name} has changed since {run.name} was written")
        axes = {tuple(zip(run.run.axes, run.run.units, strict=True)) for run in self.runs}
        if len(axes) > 1:
            notes.append("the machines have different axes: values of an axis are given for the runs that have it")
        return notes

    def facts(self) -> dict[str, str]:
        verdicts = {
            f"verdict on {name}": verdict.headline for name, verdict in zip(self.names, self.verdicts, strict=True)
        }
        return {"answer": self.sentence, **verdicts}

    def __str__(self) -> str:
        return "\n".join([self.sentence, *(f"note: {note}" for note in self.notes)])

    def summary(self) -> dict[str, Any]:
        """Return all values, for JSON; a key ends in its unit."""
        return {
            "runs": list(self.names),
            "answer": self.sentence,
            "better": None if self.best is None else self.names[self.best],
            "same": self.are_same,
            "differences": [
                {"of": difference.kind, "key": difference.key, "values": list(difference.texts)}
                for difference in self.differences
            ],
            "abscissa": "path" if self.by_path else "time",
            "verdicts": [verdict.headline for verdict in self.verdicts],
            "checks": [check.content() for check in self.checks],
            "error_budgets": {
                name: [None if part is None else part.content() for part in parts]
                for name, parts in self.budgets.items()
            },
            "contour_difference": [_apart(apart) for apart in self.apart],
            "causes_rms_um": {
                name: [ERROR_SIZES[0].content(value) for value in worth] for name, worth in self.causes.items()
            },
            "values": [
                {
                    "group": value.group,
                    "key": value.quantity.key,
                    "values": list(value.values),
                    "changes": [value.change(run) for run in range(len(self.runs))],
                }
                for value in self.values
            ],
            "notes": self.notes,
        }


def _apart(apart: PlaceDifference | None) -> dict[str, float | None] | None:
    if apart is None or not apart.length:
        return None
    sizes = {size.key: size.content(size.get(apart)) for size in ERROR_SIZES}
    return {**sizes, "length_mm": apart.length}


def _across(part: Part) -> Floats:
    """Return an error across the path, lateral and vertical, (m, 2) [mm]."""
    return np.column_stack([part.lateral, part.vertical])


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
    checks = [check for row in compared_rows(verdict) for check in row.checks]
    return {check.name: min(check.usage, CAP) for check in checks if not math.isnan(check.usage)}


def _unchecked_failures(verdict: Verdict) -> float:
    """Return the burden of rows that fail without a check, as where no glue comes out."""
    return burden_of_usages(CAP for row in verdict.rows if row.fails_without_check)


def is_better(first: Verdict, second: Verdict) -> bool:
    """Return whether a verdict is better than another."""
    for value, rival in zip(*ranks_of(first, second), strict=True):
        if value != rival and not math.isclose(value, rival, rel_tol=_EQUAL_BURDENS, abs_tol=_EQUAL_BURDENS):
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
        if len(names) == FEWEST_RUNS:
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
        judged = {row.name for row in compared_rows(verdicts[other]) if row.checks}
        for row in compared_rows(verdicts[number]):
            if not verdicts[number].fault and not row.checks and row.name in judged:
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
    texts = [_values(check, best, rival) for check in worse[:_NAMED_CHECKS]]
    if len(worse) > _NAMED_CHECKS:
        texts.append(f"{len(worse) - _NAMED_CHECKS} further checks")
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
    texts = [str(difference) for difference in shown[:_NAMED_CHECKS]]
    further = len(differences) - len(texts)
    if further:
        texts.append(f"{further} further value{'s' if further > 1 else ''}")
    return f"What differs: {'; '.join(texts)}."


def _listed_names(names: Sequence[str]) -> str:
    return f"{', '.join(names[:-1])} and {names[-1]}"
