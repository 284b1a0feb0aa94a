"""`improve`: find out what to change in a job, by simulating it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import replace

from gantrysim.base.errors import GantryError, InputError, check_type, unknown
from gantrysim.base.quantity import number_text
from gantrysim.job.causes import Causes, Effect, causes_of
from gantrysim.job.job import Job, check_job
from gantrysim.metrics.budget import Budget
from gantrysim.remedy.bench import Bench, Progress
from gantrysim.remedy.by_place import speed_by_place
from gantrysim.remedy.combination import (
    Combinations,
    Limit,
    Pick,
    best_combination,
    fewest_levers,
    merged_picks,
    setting_of,
)
from gantrysim.remedy.fastest import fastest_program
from gantrysim.remedy.improvement import Improvement
from gantrysim.remedy.lever import ROWS, Lever, Setting, Skipped, State, Trial, gains_of
from gantrysim.remedy.levers import LEVERS
from gantrysim.remedy.levers.program import FASTER, SLOWER
from gantrysim.remedy.outcome import Outcome
from gantrysim.results.score import row_burden
from gantrysim.results.verdict import PATH

# The search: every plausible lever alone, and the best combination, see `gantrysim.remedy.combination`.

_SAME_SECTION = 0.02  # relative
_SAME_DOT = 10.0  # [%]
_LONGER_DURATION = 1.05  # times the job's duration, from which speeds by place are looked for
CAUSE_WORTH = 0.05  # of the contour error, rms or largest: a cause that is worth less does not matter


class Search:
    """The search for what to change in a job.

    Args:
        job: the job as it is.
        bench: simulates.
        rows: names of the rows of the verdict that are to pass.
        causes: of the error; None where they are not known, so that any cause may matter.

    Attributes:
        start: the state of the job as it is.
    """

    def __init__(self, job: Job, bench: Bench, rows: Sequence[str], causes: Causes | None = None) -> None:
        self.start = State(job, self._measure)
        self._bench = bench
        self._rows = frozenset(rows)
        self._causes = causes
        self._combinations = Combinations(self.start, self._promising, self._bad_rows, bench.family.member)

    def plausible(self, levers: Sequence[Lever]) -> tuple[list[Lever], list[Skipped]]:
        """Return the levers to try, and those that cannot help: the rows they act on pass, or no cause is theirs."""
        plausible = []
        skipped = []
        for lever in levers:
            reason = self._implausible(lever)
            if reason:
                skipped.append(Skipped(lever, reason))
            else:
                plausible.append(lever)
        return plausible, skipped

    def alone(self, levers: Sequence[Lever]) -> tuple[list[Trial], list[Skipped]]:
        """Simulate each setting of each lever alone; return the trials, and the levers that do not apply."""
        candidates = []
        skipped = []
        for lever in levers:
            settings = lever.settings(self.start)
            if isinstance(settings, str):
                skipped.append(Skipped(lever, settings))
            else:
                candidates += [(lever, setting) for setting in settings]
        self._bench.task.name = "levers"
        return self._trials(self.start, candidates), skipped

    def best_picks(self, levers: Sequence[Lever]) -> list[Pick]:
        """Return the best combination, in the order in which its levers joined; empty where none helps."""
        self._bench.task.name = "combination"
        picks = best_combination(self._combinations, levers)
        fewest = fewest_levers(self._combinations, picks, self._bench.motion_key, self._bench.motions_fail)
        return merged_picks(self._combinations, fewest)

    def state_of(self, picks: Sequence[Pick]) -> State:
        """Return the state after the levers of a combination are set, see `Combinations.state_of`."""
        return self._combinations.state_of(picks)

    def at_program_speed(self, improvement: Improvement) -> Job:
        """Return the improved job without the levers that change its speed everywhere alike."""
        picks = [
            Pick(trial.lever, trial.setting)
            for trial in improvement.combination
            if trial.lever.name not in (FASTER.name, SLOWER.name)
        ]
        try:
            return self.state_of(picks).job
        except GantryError:  # a lever has no such setting at the program's speed
            return improvement.job

    def trials_of(self, picks: Sequence[Pick]) -> list[Trial]:
        """Return the trial of each lever of a combination, on top of those before it."""
        trials = []
        for k, pick in enumerate(picks):
            state = self.state_of(picks[:k])
            trials += self._trials(state, [(pick.lever, setting_of(state, pick))])
        return trials

    def _implausible(self, lever: Lever) -> str:
        rows = [name for name in lever.rows if name in self._bad_rows(self.start.outcome)]
        if not rows:
            return f"{' and '.join(lever.rows)} {'passes' if len(lever.rows) == 1 else 'pass'}"
        if rows != [PATH] or not lever.causes or self._causes is None:
            return ""
        worth = {effect.cause.name: _share(effect) for effect in self._causes.effects}
        if any(worth.get(cause, 0.0) >= CAUSE_WORTH for cause in lever.causes):
            return ""
        return f"the error is not caused by {' or '.join(lever.causes)}"

    def _bad_rows(self, outcome: Outcome) -> set[str]:
        if outcome.verdict is None:
            return set()
        return {row.name for row in outcome.verdict.rows if row.name in self._rows and row_burden(row) > 0}

    def _trials(self, state: State, candidates: Sequence[tuple[Lever, Setting]]) -> list[Trial]:
        jobs: list[Job] = []
        refusals: dict[int, Outcome] = {}
        for k, (_, setting) in enumerate(candidates):
            try:
                jobs.append(state.job.changed(setting.changes))
            except GantryError as error:
                refusals[k] = Outcome(None, failure=str(error))
        measured = iter(self._measure_all(jobs))
        trials = []
        base = self.start.outcome
        assert base.verdict is not None
        for k, (lever, setting) in enumerate(candidates):
            outcome = refusals[k] if k in refusals else next(measured)
            gains = gains_of(base.verdict, outcome.verdict)
            time = outcome.duration - base.duration
            trials.append(Trial(lever, setting.label, setting.changes, outcome, gains, time))
        return trials

    def _measure(self, job: Job) -> Outcome:
        return self._bench.measure(job) if job is self.start.job else self._measure_all([job])[0]

    def _measure_all(self, jobs: Sequence[Job]) -> list[Outcome]:
        return [self._checked_outcome(outcome) for outcome in self._bench.measure_all(jobs)]

    def _promising(self, jobs: Sequence[Job], limit: Limit) -> list[Outcome | None]:
        outcomes = self._bench.promising(jobs, lambda known: limit([self._checked_outcome(other) for other in known]))
        return [None if outcome is None else self._checked_outcome(outcome) for outcome in outcomes]

    def _checked_outcome(self, outcome: Outcome) -> Outcome:
        """Return the outcome, as a failure where it lays another part than the job: no row judges that."""
        return outcome if outcome.failure else replace(outcome, failure=another_part(self.start.outcome, outcome))


def another_part(before: Outcome, after: Outcome) -> str:
    """Return how the glue requested after a change differs: section and dots; empty where it is the same.

    A speed that the controller clamps, for one, leaves a scaled flow on a path that is no faster.
    """
    if abs(after.nominal - before.nominal) > _SAME_SECTION * before.nominal:
        return f"another bead: {after.nominal:.3g} mm² instead of {before.nominal:.3g} mm²"
    if len(after.dots) != len(before.dots):
        return f"{len(after.dots)} dots instead of {len(before.dots)}"
    changes = [100 * (dot / asked - 1) for dot, asked in zip(after.dots, before.dots, strict=True) if asked]
    largest = max(changes, key=abs, default=0.0)
    if abs(largest) <= _SAME_DOT:
        return ""
    return f"another volume of dots, {number_text(largest, '+.1f')} %"


def _share(effect: Effect) -> float:
    """Return the share of the contour error, rms or largest, that a cause is worth; inf where its run failed."""
    worth = effect.worth.get("contour")
    if worth is None:
        return math.inf
    before = effect.before["contour"]
    pairs = ((worth.rms, before.rms), (worth.max, before.max))
    return max(part / whole if whole > 0 else 0.0 for part, whole in pairs)


def improve(
    job: Job,
    *,
    levers: Iterable[str] | None = None,
    rows: Iterable[str] | None = None,
    causes: Causes | None = None,
    budget: Budget | None = None,
    workers: int | None = None,
    fastest: bool | None = None,
    by_place: bool | None = None,
    progress: Progress | None = None,
) -> Improvement:
    """Find out what to change in a job so that its verdict becomes a pass.

    Every lever that the verdict and the causes of the error suggest is simulated alone, and then in the best
    combination, by the search above. No levers are tried for a job that passes or ends in a fault.

    Args:
        job: the job.
        levers: names of the levers to try, by default all.
        rows: names of the rows of the verdict to improve, by default all that do not pass.
        causes: of the job's error, if they are known; found where they are needed otherwise.
        budget: of the job's run, if it has run; simulated otherwise.
        workers: maximum number of threads, by default one for each core; the result does not depend on it.
        fastest: whether to look for the fastest program that is as good as the best combination; by default where the
            job gives a tolerance.
        by_place: whether to look for a speed of each stretch of the program, on top of the best combination; by default
            where that passes and takes more than 5 % longer than the job.
        progress: called with the number of finished runs, of those known by now, and what runs.

    Raises:
        InputError: an unknown lever or row, fewer than one worker, or a job that is refused.
    """
    check_job(job)
    if causes is not None:
        check_type("causes", causes, Causes, "Causes", "gantrysim.causes_of(job) returns them")
    if budget is not None:
        check_type("budget", budget, Budget, "a Budget", "gantrysim.Budget(run) returns one")
    chosen = chosen_levers(levers)
    names = tuple(ROWS if rows is None else rows)
    for name in names:
        if name not in ROWS:
            raise unknown("row of the verdict", name, ROWS)
    bench = Bench(job, workers, progress)
    if budget is not None:
        bench.add(job, budget)
    else:
        # a job that is refused is so again below
        with suppress(GantryError):
            bench.show(job)
    before = bench.measure(job)
    if before.verdict is None:
        raise InputError(before.failure)
    wants_fastest = job.tolerance is not None if fastest is None else fastest
    if before.failure:
        return Improvement(job, before, (), (), (), before, job)
    bad = _bad_rows(before, names)
    at_program_speed = job
    if bad:
        search = Search(job, bench, names, _causes(job, bad, causes, bench.shown_budget(job)))
        improvement = _searched_improvement(search, chosen, before)
        at_program_speed = search.at_program_speed(improvement)
    else:
        improvement = Improvement(job, before, (), (), (), before, job)
    if wants_fastest:
        improvement = _with_fastest(improvement, bench)
    if improvement.changes_anything:
        improvement = _confirmed_improvement(improvement, bench)
    after = improvement.after
    costs_time = after.passes and after.duration > _LONGER_DURATION * before.duration
    if costs_time if by_place is None else by_place:
        bench.task.name = "speed by place"
        improvement = replace(improvement, by_place=speed_by_place(at_program_speed, after, bench))
    return improvement


def worst_rows(before: Outcome) -> list[str]:
    """Return the names of the two rows of a verdict that are worst, and do not pass, the worst first."""
    if before.verdict is None:
        return []
    rows = [row for row in before.verdict.rows if row_burden(row) > 0]
    return [row.name for row in sorted(rows, key=row_burden, reverse=True)[:2]]


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


def _causes(job: Job, bad: Sequence[str], known: Causes | None, budget: Budget | None) -> Causes | None:
    """Return the causes of the contour error where the path is bad; None for a job with deliberate faults."""
    if PATH not in bad or job.faults:
        return None
    return causes_of(job, budget=budget, by_link=False) if known is None else known


def _searched_improvement(search: Search, levers: Sequence[Lever], before: Outcome) -> Improvement:
    plausible, implausible = search.plausible(levers)
    trials, inapplicable = search.alone(plausible)
    picks = search.best_picks(plausible)
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


def _confirmed_improvement(improvement: Improvement, bench: Bench) -> Improvement:
    """Return the result with what MuJoCo's run of the improved job shows, see `Bench.confirm`."""
    outcome, note = bench.confirm(improvement.job)
    fastest = improvement.fastest
    if fastest is not None:
        fastest = replace(fastest, outcome=outcome)
    return replace(improvement, after=outcome, fastest=fastest, note=note)


def _with_fastest(improvement: Improvement, bench: Bench) -> Improvement:
    """Return the result with the fastest program that is as good, where it is faster."""
    fastest = fastest_program(improvement.job, bench)
    if fastest is None:
        return improvement
    return replace(improvement, after=fastest.outcome, job=fastest.job, fastest=fastest)
