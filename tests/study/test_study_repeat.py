"""Repeats of a job: accuracy and repeatability."""

from dataclasses import replace

import numpy as np
import pytest

from gantrysim.base.errors import InputError
from gantrysim.job.job import Job
from gantrysim.metrics.analysis import Analysis
from gantrysim.study import OK, Case, Report, run_study
from gantrysim.study.repeat import (
    PHASES,
    RepeatCase,
    RepeatStudy,
    has_phase,
    measure_repeat,
    phased_setpoints,
    places_along,
)

from support.distinct import unaccounted

pytestmark = pytest.mark.usefixtures("blank_pictures")

PROJECTED = 1e-5  # [mm], of a shift seen square to the path: what the repeats' lags along it make of it
SPIRAL = ("diameter=60.0", "turns=1", "thickness=10.0")


def small(*overrides):
    return Job.load("an225", [*SPIRAL, *overrides])


@pytest.mark.parametrize("phase", range(1, PHASES))
def test_a_program_that_starts_before_a_tick_is_the_same_motion_sampled_later(phase):
    job = small()
    setpoints, usual = phased_setpoints(job, phase), job.setpoints
    period = job.built_servo.period
    fine = job.controller.setpoints(period / PHASES)
    moving = len(fine.position) // PHASES
    k = np.arange(moving - 1)
    assert setpoints.position[1:moving] == pytest.approx(fine.position[k * PHASES + phase], abs=1e-12)
    assert np.array_equal(setpoints.position[0], usual.position[0])
    assert np.array_equal(setpoints.position[-1], usual.position[-1])
    # between the positions before and after, and the path is the same
    ahead = np.linalg.norm(setpoints.position[1:20] - usual.position[:19], axis=1)
    step = np.linalg.norm(usual.position[1:20] - usual.position[:19], axis=1)
    assert np.all((ahead > 0) & (ahead < step))
    assert setpoints.period == period
    assert setpoints.dispense.sum() == pytest.approx(usual.dispense.sum(), abs=1)


def test_without_a_phase_the_setpoints_are_the_jobs_own():
    job = small()
    assert phased_setpoints(job, 0) is job.setpoints


def test_a_program_bound_to_ticks_has_no_phase():
    assert has_phase(small())
    assert not has_phase(small("program.servo_period=0.001"))
    assert not has_phase(Job.load("fanuc-spiral"))
    assert not has_phase(Job.load("softmc-arc"))


def test_cases_with_different_phases_have_different_keys():
    one = RepeatCase.of(small())
    other = replace(one, phase=3)
    assert len({one.key, other.key, Case.of(small()).key}) == 3
    assert replace(other, phase=0).key == one.key


def test_places_lie_evenly_where_glue_is_laid():
    analysis = Analysis(Job.load("softmc-arc").follow())
    places = places_along(analysis, 100)
    length = analysis.run.requested.length
    assert places[0] == pytest.approx(100.0)  # after the approach
    assert places[-1] == pytest.approx(length - 85)  # before the way home
    assert np.diff(places) == pytest.approx(np.full(99, (length - 185) / 99))


def test_there_are_no_places_in_a_gap():
    program = """
    Move G1 {40, 0}
    Move G1 {60, 0} Dispense=0
    Move G1 {100, 0}
    """
    job = Job(name="gap", program={"controller": "softmc.Program", "program": program})
    places = places_along(Analysis(job.follow()), 101)
    assert places == pytest.approx([*range(41), *range(60, 101)], abs=1e-9)


def test_repeats_that_differ_in_nothing_have_no_scatter(tmp_path):
    study = RepeatStudy(small("servo.resolution=0.0", "program.servo_period=0.001"), repeats=3, friction=0.0, places=50)
    assert study.sources == ()
    outcome = run_study(study, tmp_path / "out", workers=1)
    path = study.paths(outcome.rows)["all"]
    assert path.path_repeatability < 1e-12
    assert path.path_accuracy == pytest.approx(1e-3 * outcome.rows[0]["contour_max_um"], rel=1e-9)
    assert len(outcome.rows) == 3
    _, variation = zip(*outcome.report.details.tables[0].rows, strict=True)
    assert variation == ("0 % standard deviation", "none", "none, it starts on a servo tick")


