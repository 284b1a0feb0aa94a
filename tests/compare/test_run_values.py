"""Checks, values and jobs of several runs beside one another, and the sentence on them, by hand."""

import math
from dataclasses import replace
from types import SimpleNamespace

import pytest
from matplotlib.figure import Figure

from gantrysim import Verdict
from gantrysim.base.quantity import Quantity
from gantrysim.compare.runs.compared_run import ComparedRun
from gantrysim.compare.runs.compared_runs import answer, best_of, is_better, ranks_of
from gantrysim.compare.runs.differences import (
    CheckChange,
    JobDifference,
    ValueChange,
    check_changes,
    differences_of,
    with_share,
)
from gantrysim.compare.runs.overlays import draw_compared_budgets, draw_compared_causes, draw_limit_use
from gantrysim.compare.runs.runs_page import _facts
from gantrysim.results.checks import FAIL, Check, Row

from support.compared import TEXT, circle_job, recorded


def check_of(name, usage, unit="mm", at_least=False):
    """A check that uses a share of its limit of 2, or of a least value of 2."""
    value = 2 / usage if at_least else 2 * usage
    return Check(
        name=name, quantity=f"{name} of it", value=value, limit=2.0, unit=unit, source="given", at_least=at_least,
        form=".2f",
    )  # fmt: skip


def verdict_of(**usages):
    """A verdict of one row."""
    return Verdict((Row.of("path", [check_of(name, usage) for name, usage in usages.items()]),))


def change_of(*usages, **options):
    return CheckChange("path", tuple(None if usage is None else check_of("rms", usage, **options) for usage in usages))


def test_a_check_of_every_run_stands_beside_the_others():
    change = change_of(0.5, 1.25, 0.501, None)
    assert [change.cell(run) for run in range(4)] == ["1.00 ✓", "2.50 ✗", "1.00 ✓", "–"]
    assert [change.judgement(run) for run in range(4)] == ["same", "worse", "same", ""]
    assert [change.change_text(run) for run in range(4)] == ["= same", "+1.50 ▼ worse", "= same", "–"]
    assert change.judgement(0, 1) == "better"
    assert change.change(1) == pytest.approx(1.5)
    assert math.isnan(change.change(3))
    content = change.content()
    assert content["limits"] == [2.0, 2.0, 2.0, None]
    assert content["values"] == [1.0, 2.5, 1.002, None]
    assert content["states"] == ["pass", "fail", "pass", "not judged"]
    assert content["judgements"] == ["same", "worse", "same", None]
    assert content["bound"] == "at most"
    unbounded = change_of(0.5, math.inf)
    assert math.isnan(unbounded.change(1))
    assert unbounded.judgement(1) == "worse"


def test_a_larger_value_is_better_where_it_must_be_at_least():
    change = change_of(0.5, 0.4, 0.8, at_least=True)
    assert [change.judgement(run) for run in range(3)] == ["same", "better", "worse"]
    assert change.change_text(1) == "+1.00"  # neither is near the limit
    assert change_of(0.5, 0.9, at_least=True).change_text(1).endswith(" ▼ worse")
    assert change.limit == "at least 2.00"


def test_checks_come_in_the_order_of_the_first_that_has_them():
    changes = list(check_changes([verdict_of(rms=0.1, most=0.2), verdict_of(most=0.4, turns=0.3)]))
    assert [change.known.name for change in changes] == ["most", "rms", "turns"]
    rms = changes[1]
    assert rms.checks[0].value == 0.2
    assert rms.checks[1] is None


def value_of(*values, form=".2f"):
    quantity = Quantity("size_mm", label="size", unit="mm", form=form, meaning="", path=lambda subject: subject)
    return ValueChange("sizes", quantity, values)


@pytest.mark.parametrize(
    ("values", "text", "large"),
    [
        ((10.0, 12.0), "+2.00 (+20 %)", True),
        ((10.0, 9.5), "−0.50 (−5.0 %)", True),
        ((10.0, 10.099), "+0.10 (+1.0 %)", False),
        ((10.0, 10.101), "+0.10 (+1.0 %)", True),
        ((-10.0, -11.0), "−1.00 (−10 %)", True),
        ((10.0, 10.001), "0", False),
        ((0.001, 0.002), "0", False),
        ((0.0, 3.0), "+3.00", True),
        ((10.0, None), "–", True),
        ((None, 3.0), "–", True),
        ((None, None), "–", False),
    ],
)
def test_a_value_changes_against_the_first_run(values, text, large):
    change = value_of(*values)
    assert change.change_text(1) == text
    assert change.is_large == large


def test_a_change_of_any_later_run_counts():
    assert value_of(10.0, 10.0, 12.0).is_large
    assert not value_of(10.0, 10.0, 10.0).is_large


@pytest.mark.parametrize(
    ("change", "value", "text"),
    [
        (1.0, 2000.1, "+1"),
        (1.0, 1999.9, "+1 (+0.1 %)"),
        (-1.0, -20.0, "+1 (−5.0 %)"),
        (1.0, 10.01, "+1 (+10.0 %)"),
        (1.0, 9.99, "+1"),  # one digit is nothing to take a share of
        (1.0, 0.0, "+1"),
    ],
)
def test_the_share_of_a_change_has_as_many_digits_as_it_tells(change, value, text):
    assert with_share("+1", change, value) == text


