"""Answers of all studies from rows whose right answer is known by hand, and the one order in which they are shown."""

from pathlib import Path

import numpy as np
import pytest

from gantrysim import Job
from gantrysim.cli.study import _say_report
from gantrysim.metrics import RepeatedPath
from gantrysim.report.document import Section
from gantrysim.report.drawn_page import write_page
from gantrysim.study import CircleStudy, LawsStudy, LoopStudy, MachineStudy, RepeatStudy, SpeedStudy
from gantrysim.study.acceptance import Acceptance, Criterion, Scope, improve_command
from gantrysim.study.cases import ASPECTS
from gantrysim.study.laws.report import laws_answer
from gantrysim.study.laws.study import LADDER
from gantrysim.study.loop.report import loop_answer, sweep_verdicts
from gantrysim.study.repeat.report import repeat_answer
from gantrysim.study.run import page_sections
from gantrysim.study.study import Details, Plot, Report
from gantrysim.study.tuning.report import question as tuning_question

from support.tunings import tuning

WHOLE = "the job's tolerance"
MOTION = "the limits of path, stability and machine"
AS_GOOD = ", with glue no worse than now"
CONTOUR = "path: contour error, max {:.1f} µm, at most 80.0 µm"


def verdict(path=40.0, glue="pass", stability="pass", machine="pass"):
    """Columns of a verdict on a run whose largest contour error may be 80 µm, each other aspect in a state."""
    states = {
        "path": "fail" if path > 80 else "warn" if path > 64 else "pass",
        "glue": glue,
        "stability": stability,
        "machine": machine,
    }
    uses = {"pass": 10.0, "warn": 90.0, "fail": 250.0, "not judged": None}
    row = {"status": "ok", "contour_max_um": path}
    for aspect, state in states.items():
        row[f"{aspect}_verdict"] = state
        row[f"{aspect}_limit_use_percent"] = uses[state]
        row[f"{aspect}_check"] = f"{aspect} in words"
    row["path_limit_use_percent"] = 100 * path / 80
    row["path_check"] = f"contour error, max {path:.1f} µm, at most 80.0 µm"
    return row


FAULT = {"status": "fault: following error on axis x"}


@pytest.fixture(scope="module")
def job():
    return Job.load("softmc-arc")


def laws(job, **paths):
    """The answer for laws with these contour errors; all others end in a fault."""
    study = LawsStudy(job)
    names = {rung.name.replace("+", "_"): rung.name for rung in LADDER}
    return laws_answer(study, {names[key]: value for key, value in paths.items()})


def test_the_law_named_is_the_cheapest_that_keeps_the_tolerance(job):
    # one law of two parts is nearer to none of its limits than another of one part, which is cheaper
    text = laws(job, pd=verdict(90.0), pid=verdict(96.0), pid_friction=verdict(8.0), pid_observer=verdict(60.0))
    assert text == (
        'Set servo.law = ["pid", "observer"]: pid+observer is the cheapest of 4 laws that keeps the job\'s tolerance, '
        f"with 75 % of the closest limit used ({CONTOUR.format(60)})."
    )
    # a part more costs more, however good it is; of equal ones, the first of the ladder
    text = laws(job, pid_learning=verdict(70.0), pid_friction=verdict(72.0), pid_friction_preview=verdict(1.0))
    assert text.startswith('Set servo.law = ["pid", "friction"]: pid+friction is the cheapest of 3')


def test_the_job_s_own_law_need_not_change_where_it_keeps_the_tolerance(job):
    text = laws(job, pd=verdict(72.0), pid=verdict(60.0))
    assert text == (
        'pd (servo.law = ["pd"]) is the cheapest of 2 laws that keeps the job\'s tolerance, with 90 % of the closest '
        f"limit used ({CONTOUR.format(72)}); the job's own law pid keeps the same limits, with 75 % used, and need not "
        "change."
    )
    assert laws(job, pd=verdict(88.0), pid=verdict(60.0)).startswith(
        'Keep servo.law = ["pid"]: pid is the cheapest of 2'
    )