@pytest.mark.soak
def test_home_offsets_scatter_the_path_by_their_normal_component(tmp_path):
    study = RepeatStudy(Job.load("softmc-arc"), repeats=6, friction=0.0, places=60)
    assert study.sources == ("home offset",)
    outcome = run_study(study, tmp_path / "out", workers=1)
    path = study.paths(outcome.rows)["all"]
    offsets = np.array([case.perturbation.home_offset for case in next(study.rounds())])
    assert np.all(np.abs(offsets) <= 0.5 * 1e-3)
    assert np.ptp(offsets) > 0.3e-3
    normal = study.job.controller.requested.normal(path.s)[:, :2]
    across = np.abs((offsets - offsets.mean(axis=0)) @ normal.T)
    expected = across.mean(axis=0) + 3 * across.std(axis=0, ddof=1)
    smooth = np.abs(path.s[:, None] - np.cumsum([100, 100 * np.pi, 15])[None]).min(axis=1) > 2  # away from corners
    assert path.repeatability[smooth] == pytest.approx(expected[smooth], abs=PROJECTED)


def test_each_source_varies_alone_as_it_does_with_the_others():
    study = RepeatStudy(small(), repeats=4, friction=0.1)
    assert study.sources == ("friction", "home offset", "phase")
    cases = next(study.rounds())
    by = {varied: [case for case in cases if dict(case.tags)["varied"] == varied] for varied in ("all", *study.sources)}
    assert [len(group) for group in by.values()] == [4, 4, 4, 4]
    for k in range(4):
        everything = by["all"][k]
        friction, home, phase = (by[name][k] for name in study.sources)
        assert friction.perturbation.friction == everything.perturbation.friction
        assert friction.perturbation.viscous == everything.perturbation.viscous
        assert 1 not in (*friction.perturbation.viscous, *friction.perturbation.friction)
        assert friction.perturbation.home_offset == 0
        assert friction.phase == home.phase == 0
        assert home.perturbation.home_offset == everything.perturbation.home_offset
        assert home.perturbation.friction == phase.perturbation.friction == 1
        assert phase.phase == everything.phase
    scatter = np.log([case.perturbation.friction for case in next(RepeatStudy(small(), 400, 0.1).rounds())[:400]])
    assert scatter.std() == pytest.approx(0.1, rel=0.1)
    assert scatter.mean() == pytest.approx(0, abs=0.02)
    assert {case.phase for case in next(RepeatStudy(small(), 100).rounds())} == set(range(PHASES))


def test_more_scatter_of_friction_worsens_the_repeatability(tmp_path):
    found = []
    for friction in (0.01, 0.1):
        study = RepeatStudy(small("servo.resolution=0.0", "program.servo_period=0.001"), 5, friction, places=80)
        outcome = run_study(study, tmp_path / f"{friction}", workers=1)
        found.append(study.paths(outcome.rows)["all"])
        assert f"RTp = {1e3 * found[-1].path_repeatability:.2f} µm" in outcome.findings[0]
        assert f"ATp = {1e3 * found[-1].path_accuracy:.2f} µm" in outcome.findings[0]
    assert found[1].path_repeatability > 4 * found[0].path_repeatability > 0
    assert found[1].path_accuracy == pytest.approx(found[0].path_accuracy, rel=0.05)
    names = {path.name for path in (tmp_path / "0.1").iterdir()}
    assert {"curves.csv", "study.csv", "report.html", "plots"} <= names
    assert {path.name for path in (tmp_path / "0.1" / "plots").iterdir()} == {"along.png", "plan.png"}


def test_the_curves_of_a_repeat_are_the_offsets_of_the_nozzle():
    job = small()
    analysis = Analysis(job.run())
    row = measure_repeat(RepeatCase.of(job), tuple(analysis.nozzle.s[[400, 800]]))
    assert row["status"] == OK
    offset = 1e-3 * np.array([row[f"offset_{name}_um"] for name in "xyz"]).T
    assert offset == pytest.approx(analysis.nozzle.offset[[400, 800]], abs=1e-6)


