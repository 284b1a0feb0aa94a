"""The verdict by dot: volume, place and string, beside beads and alone, as it is shown."""

import json

import pytest

from gantrysim import Job, Verdict
from gantrysim.cli.tables import outcome_table
from gantrysim.glue.bead import Bead
from gantrysim.metrics.analysis import Analysis
from gantrysim.metrics.budget import Budget
from gantrysim.report.page import write_run_page
from gantrysim.report.rows import dot_rows
from gantrysim.report.summary import summary
from gantrysim.report.viewer_data import ViewerData
from gantrysim.results.run_results import RunResults

DOTS = "G21 G90 G61\n" + "".join(
    f"G0 X{x} Y{y}\nG0 Z0\nM3\nG4 P{time}\nM5\nG0 Z3\n" for x, y, time in ((0, 0, 0.1), (8, 0, 0.2), (0, 8, 0.1))
)
STROKE = "G0 X0 Y20\nG0 Z0\nM3\nG1 X40 F1800\nM5\nG0 Z3\n"
VOLUMES = [2.0, 4.0, 2.0]


def dots_job(text=DOTS, dispenser=None, **tables):
    content = {
        "name": "dots",
        "machine": "xyz",
        "program": {"controller": "linuxcnc.Program", "text": text},
        "dispenser": {"flow": 20.0} | (dispenser or {}),
        **tables,
    }
    return Job.of_content(content, "job dots")


def followed(job):
    return job.follow()


def results_of(job, run):
    analysis = Analysis(run)
    return RunResults(job, job.built_machine, Budget(analysis), Bead(run, job.bead, analysis))


def glue(job, run):
    return Verdict.of(job, run)["glue"]


def test_dots_alone_are_judged_by_dot_and_not_as_a_bead():
    job = dots_job()
    row = glue(job, followed(job))
    assert row.state == "pass"
    assert {check.name for check in row.checks} == {"dot_volume", "dot_place", "dot_string", "bead_ploughed"}
    assert row.values["passes_through_glue"] == 0
    assert row.remark == "3 dots, 8 mm³ in all, 2.51 to 3.17 mm wide on the work: none out of tolerance"
    dots = row.values["dots"]
    assert [dot["volume_mm3"] for dot in dots] == pytest.approx(VOLUMES, rel=1e-9)
    assert [dot["requested_volume_mm3"] for dot in dots] == pytest.approx(VOLUMES, rel=1e-9)
    assert [dot["program_line"] for dot in dots] == [5, 11, 17]
    assert [dot["state"] for dot in dots] == ["pass"] * 3


def test_a_dot_with_too_little_glue_is_named():
    job = dots_job()
    run = followed(job)
    flow = run.flow.copy()
    second = Bead(run, job.bead).dots[1]
    flow[slice(*second.stretch)] *= 0.8
    row = glue(job, run.replaced(flow=flow))
    assert row.state == "fail"
    assert str(row.checks[0]).startswith("dot 2 too small by 20.0 %, at most 10.0 % (default): t = ")
    assert row.remark.endswith("1 out of tolerance, no. 2")
    assert [dot["state"] for dot in row.values["dots"]] == ["pass", "fail", "pass"]
    tolerant = dots_job(tolerance={"dot_volume": 30.0})
    assert glue(tolerant, run.replaced(flow=flow)).state == "pass"


def test_a_dot_off_its_place_is_named():
    job = dots_job()
    run = followed(job)
    nozzle = run.nozzle.copy()
    nozzle[slice(*Bead(run, job.bead).dots[2].share)] += [0.1, 0.0, 0.0]
    row = glue(job, run.replaced(nozzle=nozzle))
    assert str(row.checks[0]).startswith("dot 3 off its place by 0.100 mm, at most 0.082 mm (default): t = ")
    assert row.state == "fail"
    assert glue(dots_job(tolerance={"dot_place": 0.2}), run.replaced(nozzle=nozzle)).state == "pass"