def test_no_law_is_recommended_where_none_keeps_the_tolerance(job):
    text = laws(job, pd=verdict(160.0), pid=verdict(120.0), pid_friction=verdict(100.0), pid_observer=verdict(100.0))
    assert text == (  # of two that are as near, the first of the ladder
        f'None of 4 laws keeps {MOTION}: pid+observer (servo.law = ["pid", "observer"]) comes nearest, at 1.25 times '
        f"the limit ({CONTOUR.format(100)}), and the job's own law pid has 1.5 times the limit "
        f"({CONTOUR.format(120)}); gantrysim improve softmc-arc tries what else can be changed."
    )
    assert laws(job, pd={"status": "ok"}) == (
        "No law has a run that was judged by the job's tolerance, so none is recommended."
    )


def test_glue_that_fails_with_every_law_is_named_and_never_called_within_the_tolerance(job):
    text = laws(job, pd=verdict(40.0, glue="fail"), pid=verdict(20.0, glue="fail", stability="not judged"))
    assert "tolerance" not in text
    assert f"keeps {MOTION}{AS_GOOD}, with 50 % of the closest limit used" in text
    assert "; the glue fails all the same (glue in words)" in text
    alone = laws(job, pid=verdict(20.0, glue="fail", stability="not judged"))
    assert "; stability is not judged; the glue fails" in alone


def test_a_law_that_worsens_glue_which_fails_with_every_law_is_not_recommended(job):
    worse = {**verdict(20.0, glue="fail"), "glue_limit_use_percent": 400.0}
    text = laws(job, pd=worse, pid=verdict(60.0, glue="fail"), pid_friction=verdict(30.0, glue="fail"))
    assert text.startswith('Keep servo.law = ["pid"]: pid is the cheapest of 3 laws that keeps')
    kept = Scope.of([Acceptance.of(worse)], Acceptance.of(verdict(glue="fail")))
    assert kept.failures(Acceptance.of(worse)) == "glue: glue in words, worse than now"


def test_the_laws_are_reported_without_pd_where_it_has_no_run(job):
    names = {rung.name for rung in LADDER if rung.name != "pd"}
    values = (
        "following_rms_um",
        "following_along_rms_um",
        "reversal_max_um",
        "contour_rms_um",
        "torque_ripple_Nm",
        "gain_margin",
    )
    numbers = dict.fromkeys((*values, "phase_margin_deg", "sensitivity"), 2.0)
    rows = [{"law": name, "variation": "nominal", **verdict(60.0), **numbers} for name in sorted(names)]
    report = LawsStudy(job).report([{"law": "pd", "variation": "nominal", **FAULT}, *rows])
    assert "the cheapest of" in report.answer
    assert len(report.table.rows) == len(names)
    assert {row[2] for row in report.table.rows} == {None}
    assert any("has no run with values" in note for note in report.details.notes)


def swept(sweep, **rows):
    """Rows of the unchanged job, by value in ms."""
    return [{"sweep": sweep, "variant": "as it is", "value": float(key[1:]) / 1e3, **row} for key, row in rows.items()]


def test_the_loop_period_that_keeps_the_tolerance():
    study = LoopStudy(Job.load("an225"))  # of 100 ms
    rows = swept("loop_period", _5=FAULT, _10=verdict(120.0), _20=verdict(60.0), _50=verdict(72.0), _100=verdict(96.0))
    rows += swept("servo_period", _1=verdict(96.0), _2=verdict(104.0))
    text = loop_answer(study, rows, {"loop period (loop alone)": "4.6 ms"})
    assert text == (
        "Set program.loop_period = 0.05: 50 ms is the longest loop period tried that keeps the job's tolerance, with "
        f"90 % of the closest limit used ({CONTOUR.format(72)}); the contour error has knees at loop period (loop "
        "alone) 4.6 ms."
    )
    assert sweep_verdicts(study, rows)["loop_period"].kept_text == "20 ms to 50 ms"
    kept = [*rows, *swept("loop_period", _100=verdict(40.0), _200=verdict(44.0))]  # the later row counts
    text = loop_answer(study, kept, {})
    assert text.startswith("Keep program.loop_period = 0.1, which keeps the job's tolerance, with 50 % of the closest ")
    assert text.endswith("; 200 ms is the longest loop period tried that does.")


