"""The verdict on runs whose errors are made: what fails, by how much, and where."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from gantrysim import Fault, InputError, Job, Tolerance, Verdict
from gantrysim.glue.bead import Bead
from gantrysim.job.tolerance import ToleranceSettings
from gantrysim.metrics.analysis import Analysis
from gantrysim.metrics.budget import Budget
from gantrysim.render.colours import scale_for
from gantrysim.report.plots.bead import draw_laid
from gantrysim.report.plots.plan import draw_coloured_plan
from gantrysim.report.viewer_data import ViewerData
from gantrysim.results.checks import Check, Place, Row
from gantrysim.results.glue import BeadWidth
from gantrysim.results.run_results import RunResults
from gantrysim.results.score import burden_of
from gantrysim.servo.stability.margins import Margins

from support.jobs import job_run
from support.remedies import spiral_job
from support.soaked import suite_runs

NEEDLE = 0.82  # outer diameter [mm]
AREA = 2.0  # [mm²]
SPEED = 100.0  # [mm/s]

# one straight line from x = -80 to 80 mm; the second half is the move of line 5
LINE = """G21 G17 G90 G94 G64
G0 X-80 Y0
M62 P0
G1 X0 F6000
G1 X80
M63 P0
M2
"""
SECOND_HALF = 5
STEPPERS = Path(__file__).parents[2] / "examples" / "machines" / "stepper.toml"
SESSILE = {"squashed": False}  # a circular segment: its width goes with the root of its area


def line_job(**tables):
    content = {
        "name": "line",
        "machine": "xyz",
        "program": {"controller": "linuxcnc.Program", "text": LINE},
        "dispenser": {"area": AREA},
        "bead": SESSILE,
        **tables,
    }
    return Job.of_content(content, "job line")


@pytest.fixture(scope="module")
def job():
    return line_job()


@pytest.fixture(scope="module")
def follower(job):
    return job.follow()


def tick_at(run, x):
    """The dispensing tick whose command is nearest to a place."""
    distance = np.where(run.dispense, np.abs(run.commanded_tip[:, 0] - x), np.inf)
    return int(distance.argmin())


def between(run, low, high):
    x = run.commanded_tip[:, 0]
    return run.dispense & (x >= low) & (x < high)


def only(checks, name):
    (check,) = [check for check in checks if check.name == name]
    return check


def test_a_perfect_follower_passes(job, follower):
    verdict = Verdict.of(job, follower)
    assert verdict.state == "pass"
    assert [row.name for row in verdict.rows] == ["path", "glue", "stability", "machine"]
    assert [row.state for row in verdict.rows] == 4 * ["pass"]
    assert only(verdict["path"].checks, "path_max").value == pytest.approx(0, abs=1e-6)
    assert only(verdict["glue"].checks, "bead_width").value == pytest.approx(0, abs=0.1)
    assert verdict["glue"].content()["blobs"] == verdict["glue"].content()["gaps"] == 0
    # it takes no torque; its speed is 100 of the axis' limit
    assert only(verdict["machine"].checks, "torque_reserve").value == 100
    (axis,) = (axis for axis in job.built_machine.axes if axis.name == "x")
    fastest = np.abs(np.diff(follower.motor[:, 0])).max() / follower.period
    expected = 100 * (1 - fastest / axis.speed_limit)
    assert only(verdict["machine"].checks, "speed_reserve").value == pytest.approx(expected, abs=0.5)


@pytest.mark.parametrize(("offset", "state"), [(0.05, "pass"), (0.07, "warn"), (0.1, "fail")])
def test_an_offset_of_the_nozzle_is_found_at_its_place_and_line(job, follower, offset, state):
    tick = tick_at(follower, 40.0)
    nozzle = follower.nozzle.copy()
    nozzle[tick, 1] += offset
    row = Verdict.of(job, follower.replaced(nozzle=nozzle))["path"]
    check = only(row.checks, "path_max")
    assert row.state == check.state == state
    assert check.value == pytest.approx(1e3 * offset)
    assert check.limit == pytest.approx(82.0)
    assert check.source == "default"
    assert check.place.time == pytest.approx(follower.time[tick])
    assert check.place.point[0] == pytest.approx(40.0, abs=0.1)
    assert check.place.line == SECOND_HALF
    # a single tick is less than 5 % of them
    assert only(row.checks, "path_p95").value == pytest.approx(0, abs=1e-6)


def test_an_offset_everywhere_fails_by_its_95th_percentile_first(job, follower):
    nozzle = follower.nozzle + np.array([0.0, 0.05, 0.0])
    row = Verdict.of(job, follower.replaced(nozzle=nozzle))["path"]
    assert [(check.name, check.state) for check in row.checks] == [("path_p95", "fail"), ("path_max", "pass")]
    assert row.checks[0].value == pytest.approx(50.0)


@pytest.mark.parametrize(
    ("everywhere", "once", "limit"), [(0.05, 0.0, 41.0), (0.0, 0.1, 82.0), (0.05, 0.1, 82.0), (0.01, 0.0, 82.0)]
)
def test_pictures_show_the_path_in_shares_of_the_limit_for_which_it_fails(job, follower, everywhere, once, limit):
    """An error of 50 µm everywhere fails for 41 µm at 95 % and must not be drawn within 82 µm."""
    nozzle = follower.nozzle + np.array([0.0, everywhere, 0.0])
    nozzle[tick_at(follower, 40.0), 1] += once
    run = replace(follower.replaced(nozzle=nozzle), job=job)
    analysis = Analysis(run)
    results = RunResults(job, job.built_machine, Budget(analysis), Bead(run, job.bead, analysis))
    assert 1e3 * results.verdict.path_limit == pytest.approx(limit)
    assert ViewerData(results).content()["path_tolerance"] == pytest.approx(limit)
    assert scale_for("error", [run], verdict=results.verdict).high == pytest.approx(10 * limit)
    plan = draw_coloured_plan(Figure(), results.budget)
    assert f"{limit:.3g}, tolerance" in [label.get_text() for label in plan.figure.axes[-1].get_yticklabels()]
    (bar,) = draw_laid(Figure(), results).child_axes
    # one tick far off is also a bead too wide there, which is worse
    assert results.verdict.shown_row == ("path" if everywhere else "glue")
    assert not everywhere or f"{10 * limit:.3g} µm" in [text.get_text() for text in bar.texts]


@pytest.mark.parametrize(("factor", "blobs", "gaps", "quantity"), [(1.44, 1, 0, "wide"), (0.64, 0, 1, "narrow")])
def test_a_constant_error_of_the_flow_is_one_of_width(job, follower, factor, blobs, gaps, quantity):
    """The width of a sessile bead goes with the root of its area: 20 % of it with 44 and 36 % of the flow."""
    row = Verdict.of(job, follower.replaced(flow=factor * follower.flow))["glue"]
    check = only(row.checks, "bead_width")
    assert (row.state, check.state) == ("fail", "fail")
    assert check.value == pytest.approx(20.0, abs=0.5)
    assert quantity in check.quantity
    content = row.content()
    assert (content["blobs"], content["gaps"]) == (blobs, gaps)
    assert content["width_out_of_tolerance_percent"] == pytest.approx(100.0)


def test_two_gaps_are_counted_with_their_share_of_the_length(job, follower):
    flow = follower.flow.copy()
    thin = between(follower, -40, -20) | between(follower, 20, 40)
    flow[thin] *= 0.49
    row = Verdict.of(job, follower.replaced(flow=flow))["glue"]
    content = row.content()
    assert (content["blobs"], content["gaps"]) == (0, 2)
    width = only(row.checks, "start_length").limit
    assert content["width_out_of_tolerance_percent"] == pytest.approx(100 * 40 / (160 - 2 * width), abs=1)
    check = only(row.checks, "bead_width")
    assert check.value == pytest.approx(30.0, abs=0.5)
    assert 20 <= abs(check.place.point[0]) <= 40


def test_glue_missing_at_one_place_and_in_excess_at_another_is_not_set_off(job, follower):
    """The net volume is right, the bead is not."""
    flow = follower.flow.copy()
    flow[between(follower, -40, -20)] *= 0.5
    flow[between(follower, 20, 40)] *= 1.5
    run = follower.replaced(flow=flow)
    assert abs(Bead(run, job.bead).volume_error_percent) < 0.1
    row = Verdict.of(job, run)["glue"]
    content = row.content()
    assert (row.state, content["blobs"], content["gaps"]) == ("fail", 1, 1)


@pytest.mark.parametrize(("missing", "state"), [(2.0, "pass"), (6.0, "fail")])
def test_glue_missing_at_the_start_is_bounded_by_the_start_length(follower, missing, state):
    job = line_job(tolerance={"start_length": 4.0})
    flow = follower.flow.copy()
    flow[between(follower, -80, -80 + missing)] = 0.0
    check = only(Verdict.of(job, follower.replaced(flow=flow))["glue"].checks, "start_length")
    assert (check.state, check.source) == (state, "given")
    assert check.value == pytest.approx(missing, abs=0.2)
    assert check.place.point[0] == pytest.approx(-80, abs=0.2)


def two_strokes():
    """A job of two strokes along x, 10 mm apart, from 0 to 30 mm and back."""
    text = "G21 G17 G90 G94 G61\nM62 P0\nG1 X30 F6000\nM63 P0\nG0 Y10\nM62 P0\nG1 X0\nM63 P0\nG0 X-5\nM2\n"
    return line_job(program={"controller": "linuxcnc.Program", "text": text})


@pytest.mark.parametrize("worse", [0, 1])
def test_the_worst_start_and_stop_of_several_strokes_are_told_with_their_places(worse):
    """A length of bead without glue is missing, and as much laid in a tick beyond the end is in excess."""
    job = two_strokes()
    run = job.follow()
    flow = run.flow.copy()
    x = run.commanded_tip[:, 0]
    stretches = Bead(run, job.bead).stretches.tolist()
    for stroke, (first, after) in enumerate(stretches):
        length = 3.0 if stroke == worse else 1.0
        flow[first:after][np.abs(x[first:after] - x[first]) < length] = 0.0
        flow[after] += 2 * length * AREA / run.period
    assert len(stretches) == 2
    row = Verdict.of(job, run.replaced(flow=flow))["glue"]
    start, stop = (only(row.checks, name) for name in ("start_length", "stop_length"))
    assert start.value == pytest.approx(3.0, abs=0.2)
    assert stop.value == pytest.approx(6.0, abs=0.2)
    assert "missing" in start.quantity
    assert "excess" in stop.quantity
    begins = [(0.0, 0.0), (30.0, 10.0)]
    ends = [(30.0, 0.0), (0.0, 10.0)]
    assert start.place.point[:2] == pytest.approx(begins[worse], abs=0.3)
    assert stop.place.point[:2] == pytest.approx(ends[worse], abs=0.3)


def test_no_glue_is_no_pass():
    job = line_job(dispenser={})
    verdict = Verdict.of(job, job.follow())
    assert (verdict.state, verdict["glue"].state) == ("warn", "warn")
    assert "nothing was laid" in str(verdict)


def test_a_bead_shorter_than_its_ends_has_no_width_to_judge():
    for end, judged in ((60, True), (4, False)):
        text = f"G21 G17 G90 G94 G64\nG0 X0 Y0\nM62 P0\nG1 X{end} F6000\nM63 P0\nM2\n"
        job = line_job(program={"controller": "linuxcnc.Program", "text": text})
        row = Verdict.of(job, job.follow())["glue"]
        assert (
            "width not judged: every stretch of bead is shorter than a start and a stop" in row.remark
        ) is not judged
        assert (row.values["blobs"] is not None) is judged


def test_glue_that_never_comes_fails(job, follower):
    row = Verdict.of(job, follower.replaced(flow=np.zeros_like(follower.flow)))["glue"]
    assert row.state == "fail"
    assert "nothing was laid, though glue is requested" in row.texts


def test_a_saturated_axis_has_no_torque_reserve(job, follower):
    tick = tick_at(follower, -20.0)
    demand = follower.demand.copy()
    demand[tick, 1] = -job.built_machine.axes[1].peak_torque
    row = Verdict.of(job, follower.replaced(demand=demand))["machine"]
    check = row.checks[0]
    assert (check.name, check.state) == ("torque_reserve", "fail")
    assert check.value == pytest.approx(0.0, abs=1e-9)
    assert (check.place.axis, check.place.time) == (job.built_machine.axes[1].name, follower.time[tick])


def test_a_stepper_that_has_lost_steps_fails_by_the_most_of_them():
    """For a moment, the rotor is two periods of the field behind: eight full steps."""
    job = line_job(machine=str(STEPPERS))
    follower = job.follow()
    motor = follower.motor.copy()
    # the field follows the command by a servo period
    motor[1:] = follower.commanded[:-1]
    checks = Verdict.of(job, follower.replaced(motor=motor))["machine"].checks
    assert "full_steps_lost" not in {check.name for check in checks}
    tick = tick_at(follower, 10.0)
    motor[tick, 0] -= 2 * job.built_machine.axes[0].electrical_period
    check = only(Verdict.of(job, follower.replaced(motor=motor))["machine"].checks, "full_steps_lost")
    assert (check.value, check.limit, check.at_least, check.state) == (8, 0, False, "fail")
    assert (check.place.axis, check.place.time) == ("x", follower.time[tick])


def test_small_margins_fail_with_their_axis(follower):
    job = line_job()
    good = Margins(3.0, 0.0, 60.0, 0.01, 1.5, 20.0, stable=True, together=3.0)
    vars(job)["margins"] = (good, replace(good, together=1.2), replace(good, sensitivity=2.8))
    row = Verdict.of(job, follower)["stability"]
    assert [(check.name, check.value, check.state, check.place.axis) for check in row.checks] == [
        ("gain_margin", 1.2, "fail", "y"),
        ("sensitivity", 2.8, "warn", "z"),
    ]
    assert "unstable" not in str(row.texts)
    vars(job)["margins"] = (good, replace(good, stable=False, together=0.0), good)
    assert Verdict.of(job, follower)["stability"].remark == "unstable: y"


def test_unknown_margins_are_not_judged_and_no_pass(follower):
    job = line_job()
    vars(job)["margins"] = None
    verdict = Verdict.of(job, follower)
    assert verdict["stability"].state == "not judged"
    assert verdict.state == "warn"
    loops = RunResults(job, job.built_machine, Budget(Analysis(follower))).loops
    assert list(loops) == ["x", "y", "z"]
    for axis in job.built_machine.axes:
        assert loops[axis.name].margins is None
        share = loops[axis.name].torque_ripple / axis.peak_torque
        assert loops[axis.name].torque_ripple_share == pytest.approx(share, nan_ok=True)


def test_the_headline_names_the_rows_that_make_the_state_and_those_not_judged():
    def headline(*states):
        names = ("path", "glue", "stability", "machine")
        return Verdict(tuple(Row(name, state=state) for name, state in zip(names, states, strict=True))).headline

    assert headline("pass", "pass", "pass", "pass") == "✓ pass"
    assert headline("warn", "fail", "pass", "fail") == "✗ fail: glue, machine"
    assert headline("fail", "warn", "not judged", "pass") == "✗ fail: path, stability"
    assert headline("warn", "pass", "pass", "not judged") == "! warn: path, machine"
    assert headline("pass", "pass", "pass", "not judged") == "! warn: machine"


def test_a_fault_fails_and_nothing_else_is_judged(job, follower):
    fault = Fault("following error", "x", 0.5, 12.0, 10.0, "mm")
    verdict = Verdict.of(job, follower.replaced(fault=fault))
    assert verdict.state == "fail"
    assert "following error on axis x at t = 0.5000 s" in verdict.headline
    assert {row.state for row in verdict.rows} == {"not judged"}
    assert not any(row.checks for row in verdict.rows)
    assert verdict.content()["fault"] == f"Fault: {fault}."
    assert Verdict.of(job, follower).content()["fault"] is None


def test_a_line_that_is_not_known_is_not_named(follower):
    job = Job.load("softmc-helical")  # it waits for its axes to settle
    assert job.setpoints.gates.size
    verdict = Verdict.of(job, job_run("softmc-helical"))
    assert all(check.place.line is None for row in verdict.rows for check in row.checks)
    assert "line" not in str(verdict)


@pytest.mark.parametrize(
    ("value", "limit", "at_least", "state"),
    [
        (8.0, 10.0, False, "pass"),
        (8.1, 10.0, False, "warn"),
        (10.0, 10.0, False, "warn"),
        (10.1, 10.0, False, "fail"),
        (2.0, 1.5, True, "pass"),
        (1.6, 1.5, True, "warn"),
        (1.4, 1.5, True, "fail"),
        (-5.0, 10.0, True, "fail"),
        (0.0, 0.0, False, "pass"),
        (4.0, 0.0, False, "fail"),
        (math.inf, 1.5, True, "pass"),
        (math.inf, 3.0, False, "fail"),
        (math.nan, 3.0, False, "not judged"),
    ],
)
def test_a_value_against_its_limit(value, limit, at_least, state):
    check = Check(
        name="q", quantity="q", value=value, limit=limit, unit="", source="given", at_least=at_least, place=Place()
    )
    assert check.state == state


@pytest.mark.parametrize(
    ("place", "text"),
    [
        (Place(), ""),
        (Place(axis="x"), "axis x"),
        (Place(time=0.25), "t = 0.250 s"),
        (Place(point=(1.0, -2.0, 0.5), line=7), "x = 1.0, y = −2.0, z = 0.5 mm, line 7"),
        (Place("y", 1.5, (1.0, 0.0, 0.0), 3), "axis y, t = 1.500 s, x = 1.0, y = 0, z = 0 mm, line 3"),
    ],
)
def test_a_place_says_what_is_known_of_it(place, text):
    assert str(place).replace("-", "−") == text


def test_defaults_follow_from_needle_bead_and_encoder():
    tolerance = Tolerance.of(ToleranceSettings(), NEEDLE, [0.001], width=4.0)
    assert tolerance.path_max == pytest.approx(0.082)
    assert tolerance.path_p95 == pytest.approx(0.041)
    assert (tolerance.start_length, tolerance.stop_length) == (4.0, 4.0)
    assert tolerance.turn_clearance == pytest.approx(0.4 + 2 * 0.082)
    assert tolerance.sensitivity == pytest.approx(3.0)
    assert tolerance.given == frozenset()
    coarse = Tolerance.of(ToleranceSettings(), NEEDLE, [0.001, 0.1], width=4.0)
    assert coarse.path_max == pytest.approx(0.2)


def test_given_limits_are_kept_in_the_job_and_said_to_be_given():
    job = line_job().with_overrides(["path_max=0.02", "tolerance.least_gain_margin=2"])
    tolerance = Job.of_content(job.model_dump(exclude_none=True), "job").limits(NEEDLE, 4.0)
    assert (tolerance.path_max, tolerance.path_p95, tolerance.gain_margin) == (0.02, 0.01, 2.0)
    assert tolerance.sensitivity == pytest.approx(2.0)
    assert tolerance.given == {"path_max", "gain_margin"}
    assert tolerance.source("path_max") == tolerance.source("gain_margin") == "given"
    assert tolerance.source("path_p95") == "default"


@pytest.mark.parametrize(
    "table", [{"path_max": 0}, {"bead_width": -1}, {"torque_reserve": 100}, {"path_max": True}, {"width": 1}]
)
def test_limits_without_a_meaning_are_refused(table):
    with pytest.raises(InputError, match="tolerance"):
        line_job(tolerance=table)


def test_a_job_without_tolerances_has_no_table_of_them(job):
    assert "[tolerance]" not in job.toml()


@pytest.mark.parametrize(
    "name",
    suite_runs(
        ["an225", "delta-arc", "fanuc-conical", "linuxcnc-flanges", "slicer-square", "stage-outline", "trio-basic"],
        0,
        3,
    ),
)
def test_built_in_jobs_have_a_verdict_with_the_numbers_of_budget_and_bead(name):
    job = Job.load(name)
    run = job_run(name)
    analysis = Analysis(run)
    verdict = Verdict.of(job, run)
    assert all(row.state in ("pass", "warn", "fail") and row.checks for row in verdict.rows)
    contour = Budget(analysis).values.contour
    assert only(verdict["path"].checks, "path_max").value == 1e3 * contour.max
    assert only(verdict["path"].checks, "path_p95").value == 1e3 * contour.p95
    values = Bead(run, job.bead, analysis).values
    shortfall = values.missing_at_start
    assert only(verdict["glue"].checks, "start_length").value == max(abs(shortfall.min), abs(shortfall.max))
    margins = job.margins
    least = min(min(axis.gain, axis.together) for axis in margins)
    assert only(verdict["stability"].checks, "gain_margin").value == least
    assert only(verdict["stability"].checks, "sensitivity").value == max(axis.sensitivity for axis in margins)


def test_a_needle_that_goes_home_through_its_bead_fails_with_the_line_of_that_move():
    job = Job.load("trio-basic")
    row = Verdict.of(job, job_run("trio-basic"))["glue"]
    check = only(row.checks, "bead_ploughed")
    assert (check.state, check.limit) == ("fail", 0.0)
    assert job.program["text"].splitlines()[check.place.line - 1].startswith("MOVEABS(0,0)")
    assert "1 pass, 2.5 mm, up to 0.42 mm deep; it never lifts" in row.remark
    assert row.content()["passes_through_glue"] == 1
    admitted = job.changed({"tolerance.bead_ploughed": 5.0})
    assert only(Verdict.of(admitted, job_run("trio-basic"))["glue"].checks, "bead_ploughed").state == "pass"


def test_a_job_that_lifts_its_needle_ploughs_nothing():
    row = Verdict.of(Job.load("svg-gasket"), job_run("svg-gasket"))["glue"]
    check = only(row.checks, "bead_ploughed")
    assert (check.value, check.state) == (0.0, "pass")
    assert "needle" not in row.remark


def test_the_clearance_of_turns_that_climb_is_said_not_to_be_judged():
    remark = "clearance of turns not judged: they lie at different heights"
    climbing = Verdict.of(Job.load("fanuc-conical"), job_run("fanuc-conical"))["glue"]
    assert remark in climbing.remark
    assert not [check for check in climbing.checks if check.name == "turn_clearance"]
    flat = Verdict.of(Job.load("an225"), job_run("an225"))["glue"]
    assert remark not in flat.remark
    assert only(flat.checks, "turn_clearance").state == "fail"


@pytest.fixture(scope="module")
def turns():
    """A job of four turns 5 mm apart, with starts and stops of 20 mm, and its perfect follower."""
    tables = {"bead": {"contact_angle": 90.0, "squashed": False}, "tolerance": {"start_length": 20, "stop_length": 20}}
    job = spiral_job(tables, turns=4, thickness=5.0, wait_resolution=0.0)
    return job, job.follow()


DISCRETE = 0.012  # what the waits of the spiral's program leave of its pitch [mm]


@pytest.mark.parametrize("factor", [0.81, 1.0, 1.21])
def test_the_clearance_of_turns_is_off_by_what_their_width_is(turns, factor):
    """The width of a half circle goes with the root of its area: a tenth of it with 21 % of the flow."""
    job, run = turns
    width = math.sqrt(8 * AREA / math.pi)
    check = only(Verdict.of(job, run.replaced(flow=factor * run.flow))["glue"].checks, "turn_clearance")
    assert check.value == pytest.approx(width * abs(math.sqrt(factor) - 1), abs=DISCRETE)


def test_a_part_of_one_turn_that_is_wider_takes_half_of_it_from_the_clearance_there(turns):
    job, run = turns
    x, y = run.nozzle[:, :2].T
    angle = np.unwrap(np.arctan2(y, x - 30.0))  # it begins 30 mm from its centre
    turned = np.abs(angle - angle[np.flatnonzero(run.dispense)[0]])
    for middle, seen in ((2.5 * math.pi, True), (0.0, False)):
        there = np.abs(turned - middle) < (0.3 if seen else 0.5 * 20.0 / 30.0)
        flow = np.where(there, 1.21 * run.flow, run.flow)
        check = only(Verdict.of(job, run.replaced(flow=flow))["glue"].checks, "turn_clearance")
        width = math.sqrt(8 * AREA / math.pi)
        assert check.value == pytest.approx(0.05 * width if seen else 0.0, abs=DISCRETE)
        if seen:
            at = turned[np.searchsorted(run.time, check.place.time)] - middle
            assert min(abs(at), abs(at + 2 * math.pi)) < 0.35  # there, or on the turn beside it


def test_every_row_of_a_verdict_has_a_line_and_further_ones_for_what_does_not_pass():
    checks = [
        Check(name=f"c{k}", quantity=f"size {k}", value=value, limit=2.0, unit="mm", source="given", place=Place("x"))
        for k, value in enumerate((1.0, 3.0, 1.9))
    ]
    rows = (Row.of("path", checks, "a remark"), Row.of("glue", checks[:1]), Row("machine"))
    assert Verdict(rows).lines == (
        "verdict ✗ fail: path, machine",
        "✗ fail       path      size 1 3.0 mm, at most 2.0 mm (given): axis x",
        "                       size 2 1.9 mm, at most 2.0 mm (given): axis x",
        "                       a remark",
        "✓ pass       glue      size 0 1.0 mm, at most 2.0 mm (given): axis x",
        "– not judged machine   ",
    )


def test_errors_that_contradict_one_another_are_not_judged_and_blame_nothing():
    verdict = Verdict.of_contradictions(("the nozzle is too far", "so is a link"))
    reason = (
        "errors not known, because the nozzle is too far; so is a link. This is a defect of the analysis: please "
        "report the job."
    )
    assert (verdict.state, verdict.fault, verdict.unjudged) == ("warn", "", reason)
    assert verdict.headline == f"! warn: {reason}"
    assert verdict.lines == (f"verdict ! warn: {reason}",)
    assert [row.name for row in verdict.rows] == ["path", "glue", "stability", "machine"]
    assert {row.state for row in verdict.rows} == {"not judged"}
    assert burden_of(verdict) == math.inf
    assert (verdict.content()["contradiction"], verdict.content()["fault"]) == (reason, None)


def _row(name, *usages, at=None, remark="", state=None):
    """A row of checks with a limit of 1 each, at times `at`."""
    times = at or [None] * len(usages)
    checks = [
        Check(
            name=f"{name} {k}", quantity=name, value=usage, limit=1.0, unit="mm", source="given", place=Place(time=time)
        )
        for k, (usage, time) in enumerate(zip(usages, times, strict=True))
    ]
    row = Row.of(name, checks, remark)
    return row if state is None else replace(row, state=state)


def test_the_worst_row_is_the_failing_one_that_uses_most_of_its_limit():
    rows = (_row("path", 1.2, 0.1, at=[3.0, 2.0]), _row("glue", 1.1, 5.0, at=[1.0, 4.0]), _row("stability", 0.9))
    verdict = Verdict(rows)
    assert verdict.worst_row.name == "glue"
    assert (verdict.worst_check.value, verdict.worst_place.time) == (5.0, 4.0)


def test_a_warning_is_told_only_where_nothing_fails_and_a_pass_has_no_worst_row_but_a_place():
    warns = Verdict((_row("path", 0.9, at=[3.0]), _row("glue", 0.95, at=[1.0])))
    assert warns.worst_row.name == "glue"
    passes = Verdict((_row("path", 0.5, at=[3.0]), _row("glue", 0.4, at=[1.0])))
    assert passes.worst_row is None
    assert passes.worst_check is None
    assert passes.worst_place.time == 3.0
    fails = Verdict((_row("path", 1.01, at=[3.0]), _row("glue", 0.95, at=[1.0])))
    assert fails.worst_row.name == "path"


def test_stability_has_no_place_so_that_the_next_row_gives_it():
    verdict = Verdict((_row("path", 1.5, at=[3.0]), _row("stability", math.inf)))
    assert verdict.worst_row.name == "stability"
    assert verdict.worst_place.time == 3.0


def test_a_row_that_fails_by_its_remark_alone_is_the_worst_without_a_check():
    verdict = Verdict((_row("path", 1.5, at=[3.0]), _row("glue", 0.2, at=[1.0], remark="no glue", state="fail")))
    assert verdict.worst_row.name == "glue"
    assert verdict.worst_check is None
    unjudged = Verdict((Row("path"), Row("glue")), fault="x exceeded its limit")
    assert (unjudged.worst_row, unjudged.worst_check, unjudged.worst_place) == (None, None, None)


def test_the_width_is_judged_between_the_length_of_a_start_and_that_of_a_stop(follower):
    job = line_job(tolerance={"start_length": 20.0, "stop_length": 5.0})
    bead = Bead(follower, job.bead)
    x = bead.point[BeadWidth(bead, Verdict.of(job, follower).tolerance).judged, 0]
    assert (x.min(), x.max()) == pytest.approx((-80 + 20, 80 - 5), abs=0.3)


def test_a_servo_s_own_limit_of_the_torque_counts_where_it_is_lower_than_the_drive_s(follower):
    limit = 0.4
    job = line_job(servo={"torque_limit": limit})
    assert limit < min(axis.peak_torque for axis in job.built_machine.axes)
    demand = np.zeros_like(follower.demand)
    demand[tick_at(follower, 20.0), 1] = 0.95 * limit
    check = only(Verdict.of(job, follower.replaced(demand=demand))["machine"].checks, "torque_reserve")
    assert check.value == pytest.approx(5.0)


def test_the_clearance_of_turns_is_not_judged_where_the_bead_is_laid_in_pieces(turns):
    """Beside an end of a piece there is no neighbour, whatever the turns are."""
    job, run = turns
    pause = slice(len(run.time) // 2, len(run.time) // 2 + 200)
    assert run.dispense[pause].all()
    columns = {name: np.array(getattr(run, name)) for name in ("dispense", "flow", "flow_demand")}
    for column in columns.values():
        column[pause] = 0
    names = {
        pieces: [check.name for check in Verdict.of(job, record)["glue"].checks]
        for pieces, record in ((1, run), (2, run.replaced(**columns)))
    }
    assert "turn_clearance" in names[1]
    assert "turn_clearance" not in names[2]


TWO_LINES = """G21 G17 G90 G94 G64
G0 X-20 Y0
M62 P0
G1 X20 F3000
M63 P0
G0 Y{way}
G0 X{far} Y8
G0 X{far} Y{way}
M62 P0
G1 X-20
M63 P0
M2
"""


def test_a_needle_off_its_path_is_told_to_reduce_the_error_and_not_to_be_lifted():
    """The second of two lines 8 mm apart is laid upon the first, by a machine that is 8 mm off; or asked for there."""
    job = line_job(program={"controller": "linuxcnc.Program", "text": TWO_LINES.format(way=8, far=20)})
    run = job.follow()
    assert only(Verdict.of(job, run)["glue"].checks, "bead_ploughed").value == 0
    nozzle = np.array(run.nozzle)
    second = nozzle[:, 1] > 7.99
    nozzle[second, 1] -= 8.0
    astray = Verdict.of(job, run.replaced(nozzle=nozzle))["glue"]
    assert only(astray.checks, "bead_ploughed").value > 10
    assert astray.remark.endswith("on the requested path it would touch none: reduce the path error of up to 8000.0 µm")
    job = line_job(program={"controller": "linuxcnc.Program", "text": TWO_LINES.format(way=0, far=20)})
    asked = Verdict.of(job, job.follow())["glue"]
    assert only(asked.checks, "bead_ploughed").value > 10
    assert "the path crosses its own bead while it dispenses" in asked.remark
