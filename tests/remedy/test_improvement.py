"""What the result of a search says, of verdicts and trials that are made up."""

import math
from dataclasses import replace
from types import SimpleNamespace

import pytest

from gantrysim import Verdict
from gantrysim.job.job import Job
from gantrysim.remedy.bounds import bound_of
from gantrysim.remedy.improvement import Improvement, _usages
from gantrysim.remedy.lever import Lever, Skipped, Trial, gains_of
from gantrysim.remedy.outcome import Outcome
from gantrysim.remedy.report import _values, change_section, remedy_of
from gantrysim.results.checks import FAIL, Check, Row

from support.remedies import SIDES, lines_job

ROWS = ("path", "stability", "machine")


def verdict_of(*usages):
    """A verdict whose rows use shares of a limit of 4 mm."""
    rows = []
    for name, usage in zip(ROWS, usages, strict=True):
        values = usage if isinstance(usage, tuple) else (usage,)
        checks = [
            Check(name=f"{name}{k}", quantity=f"size {k}", value=4 * value, limit=4.0, unit="mm", source="given")
            for k, value in enumerate(values)
        ]
        rows.append(Row.of(name, checks))
    return Verdict(tuple(rows))


def outcome_of(*usages, duration=10.0):
    return Outcome(verdict_of(*usages), duration)


def lever(name):
    return Lever(name, "", f"cost of {name}", ROWS, lambda state: [])


def trial_of(name, setting, before, after, failure=""):
    outcome = Outcome(None, failure=failure) if failure else after
    gains = gains_of(before.verdict, outcome.verdict)
    return Trial(lever(name), setting, {"bead.gap": 0.4}, outcome, gains, outcome.duration - before.duration)


BEFORE = outcome_of(0.5, 2.0, 1.25)


def result_of(after=BEFORE, *, combination=(), trials=(), skipped=(), before=BEFORE):
    job = lines_job(SIDES)
    return Improvement(job, before, tuple(trials), tuple(skipped), tuple(combination), after, job)


def picked(after, *names, before=BEFORE):
    return [trial_of(name, f"× {k + 2}" if k == 0 else "", before, after) for k, name in enumerate(names)]


def test_the_sentence_says_what_is_reached_and_what_remains():
    good = outcome_of(0.5, 0.7, 0.6)
    assert result_of(good, combination=picked(good, "gain", "speed")).sentence == "passes with gain (× 2); speed."
    assert result_of(good, before=good).sentence == "nothing to change: the verdict is pass."
    better = outcome_of(0.5, 1.5, 1.2)
    sentence = result_of(better, combination=picked(better, "gain")).sentence
    assert sentence.startswith("best with gain (× 2); nothing meets the tolerance: stability still fails, size 0")
    assert sentence.endswith("What forbids it is the servo: its loops have too little margin.")
    sentence = result_of(before=outcome_of(0.5, 0.85, 0.9), after=outcome_of(0.5, 0.85, 0.9)).sentence
    assert sentence.startswith("no lever helps; no combination leaves a 20 % margin: machine still warns, size 0")
    assert sentence.endswith("What forbids it is the drives: their torque or speed has too little reserve.")


def glue_of(
    ploughed,
    width,
    remark="1 pass; it never lifts: lift it before dry moves, or order them so that none crosses the bead",
):
    """An outcome whose needle ploughs a length of its bead, beside a path that passes."""
    checks = [
        Check(name="bead_ploughed", quantity="bead ploughed", value=ploughed, limit=0.0, unit="mm", source="default"),
        Check(name="bead_width", quantity="bead too narrow by", value=width, limit=10.0, unit="%", source="default"),
    ]
    return Outcome(Verdict((verdict_of(0.5, 0.5, 0.5).rows[0], Row.of("glue", checks, remark))), 10.0)


def test_what_no_lever_cures_is_told_first_with_what_does():
    """The change proposed is for another value than the one that spoils the run: it must not seem to cure that."""
    order = "lift it before dry moves, or order them so that none crosses the bead"
    before, after = glue_of(2.5, 15.2), glue_of(2.4, 2.04)
    result = result_of(after, before=before, combination=picked(after, "lag compensation", before=before))
    assert result.sentence == (
        f"no lever cures bead ploughed: {order}. "
        "Lag compensation (× 2) is for what else fails: bead too narrow by 15.2 → 2.0 %."
    )
    change = f"L{order[1:]}: no setting cures that. For the rest: lag compensation (× 2)."
    assert remedy_of(result).change == change
    assert result_of(before, before=before).sentence == f"no lever cures bead ploughed: {order}."
    # what got worse is not said to be what the change is for
    worse = glue_of(2.4, 16.0)
    result = result_of(worse, before=before, combination=picked(worse, "lag compensation", before=before))
    assert result.sentence == f"no lever cures bead ploughed: {order}."
    crossed = "1 pass; the path crosses its own bead: lay it without crossings"
    most = glue_of(0.5, 2.0, crossed)
    result = result_of(most, before=before, combination=picked(most, "lift", before=before))
    not_enough = "Lift (× 2). Not enough: the path crosses its own bead: lay it without crossings."
    assert remedy_of(result).change == not_enough
    assert result.sentence == (
        "best with lift (× 2); nothing meets the tolerance: glue still fails, bead ploughed 0.5 mm, at most 0 mm. "
        "The path crosses its own bead: lay it without crossings."
    )