def test_the_sweep_that_comes_nearest_is_named_where_no_loop_period_keeps_the_tolerance():
    study = LoopStudy(Job.load("an225"))
    rows = swept("loop_period", _10=verdict(240.0), _100=verdict(160.0), _200=FAULT)
    rows += swept("interpreter_time", _0=verdict(160.0), _1=verdict(88.0))
    text = loop_answer(study, rows, {})
    assert text == (
        f"No loop period tried, 10 ms to 200 ms, keeps {MOTION}: 100 ms comes nearest, at 2 times the limit "
        f"({CONTOUR.format(160)}), program.interpreter_time = 0.001 nearer, at 1.1 times the limit "
        f"({CONTOUR.format(88)}); gantrysim improve an225 tries other levers."
    )
    rows += swept("servo_period", _1=verdict(16.0), _2=verdict(96.0), _4=verdict(8.0))
    assert loop_answer(study, rows, {}).endswith("; servo.period alone keeps them at 1 ms, 4 ms.")


def machines(row_of, nominal, **settings):
    study = MachineStudy(Job.load("an225"), samples=40, **settings)
    (cases,) = study.rounds()
    first, *others = ({**dict(case.tags)} for case in cases)
    return study.report([{**first, **nominal}, *({**tags, **row_of(tags)} for tags in others)])


def by_friction(tags):
    """At most 1.2 times the friction of x keeps the limit."""
    return verdict(80.0 * tags["friction_x"] / 1.2)


def test_the_yield_of_a_build_names_the_lever():
    report = machines(by_friction, verdict(60.0))
    study = MachineStudy(Job.load("an225"), samples=40)
    kept = int(np.sum(study.machines["friction_x"] <= 1.2))
    assert 0 < kept < 40
    assert report.answer.startswith(f"{kept} of 40 machines keep the job's tolerance, a yield of {2.5 * kept:.1f} %")
    assert "the lever is friction of x, to be kept low: 100 % of the machines below its median" in report.answer
    assert machines(lambda tags: verdict(8.0), verdict(8.0)).answer.endswith("; nothing of the build needs to change.")


@pytest.mark.parametrize(
    ("nominal", "failure", "limits"),
    [
        (verdict(100.0), CONTOUR.format(100), MOTION),
        (verdict(40.0, glue="fail"), "glue: glue in words", MOTION),
        (FAULT, "fault: following error on axis x", MOTION),
    ],
    ids=["path", "glue", "fault"],
)
def test_a_nominal_machine_that_fails_is_named_first(nominal, failure, limits):
    text = machines(by_friction, nominal).answer
    assert text.startswith(
        f"The nominal machine itself fails ({failure}), so tolerances of the build are not the lever: first run "
        "gantrysim improve an225; as it is, "
    )
    assert f" of 40 machines keep {limits}, a yield of " in text


def test_a_metric_of_the_user_s_own_decides_alone():
    settings = {"tolerance": 70.0, "metric": "contour_max"}
    text = machines(by_friction, verdict(75.0, glue="fail"), **settings).answer
    assert "nominal machine itself fails (largest contour error 75 µm, at most 70 µm)" in text
    text = machines(by_friction, verdict(60.0, glue="fail"), **settings).answer
    assert "itself fails" not in text
    assert "keep the tolerance of 70 µm (largest contour error)" in text


def paths_of(offsets):
    s = np.arange(3.0)
    command = np.zeros((3, 3))
    attained = [command + np.array([0, offset, 0]) * 1e-3 for offset in offsets]
    return {"all": RepeatedPath(s, command, np.array(attained))}


@pytest.mark.parametrize(
    ("rows", "offsets", "start", "end"),
    [
        ([verdict(40.0), verdict(60.0)], (40, 60), f"Yes, all 2 repeats keep the job's tolerance, with at most 75 % of "
         f"the closest limit used ({CONTOUR.format(60)}): path accuracy ATp = 50.00 µm", "of softmc-arc."),
        ([verdict(40.0), verdict(79.5)], (40, 60), "Barely, all 2 repeats keep the job's tolerance, with at most 99",
         "of softmc-arc."),
        ([verdict(40.0), verdict(120.0)], (99, 101), "No, 1 of 2 repeats keep the job's tolerance; the worst is at 1.5 "
         f"times the limit ({CONTOUR.format(120)}): ", "; the systematic error is the larger part, and gantrysim "
         "improve softmc-arc tries the levers."),
        ([verdict(40.0), verdict(120.0)], (-100, 101), "No, 1 of 2", "the scatter is the larger part, and gantrysim "
         "improve softmc-arc tries the levers."),
        ([verdict(40.0), FAULT], (40, 60), "No, 1 of 2 repeats keep the job's tolerance; the others were refused or "
         "ended in a fault: ", "tries the levers."),
    ],
    ids=["all", "barely", "systematic", "scatter", "fault"],
)  # fmt: skip
def test_repeats_are_judged_by_the_tolerance(job, rows, offsets, start, end):
    study = RepeatStudy(job, repeats=2)
    text = repeat_answer(study, [{"varied": "all", **row} for row in rows], paths_of(offsets))
    assert text.startswith(start)
    assert text.endswith(end)


