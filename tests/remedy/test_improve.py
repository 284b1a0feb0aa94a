"""What to change in small jobs: the promised verdict, lines that keep the promise, and jobs that need nothing."""

import shlex
import tomllib
from functools import cache
from types import SimpleNamespace

import pytest

import gantrysim
from gantrysim import InputError, Job, Verdict
from gantrysim.base.quantity import number_text
from gantrysim.engine.recording import dispensed_otherwise
from gantrysim.job.causes import causes_of
from gantrysim.metrics.analysis import Analysis
from gantrysim.metrics.budget import Budget
from gantrysim.remedy.bench import Bench
from gantrysim.remedy.combination import Pick
from gantrysim.remedy.fastest import FastestProgram
from gantrysim.remedy.improve import Search, another_part, improve, worst_rows
from gantrysim.remedy.lever import Lever, Setting
from gantrysim.remedy.outcome import Motion, Outcome, motion_key
from gantrysim.remedy.report import TITLE, change_section, comparison_of
from gantrysim.results.checks import Check, Row
from gantrysim.study.cases import measure
from gantrysim.study.speed import SpeedStudy
from gantrysim.study.speed.study import Grade, SpeedAnswer

from support.remedies import (
    CIRCLE,
    DOTS,
    FLOW,
    LAG,
    LINE,
    SIDES,
    fixed_flow,
    lagging,
    lines_job,
    measured_outcome,
    outcome,
    rubbing,
)

GLUE_LEVERS = ("flow by speed", "lag compensation", "leads")


@cache
def improved():
    return improve(fixed_flow(), workers=1)


@cache
def passing():
    return lines_job(SIDES)


def job_of_toml(text):
    return Job.of_content(tomllib.loads(text), "job of a file")


def test_improve_is_public():
    assert gantrysim.improve is improve


def test_the_result_keeps_its_promise():
    result = improved()
    assert result.verdict.state == "fail"
    assert result.improved.state == "pass"
    job = job_of_toml(result.job.toml())
    assert str(Verdict.of(job, job.run())) == str(result.improved)