def test_a_seed_has_its_own_repeats():
    first, again, other = (list(next(RepeatStudy(small(), 4, 0.1, seed=seed).rounds())) for seed in (1, 1, 2))
    assert first == again
    for one, two in zip(first, other, strict=True):
        if dict(one.tags)["varied"] in ("all", "friction"):
            assert one.perturbation.friction != two.perturbation.friction
            assert one.perturbation.viscous != two.perturbation.viscous
        if dict(one.tags)["varied"] in ("all", "home offset"):
            assert one.perturbation.home_offset != two.perturbation.home_offset
    assert [case.phase for case in first] != [case.phase for case in other]


def test_every_value_of_known_repeats_is_shown_where_it_belongs():
    """Off by 20 µm and at one place by 90; scattered by 1 µm either way, at another place by 4."""
    study = RepeatStudy(small(), repeats=2)
    count = study.s.size
    normal = study.job.controller.requested.normal(study.s)
    rows = []
    for varied, scale in (("all", 1.0), ("friction", 0.5)):
        mean, scatter = np.full(count, 20.0 * scale), np.full(count, 1.0 * scale)
        mean[7], scatter[11] = 90.0 * scale, 4.0 * scale
        for sign in (1, -1):
            offset = (mean + sign * scatter)[:, None] * normal
            curves = {f"offset_{name}_um": offset[:, i].tolist() for i, name in enumerate("xyz")}
            rows.append({"varied": varied, "status": OK, "s_mm": study.s.tolist(), **curves})
    report = study.report(rows)
    table = report.tables[0]
    assert table.heads[2:] == ["ATp [µm]", "at s [mm]", "median AT [µm]", "RTp [µm]", "at s [mm]", "median RT [µm]"]
    for (varied, repeats, *values), name, scale in zip(table.rows, ("all", "friction"), (1.0, 0.5), strict=True):
        assert (varied, repeats) == (name, 2)
        # two repeats at the same distance from their mean: no spread of it
        expected = [90 * scale, study.s[7], 20 * scale, 4 * scale, study.s[11], scale]
        assert values == pytest.approx(expected, abs=1e-6)
    assert report.answer == (
        "Not judged by a tolerance: path accuracy ATp = 90.00 µm, path repeatability RTp = 4.00 µm over 2 repeats of "
        "an225."
    )
    assert unaccounted(report.answer.replace("an225", ""), report.tables) == []
    assert report.details.notes[0].endswith(" is 22.5 times the scatter.")
    along, plan = (plot.figure for plot in report.plots)
    labels = [text.get_text() for axes in along.axes for text in axes.get_legend().texts]
    assert [label for label in labels if "µm" in label] == [
        "ATp = 90.00 µm", "limit 82 µm", "all varied, RTp = 4.00 µm", "friction alone, 2.00 µm"
    ]  # fmt: skip
    marks = {line.get_label(): line.get_xydata()[0] for line in plan.axes[0].lines}
    command = study.job.controller.requested.position(study.s)[:, :2]
    assert marks["RTp = 4.00 µm"] == pytest.approx(command[11])
    assert marks["ATp = 90.00 µm"] == pytest.approx(command[7])


def test_repeats_that_fault_are_left_out_and_counted():
    study = RepeatStudy(small(), repeats=3)
    curve = {"s_mm": [0.0], **{f"offset_{name}_um": [1.0] * study.s.size for name in "xyz"}}
    good = {"varied": "all", "status": OK, **curve}
    rows = [good, {"varied": "all", "status": "fault: travel"}, good]
    report = study.report(rows)
    assert report.details.notes[-1] == "1 of 3 runs failed and are left out."
    assert "over 2 repeats" in report.answer
    text = "Not known: fewer than two of 3 repeats have values: fault: travel."
    assert study.report(rows[1:]) == Report("Does every repeat of this job meet the tolerance?", text)


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ({"repeats": 1}, "repeats = 1: must be at least 2"),
        ({"places": 1.5}, "places = 1.5: must be at least 2"),
        ({"friction": -0.1}, "friction = -0.1: must be at least 0"),
    ],
)
def test_invalid_repeats_are_refused(values, text):
    with pytest.raises(InputError, match=text):
        RepeatStudy(Job.load("softmc-arc"), **values)
