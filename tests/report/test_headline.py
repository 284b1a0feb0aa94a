"""The cause that the headline names, for effects whose worth is given."""

from types import SimpleNamespace

import pytest

from gantrysim.job.causes import CAUSES, Causes, Effect
from gantrysim.metrics.analysis import ErrorSpread
from gantrysim.report.headline import cause_sentences, glue_cause_sentences, glue_sentences, headline
from gantrysim.results.checks import Check, Row
from gantrysim.results.glue import THROUGH_GLUE
from gantrysim.results.glue_causes import GLUE_CAUSES, GlueCauses, GlueEffect

WHOLE = 10e-3  # rms error [mm]
NAMES = [cause.name for cause in CAUSES]


def causes_worth(**worth):
    """Causes of an error of 10 µm, worth so many µm; None for one whose run failed, and 0 for all others."""
    before = {"contour": ErrorSpread(WHOLE, 2 * WHOLE, 1.5 * WHOLE)}
    effects = []
    for cause in CAUSES:
        value = worth.get(cause.name, 0.0)
        without = {} if value is None else {"contour": ErrorSpread(WHOLE - 1e-3 * value, WHOLE, WHOLE)}
        effects.append(Effect(cause, before, without, "failed" if value is None else ""))
    return Causes(before, tuple(effects))


def sentences(**worth):
    return list(cause_sentences(causes_worth(**worth)))


@pytest.mark.parametrize("cause", CAUSES, ids=lambda cause: cause.name)
def test_the_cause_of_most_of_the_error_is_told_with_what_is_left(cause):
    """With what it is, where its name alone does not tell."""
    name = f"{cause.name} ({cause.meaning})" if cause.name != "friction" else cause.name
    assert sentences(**{cause.name: 9.0}) == [
        f"9.0 of 10.0 µm due to {name}; without it 1.0 µm are left by several causes together, "
        "none alone more than 0.1 µm."
    ]
    assert sentences(**{cause.name: 10.0}) == [f"All 10.0 µm due to {name}."]


def test_a_cause_worth_half_is_the_main_one():
    (text,) = sentences(friction=5.001, counts=4.0)
    assert text == "5.0 of 10.0 µm due to friction; without it 5.0 µm are left, next counts (4.0 µm)."
    # effects do not add up: the larger of two is named
    (text,) = sentences(friction=7.0, sampling=8.0, counts=2.0)
    assert text.startswith("8.0 of 10.0 µm due to sampling")
    assert text.endswith("without it 2.0 µm are left, next friction (7.0 µm); causes overlap.")
    (text,) = sentences(sampling=6.0, friction=3.0, counts=2.0)
    assert text.endswith("next friction (3.0 µm) and counts (2.0 µm); causes overlap.")


def test_what_is_left_without_a_cause_is_told_by_its_link_where_no_other_cause_is_worth_much():
    before = {name: ErrorSpread(WHOLE, WHOLE, WHOLE) for name in ("contour", "program", "servo")}
    after = {name: ErrorSpread(1e-3, 2e-3, 1.5e-3) for name in ("contour", "servo")}
    after["program"] = ErrorSpread(0.0, 0.0, 0.0)
    (text,) = cause_sentences(Causes(before, (Effect(CAUSES[0], before, after, ""),)))
    assert text.endswith("without it 1.0 µm are left, most of it in servo (commanded to encoder).")


def test_the_causes_are_those_of_the_value_that_is_judged():
    before = {"contour": ErrorSpread(10e-3, 30e-3, 20e-3)}
    after = {"contour": ErrorSpread(4e-3, 12e-3, 5e-3)}
    causes = Causes(before, (Effect(CAUSES[3], before, after, ""),))
    for name, text in (("path_max", "18.0 of 30.0 µm"), ("path_p95", "15.0 of 20.0 µm")):
        check = Check(name=name, quantity=name, value=1.0, limit=1.0, unit="µm", source="given")
        assert next(cause_sentences(causes, check)).startswith(f"{text} due to friction")
    assert next(cause_sentences(causes)).startswith("6.0 of 10.0 µm due to friction")


def test_where_no_cause_is_worth_half_nothing_is_blamed():
    assert sentences(friction=4.99, counts=3.0, winding=2.0) == [
        "No single cause is worth half of the 10.0 µm; worth most: friction (5.0 µm) and counts (3.0 µm: steps of the "
        "encoders); none of the other 4 is worth more than 2.0 µm; what they are worth need not add up."
    ]
    (text,) = sentences(friction=1.0)
    assert text.startswith("No single cause is worth half of the 10.0 µm; worth most: friction (1.0 µm); none of")
    # below 0.1 µm, and where every cause offsets others, there is nothing to name
    assert sentences(friction=0.09) == ["No single cause is worth half of the 10.0 µm."]
    assert sentences(**dict.fromkeys(NAMES, -1.0)) == ["No single cause is worth half of the 10.0 µm."]


