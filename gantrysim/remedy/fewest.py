"""The fewest levers that pass, of those of a combination that passes.

The greedy search adds one lever after the other, so that a later one may make up for the setting of an earlier one.
Where the levers of its combination have few settings together, all of them are tried in smaller numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import combinations as subsets

from gantrysim.base.errors import GantryError
from gantrysim.job.job import Job
from gantrysim.remedy.combination import SHARE, Candidate, Combinations, Pick, rank
from gantrysim.remedy.lever import Lever

MOST_MOTIONS = 64  # that are simulated for a number of levers


def fewest_levers(combinations: Combinations, picks: Sequence[Pick], motion_of: Callable[[Job], str]) -> list[Pick]:
    """Return the fewest of some levers that pass, with the settings of the shortest run.

    A combination counts if it takes no longer than the present one.

    Args:
        combinations: of the job.
        picks: a combination; returned as it is where it does not pass, or too many motions would be simulated.
        motion_of: returns a text that is the same for jobs with the same motion.
    """
    present = combinations.state_of(picks).outcome
    if present.burden > 0:
        return list(picks)
    levers = [pick.lever for pick in picks]
    for count in range(1, len(levers) + 1):
        candidates = [
            candidate for chosen in subsets(levers, count) for candidate in _candidates(combinations, (), chosen)
        ]
        if len({motion_of(candidate.job) for candidate in candidates}) > MOST_MOTIONS:
            continue
        outcomes = combinations.measured([candidate.job for candidate in candidates])
        passing = [
            (rank(outcome), k)
            for k, outcome in enumerate(outcomes)
            if outcome.burden == 0 and outcome.duration <= (1 + SHARE) * present.duration
        ]
        if passing:
            return list(candidates[min(passing)[1]].picks)
    return list(picks)


def _candidates(combinations: Combinations, picks: tuple[Pick, ...], levers: Sequence[Lever]) -> Iterator[Candidate]:
    """Yield a combination with further levers, each at every setting."""
    if not levers:
        yield Candidate(picks, combinations.state_of(picks).job)
        return
    for pick in _settings(combinations, picks, levers[0]):
        yield from _candidates(combinations, (*picks, pick), levers[1:])


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
