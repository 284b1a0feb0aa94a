"""Which levers join a combination, on jobs whose burden is the product of what each lever leaves of it."""

from dataclasses import dataclass
from math import prod
from types import SimpleNamespace

import pytest

from gantrysim.remedy.combination import SHARE, Combinations, Pick
from gantrysim.remedy.lever import Effort, Lever, Setting, State

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

    def measure_all(jobs):
        return [measure(job) for job in jobs]

    return Combinations(State(FactorJob(), measure), measure_all, lambda _: {"path"}, lambda job: job)


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
