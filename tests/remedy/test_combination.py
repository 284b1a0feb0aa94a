"""Which levers join a combination, on jobs whose burden is the product of what each lever leaves of it."""

import math
from dataclasses import dataclass
from math import prod
from types import SimpleNamespace

import pytest

from gantrysim.remedy.combination import SHARE, Combinations, Pick, rank
from gantrysim.remedy.lever import Effort, Lever, Setting, State
from gantrysim.results.checks import Check
from gantrysim.results.row import Row

BURDEN = 100.0


@dataclass(frozen=True)
class FactorJob:
    """A job with the levers that are set in it."""

    levers: tuple[str, ...] = ()

    def changed(self, changes):
        return FactorJob((*self.levers, *changes))


def lever(name, effort=Effort.SETTING):
    return Lever(name, "", "", ("path",), lambda state: [Setting("", {name: 1})], effort=effort)


def combinations(factors, forecast=None, measured=None):
    """Combinations of levers that leave these factors of the burden; the levers of jobs that are measured join a list.

    Of several levers the last is named.
    """

    def measure(job):
        if measured is not None:
            measured.append("".join(job.levers[-1:]))
        burden = BURDEN * prod(factors[name] for name in job.levers)
        return SimpleNamespace(burden=burden, duration=1.0, verdict=None)

    def measure_all(jobs):
        return [measure(job) for job in jobs]

    return Combinations(State(FactorJob(), measure), measure_all, lambda _: {"path"}, lambda job: job, forecast)


def forecast_of(factors, share):
    """Forecasts of a share of the burdens."""
    return SimpleNamespace(
        is_worthwhile=lambda present: True,
        burden=lambda job, alone: share * BURDEN * prod(factors[name] for name in job.levers),
    )


def names(picks):
    return {pick.lever.name for pick in picks}


@pytest.mark.parametrize(("leaves", "joins"), [(1.0, False), (1 - 0.5 * SHARE, False), (1 - 2 * SHARE, True)])
def test_a_lever_joins_only_where_it_lowers_the_burden_by_a_hundredth(leaves, joins):
    levers = [lever("strong"), lever("weak")]
    tried = combinations({"strong": 0.5, "weak": leaves})
    picks = tried.joined([], levers)
    assert names(picks) == {"strong"}
    more = tried.joined(picks, levers)
    assert (more is not None) == joins
    if joins:
        assert names(more) == {"strong", "weak"}


@pytest.mark.parametrize(("leaves", "spared"), [(1 - 0.5 * SHARE, True), (1 - 2 * SHARE, False)])
def test_a_lever_without_which_the_burden_hardly_grows_is_left_out(leaves, spared):
    picks = [Pick(lever("strong"), ""), Pick(lever("weak", Effort.HARDWARE), "")]
    needed = combinations({"strong": 0.5, "weak": leaves}).without_spare(picks)
    assert names(needed) == ({"strong"} if spared else {"strong", "weak"})


def test_of_levers_that_are_as_good_the_one_that_takes_least_joins():
    levers = [lever("part", Effort.HARDWARE), lever("value")]
    factors = {"part": 0.5, "value": 0.5 + 0.5 * SHARE}
    assert names(combinations(factors).joined([], levers)) == {"value"}


@pytest.mark.parametrize(("share", "simulated"), [(0.9, {"best", "as good", "near"}), (1.0, {"best", "as good"})])
def test_candidates_whose_forecast_leaves_them_no_chance_are_not_simulated(share, simulated):
    """Of nine tenths of the burdens, 45 of 50: the best, 20, leaves a chance up to 20 + 0.5."""
    factors = {"first": 0.5, "worse": 1.1, "best": 0.4, "as good": 0.405, "near": 0.45, "far": 0.9}
    levers = [lever(name, Effort.HARDWARE if name == "best" else Effort.SETTING) for name in factors]
    picks = [Pick(levers[0], "")]
    measured = []
    better = combinations(factors, forecast_of(factors, share), measured).joined(picks, levers)
    assert better == combinations(factors).joined(picks, levers)
    assert names(better) == {"first", "as good"}
    assert set(measured) == {"first", *simulated}


def test_nothing_is_simulated_where_no_forecast_is_better_than_the_present():
    factors = {"first": 0.5, "as bad": 1 - 0.5 * SHARE, "worse": 1.1}
    levers = [lever(name) for name in factors]
    measured = []
    tried = combinations(factors, forecast_of(factors, 1.0), measured)
    assert tried.joined([Pick(levers[0], "")], levers) is None
    assert set(measured) == {"first"}


def test_a_candidate_that_is_worse_than_the_present_leaves_others_no_more_chance():
    """Of nine tenths of the burdens, 0.945 and 1.035 times the present one: the second has no chance from the start."""
    factors = {"first": 0.5, "worse": 1.05, "far": 1.15}
    levers = [lever(name) for name in factors]
    measured = []
    assert combinations(factors, forecast_of(factors, 0.9), measured).joined([Pick(levers[0], "")], levers) is None
    assert set(measured) == {"first", "worse"}


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


@pytest.mark.parametrize(("leaves", "simulated"), [(0.5, set()), (1 - 0.5 * SHARE, {"strong"})])
def test_a_lever_is_left_out_on_trial_only_where_its_absence_may_be_forgiven(leaves, simulated):
    factors = {"strong": 0.5, "weak": leaves}
    picks = [Pick(lever("strong"), ""), Pick(lever("weak", Effort.HARDWARE), "")]
    measured = []
    needed = combinations(factors, forecast_of(factors, 1.0), measured).without_spare(picks)
    assert needed == combinations(factors).without_spare(picks)
    assert set(measured) == {"weak", *simulated}