def test_the_speed_is_judged_by_the_job_s_limits():
    study = SpeedStudy(Job.load("an225"))

    def report(values, **states):
        rows = []
        for speed, path in values.items():
            row = {**verdict(path, **states), "contour_rms_um": path, "program_rms_um": path}
            rows.append({"speed_mm_s": speed, **row, "speed_mean_mm_s": speed, "duration_s": 1e3 / speed})
        return study.report(rows).answer

    assert report({50.0: 20.0, 100.0: 40.0, 200.0: 88.0}) == (
        f"Keep the programmed speed: 100 mm/s, 1 times the programmed 100 mm/s, is the fastest speed that keeps "
        f"{WHOLE}; 200 mm/s does not ({CONTOUR.format(88)})."
    )
    text = report({50.0: 20.0, 100.0: 88.0}, glue="fail")
    assert text == (
        f"No speed tried, from 50 to 100 mm/s, keeps {WHOLE}: 50 mm/s comes nearest (glue: glue in words), so speed is "
        f"not the lever; gantrysim improve an225 tries the others. By {MOTION}{AS_GOOD}, 50 mm/s is the fastest."
    )
    faster = {"glue": "fail"}
    rows = [
        {"speed_mm_s": speed, **verdict(40.0, **faster), "glue_limit_use_percent": use, "contour_rms_um": 1.0}
        | {"program_rms_um": 1.0, "speed_mean_mm_s": speed, "duration_s": 1e3 / speed}
        for speed, use in ((50.0, 240.0), (100.0, 250.0), (200.0, 400.0))
    ]
    text = study.report(rows).answer
    assert text.startswith(f"No speed tried, from 50 to 200 mm/s, keeps {WHOLE}: 50 mm/s comes nearest (glue: glue")
    assert text.endswith(f"By {MOTION}{AS_GOOD}, 100 mm/s is the fastest.")
    assert report({50.0: 96.0, 100.0: 120.0}) == (
        f"No speed tried, from 50 to 100 mm/s, keeps {MOTION}: 50 mm/s comes nearest ({CONTOUR.format(96)}), so speed "
        "is not the lever; gantrysim improve an225 tries the others."
    )
    assert report({50.0: 20.0, 100.0: 40.0, 150.0: 72.0, 200.0: 88.0}) == (
        f"Keep the programmed speed: 100 mm/s, 1 times the programmed 100 mm/s, is the fastest speed that keeps "
        f"{WHOLE} without a warning; 150 mm/s does not ({CONTOUR.format(72)}); up to 150 mm/s it is kept with a "
        "warning."
    )
    assert report({50.0: 20.0, 100.0: 72.0, 150.0: 76.0, 200.0: 88.0}).endswith(
        f"150 mm/s, 1.5 times the programmed 100 mm/s, is the fastest speed that keeps {WHOLE}; 200 mm/s does not "
        f"({CONTOUR.format(88)}); without a warning up to 50 mm/s."
    )
    assert report({100.0: 72.0, 200.0: 88.0}).endswith("; no speed tried is without a warning.")


def circles(*paths):
    study = CircleStudy("xy", 40.0, 80.0)
    angle = np.arange(0, 360, 1.0)
    rows = []
    for name, path in zip(("clockwise", "counter-clockwise"), paths, strict=True):
        order = slice(None, None, -1 if name == "clockwise" else 1)
        wave = np.cos(2 * np.radians(angle[order]))
        curves = {"angle_deg": angle[order], "radial_deviation_um": 30 * wave, "motor_deviation_um": 5 * wave}
        rows.append({"direction": name, **verdict(path), **{key: curve.tolist() for key, curve in curves.items()}})
    return study.report(rows)