def differences(*jobs):
    run = recorded()
    return differences_of([ComparedRun.of(run.replaced(job=job), str(k)) for k, job in enumerate(jobs)])


def test_what_differs_between_jobs_is_named_by_key_value_and_unit():
    job = circle_job()
    assert differences(job, job) == ()
    other = circle_job(period=0.002).model_copy(update={"name": "another name"})
    named = {difference.key: difference for difference in differences(job, other)}
    assert named["servo.period"] == JobDifference("job", "servo.period", ("0.001", "0.002"))
    assert named["servo period [ms]"].texts == ("1", "2")
    assert "name" not in named
    servos = [item.built_servo for item in (job, other)]
    for key, name in (("x: kp [N·m/mm]", "kp"), ("y: kp [N·m/mm]", "kp")):
        axis = "xy".index(key[0])
        assert named[key].texts == tuple(f"{servo.per_axis(name)[axis]:.6g}" for servo in servos)
    assert all(key.endswith("]") or "[" not in key for key in named)


def test_a_parameter_without_a_unit_has_no_brackets():
    named = [difference.key for difference in differences(circle_job(), circle_job().changed({"servo.law": "contour"}))]
    assert "laws" in named
    assert "x: contour_gain" in named


def test_a_program_that_differs_is_named_by_its_first_line():
    job = circle_job()
    one = circle_job(text=TEXT.replace("F3000", "F2400"))
    (difference,) = [item for item in differences(job, one) if item.key.startswith("program.text")]
    assert (difference.key, difference.texts) == ("program.text, line 2", ("F3000", "F2400"))
    longer = circle_job(text=TEXT.replace("F3000", "F2400") + "(end)\n")
    first, further = [item for item in differences(job, longer) if item.key.startswith("program.text")]
    assert first == difference
    assert further.key == "program.text, 1 further lines differ; length"
    assert further.texts == ("8 lines", "9 lines")


def test_a_machine_s_values_are_told_with_the_unit_of_the_axis():
    named = {item.key: item for item in differences(circle_job(), circle_job(machine="xyz"))}
    assert named["machine"].texts == ("xy", "xyz")
    assert "machine, digest of its physics" not in named


def test_burdens_count_the_checks_that_both_judge():
    """A check weighs ln(usage / 0.8) beyond 0.8."""
    first = verdict_of(rms=1.6, most=0.5)
    second = verdict_of(rms=0.4, turns=8.0)
    (burden, worst), (other_burden, other_worst) = ranks_of(first, second)
    assert (burden, worst) == (pytest.approx(math.log(2)), 1.6)
    assert (other_burden, other_worst) == (0.0, 0.4)
    assert is_better(second, first)
    assert not is_better(first, second)
    assert best_of([first, second]) == 1
    # of two that pass, the one whose worst check uses less
    assert best_of([verdict_of(rms=0.5), verdict_of(rms=0.4), verdict_of(rms=0.45)]) == 1
    assert best_of([verdict_of(rms=0.5), verdict_of(rms=0.4), verdict_of(rms=0.4)]) is None
    assert best_of([verdict_of(rms=0.4), verdict_of(rms=0.4 + 1e-8)]) is None
    fault = Verdict((), "x jammed")
    assert ranks_of(fault, first)[0] == (math.inf, 0.0)
    assert best_of([fault, verdict_of(rms=900.0)]) == 1
    # a row that fails without a check weighs as a thousandfold usage
    bare = Verdict((Row("path", state=FAIL),))
    assert ranks_of(bare, first)[0][0] == pytest.approx(math.log(1250))


def said(names, verdicts, differences=(), same=False):
    return answer(names, verdicts, list(check_changes(verdicts)), differences, same)


def test_the_sentence_names_the_best_the_gain_and_the_losses():
    first = verdict_of(rms=1.5, most=0.5, turns=0.1)
    second = verdict_of(rms=0.5, most=0.9, turns=0.2)
    assert said(["a", "b"], [first, second]) == (
        "b is better than a: verdict warn against fail; rms of it: 1.00 against 3.00 mm (at most 2.00 mm). But worse: "
        "most of it: 1.80 against 1.00 mm (at most 2.00 mm). Their jobs, machines and servos do not differ."
    )
    passes = [verdict_of(rms=0.5, most=0.2), verdict_of(rms=0.4, most=0.3)]
    assert said(["a", "b"], passes).startswith("b is better than a: both pass; rms of it: 0.80 against 1.00 mm")
    assert "But worse" not in said(["a", "b"], passes)
    assert "both fail" in said(["a", "b"], [verdict_of(rms=2.0), verdict_of(rms=3.0)])
    assert "both come close to a limit" in said(["a", "b"], [verdict_of(rms=0.85), verdict_of(rms=0.9)])