def test_the_lever_that_lowers_the_worst_value_is_named_first():
    before, wide, most = glue_of(14.7, 22.0), glue_of(14.7, 5.0), glue_of(1.5, 5.0)
    levers = [trial_of("lag compensation", "", before, wide), trial_of("lift", "3 mm", before, most)]
    assert result_of(most, before=before, combination=levers).sentence.startswith(
        "best with lift 3 mm; lag compensation; nothing meets the tolerance: glue still fails, bead ploughed 1.5 mm"
    )


def test_a_run_that_is_not_judged_has_no_levers_tried():
    fault = Outcome(Verdict((), "x jammed."), 1.0, "x jammed.")
    # the verdict, which stands beside it, names the fault
    assert result_of(fault, before=fault).sentence == (
        "The run ends in a fault: no lever is tried before that is repaired."
    )


def test_rows_show_the_job_each_lever_alone_and_the_combination():
    after = outcome_of(0.5, 1.5, 0.25, duration=12.5)
    trials = [trial_of("gain", "× 2", BEFORE, after), trial_of("speed", "", BEFORE, after, failure="refused")]
    result = result_of(after, trials=trials, combination=picked(after, "gain", "lift"))
    assert result.heads == ("lever", "setting", "path", "stability", "machine", "time [s]", "cost")
    assert result.rows == [
        ("unchanged", "", "50 %", "200 %", "125 %", "10.00", ""),
        ("gain", "× 2", "50 %", "150 %", "25 %", "12.50", "cost of gain"),
        ("speed", "", "–", "–", "–", "–", "refused"),
        ("= gain", "× 2", "50 %", "150 %", "25 %", "12.50", "cost of gain"),
        ("+ lift", "", "50 %", "150 %", "25 %", "12.50", "cost of lift"),
    ]
    assert result.gains == [
        "path: size 0 2.0 → 2.0 mm",
        "stability: size 0 8.0 → 6.0 mm",
        "machine: size 0 5.0 → 1.0 mm",
        "time: 10.00 → 12.50 s",
    ]
    assert result.changes_anything
    assert not result_of().changes_anything
    assert result_of().lines == {}


@pytest.mark.parametrize(
    ("usages", "text"),
    [((math.inf,), "∞"), ((math.inf, 1.5, 0.4), "∞, 150 %"), ((0.1, 0.305), "30 %"), ((math.nan,), "–")],
)
def test_a_usage_without_bound_is_told_with_the_next_one(usages, text):
    assert result_of(before=outcome_of(0.5, usages, 0.5)).rows[0][3] == text


def test_levers_that_were_not_tried_are_told_by_their_reason():
    skipped = [Skipped(lever(name), reason) for name, reason in (("a", "late"), ("b", "costly"), ("c", "late"))]
    assert result_of(skipped=skipped).untried_levers == {"late": "a, c", "costly": "b"}


def test_names_of_levers_come_with_their_settings():
    assert result_of().words_of(picked(BEFORE, "gain", "lift")) == "gain (× 2); lift"
    assert result_of().words_of([]) == ""


def test_the_frame_has_the_worst_check_of_each_row_before_and_after():
    pandas = pytest.importorskip("pandas")
    after = outcome_of(0.5, 1.5, 0.25, duration=12.5)
    result = result_of(after, trials=[trial_of("gain", "× 2", BEFORE, after)], combination=picked(after, "gain"))
    frame = result.to_frame()
    assert isinstance(frame, pandas.DataFrame)
    assert frame["combined"].tolist() == [False, True]
    first = frame.iloc[0]
    assert (first["stability_before"], first["stability_after"], first["stability_usage"]) == (8.0, 6.0, 1.5)
    assert (first["stability_state"], first["machine_state"]) == ("fail", "pass")
    assert (first["duration_s"], first["longer_by_s"], first["failure"]) == (12.5, 2.5, "")


def test_a_blob_that_e_feeds_at_rest_is_not_put_down_to_the_speed():
    """A prime of 1 mm without a retraction, where the bead begins."""
    text = "G21\nG90\nM83\nG1 X10 F3000\nG1 E1 F120\nG1 X60 E2.5 F1200\n"
    program = {"controller": "slicer.Program", "text": text}
    content = {"name": "primed", "machine": "xyz", "program": program, "dispenser": {"filament": 1.75}}
    job = Job.of_content(content, "job primed")
    reason = bound_of(job, "glue")
    assert reason == "the program link: what E feeds, at rest or for each length, varies more than the bead admits"


