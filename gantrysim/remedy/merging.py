"""Levers of a combination that change one value, shown as one: the search may set a value twice."""

from __future__ import annotations

from collections.abc import Sequence

from gantrysim.base.errors import GantryError
from gantrysim.remedy.combination import SHARE, Combinations, Pick, setting_of
from gantrysim.remedy.levers.numbers import factor_text, rounded
from gantrysim.remedy.levers.speed import FASTER, SLOWER, at_factor


def merged(combinations: Combinations, picks: Sequence[Pick]) -> list[Pick]:
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
    factor = rounded(
        present.job.controller.programmed_speed / combinations.state_of([]).job.controller.programmed_speed
    )
    single = [Pick(at_factor(factor), factor_text(factor))] if factor != 1 else []
    first = speeds[0]
    together = [*picks[:first], *single, *(pick for k, pick in enumerate(picks) if k > first and k not in speeds)]
    try:
        outcome = combinations.state_of(together).outcome
    except GantryError:  # a lever between them has no such setting at that speed
        return list(picks)
    return together if (1 - SHARE) * outcome.burden <= present.outcome.burden else list(picks)


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