def test_a_circle_is_judged_by_the_tolerance():
    assert circles(20.0, 60.0).answer.startswith(
        f"Yes, both directions keep {MOTION}, with 75 % of the closest limit used ({CONTOUR.format(60)}): "
        "circular deviation G = "
    )
    assert "; the largest spike at a reversal is " in circles(20.0, 60.0).answer
    text = circles(20.0, 120.0).answer
    assert text.startswith(f"No, run counter-clockwise it is at 1.5 times the limit ({CONTOUR.format(120)}): ")
    assert text.endswith(
        "; the motors' G is 10.0 µm clockwise, so most of it arises behind the motors, and gantrysim improve job.toml "
        "tries the levers."
    )


def test_a_command_to_paste_names_the_job_of_the_folder(capsys):
    """The answer's job.toml lies beside its page, in the study's folder; the terminal stands elsewhere."""
    answer = circles(20.0, 120.0)
    _say_report(answer, Path("out") / "circle")
    assert "gantrysim improve out/circle/job.toml tries the levers." in " ".join(capsys.readouterr().out.split())


def test_a_failure_without_a_number_is_beyond_every_other():
    row = {**verdict(), "glue_verdict": "fail", "glue_limit_use_percent": None}
    acceptance = Acceptance.of(row)
    assert acceptance.use() == float("inf")
    assert acceptance.use(("path",)) == 50.0
    assert acceptance.worst() == "glue: glue in words"
    assert Scope.of([acceptance, None]).aspects == ("path", "stability", "machine")
    assert Scope.of([acceptance, Acceptance.of(verdict())]).aspects == ASPECTS
    assert Acceptance.of(FAULT) is None


def test_the_command_of_a_changed_job_names_its_file(job):
    assert improve_command(job) == "gantrysim improve softmc-arc"
    assert improve_command(job.changed({"servo.law": ["pd"]})) == "gantrysim improve job.toml"


@pytest.fixture(scope="module")
def reports():
    """A report of every study, with the question of the tuning on that of the circles."""
    rounds = circles(20.0, 60.0)
    built = machines(by_friction, verdict(60.0))
    study = LoopStudy(Job.load("an225"))
    loop = study.report([*swept("loop_period", _10=verdict(240.0), _100=verdict(160.0))])
    rows = []
    for rung in LADDER[:2]:
        values = {"following_rms_um": 5.0, "following_along_rms_um": 4.0, "reversal_max_um": 9.0}
        margins = {"gain_margin": 2.0, "phase_margin_deg": 40.0, "sensitivity": 1.8, "torque_ripple_Nm": 0.01}
        for variation in ("nominal", "exact encoder", "payload", "friction"):
            tags = {"law": rung.name, "variation": variation}
            rows.append({**tags, **verdict(), **values, **margins, "contour_rms_um": 3.0})
    ladder = LawsStudy(Job.load("softmc-arc")).report(rows)
    return {"circle": rounds, "machine": built, "loop": loop, "laws": ladder}


@pytest.mark.parametrize("name", ["circle", "machine", "loop", "laws"])
def test_every_report_has_question_answer_chart_table_and_details_in_this_order(reports, name, tmp_path, capsys):
    from matplotlib.figure import Figure

    report = reports[name]
    assert report.question.endswith("?")
    assert report.answer.endswith(".")
    assert report.chart is not None
    # the text of the figures takes long to draw and is not in question here
    plain = Plot(report.chart.name, report.chart.title, report.chart.text, Figure(), report.chart.tables)
    shown = Report(report.question, report.answer, plain, report.table, Details(report.details.notes))
    sections = page_sections(shown, [Section("Job", "spiral")])
    assert [section.title for section in sections[:3]] == ["Answer", report.chart.title, "Table"]
    assert [section.folded for section in sections] == [False] * 3 + [True] * (len(sections) - 3)
    assert sections[2].table is report.table
    write_page(tmp_path / "page.html", report.question, "study", sections)
    html = (tmp_path / "page.html").read_text()
    marks = ("<h1>", 'id="answer"', "<svg", 'id="table"', "<details>")
    places = [html.index(mark) for mark in marks]
    assert places == sorted(places)
    # a long path would be broken over lines
    _say_report(report, Path("out"))
    printed = " ".join(capsys.readouterr().out.split())
    answer = report.answer.replace("job.toml", "out/job.toml")
    texts = (report.question, answer, report.table.caption, f" {report.table.cells[0][0].split()[0]} ")
    places = [printed.rindex(" ".join(text.split())) for text in texts]
    assert places == sorted(places)
    assert all(note not in printed for note in report.details.notes)