def test_a_needle_that_lifts_before_the_valve_has_closed_draws_a_string():
    hasty = dots_job(dispenser={"opening": 0.1, "closing": 0.1})
    row = glue(hasty, followed(hasty))
    assert row.state == "fail"
    assert {check.name for check in row.checks if check.state == "fail"} == {"dot_string", "dot_volume"}
    patient = dots_job(DOTS.replace("M5\n", "M5\nG4 P1\n"), {"opening": 0.1, "closing": 0.1})
    assert glue(patient, followed(patient)).state == "pass"


def test_the_target_of_a_job_goes_before_what_the_program_requests():
    job = dots_job(bead={"dot_target": 2.0})
    row = glue(job, followed(job))
    assert [dot["volume_error_percent"] for dot in row.values["dots"]] == pytest.approx([0, 100, 0], abs=1e-6)
    assert str(row.checks[0]).startswith("dot 2 too large by 100.0 %")


def test_a_flow_in_proportion_to_the_speed_lays_no_dots():
    """Once a pass with 0.0004 mm³."""
    job = dots_job(dispenser={"flow": 0.0, "area": 1.0})
    row = glue(job, followed(job))
    assert row.state == "fail"
    assert row.remark.startswith("3 dots get no glue: none is requested at rest; dispenser.flow lays it there")


def test_dots_without_glue_beside_a_good_bead_are_named_first():
    """Once "fail: bead too wide by 0.1 %, at most 10.0 %"."""
    job = dots_job(STROKE + DOTS.replace("G21 G90 G61\n", ""), dispenser={"flow": 0.0, "area": 1.0})
    row = glue(job, followed(job))
    assert row.state == "fail"
    assert row.texts[0].startswith("3 dots get no glue")
    assert {check.state for check in row.checks} == {"pass"}


def test_a_job_without_glue_is_a_warning_with_dots_too():
    job = dots_job(dispenser={"flow": 0.0})
    row = glue(job, followed(job))
    assert row.state == "warn"
    assert row.remark == "nothing was laid: no glue is requested"


def test_dots_beside_a_bead_get_both_verdicts():
    job = dots_job(STROKE + DOTS.replace("G21 G90 G61\n", ""))
    run = followed(job)
    row = glue(job, run)
    names = {check.name for check in row.checks}
    assert {"dot_volume", "dot_place", "dot_string", "bead_width", "start_length", "stop_length"} <= names
    assert row.state == "pass"
    assert "3 dots, 8 mm³ in all" in row.remark
    assert "width out of tolerance on 0 %" in row.remark
    # the bead has its own volume alone: 40 mm at 30 mm/s with 20 mm³/s
    assert results_of(job, run).bead_values.volume == pytest.approx(20 * (40 / 30 + 30 / 1000), rel=1e-3)
    flow = run.flow.copy()
    flow[slice(*Bead(run, job.bead).dots[0].stretch)] = 0.0
    broken = glue(job, run.replaced(flow=flow))
    assert broken.state == "fail"
    assert str(broken.checks[0]).startswith("dot 1 too small by 100.0 %")


def test_dots_are_shown_in_summary_terminal_page_and_viewer(tmp_path):
    job = dots_job()
    results = results_of(job, followed(job))
    content = json.loads(json.dumps(summary(results)))
    assert [dot["diameter_mm"] for dot in content["verdict"]["glue"]["dots"]] == pytest.approx(
        [dot.diameter for dot in results.bead.dots]
    )
    assert content["bead"] is None
    table = outcome_table(results.budget.analysis, None, None, results.dots)
    rows = dict(zip(table.columns[0]._cells, table.columns[2]._cells, strict=True))
    assert rows["dots"] == "8 mm³ in all, 2 to 4 mm³ each"
    viewer = ViewerData(results).content()["dots"]
    assert [(dot["x"], dot["y"], dot["failed"]) for dot in viewer] == [
        (pytest.approx(x), pytest.approx(y), False) for x, y in ((0, 0), (8, 0), (0, 8))
    ]
    assert [dot["z"] for dot in viewer] == pytest.approx([-results.bead.gap] * 3)
    assert ViewerData(results).content()["width"] is None
    write_run_page(tmp_path / "report.html", results)
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "Dots as laid: caps on the work" in page


