"""The burden of verdicts that are made up: its closed form, its order, its cap."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gantrysim import Verdict
from gantrysim.results.checks import FAIL, UNJUDGED, WARN, Check, Row
from gantrysim.results.score import CAP, burden_of, usage_of

NAMES = ("path", "glue", "stability", "machine")
USAGES = st.lists(st.floats(0, 1e6), min_size=4, max_size=4)


def check_of(name, usage):
    return Check(name=name, quantity=name, value=usage, limit=1.0, unit="", source="given")


def verdict_with(usages):
    """A verdict whose rows each use a share of a limit of 1."""
    return Verdict(tuple(Row.of(name, [check_of(name, usage)]) for name, usage in zip(NAMES, usages, strict=True)))


@given(USAGES)
def test_the_burden_is_zero_where_and_only_where_the_verdict_passes(usages):
    verdict = verdict_with(usages)
    assert (burden_of(verdict) == 0) == (verdict.state == "pass")


@given(USAGES, st.integers(0, 3), st.floats(1, 100))
def test_the_burden_grows_with_every_usage(usages, row, factor):
    worse = [usage * factor if k == row else usage for k, usage in enumerate(usages)]
    assert burden_of(verdict_with(worse)) >= burden_of(verdict_with(usages))
    if usages[row] > 0.8 and worse[row] <= CAP and factor > 1.001:
        assert burden_of(verdict_with(worse)) > burden_of(verdict_with(usages))


def test_the_checks_of_a_row_add_up():
    alone = verdict_with([3.0, 0.1, 0.1, 0.1])
    both = Verdict((Row.of("path", [*alone.rows[0].checks, check_of("second", 2.9)]), *alone.rows[1:]))
    assert burden_of(both) == pytest.approx(burden_of(alone) + math.log(2.9 / 0.8))


def test_an_unbounded_usage_is_capped_and_a_fault_is_worse():
    capped = burden_of(verdict_with([math.inf] * 4))
    assert capped == pytest.approx(4 * math.log(CAP / 0.8))
    assert burden_of(Verdict((), "x jammed")) > capped


def test_of_what_is_not_admitted_at_all_less_is_better():
    """Limit 0: ln(1000 / 0.8) and a quarter of ln(1 + value)."""

    def burden(value):
        check = Check(name="ploughed", quantity="ploughed", value=value, limit=0.0, unit="mm", source="default")
        return burden_of(Verdict((Row.of("glue", [check]),)))

    assert burden(0.0) == 0
    assert burden(14.7) == pytest.approx(math.log(1250) + 0.25 * math.log(15.7))
    assert burden(14.7) > burden(1.5) > burden(0.1) > math.log(1250)


def test_a_row_without_a_check_weighs_only_as_a_failure():
    assert burden_of(Verdict((Row("glue", state=FAIL),))) == pytest.approx(math.log(CAP / 0.8))
    # as dots without glue beside a good bead, once "nothing to change: the verdict is fail"
    beside = Row("glue", (check_of("bead_width", 0.5),), state=FAIL)
    assert burden_of(Verdict((beside,))) == pytest.approx(math.log(CAP / 0.8))
    assert usage_of(beside) == CAP
    assert burden_of(Verdict((Row("glue", state=WARN),))) == 0


def test_the_usage_of_a_row_is_that_of_its_worst_check_that_is_judged():
    checks = [check_of("first", 0.4), check_of("second", 1.7), check_of("third", math.nan)]
    assert usage_of(Row.of("path", checks)) == 1.7
    assert usage_of(Row("glue", state=FAIL)) == CAP
    for state in (WARN, UNJUDGED):
        assert math.isnan(usage_of(Row("glue", state=state)))
