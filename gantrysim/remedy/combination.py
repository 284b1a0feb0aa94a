"""The best combination of levers, found greedily.

All settings of all levers that are left are tried on top of the combination, and the one with the least burden joins,
as long as it lowers the burden by at least `BURDEN_SHARE`. Of levers that are as good, the one that takes least joins.
Where none helps any more, another setting of a lever that has joined is tried: the best loop period, for one, is
another once its waits are exact.

Levers that only need another setting of the controller come first; those that cost cycle time or change the bead join
where these do not suffice, and other hardware comes last. Where not even that suffices, each lever of the combination
is exchanged for any other. Then each lever is left out in turn, the costliest first, and stays out where the burden
hardly grows without it. The search ends as soon as the verdict is a pass.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import combinations as subsets

from gantrysim.base.errors import GantryError
from gantrysim.job.job import Job
from gantrysim.remedy.lever import Effort, Lever, Setting, State, factor_text, rounded_number
from gantrysim.remedy.levers.program import FASTER, SLOWER, at_factor
from gantrysim.remedy.outcome import Outcome, least_burden
from gantrysim.results.score import usage_of

BURDEN_SHARE = 0.01  # of the burden, by which a lever of the combination lowers it


# the largest burden that counts, for what is known of other jobs
Limit = Callable[[Sequence[Outcome]], float]


@dataclass(frozen=True)
class Pick:
    """A lever of a combination, with the label of its setting."""

    lever: Lever
    setting: str


@dataclass(frozen=True)
class Candidate:
    """A combination and its job."""

    picks: tuple[Pick, ...]
    job: Job

    @property
    def added_pick(self) -> Pick:
        """The lever by which it differs from the present combination."""
        return self.picks[-1]


class MissingSettingError(GantryError):
    """A combination names a setting that its lever does not have at that place."""


def setting_of(state: State, pick: Pick) -> Setting:
    """Return the setting of a lever of a combination, for a state.

    Raises:
        MissingSettingError: the lever has no setting of that label there.
    """
    settings = pick.lever.settings(state)
    known = {} if isinstance(settings, str) else {setting.label: setting for setting in settings}
    if pick.setting not in known:
        raise MissingSettingError(f"{pick.lever.name}: has no setting {pick.setting!r} here")
    return known[pick.setting]


class Combinations:
    """Combinations of levers for a job.

    Args:
        start: the state of the job as it is.
        promising: returns what the runs of jobs show, None for those whose burden is above a limit.
        bad_rows: returns the names of the rows that are to pass and do not, from what a run shows.
        member: returns a job that shares with others what it has in common with them.

    Attributes:
        promising: as given.
    """

    def __init__(
        self,
        start: State,
        promising: Callable[[Sequence[Job], Limit], list[Outcome | None]],
        bad_rows: Callable[[Outcome], set[str]],
        member: Callable[[Job], Job],
    ) -> None:
        self._start = start
        self.promising = promising
        self._bad_rows = bad_rows
        self._member = member
        # by names of levers and labels of settings
        self._states: dict[tuple[tuple[str, str], ...], State] = {}

    def state_of(self, picks: Sequence[Pick]) -> State:
        """Return the state after the levers of a combination are set, one after the other.

        Raises:
            GantryError: a setting that does not exist at its place in the combination, or that the job refuses.
        """
        if not picks:
            return self._start
        key = tuple((pick.lever.name, pick.setting) for pick in picks)
        # combinations are extended, so that the same levers come first again and again
        if key not in self._states:
            *others, last = picks
            state = self.state_of(others)
            self._states[key] = State(self._changed_job(state, setting_of(state, last)), state.measure)
        return self._states[key]

    def _changed_job(self, state: State, setting: Setting) -> Job:
        return self._member(state.job.changed(setting.changes))

    def with_best_lever(self, picks: Sequence[Pick], levers: Iterable[Lever]) -> list[Pick] | None:
        """Return the combination with the lever that helps most, None where none does."""
        return self._best(picks, list(self._candidates_with(picks, levers)))

    def with_exchange(self, picks: Sequence[Pick], levers: Sequence[Lever]) -> list[Pick] | None:
        """Return the combination with one of its levers exchanged for one of these, None where that does not help."""
        candidates: list[Candidate] = []
        for k, pick in enumerate(picks):
            others = [*picks[:k], *picks[k + 1 :]]
            choice = [lever for lever in levers if lever is not pick.lever]
            candidates += self._candidates_with(others, choice)
        return self._best(picks, candidates)

    def with_other_setting(self, picks: Sequence[Pick]) -> list[Pick] | None:
        """Return the combination with another setting of one of its levers, None where that does not help."""
        candidates: list[Candidate] = []
        for k, pick in enumerate(picks):
            candidates += self._candidates_with([*picks[:k], *picks[k + 1 :]], [pick.lever])
        return self._best(picks, candidates)

    def without_spare(self, picks: Sequence[Pick]) -> list[Pick]:
        """Return a combination without the levers that it can spare."""
        needed = list(picks)
        for pick in sorted(picks, key=lambda pick: -pick.lever.effort):
            fewer = [other for other in needed if other is not pick]
            if self._is_as_good(fewer, self.state_of(needed).outcome.burden / (1 - BURDEN_SHARE)):
                needed = fewer
        return needed

    def _is_as_good(self, picks: Sequence[Pick], most: float) -> bool:
        """Return whether the burden of a combination is at most so much."""
        try:
            job = self.state_of(picks).job
        except GantryError:
            return False
        (outcome,) = self.promising([job], lambda _: most)
        return outcome is not None and outcome.burden <= most

    def act_on_all(self, levers: Iterable[Lever]) -> bool:
        """Return whether each row of the verdict that does not pass has one of these levers that acts on it."""
        acted_on = {row for lever in levers for row in lever.rows}
        return self._bad_rows(self._start.outcome) <= acted_on

    def _candidates_with(self, picks: Sequence[Pick], levers: Iterable[Lever]) -> Iterable[Candidate]:
        """Yield a combination with each setting of each lever that is not in it, on top."""
        try:
            state = self.state_of(picks)
        except GantryError:  # it holds a setting that needs the lever left out
            return
        bad = self._bad_rows(state.outcome)
        used = {pick.lever.name for pick in picks}
        for lever in levers:
            if lever.name in used or not bad & set(lever.rows):
                continue
            settings = lever.settings(state)
            for setting in () if isinstance(settings, str) else settings:
                try:
                    job = self._changed_job(state, setting)
                except GantryError:  # the values do not fit those of other levers
                    continue
                yield Candidate((*picks, Pick(lever, setting.label)), job)

    def _best(self, picks: Sequence[Pick], candidates: Sequence[Candidate]) -> list[Pick] | None:
        """Return the best candidate where it lowers the burden enough."""
        if not candidates:
            return None
        present = self.state_of(picks).outcome.burden
        enough = (1 - BURDEN_SHARE) * present

        def limit(known: Sequence[Outcome]) -> float:
            """Return the largest burden that may count: near the least one, where that is low enough."""
            least = least_burden(known)
            return least + BURDEN_SHARE * present if least <= enough else enough

        outcomes = self.promising([candidate.job for candidate in candidates], limit)
        burdens = [math.inf if outcome is None else outcome.burden for outcome in outcomes]
        least = min(burdens)
        if least > enough:
            return None
        near = [k for k, burden in enumerate(burdens) if burden <= least + BURDEN_SHARE * present]
        known = {k: outcome for k, outcome in enumerate(outcomes) if outcome is not None}
        effort = min(candidates[k].added_pick.lever.effort for k in near)
        lever = next(candidates[k].added_pick.lever for k in near if candidates[k].added_pick.lever.effort == effort)
        settings = [k for k in near if candidates[k].added_pick.lever is lever]
        best = min(settings, key=lambda k: (*rank(known[k]), k))
        return list(candidates[best].picks)


def best_combination(combinations: Combinations, levers: Sequence[Lever]) -> list[Pick]:
    """Return the best combination of levers, in the order in which they joined; empty where none helps."""
    picks: list[Pick] = []
    for effort in Effort:
        choice = [lever for lever in levers if lever.effort <= effort]
        while combinations.state_of(picks).outcome.burden > 0:
            better = combinations.with_best_lever(picks, choice) or combinations.with_other_setting(picks)
            if better is None and effort == max(Effort):
                better = combinations.with_exchange(picks, choice)
            if better is None:
                break
            picks = better
    return combinations.without_spare(picks)


def rank(outcome: Outcome) -> tuple[float, float, float]:
    """Return what the better of two settings has less of: burden, time, and usage of its worst row."""
    usages = [] if outcome.verdict is None else [usage_of(row) for row in outcome.verdict.rows]
    return outcome.burden, round(outcome.duration, 2), max((u for u in usages if not math.isnan(u)), default=0.0)


# Levers of a combination that change one value, shown as one: the search may set a value twice.


def merged_picks(combinations: Combinations, picks: Sequence[Pick]) -> list[Pick]:
    """Return a combination in which no two levers change one value, if that is as good."""
    single = _with_one_speed(combinations, picks)
    while fewer := _with_one_less(combinations, single):
        single = fewer
    return single


def _with_one_speed(combinations: Combinations, picks: Sequence[Pick]) -> list[Pick]:
    """Return a combination with one factor of the speed in place of several."""
    speeds = [k for k, pick in enumerate(picks) if pick.lever in (FASTER, SLOWER)]
    if len(speeds) < 2:
        return list(picks)
    present = combinations.state_of(picks)
    factor = rounded_number(
        present.job.controller.programmed_speed / combinations.state_of([]).job.controller.programmed_speed
    )
    single = [Pick(at_factor(factor), factor_text(factor))] if factor != 1 else []
    first = speeds[0]
    together = [*picks[:first], *single, *(pick for k, pick in enumerate(picks) if k > first and k not in speeds)]
    try:
        outcome = combinations.state_of(together).outcome
    except GantryError:  # a lever between them has no such setting at that speed
        return list(picks)
    return together if (1 - BURDEN_SHARE) * outcome.burden <= present.outcome.burden else list(picks)


def _with_one_less(combinations: Combinations, picks: Sequence[Pick]) -> list[Pick] | None:
    """Return a combination that makes the same job without one of two levers that set one value; None without such."""
    job = combinations.state_of(picks).job.toml()
    changed = [set(setting_of(combinations.state_of(picks[:k]), pick).changes) for k, pick in enumerate(picks)]
    for later in range(len(picks)):
        for k in range(later):
            if not changed[k] & changed[later]:
                continue
            settings = picks[k].lever.settings(combinations.state_of(picks[:k]))
            for setting in () if isinstance(settings, str) else settings:
                others = [pick for n, pick in enumerate(picks) if n not in (k, later)]
                fewer = [*others[:k], Pick(picks[k].lever, setting.label), *others[k:]]
                try:
                    if combinations.state_of(fewer).job.toml() == job:
                        return fewer
                except GantryError:  # the values do not fit those of other levers
                    continue
    return None


# The fewest levers that pass, of those of a combination that passes.
#
# The greedy search adds one lever after the other, so that a later one may make up for the setting of an earlier one.
# Where the levers of its combination have few settings together, all of them are tried in smaller numbers: first those
# that move the machine otherwise, as a motion that fails does so with every glue. Where all levers are needed, one
# setting after the other is exchanged for one with a shorter run.

MOST_MOTIONS = 64  # that are simulated for a number of levers

# keys of a job that the motion does not depend on, but for the start lead, which may hold the program back
_OF_GLUE = ("dispenser.", "bead.")
_OF_MOTION = ("dispenser.start_lead", "dispenser.needle")


def fewest_levers(
    combinations: Combinations,
    picks: Sequence[Pick],
    motion_of: Callable[[Job], str],
    motions_fail: Callable[[Sequence[Job]], list[bool]],
) -> list[Pick]:
    """Return the fewest of some levers that pass, with the settings of the shortest run.

    A combination counts if it takes no longer than the present one. Numbers of levers with too many motions are passed
    over.

    Args:
        combinations: of the job.
        picks: a combination; returned as it is where it does not pass.
        motion_of: returns a text that is the same for jobs with the same motion.
        motions_fail: returns whether the motions of jobs fail whatever the glue.
    """
    present = combinations.state_of(picks).outcome
    if present.burden > 0:
        return list(picks)
    levers = [pick.lever for pick in picks]
    for count in range(1, len(levers)):
        choices = filter(combinations.act_on_all, subsets(levers, count))
        several = [_Chosen(combinations, chosen) for chosen in choices]
        if sum(chosen.most_motions for chosen in several) > MOST_MOTIONS:
            continue
        motions: dict[str, list[tuple[_Chosen, Candidate]]] = {}
        for chosen in several:
            for candidate in chosen.moved():
                motions.setdefault(motion_of(candidate.job), []).append((chosen, candidate))
        fails = motions_fail([group[0][1].job for group in motions.values()])
        for group, is_failing in zip(motions.values(), fails, strict=True):
            for chosen, candidate in group if not is_failing else ():
                chosen.admit(candidate)
        possible = [candidate for chosen in several for candidate in chosen.candidates()]
        # those that do not pass do not count
        outcomes = combinations.promising([candidate.job for candidate in possible], lambda _: 0.0)
        passing = [
            (rank(outcome), k)
            for k, outcome in enumerate(outcomes)
            if outcome is not None and outcome.burden == 0 and outcome.duration <= (1 + BURDEN_SHARE) * present.duration
        ]
        if passing:
            return list(possible[min(passing)[1]].picks)
    return _with_shortest_run(combinations, picks)


def _with_shortest_run(combinations: Combinations, picks: Sequence[Pick]) -> list[Pick]:
    """Return a combination that passes with other settings, of one lever after the other, while the run gets better.

    Levers that move the machine come first. A setting of theirs that fails beside the others is not tried again.
    """
    start = combinations.state_of([])
    best = tuple(picks)
    is_of_glue = [_is_of_glue(_keys_of(start, pick.lever)) for pick in picks]
    order = sorted(range(len(picks)), key=lambda k: is_of_glue[k])
    failed: set[Pick] = set()
    while True:
        before = best
        for k in order:
            passing = _passing_settings(combinations, best, k, failed)
            if not is_of_glue[k]:
                settings = _settings(combinations, best[:k], best[k].lever)
                failed |= {pick for pick in settings if pick not in passing}
            # of equal ones the first
            best = min(passing.values(), key=lambda choice: rank(choice[1]))[0]
        if best == before:
            return list(best)


def _passing_settings(
    combinations: Combinations, picks: tuple[Pick, ...], k: int, failed: Collection[Pick]
) -> dict[Pick, tuple[tuple[Pick, ...], Outcome]]:
    """Return the settings of a lever of a combination that pass in its place, with combination and outcome of each.

    Args:
        combinations: of the job.
        picks: a combination that passes.
        k: number of the lever in it.
        failed: settings that are not tried.
    """
    tried: dict[Pick, Candidate] = {}
    for pick in _settings(combinations, picks[:k], picks[k].lever):
        others = (*picks[:k], pick, *picks[k + 1 :])
        with suppress(GantryError):  # a later lever has no such setting there
            if pick not in failed:
                tried[pick] = Candidate(others, combinations.state_of(others).job)
    outcomes = combinations.promising([candidate.job for candidate in tried.values()], lambda _: 0.0)
    return {
        pick: (candidate.picks, outcome)
        for (pick, candidate), outcome in zip(tried.items(), outcomes, strict=True)
        if outcome is not None and outcome.burden == 0
    }


class _Chosen:
    """Levers of which all settings are tried together.

    Args:
        combinations: of the job.
        levers: in their order.

    Attributes:
        most_motions: product of the numbers of settings of those that move the machine otherwise, for the job as it is.
    """

    def __init__(self, combinations: Combinations, levers: Sequence[Lever]) -> None:
        self._combinations = combinations
        self._levers = levers
        keys = {lever.name: _keys_of(combinations.state_of([]), lever) for lever in levers}
        # where a lever sets the start lead, the glue of another may decide for how long
        is_mixed = any(key in _OF_MOTION for changed in keys.values() for key in changed)
        self._moving = [lever for lever in levers if is_mixed or not _is_of_glue(keys[lever.name])]
        self._names = {lever.name for lever in self._moving}
        self.most_motions = math.prod(len(_settings(combinations, (), lever)) for lever in self._moving)
        # settings of the moving levers whose motion does not fail, and all that these begin with
        self._admitted: set[tuple[str, ...]] = set()

    def moved(self) -> Iterator[Candidate]:
        """Yield the levers that move the machine otherwise, at every setting: the others do not change the motion."""
        return self._with(self._moving, (), is_admitted=lambda picks: True)

    def admit(self, candidate: Candidate) -> None:
        """Admit one of `moved`."""
        labels = self._labels(candidate.picks)
        self._admitted |= {labels[:k] for k in range(len(labels) + 1)}

    def candidates(self) -> Iterator[Candidate]:
        """Yield the levers at every setting whose motion is admitted."""
        return self._with(self._levers, (), is_admitted=lambda picks: self._labels(picks) in self._admitted)

    def _labels(self, picks: Sequence[Pick]) -> tuple[str, ...]:
        return tuple(pick.setting for pick in picks if pick.lever.name in self._names)

    def _with(
        self, levers: Sequence[Lever], picks: tuple[Pick, ...], is_admitted: Callable[[Sequence[Pick]], bool]
    ) -> Iterator[Candidate]:
        """Yield a combination with further levers, each at every setting."""
        if not is_admitted(picks):
            return
        if not levers:
            yield Candidate(picks, self._combinations.state_of(picks).job)
            return
        for pick in _settings(self._combinations, picks, levers[0]):
            yield from self._with(levers[1:], (*picks, pick), is_admitted)


def _keys_of(state: State, lever: Lever) -> set[str]:
    """Return the keys of a job that the settings of a lever change; empty where it has none there."""
    settings = lever.settings(state)
    return set() if isinstance(settings, str) else {key for setting in settings for key in setting.changes}


def _is_of_glue(keys: set[str]) -> bool:
    return bool(keys) and all(key.startswith(_OF_GLUE) for key in keys)


def _settings(combinations: Combinations, picks: tuple[Pick, ...], lever: Lever) -> list[Pick]:
    """Return a lever at each setting that the job admits after others."""
    picked = []
    settings = lever.settings(combinations.state_of(picks))
    for setting in () if isinstance(settings, str) else settings:
        pick = Pick(lever, setting.label)
        try:
            combinations.state_of([*picks, pick])
        except GantryError:  # the values do not fit those of other levers
            continue
        picked.append(pick)
    return picked
