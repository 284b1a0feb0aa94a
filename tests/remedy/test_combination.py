"""Which levers join a combination, on jobs whose burden is the product of what each lever leaves of it."""

import math
from dataclasses import dataclass
from math import prod
from types import SimpleNamespace

import pytest

from gantrysim.remedy.combination import BURDEN_SHARE, Combinations, Pick, rank
from gantrysim.remedy.lever import Effort, Lever, Setting, State
from gantrysim.results.checks import Check, Row

BURDEN = 100.0


@dataclass(frozen=True)
class FactorJob:
    """A job with the levers that are set in it."""

    levers: tuple[str, ...] = ()

    def changed(self, changes):
        return FactorJob((*self.levers, *changes))


def lever(name, effort=Effort.SETTING):
    return Lever(name, "", "", ("path",), lambda state: [Setting("", {name: 1})], effort=effort)


def combinations(factors):
    """Combinations of levers that leave these factors of the burden."""

    def measure(job):
        burden = BURDEN * prod(factors[name] for name in job.levers)
        return SimpleNamespace(burden=burden, duration=1.0, verdict=None)

    def promising(jobs, limit):
        return [measure(job) for job in jobs]

    return Combinations(State(FactorJob(), measure), promising, lambda _: {"path"}, lambda job: job)


def names(picks):
    return {pick.lever.name for pick in picks}


@pytest.mark.parametrize(
    ("leaves", "joins"), [(1.0, False), (1 - 0.5 * BURDEN_SHARE, False), (1 - 2 * BURDEN_SHARE, True)]
)
def test_a_lever_joins_only_where_it_lowers_the_burden_by_a_hundredth(leaves, joins):
    levers = [lever("strong"), lever("weak")]
    tried = combinations({"strong": 0.5, "weak": leaves})
    picks = tried.with_best_lever([], levers)
    assert names(picks) == {"strong"}
    more = tried.with_best_lever(picks, levers)
    assert (more is not None) == joins
    if joins:
        assert names(more) == {"strong", "weak"}


@pytest.mark.parametrize(("leaves", "spared"), [(1 - 0.5 * BURDEN_SHARE, True), (1 - 2 * BURDEN_SHARE, False)])
def test_a_lever_without_which_the_burden_hardly_grows_is_left_out(leaves, spared):
    picks = [Pick(lever("strong"), ""), Pick(lever("weak", Effort.HARDWARE), "")]
    needed = combinations({"strong": 0.5, "weak": leaves}).without_spare(picks)
    assert names(needed) == ({"strong"} if spared else {"strong", "weak"})


def test_of_levers_that_are_as_good_the_one_that_takes_least_joins():
    levers = [lever("part", Effort.HARDWARE), lever("value")]
    factors = {"part": 0.5, "value": 0.5 + 0.5 * BURDEN_SHARE}
    assert names(combinations(factors).with_best_lever([], levers)) == {"value"}


def outcome(burden, duration, *usages):
    checks = [Check(name="rms", quantity="path", value=usage, limit=1.0, unit="", source="given") for usage in usages]
    rows = [Row.of("path", [check]) for check in checks]
    return SimpleNamespace(burden=burden, duration=duration, verdict=SimpleNamespace(rows=rows) if usages else None)


def test_of_two_settings_the_better_has_less_burden_then_time_then_usage_of_its_worst_row():
    """Times that differ by less than 10 ms are the same; a row that is not judged does not count."""
    ascending = [
        outcome(1.0, 9.0, 0.9),
        outcome(2.0, 3.001, 0.3, 0.5),
        outcome(2.0, 3.004, 0.6, 0.1),
        outcome(2.0, 3.001, math.nan, 0.7),
        outcome(2.0, 3.02, 0.1),
    ]
    ranks = [rank(setting) for setting in ascending]
    assert ranks == sorted(set(ranks))
    assert rank(outcome(2.0, 3.0)) == rank(outcome(2.0, 3.0, math.nan)) == (2.0, 3.0, 0.0)


@pytest.mark.parametrize("place", [0, 1, 2])
def test_the_lever_that_does_least_is_exchanged_and_all_others_stay(place):
    factors = {"strong": 0.3, "middle": 0.5, "better": 0.4, "worse": 0.9}
    order = ["strong", "middle"]
    order.insert(place, "weak")
    tried = combinations({**factors, "weak": 0.8})
    picks = [Pick(lever(name), "") for name in order]
    levers = [pick.lever for pick in picks] + [lever("better"), lever("worse")]
    assert names(tried.with_exchange(picks, levers)) == {"strong", "middle", "better"}
    assert tried.with_exchange(picks, [*levers[:3], lever("worse")]) is None


@pytest.mark.parametrize("place", [0, 1, 2])
def test_one_lever_takes_another_setting_and_all_others_stay(place):
    """Of a lever with two settings, of which the second leaves less."""
    twofold = Lever("twofold", "", "", ("path",), lambda state: [Setting("1", {"once": 1}), Setting("2", {"twice": 1})])
    tried = combinations({"strong": 0.3, "middle": 0.5, "once": 0.8, "twice": 0.6})
    picks = [Pick(lever("strong"), ""), Pick(lever("middle"), "")]
    picks.insert(place, Pick(twofold, "1"))
    better = tried.with_other_setting(picks)
    assert {(pick.lever.name, pick.setting) for pick in better} == {("strong", ""), ("middle", ""), ("twofold", "2")}
    assert tried.with_other_setting(better) is None