@pytest.mark.parametrize("key", ["dot_volume", "dot_place", "dot_string"])
def test_tolerances_of_dots_are_above_0(key):
    with pytest.raises(ValueError, match=key):
        dots_job(tolerance={key: 0.0})


def test_e_fed_at_rest_alone_lays_dots_and_a_retraction_none():
    """0.5 mm of a filament of 1.75 mm is 1.203 mm³, and what undoes a retraction lays nothing; nor does the travel."""
    text = "G21\nG90\nM83\n" + "".join(
        f"G1 X{x} F3000\nG1 Z0 F600\nG1 E{e} F60\nG1 E-0.2\nG1 Z4 F600\n" for x, e in ((10, 0.5), (20, 0.7))
    )
    program = {"controller": "slicer.Program", "text": text}
    content = {"name": "syringe", "machine": "xyz", "program": program, "dispenser": {"filament": 1.75}}
    job = Job.of_content(content, "job syringe")
    dots = glue(job, followed(job)).values["dots"]
    assert [dot["asked_mm"][0] for dot in dots] == [10, 20]
    section = 0.25 * 3.14159265 * 1.75**2
    assert [dot["volume_mm3"] for dot in dots] == pytest.approx([0.5 * section] * 2, rel=5e-3)


@pytest.mark.parametrize("beside", ["", STROKE])
def test_a_low_move_over_dots_fails(beside):
    """By a detour over the dots in (0, 0) and (8, 0), whose cap of 60 deg is 0.91 mm high, 0.5 mm above the work."""
    job = dots_job(DOTS + "G0 Z0\nG0 X-8\nG0 Y0\nG0 X16\nG0 Z3\n" + beside)
    row = glue(job, followed(job))
    assert row.state == "fail"
    (check,) = (check for check in row.checks if check.name == "bead_ploughed")
    # both diameters, which the remark gives
    assert check.value == pytest.approx(2.51 + 3.17, abs=0.01)
    assert check.place.line == 23
    assert "needle through its own glue, 2 dots among it: 2 passes, 5.7 mm in all, up to 0.41 mm deep" in row.remark
    assert row.remark.endswith("lift the needle before this dry move")
    assert row.values["passes_through_glue"] == 2
    assert all(dot["state"] == "pass" for dot in row.values["dots"])


def test_e_fed_at_rest_beside_a_bead_lays_a_dot_beyond_what_undoes_a_retraction():
    """By hand: E0.5 lays 0.5 mm of filament; of E1.4 after E-0.8, 0.6 mm; E0.8 before the bead undoes E-0.8."""
    text = (
        "G21\nG90\nM83\nG1 X10 F3000\nG1 E0.5 F60\nG1 E-0.8\nG1 Z4 F600\nG1 X20\nG1 Z0\nG1 E0.8\nG1 X60 E2\n"
        "G1 E-0.8\nG1 Z4\nG1 X80\nG1 Z0\nG1 E1.4\nG1 E-0.8\nG1 Z4\n"
    )
    program = {"controller": "slicer.Program", "text": text}
    content = {"name": "syringe", "machine": "xyz", "program": program, "dispenser": {"filament": 1.75}}
    job = Job.of_content(content, "job syringe")
    run = followed(job)
    dots = glue(job, run).values["dots"]
    section = 0.25 * 3.14159265 * 1.75**2
    assert [dot["asked_mm"][0] for dot in dots] == [10, 80]
    assert [dot["volume_mm3"] for dot in dots] == pytest.approx([0.5 * section, 0.6 * section], rel=5e-3)
    assert results_of(job, run).bead.values.volume == pytest.approx(2 * section, rel=5e-3)


def test_the_mean_diameter_of_dots_is_that_over_all_of_them():
    """Diameters go with the cube root of the volume: two of 2 mm³ and one of 4."""
    job = dots_job()
    dots = results_of(job, followed(job)).dots
    small = dots[0].dot.diameter
    large = dots[1].dot.diameter
    assert large == pytest.approx(2 ** (1 / 3) * small)
    _, (name, mean, remark) = dot_rows(dots)
    assert (name, mean) == ("dot diameter", f"{(2 * small + large) / 3:.3f} mm")
    assert remark == f"{small:.3f} to {large:.3f}, on the work"