def test_a_cause_whose_run_failed_is_not_taken_for_worthless():
    text, unknown = sentences(friction=6.0, sampling=None)
    assert text.startswith("6.0 of 10.0 µm due to friction")
    assert unknown == "Not known, as the run without it failed: sampling."
    assert sentences(**dict.fromkeys(NAMES)) == [
        "No single cause is worth half of it.",
        f"Not known, as the run without it failed: {', '.join(NAMES)}.",
    ]


def test_a_cause_of_the_glue_is_named_from_a_hundredth_of_the_value_on():
    def row(value):
        check = Check(name="bead_width", quantity="bead too wide by", value=value, limit=10.0, unit="%", source="given")
        return Row.of("glue", [check])

    worths = (4.0, 0.3, 0.15, -1.0, 0.0, 0.0)
    effects = [GlueEffect(cause, row(20.0 - worth)) for cause, worth in zip(GLUE_CAUSES, worths, strict=True)]
    (text,) = glue_cause_sentences(GlueCauses(row(20.0), tuple(effects)))
    first, second, third, *_ = (cause.name for cause in GLUE_CAUSES)
    assert f"worth most: {first} (4.0 %" in text
    assert f" and {second} (0.3 %" in text
    (text,) = glue_cause_sentences(GlueCauses(row(20.0), (effects[0], effects[2])))
    assert f"{first} (4.0 %)" in text
    assert third not in text


@pytest.mark.parametrize(("width", "is_told"), [(20.0, True), (9.0, False)])
def test_beside_a_ploughed_bead_the_cause_of_what_else_fails_is_told(width, is_told):
    def row(value):
        narrow = Check(
            name="bead_width", quantity="bead too narrow by", value=value, limit=10.0, unit="%", source="given"
        )
        passed = Check(name="bead_ploughed", quantity="bead ploughed", value=5.0, limit=0.0, unit="mm", source="given")
        return Row.of("glue", [narrow, passed], f"{THROUGH_GLUE} bead: 1 pass; lift it")

    first, *_ = GLUE_CAUSES
    causes = GlueCauses(row(width), (GlueEffect(first, row(0.25 * width)),))
    remark, *others = glue_sentences(row(width), causes)
    assert remark == "Needle through its own bead: 1 pass; lift it."
    texts = [text.replace("\xa0", " ") for text in others]
    told = f"Bead too narrow by 20.0 %: 15.0 of 20.0 % due to {first.name}; without it 5.0 % are left."
    assert texts == ([told] if is_told else [])


def test_what_is_left_of_the_glue_is_told_by_runs_without_two_causes():
    def row(value):
        check = Check(name="bead_width", quantity="bead too wide by", value=value, limit=10.0, unit="%", source="given")
        return Row.of("glue", [check])

    first, second, third, *_ = GLUE_CAUSES
    effects = tuple(GlueEffect(cause, row(value)) for cause, value in ((first, 8.0), (second, 19.0), (third, 20.0)))
    rest = (GlueEffect(second, row(1.0)), GlueEffect(third, row(8.0)))
    (text,) = glue_cause_sentences(GlueCauses(row(20.0), effects, rest))
    assert text.endswith(f"without it 8.0 % are left, next {second.name} (7.0 %).")


def row_of_glue(value):
    check = Check(name="bead_width", quantity="bead too wide by", value=value, limit=10.0, unit="%", source="given")
    return Row.of("glue", [check])


def test_a_cause_of_the_glue_whose_run_failed_is_not_taken_for_worthless():
    first, second, *_ = GLUE_CAUSES
    effects = (GlueEffect(first, row_of_glue(5.0)), GlueEffect(second, None, "refused: too slow"))
    main, unknown = glue_cause_sentences(GlueCauses(row_of_glue(20.0), effects))
    assert main.replace("\xa0", " ").startswith(f"15.0 of 20.0 % due to {first.name}")
    assert unknown == f"Not known: {second.name} (refused: too slow)."


def test_glue_without_a_value_has_no_cause():
    assert list(glue_cause_sentences(GlueCauses(Row("glue", remark="no bead"), ()))) == []


def test_several_small_causes_of_what_is_left_are_named_where_their_sum_explains_less_than_half():
    """Of 4 µm left without friction, 1 and 0.9 µm: each more than a tenth, together less than half."""
    (text,) = sentences(friction=6.0, sampling=1.0, counts=0.9)
    assert text.endswith(
        "without it 4.0 µm are left by several causes together, alone sampling (1.0 µm) and counts (0.9 µm)."
    )


def test_a_row_without_a_value_is_told_by_its_remark():
    rows = (Row("path"), Row("stability", remark="unstable: axis x", state="fail"))
    verdict = SimpleNamespace(worst_row=rows[1], unjudged=False, disturbances=())
    assert headline(SimpleNamespace(verdict=verdict)) == "Stability: unstable: axis x."