def test_the_lines_make_the_improved_job(tmp_path):
    result = improved()
    file = tmp_path / "small.toml"
    file.write_text(result.base.toml())
    words = shlex.split(result.lines["command line"])
    assert words[::2] == ["--set"] * (len(words) // 2)
    assert Job.load(file, words[1::2]).toml() == result.job.toml()
    tables = tomllib.loads(result.lines["job file"])
    values = {f"{table}.{key}": value for table, entries in tables.items() for key, value in entries.items()}
    assert result.base.changed(values).toml() == result.job.toml()


def test_the_combination_ends_with_the_verdict_of_the_result():
    result = improved()
    burdens = [trial.outcome.burden for trial in result.combination]
    assert burdens == sorted(burdens, reverse=True)
    assert result.combination[-1].outcome == result.after
    assert all(trial.lever.name in result.sentence for trial in result.combination)


def test_every_trial_is_that_of_its_job():
    trial = max(improved().trials, key=lambda trial: trial.outcome.duration)
    job = fixed_flow().changed(trial.changes)
    assert trial.outcome == measured_outcome(job)
    glue = next(gain for gain in trial.gains if gain.row == "glue")
    assert glue.before == improved().verdict["glue"].checks[0].value
    assert trial.time == pytest.approx(job.run().time[-1] - improved().before.duration)


def test_the_result_does_not_depend_on_the_number_of_threads():
    one = improve(fixed_flow(), levers=GLUE_LEVERS, workers=1)
    several = improve(fixed_flow(), levers=GLUE_LEVERS, workers=3)
    assert one.rows == several.rows
    assert str(one) == str(several)


def test_a_job_that_passes_needs_nothing():
    result = improve(passing())
    assert result.sentence == "nothing to change: the verdict is pass."
    assert (result.trials, result.combination, result.lines) == ((), (), {})
    assert result.job is passing()


def test_a_run_that_ends_in_a_fault_has_no_levers_tried():
    result = improve(lines_job(SIDES, servo={"following_error_limit": 1e-4}))
    assert "following error" in result.verdict.fault
    assert "no lever is tried" in result.sentence
    assert result.trials == ()
    assert result.verdict.fault in str(result)


@pytest.mark.soak
def test_what_forbids_it_is_named():
    """A path limit far below the encoder's count, and the levers of the glue alone."""
    job = lines_job(CIRCLE, tolerance={"path_max": 1e-4})
    result = improve(job, levers=["integral time"], fastest=False)
    assert result.improved.state == "fail"
    assert "nothing meets the tolerance: path still fails" in result.sentence
    assert "What forbids it is the servo link" in result.sentence


def test_the_dispenser_is_named_where_it_forbids():
    result = improve(lagging(), levers=["leads"])
    assert "what forbids it is the dispenser, which lags by 5 ms dead time, 20 ms opening" in result.sentence


def test_levers_of_rows_that_pass_are_not_tried():
    names = {skipped.lever.name: skipped.reason for skipped in improved().skipped}
    assert names["friction compensation"] == "path passes"
    assert names["loop period"] == "the program commands its path without a loop"
    assert {trial.lever.name for trial in improved().trials}.isdisjoint(names)


def test_levers_against_causes_that_do_not_matter_are_not_tried(monkeypatch):
    result = improve(rubbing(), levers=["friction compensation", "encoder"])
    causes = causes_of(rubbing())
    monkeypatch.setattr("gantrysim.remedy.improve.causes_of", None)  # known causes are not looked for again
    assert improve(rubbing(), levers=["encoder"], causes=causes).skipped == result.skipped
    assert [trial.lever.name for trial in result.trials] == ["friction compensation"]
    assert [skipped.reason for skipped in result.skipped] == ["the error is not caused by counts"]
    assert result.improved.state == "pass"


@pytest.mark.parametrize(
    ("usages", "worst"),
    [
        ((0.8, 0.7, 0.0, 0.1), []),
        ((0.8, 0.81, 0.0, 0.1), ["glue"]),
        ((1.1, 1.2, 0.5, 0.9), ["glue", "path"]),
        ((1.1, 1.2, 3.0, 2.0), ["stability", "machine"]),
    ],
)
def test_the_two_worst_rows_are_asked_about(usages, worst):
    names = ("path", "glue", "stability", "machine")
    rows = []
    for name, usage in zip(names, usages, strict=True):
        check = Check(name=name, quantity=name, value=usage, limit=1.0, unit="", source="given")
        rows.append(Row.of(name, [check]))
    assert worst_rows(Outcome(Verdict(tuple(rows)))) == worst
    assert worst_rows(Outcome(None)) == []


def test_only_the_wanted_rows_are_improved():
    assert worst_rows(outcome(fixed_flow())) == ["glue"]
    assert improve(fixed_flow(), rows=["path"]).trials == ()


def test_a_lever_that_can_be_spared_is_left_out():
    """The first lever to join is made useless by the second."""

    def lever(name, values):
        return Lever(name, name, "none", ("glue",), lambda state: [Setting("", values)])

    half = lever("half", {"dispenser.opening": 0.01, "dispenser.closing": 0.01, "dispenser.dead_time": 0.0})
    whole = lever("whole", {"dispenser.opening": 0.0, "dispenser.closing": 0.0, "dispenser.dead_time": 0.0})
    search = Search(lagging(), Bench(lagging(), 1), ("glue",))
    assert [pick.lever.name for pick in search.best_picks([half, whole])] == ["whole"]
    both = [Pick(half, ""), Pick(whole, "")]
    assert search._combinations.without_spare(both) == [both[1]]


def test_no_setting_may_change_the_part():
    """Half the flow is half the section; 0.2 s of dwell lay twice the dot of 0.1 s, but for a tick of the move."""
    before = outcome(lines_job(DOTS, dispenser={"flow": 40.0}))
    assert another_part(before, before) == ""
    assert "another bead" in another_part(before, outcome(lines_job(DOTS, dispenser={"flow": 20.0})))
    longer = outcome(lines_job(DOTS.replace("P0.1", "P0.2"), dispenser={"flow": 40.0}))
    assert another_part(before, longer) == "another volume of dots, +99.0 %"
    assert another_part(before, outcome(lines_job(SIDES, dispenser={"flow": 40.0}))) == "0 dots instead of 1"


@pytest.mark.parametrize(
    "changes",
    [
        {"dispenser.flow": 0.0, "dispenser.area": 2.0, "dispenser.advance": 0.02},
        {"dispenser.stop_lead": 0.01, "dispenser.dead_time": 0.002},
        {"bead.gap": 0.7},
    ],
)
def test_glue_laid_along_a_record_is_that_of_a_run_of_its_own(changes):
    job = fixed_flow()
    other = job.changed(changes)
    assert motion_key(other) == motion_key(job)
    assert Bench(job, workers=1).measure_all([job, other]) == [measured_outcome(job), measured_outcome(other)]
    laid = dispensed_otherwise(job.run(), other.dispenser)
    assert laid.flow.tolist() == other.run().flow.tolist()


def test_a_start_lead_that_does_not_hold_the_program_back_leaves_the_motion():
    """The line begins to be laid after a move of 40 mm, which takes longer than the first lead and not the second."""
    job = lines_job(LINE, dispenser={"area": 2.0, **LAG})
    early = job.changed({"dispenser.start_lead": 0.2})
    assert motion_key(early) == motion_key(job)
    assert Bench(job, workers=1).measure_all([job, early]) == [measured_outcome(job), measured_outcome(early)]
    assert measured_outcome(early) != measured_outcome(job)
    held = job.changed({"dispenser.start_lead": 1.0})
    assert motion_key(held) != motion_key(job)
    assert held.run().time[-1] > job.run().time[-1]


def test_a_motion_is_simulated_once_as_long_as_it_is_kept(monkeypatch):
    job = fixed_flow()
    others = [job.changed({"dispenser.stop_lead": lead}) for lead in (0.01, 0.02)]
    wanted = [measured_outcome(other) for other in others]
    runs = []
    run = Job.run
    monkeypatch.setattr(Job, "run", lambda self, **options: runs.append(self) or run(self, **options))
    bench = Bench(job, workers=1)
    assert bench.measure(job) != wanted[0]
    assert bench.measure(others[0]) == wanted[0]
    assert len(runs) == 1
    monkeypatch.setattr("gantrysim.remedy.bench.KEPT_ROOM", 0)
    bench.measure(job.changed({"bead.gap": 0.7}))  # with a motion that is still kept, and dropped thereafter
    assert bench.measure(others[1]) == wanted[1]
    assert len(runs) == 2


def test_a_run_that_is_known_is_not_made_again(monkeypatch):
    job = fixed_flow()
    budget = Budget(Analysis(job.run()))
    runs = []
    run = Job.run
    monkeypatch.setattr(Job, "run", lambda self, **options: runs.append(self) or run(self, **options))
    shown = improve(job, levers=GLUE_LEVERS, budget=budget, workers=1)
    saved = len(runs)
    assert str(shown) == str(improve(job, levers=GLUE_LEVERS, workers=1))
    assert len(runs) == 2 * saved + 1


@pytest.mark.parametrize(
    "changes", [{"dispenser.start_lead": 0.5}, {"servo.integral_time": 0.02}, {"program.acceleration": 2000.0}]
)
def test_other_motions_are_run(changes):
    assert motion_key(fixed_flow().changed(changes)) != motion_key(fixed_flow())


def test_the_fastest_program_is_as_good_and_the_next_is_not():
    """A fifth of the axis' speed of 1000 mm/s is admitted, and the line runs at half of that."""
    job = lines_job(LINE, tolerance={"speed_reserve": 80.0}).changed(
        {"program.acceleration": 4e3, "program.rapid": 6e4}
    )
    result = improve(job, levers=[])
    fastest = result.fastest
    assert fastest is not None
    assert fastest.speed > fastest.programmed_speed == pytest.approx(100)
    assert result.improved.state != "fail"
    assert result.job.controller.programmed_speed == pytest.approx(fastest.speed)
    assert fastest.speed < fastest.search.above <= 1.02 * fastest.speed + 0.1
    assert improve(job, levers=[], fastest=False).fastest is None
    # it is said wherever the result is
    assert result.facts()["fastest"] == str(fastest)
    assert f"{fastest}." in change_section(result).text
    assert str(fastest) in str(result)
    assert not comparison_of(result).are_same
    limited = job.changed({"program.axis_speeds": [100.0, 100.0, 100.0]})  # mm/s
    assert improve(limited, levers=[]).fastest is None


def test_a_search_that_ends_without_a_failure_is_not_called_the_fastest():
    """Beyond 848 mm/s the ramps decide the duration; none of the speeds tried, up to 4800 mm/s, fails."""
    ended = SpeedAnswer(4800.0, None)
    found = SpeedAnswer(300.0, 303.0)
    job, run = object(), SimpleNamespace(duration=2.7)
    saturated = FastestProgram(848.5, 150.0, ended, Grade.WARNED, found, job, run)
    assert str(saturated) == (
        "fastest program without a failure: 848.5 mm/s instead of 150 mm/s, 2.70 s (a faster one takes as long; the "
        "search ended at 4800 mm/s); without a warning up to 300 mm/s"
    )
    clean = FastestProgram(300.0, 150.0, found, Grade.CLEAN, ended, job, run)
    assert str(clean) == (
        "fastest program without a warning: 300 mm/s instead of 150 mm/s, 2.70 s (not at 303 mm/s); without a failure "
        "up to 4800 mm/s, where the search ended"
    )


@pytest.mark.soak
def test_the_fastest_program_is_that_of_the_speed_study():
    """Both name the speed without a warning, and the one without a failure."""
    job = lines_job(LINE, tolerance={"speed_reserve": 60.0})
    job = job.changed({"program.acceleration": 8e3, "program.rapid": 6e4})
    fastest = improve(job, levers=[]).fastest
    study = SpeedStudy(job)
    rows = []
    rounds = study.rounds()
    cases = next(rounds)
    while cases:
        rows += (new := [{**dict(case.tags), **measure(case)} for case in cases])
        try:
            cases = rounds.send(new)
        except StopIteration:
            break
    answer = study.report(rows).answer
    assert f"{fastest.speed:g} mm/s" in answer
    assert f"up to {fastest.other.fastest:g} mm/s" in answer
    assert f"without a failure up to {fastest.other.fastest:.4g} mm/s" in str(fastest)
    # of the axis' 1000 mm/s, 60 % must remain; a warning begins where less than 60 / 0.8 % does; an axis overshoots
    assert fastest.speed == pytest.approx(250, rel=0.06)
    assert fastest.other.fastest == pytest.approx(400, rel=0.06)
    fixed = lines_job(LINE, dispenser={"flow": FLOW})
    assert SpeedStudy(fixed).overrides(150.0) == {"program.feed_override": 1.5, "dispenser.flow": 1.5 * FLOW}


def test_what_is_recommended_is_mujocos_run_and_not_the_searchs(monkeypatch):
    """They differ in the last digits; where they differ by more, a note says so."""
    found = improve(fixed_flow(), levers=GLUE_LEVERS, workers=1)
    assert found.changes_anything
    assert found.note == ""
    shown, searched = (Motion.of(found.job, engine).outcome(found.job) for engine in ("mujoco", "loop"))
    assert found.after == shown != searched
    before = Motion.of(found.base, "mujoco").outcome(found.base)
    assert found.before == before
    monkeypatch.setattr("gantrysim.remedy.bench.difference_note", lambda *runs: "They differ.")
    assert "They differ." in str(improve(fixed_flow(), levers=GLUE_LEVERS, workers=1))


def test_progress_counts_the_runs():
    told = []
    improve(fixed_flow(), levers=["leads"], workers=1, progress=lambda *news: told.append(news))
    assert told[0] == (0, 1, "the job")
    assert all(done <= known for done, known, _ in told)
    assert told[-1][0] == told[-1][1] >= 3


def test_unknown_names_are_refused():
    with pytest.raises(InputError, match=r"unknown lever 'leeds'.*leads"):
        improve(passing(), levers=["leeds"])
    with pytest.raises(InputError, match=r"unknown row of the verdict 'glu'.*glue"):
        improve(passing(), rows=["glu"])
    with pytest.raises(InputError, match="workers = 0"):
        improve(passing(), workers=0)


def test_a_refused_job_is_refused():
    with pytest.raises(InputError, match="unstable"):
        improve(lines_job(SIDES, servo={"kp": 100.0, "kd": 0.0}))


def test_the_table_of_data_has_a_row_per_trial():
    pytest.importorskip("pandas")
    result = improved()
    frame = result.to_frame()
    assert len(frame) == len(result.trials) + len(result.combination)
    last = frame.iloc[-1]
    assert last["combined"]
    assert last["glue_state"] == result.improved["glue"].state
    assert last["glue_before"] == result.verdict["glue"].checks[0].value


def test_the_section_of_a_report():
    result = improved()
    section = change_section(result)
    assert section.title == TITLE == "What to change"
    assert result.sentence in section.text
    combined, checks, alone = section.table
    assert not combined.folded
    for name, verdict in (("before", result.verdict), ("after", result.improved)):
        column = checks.heads.index(name)
        shown = {tuple(row[:2]): row[column].split()[0] for row in checks.rows}
        for row in verdict.rows:
            for check in row.checks:
                texts = [text for (of, words), text in shown.items() if of == row.name and check.quantity in words]
                assert number_text(check.value, check.form) in texts
    assert alone.folded == f"Each lever alone: {len(result.trials)} runs"
    assert [result.rows[0], *alone.rows[1:], *combined.rows[1:]] == result.rows
    assert all(text.rstrip() in section.code for text in result.lines.values())
    unchanged = improve(passing())
    nothing = change_section(unchanged)
    assert nothing.table is None
    assert nothing.code is None
    assert "fastest" not in unchanged.facts()
    assert comparison_of(unchanged) is None


@pytest.mark.parametrize(
    ("nominal", "dots", "text"),
    [
        (2.0, (4.0, 5.0), ""),
        (2.4, (4.0, 5.0), "another bead: 2.4 mm² instead of 2 mm²"),
        (2.0, (4.0,), "1 dots instead of 2"),
        (2.0, (4.0, 6.0), "another volume of dots, +20.0 %"),
        (2.0, (3.0, 5.5), "another volume of dots, −25.0 %"),
    ],
)
def test_another_part_is_told_by_its_section_and_its_dots(nominal, dots, text):
    before = SimpleNamespace(nominal=2.0, dots=(4.0, 5.0))
    assert another_part(before, SimpleNamespace(nominal=nominal, dots=dots)) == text


def test_a_result_shows_itself_in_a_notebook():
    html = improved()._repr_html_()
    assert "What to change in small" in html
    assert "flow by speed" in html
    assert improved().improved.headline in html


def test_dots_that_get_no_glue_are_said_so_and_nothing_else_is_blamed():
    """Glue by an area lays none at rest: the row has no checks, and no speed of the program is at fault."""
    text = "G21 G90 F600\nM62 P0\nG4 P0.5\nM63 P0\nG0 X10\nM62 P0\nG4 P0.5\nM63 P0\nM2"
    result = improve(lines_job(text, dispenser={"area": 1.0}), workers=1)
    assert result.verdict["glue"].state == "fail"
    assert result.sentence.endswith(
        "glue still fails, 2 dots get no glue: none is requested at rest; dispenser.flow lays it "
        "there, an area times the speed does not."
    )