def test_the_first_screen_has_the_values_of_what_was_cured_and_of_what_is_left():
    """The worst of each row that was no pass, before and after, and whatever is no pass afterwards, with its limit."""
    before = verdict_of((2.0, 1.5), 0.5, 0.5)
    after = verdict_of((0.75, 0.5), 0.9, 3.0)
    texts = list(_values(SimpleNamespace(verdict=before, improved=after)))
    assert texts == [
        "size 0 8.0 → 3.0 mm",
        "size 0 2.0 → 3.6 mm, at most 4.0 mm",
        "size 0 2.0 → 12.0 mm, at most 4.0 mm",
    ]
    # the limit of the worst one is told with the verdict; what still fails leaves what else is cured in doubt
    partly = verdict_of((2.0, 0.5), 0.5, 0.5)
    texts = list(_values(SimpleNamespace(verdict=before, improved=partly)))
    assert texts == ["size 0 still 8.0 mm", "size 1 6.0 → 2.0 mm"]


def test_a_value_that_changes_its_sign_is_told_by_both_of_its_names():
    def verdict(quantity, value):
        check = Check(name="bead_width", quantity=quantity, value=value, limit=10.0, unit="%", source="given")
        return Verdict((Row.of("glue", [check]),))

    before, after = verdict("bead too narrow by", 15.2), verdict("bead too wide by", 2.6)
    (text,) = _values(SimpleNamespace(verdict=before, improved=after))
    assert text == "bead too narrow by 15.2 % → bead too wide by 2.6 %"


@pytest.mark.parametrize(
    ("acceleration", "bound"),
    [(1000.0, "the drives: their torque or speed has too little reserve"), (math.inf, "the program: it limits no acc")],
)
def test_a_program_without_a_limit_of_its_acceleration_is_what_binds_the_drives(acceleration, bound):
    """A rotary axis of FANUC has none by default, and drives that follow the others are no reason to blame it."""
    job = Job.load("fanuc-spiral").changed({"program.acceleration": acceleration})
    assert job.controller.rotary_acceleration == math.inf
    assert bound_of(job, "machine").startswith(bound)


def test_the_section_has_a_row_for_the_job_as_it_is_and_one_for_each_lever():
    good = outcome_of(0.5, 0.7, 0.6)
    trials = picked(good, "gain", "speed", "notch")
    skipped = (Skipped(lever("lift"), "the machine has no z axis"), Skipped(lever("flow"), "the machine has no z axis"))
    result = result_of(good, combination=trials[:2], trials=trials, skipped=skipped)
    section = change_section(result)
    combined, _, alone = section.table
    assert [len(combined.rows), len(alone.rows)] == [3, 4]
    assert combined.rows[0] == alone.rows[0] == result.rows[0]
    assert [row[0] for row in alone.rows[1:]] == [row[0] for row in result.trial_rows]
    assert alone.folded == "Each lever alone: 3 runs"
    assert "Not tried, as the machine has no z axis: lift, flow." in section.text
    assert section.text[0] == result.sentence
    nothing = change_section(result_of())
    assert not nothing.table
    assert not nothing.code


def test_facts_and_lines_of_the_result_tell_all_that_was_found():
    after = outcome_of(0.5, 0.6, 0.5, duration=8.0)
    found = replace(
        result_of(after, combination=picked(after, "slower")), note="a note", fastest="the fastest is 3 mm/s"
    )
    facts = found.facts()
    assert list(facts) == ["before", "after", "what to change", "note", "fastest"]
    assert (facts["note"], facts["fastest"]) == ("a note", "the fastest is 3 mm/s")
    lines = str(found).splitlines()
    assert lines[0] == f"before: {BEFORE.verdict.headline}"
    assert f"after: {after.verdict.headline}" in lines
    assert "time: 10.00 → 8.00 s" in lines
    assert lines.index("a note") > lines.index("the fastest is 3 mm/s")
    # where nothing changes, there is no after
    assert not any(line.startswith("after: ") for line in str(result_of()).splitlines())
    assert set(result_of().facts()) == {"before", "after", "what to change"}


def test_what_still_fails_without_a_value_is_left_to_its_remark():
    rows = list(outcome_of(0.5, 0.6, 0.5).verdict.rows)
    rows[1] = Row(rows[1].name, remark="unstable: axis x", state=FAIL)
    after = Outcome(Verdict(tuple(rows)), 10.0)
    assert result_of(after).by_hand == "unstable: axis x"
    assert result_of(outcome_of(0.5, 0.9, 0.5)).by_hand == ""
    assert _usages(after.verdict) == ["50 %", FAIL, "50 %"]
