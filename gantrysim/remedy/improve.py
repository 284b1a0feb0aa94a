"""`improve`: find out what to change in a job, by simulating it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

from gantrysim.base.errors import InputError, unknown
from gantrysim.job.causes import Causes, causes_of
from gantrysim.job.job import Job
from gantrysim.metrics.budget import Budget
from gantrysim.remedy.bench import Bench, Progress
from gantrysim.remedy.fastest import fastest_program
from gantrysim.remedy.improvement import Improvement
from gantrysim.remedy.lever import ROWS, Lever
from gantrysim.remedy.levers import LEVERS
from gantrysim.remedy.outcome import Outcome
from gantrysim.remedy.search import Search
from gantrysim.results.score import row_burden
from gantrysim.results.verdict import PATH


def improve(
    job: Job,
    *,
    levers: Iterable[str] | None = None,
    rows: Iterable[str] | None = None,
    causes: Causes | None = None,
    budget: Budget | None = None,
    workers: int | None = None,
    fastest: bool | None = None,
    progress: Progress | None = None,
) -> Improvement:
    """Find out what to change in a job so that its verdict becomes a pass.

    Every lever that the verdict and the causes of the error suggest is simulated alone, and then in the best
    combination, see `gantrysim.remedy.search`. No levers are tried for a job that passes or ends in a fault.

    Args:
        job: the job.
        levers: names of the levers to try, by default all.
        rows: names of the rows of the verdict to improve, by default all that do not pass.
        causes: of the job's error, if they are known; found where they are needed otherwise.
        budget: of the job's run, if it has run; simulated otherwise.
        workers: maximum number of threads, by default one for each core; the result does not depend on it.
        fastest: whether to look for the fastest program that is as good as the best combination; by default where the
            job gives a tolerance.
        progress: called with the number of finished runs, of those known by now, and what runs.

    Raises:
        InputError: an unknown lever or row, fewer than one worker, or a job that is refused.
    """
    chosen = chosen_levers(levers)
    names = tuple(ROWS if rows is None else rows)
    for name in names:
        if name not in ROWS:
            raise unknown("row of the verdict", name, ROWS)
    bench = Bench(job, workers, progress)
    if budget is not None:
        bench.add(job, budget)
    before = bench.measure(job)
    if before.verdict is None:
        raise InputError(before.failure)
    wants_fastest = job.tolerance is not None if fastest is None else fastest
    if before.failure:
        return Improvement(job, before, (), (), (), before, job)
    bad = _bad_rows(before, names)
    if bad:
        search = Search(job, bench, names, _causes(job, bad, causes))
        improvement = _searched(search, chosen, before)
    else:
        improvement = Improvement(job, before, (), (), (), before, job)
    return _with_fastest(improvement, bench) if wants_fastest else improvement


def worst_rows(before: Outcome, count: int = 2) -> list[str]:
    """Return the names of the rows of a verdict that are worst, and do not pass, the worst first."""
    if before.verdict is None:
        return []
    rows = [row for row in before.verdict.rows if row_burden(row) > 0]
    return [row.name for row in sorted(rows, key=row_burden, reverse=True)[:count]]


def chosen_levers(names: Iterable[str] | None) -> list[Lever]:
    """Return levers by name, in the order of `LEVERS`; all without names.

    Raises:
        InputError: an unknown name.
    """
    if names is None:
        return list(LEVERS)
    known = {lever.name: lever for lever in LEVERS}
    wanted = list(names)
    for name in wanted:
        if name not in known:
            raise unknown("lever", name, known)
    return [lever for lever in LEVERS if lever.name in wanted]


def _bad_rows(outcome: Outcome, names: Sequence[str]) -> list[str]:
    assert outcome.verdict is not None
    return [row.name for row in outcome.verdict.rows if row.name in names and row_burden(row) > 0]


def _causes(job: Job, bad: Sequence[str], known: Causes | None) -> Causes | None:
    """Return the causes of the contour error where the path is bad; None for a job with deliberate faults."""
    if PATH not in bad or job.faults:
        return None
    return causes_of(job) if known is None else known


def _searched(search: Search, levers: Sequence[Lever], before: Outcome) -> Improvement:
    plausible, implausible = search.plausible(levers)
    trials, inapplicable = search.alone(plausible)
    picks = search.combined(plausible)
    final = search.state_of(picks)
    return Improvement(
        base=search.start.job,
        before=before,
        trials=tuple(trials),
        skipped=(*implausible, *inapplicable),
        combination=tuple(search.trials_of(picks)),
        after=final.outcome,
        job=final.job,
    )


def _with_fastest(improvement: Improvement, bench: Bench) -> Improvement:
    """Return the result with the fastest program that is as good, where it is faster."""
    fastest = fastest_program(improvement.job, bench)
    if fastest is None:
        return improvement
    return replace(improvement, after=fastest.outcome, job=fastest.job, fastest=fastest)
