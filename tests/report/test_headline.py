"""The cause that the headline names, for effects whose worth is given."""

import pytest

from gantrysim.job.causes import CAUSES, Causes, Effect
from gantrysim.metrics.analysis import ErrorSize
from gantrysim.report.headline import cause_sentences, glue_cause_sentences, glue_sentences
from gantrysim.results.checks import Check, Row
from gantrysim.results.glue import THROUGH_GLUE
from gantrysim.results.glue_causes import GLUE_CAUSES, GlueCauses, GlueEffect

WHOLE = 10e-3  # rms error [mm]
NAMES = [cause.name for cause in CAUSES]


def causes_worth(**worth):
    """Causes of an error of 10 µm, worth so many µm; None for one whose run failed, and 0 for all others."""
    before = {"contour": ErrorSize(WHOLE, 2 * WHOLE)}
    effects = []
    for cause in CAUSES:
        value = worth.get(cause.name, 0.0)
        without = {} if value is None else {"contour": ErrorSize(WHOLE - 1e-3 * value, WHOLE)}
        effects.append(Effect(cause, before, without, "failed" if value is None else ""))
    return Causes(before, tuple(effects))


def sentences(**worth):
    return list(cause_sentences(causes_worth(**worth)))


@pytest.mark.parametrize("cause", CAUSES, ids=lambda cause: cause.name)
def test_a_cause_worth_almost_all_is_the_cause(cause):
    """With what it is, where its name alone does not tell."""
    name = f"{cause.name} ({cause.meaning})" if cause.name != "friction" else cause.name
    assert sentences(**{cause.name: 9.0}) == [f"Cause: {name}, worth 9.0 µm of 10.0 µm; without it 1.0 µm are left."]


def test_a_cause_worth_half_is_the_main_one():
    text = "Main cause: friction, worth 5.0 µm of 10.0 µm; without it 5.0 µm are left."
    assert sentences(friction=5.001, counts=4.0) == [text]
    assert sentences(friction=8.99)[0].startswith("Main cause: friction")
    # effects do not add up: the larger of two is named
    assert sentences(friction=7.0, sampling=8.0)[0].startswith("Main cause: sampling")


def test_where_no_cause_is_worth_half_nothing_is_blamed():
    assert sentences(friction=4.99, counts=3.0, winding=2.0) == [
        "No single cause is worth half of it; worth most: friction (5.0 µm) and counts (3.0 µm)."
    ]
    assert sentences(friction=1.0) == ["No single cause is worth half of it; worth most: friction (1.0 µm)."]
    # below 0.1 µm, and where every cause offsets others, there is nothing to name
    assert sentences(friction=0.09) == ["No single cause is worth half of it."]
    assert sentences(**dict.fromkeys(NAMES, -1.0)) == ["No single cause is worth half of it."]


def test_a_cause_whose_run_failed_is_not_taken_for_worthless():
    assert sentences(friction=6.0, sampling=None) == [
        "Main cause: friction, worth 6.0 µm of 10.0 µm; without it 4.0 µm are left.",
        "Not known, as the run without it failed: sampling.",
    ]
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
    assert text.endswith(f"worst most: {first} (4.0 %) and {second} (0.3 %).".replace("worst", "worth"))
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
    assert texts[:1] == (["Bead too narrow by 20.0 %."] if is_told else [])
    assert [f"Main cause: {first.name}, worth 15" in text for text in texts[1:]] == [True] * is_told