def test_the_tuning_asks_for_its_metric(job):
    assert tuning_question(tuning(job, metric="servo_max")) == "Which gains minimise the largest servo error?"


def test_glue_is_worse_than_now_only_where_it_fails_by_more():
    def glue(state, use):
        row = verdict(path=90.0, glue=state) | {"glue_limit_use_percent": use}
        return Acceptance.of(row)

    failing = Scope.of([None], glue("fail", 120.0))
    passing = Scope.of([None], glue("pass", 50.0))
    assert failing.worsened(glue("fail", 130.0)) == ["glue"]
    assert failing.worsened(glue("fail", 121.0)) == []
    assert failing.worsened(glue("pass", 60.0)) == []
    # a limit that is kept is kept, however much of it is used
    assert passing.worsened(glue("warn", 95.0)) == []
    assert passing.worsened(glue("fail", 101.0)) == ["glue"]


def speeds(**paths):
    """The report of a search over speeds, in mm/s, with their largest contour errors."""
    rows = []
    for name, path in paths.items():
        speed = float(name[1:])
        row = {**verdict(path), "contour_rms_um": path, "program_rms_um": path} if path is not None else FAULT
        rows.append({"speed_mm_s": speed, **row, "speed_mean_mm_s": speed, "duration_s": 1e3 / speed})
    return SpeedStudy(Job.load("an225")).report(rows)


def test_faster_speeds_that_keep_the_limits_again_are_named():
    assert (
        f"200 mm/s does not ({CONTOUR.format(88)}), though 250 mm/s does again."
        in speeds(v50=20.0, v100=40.0, v200=88.0, v250=60.0).answer
    )
    several = speeds(v50=20.0, v100=40.0, v200=88.0, v250=60.0, v300=99.0, v400=50.0)
    assert several.answer.endswith(", though 250, 400 mm/s do again.")
    between = speeds(v50=20.0, v80=88.0, v100=40.0).answer
    assert between == (
        f"Keep the programmed speed: 100 mm/s keeps {WHOLE}, and the fastest speed tried that does is 100 mm/s; but "
        f"slower is not always better: from 50 mm/s down every speed tried keeps {WHOLE}, 80 mm/s does not "
        f"({CONTOUR.format(88)})."
    )


def test_every_speed_tried_and_one_that_ends_in_a_fault_are_told():
    text = speeds(v100=40.0, v200=50.0).answer
    assert text.endswith(f": every speed tried, from 100 to 200 mm/s, keeps {WHOLE}.")
    assert text.startswith("Set program.speed = 200")
    faulty = speeds(v50=20.0, v100=40.0, v200=None)
    assert "200 mm/s does not (fault: following error on axis x)" in faulty.answer
    rows = {row[0]: row for row in faulty.table.rows}
    assert rows["next"][1:] == [200.0, None, FAULT["status"], None, None, None]
    # the contour's own size is no part of it
    assert rows["fastest"][1:] == [100.0, 50.0, "program", 40.0, 100.0, 10.0]
    text = speeds(v50=None, v100=None).answer
    assert text == "Not known: none of the 2 speeds tried gives a run with values: fault: following error on axis x."


@pytest.mark.parametrize(
    ("metric", "label"),
    [
        ("x_deviation_max_um", "largest x deviation"),
        ("y_torque_rms_N·m", "rms y torque N·m"),
        ("loop_std_um", "standard deviation of loop"),
        ("gap_p95_um", "95 % gap"),
        ("lag", "lag"),
    ],
)
def test_a_metric_that_a_study_adds_is_told_by_its_words(metric, label):
    assert Criterion(metric, 1.0).label == label


def test_the_largest_source_of_scatter_is_the_lever(job):
    rows = [{"varied": "all", **verdict(40.0)}, {"varied": "all", **verdict(120.0)}]
    sources = {"friction": paths_of((-20, 21))["all"], "encoder": paths_of((-60, 61))["all"]}
    text = repeat_answer(RepeatStudy(job, repeats=2), rows, {**paths_of((-100, 101)), **sources})
    size = sources["encoder"].path_repeatability
    assert text.endswith(f"the scatter is the larger part, most of it from the encoder ({1e3 * size:.2f} µm alone).")