def test_of_several_runs_the_next_best_is_the_rival():
    verdicts = [verdict_of(rms=usage) for usage in (1.5, 0.9, 1.2)]
    sentence = said(["a", "b", "c"], verdicts)
    assert sentence.startswith("b is the best of 3 runs, c the next: verdict warn against fail; rms of it: 1.80")


def test_the_largest_gain_and_the_largest_losses_are_named_first():
    before = verdict_of(a=3.0, b=2.0, p=0.5, q=0.5, r=0.5, s=0.5)
    after = verdict_of(a=2.0, b=0.5, p=0.85, q=1.2, r=0.95, s=1.1)
    sentence = said(["before", "after"], [before, after])
    assert "; b of it: 1.00 against 4.00 mm" in sentence
    losses = sentence.partition("But worse: ")[2].partition(". Their")[0].split("; ")
    assert [loss.split()[0] for loss in losses] == ["q", "s", "r", "1"]
    assert losses[-1] == "1 further checks"


def test_what_differs_is_told_of_jobs_first_and_at_most_thrice():
    jobs = [JobDifference("job", f"key{k}", ("1", "2")) for k in range(2)]
    others = [JobDifference("servo", f"gain{k}", ("3", "4")) for k in range(3)]
    verdicts = [verdict_of(rms=0.5), verdict_of(rms=0.4)]
    sentence = said(["a", "b"], verdicts, [*others, *jobs])
    assert sentence.endswith("What differs: key0 1 → 2; key1 1 → 2; 3 further values.")
    assert said(["a", "b"], verdicts, others[:1]).endswith("What differs: gain0 3 → 4.")
    four = [replace(jobs[0], key=f"key{k}") for k in range(4)]
    assert said(["a", "b"], verdicts, four).endswith("key2 1 → 2; 1 further value.")


def test_none_is_better_where_the_checks_that_both_judge_are_the_same():
    unjudged = Verdict((Row("path", remark="no path"),))
    assert said(["a", "b"], [verdict_of(rms=0.5), unjudged]) == (
        "None is better than the others by its verdict: a ✓ pass; b ! warn: path. The path is not compared: b has "
        "none judged (no path). Their jobs, machines and servos do not differ."
    )
    assert said(["a", "b", "c"], [verdict_of(rms=0.5)] * 3, same=True).startswith("a, b and c are the same: no value")


def test_bars_of_a_limit_s_use_are_cut_beyond_two_and_a_half_limits_and_keep_their_numbers():
    verdicts = [verdict_of(rms=0.5), verdict_of(rms=2.4), verdict_of(rms=9.0)]
    axes = draw_limit_use(Figure(), SimpleNamespace(names=("a", "b", "c"), verdicts=verdicts))
    assert [bars[0].get_width() for bars in axes.containers] == pytest.approx([50, 240, 250])
    assert [text.get_text() for text in axes.texts] == ["50", "240", "900"]
    assert 100 in [line.get_xdata()[0] for line in axes.lines]


def test_the_page_begins_with_the_error_of_each_run_and_the_difference_at_the_same_place():
    """Of runs that end in a fault before glue, and of paths that are nowhere the same, there is none."""
    verdict = SimpleNamespace(headline="pass")

    def facts(names, parts, apart):
        verdicts = [verdict] * len(names)
        compared = SimpleNamespace(names=names, verdicts=verdicts, budgets={"contour": parts}, apart=apart, runs=names)
        return [tuple(text.replace("\xa0", " ") for text in fact) for fact in _facts(compared)]

    part = SimpleNamespace(rms=0.00123, max=0.00456)
    apart = SimpleNamespace(rms=0.0021, max=0.0057, length=123.4)
    (first, second, both) = facts(["a", "b"], [part, part], [None, apart])
    assert (first[0], second[0], both[0]) == (
        "Contour error, a",
        "Contour error, b",
        "Difference at the same place",
    )
    assert first[1:] == ("1.2 µm rms", "max 4.6 µm; pass")
    assert both[1:] == ("2.1 µm rms", "max 5.7 µm, over 123.4 mm of path")
    three = facts(["a", "b", "c"], [part, None, part], [None, apart, SimpleNamespace(length=0.0)])
    assert [fact[0] for fact in three] == ["Contour error, a", "Contour error, c", "b less a"]


def test_bars_of_causes_and_links_are_in_micrometres_and_empty_where_a_run_has_none():
    causes = {"friction": [0.0031, None], "counts": [None, -0.0004]}
    compared = SimpleNamespace(names=("a", "b"), causes=causes)
    axes = draw_compared_causes(Figure(), compared)
    assert [[bar.get_width() for bar in bars] for bars in axes.containers] == [
        pytest.approx([3.1, 0.0]),
        pytest.approx([0.0, -0.4]),
    ]
    assert [text.get_text() for text in axes.texts] == ["3.10", "–", "–", "−0.40"]
    part = SimpleNamespace(rms=0.0025)
    axes = draw_compared_budgets(Figure(), SimpleNamespace(names=("a", "b"), budgets={"servo": [part, None]}))
    assert [bars[0].get_width() for bars in axes.containers] == pytest.approx([2.5, 0.0])
