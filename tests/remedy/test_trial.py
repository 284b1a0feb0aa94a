"""What a change does to the checks of a verdict, by hand."""

import math
from dataclasses import replace

import pytest

from gantrysim import Verdict
from gantrysim.remedy.lever import Gain, gains_of, shown_gains
from gantrysim.results.checks import FAIL, Check, Row


def row(name, **usages):
    """A row whose checks use shares of a limit of 2 mm."""
    checks = [
        Check(name=key, quantity=f"size of {key}", value=2 * usage, limit=2.0, unit="mm", source="given", form=".2f")
        for key, usage in usages.items()
    ]
    return Row.of(name, checks)


BEFORE = Verdict((row("path", rms=0.1, most=1.5), row("glue", start=0.2, width=0.9, gap=0.3), Row("machine")))
AFTER = Verdict((row("path", rms=0.6, most=0.5), row("glue", start=0.95, width=0.85, gap=0.1), Row("machine")))


def test_a_gain_is_that_of_the_worst_check_of_each_row():
    """After the change another check of a row may be its worst one."""
    path, glue, machine = gains_of(BEFORE, AFTER)
    assert path == Gain("path", "size of most", "mm", ".2f", False, 3.0, 1.0, 1.5, 0.6, "pass")
    assert (glue.quantity, glue.before, glue.after) == ("size of width", 1.8, 1.7)
    assert (glue.usage_before, glue.usage_after, glue.state) == (0.9, 0.95, "warn")
    assert (machine.row, machine.quantity) == ("machine", "")
    assert math.isnan(machine.before)
    assert math.isnan(machine.after)


def test_the_worst_check_of_each_row_is_shown_and_every_other_that_does_not_pass():
    before = Verdict((row("path", rms=0.1, most=0.2), row("glue", start=1.2, width=0.9, gap=0.3)))
    assert [gain.quantity for gain in shown_gains(before, AFTER)] == [
        "size of most",
        "size of start",
        "size of width",
    ]


@pytest.mark.parametrize("after", [None, Verdict((), "x jammed")])
def test_a_job_that_is_refused_or_ends_in_a_fault_gains_nothing(after):
    for gain in (*gains_of(BEFORE, after)[:2], *shown_gains(BEFORE, after)):
        assert gain.before > 0
        assert math.isnan(gain.after)
        assert math.isnan(gain.usage_after)
        assert gain.state == "not judged"


def test_a_check_that_is_not_made_after_a_change_has_no_value():
    after = Verdict((row("path", rms=0.6), Row("glue", state=FAIL), Row("machine")))
    path, glue, _ = gains_of(BEFORE, after)
    assert math.isnan(path.after)
    assert (path.usage_after, path.state) == (0.6, "pass")
    assert (glue.usage_after, glue.state) == (1000.0, "fail")


def test_a_value_whose_sign_changes_keeps_its_words():
    gain = Gain("glue", "bead too narrow by", "%", before=15.2, after=2.6, quantity_after="bead too wide by")
    assert gain.text == "15.2 % → bead too wide by 2.6 %"
    assert replace(gain, quantity_after="").text == "15.2 → 2.6 %"


def test_a_check_that_changes_its_words_gives_both():
    def verdict(words, value):
        check = Check(name="width", quantity=words, value=value, limit=10.0, unit="%", source="given")
        return Verdict((Row.of("glue", [check]),))

    (gain,) = shown_gains(verdict("too narrow by", 15.2), verdict("too wide by", 2.6))
    assert f"{gain.quantity} {gain.text}" == "too narrow by 15.2 % → too wide by 2.6 %"
    (gain,) = shown_gains(verdict("too narrow by", 15.2), verdict("too narrow by", 2.6))
    assert f"{gain.quantity} {gain.text}" == "too narrow by 15.2 → 2.6 %"
