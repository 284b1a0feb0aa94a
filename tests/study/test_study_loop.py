"""The loop study: its cases, what it says of rows that are known, and a small one from end to end."""

import functools
import math
import re

import numpy as np
import pytest
from gantrysim.study.loop.findings import findings, loop_knee
from gantrysim.study.loop.integrator import convergence
from hypothesis import given
from hypothesis import strategies as st

from gantrysim import Job
from gantrysim.study import Case, run_study
from gantrysim.study.loop import (
    AS_IT_IS,
    FREE,
    LOOP_ALONE,
    NO_FRICTION,
    NO_LOOP,
    PERFECT,
    SWEEPS,
    LoopStudy,
)
from gantrysim.study.loop.trends import Convergence, crossing, knee, power

SMALL = {
    "loop_periods": (0.01, 0.03, 0.1),
    "interpreter_times": (0.0, 1e-3, 4e-3),
    "servo_periods": (1e-3, 2e-3, 4e-3),
    "resolutions": (1e-3, 1e-2),
    "halvings": 2,
}
SHORT = ["turns=2", "diameter=30", "thickness=5", "speed=200", "loop_period=0.05", "simulation.settle=0.05"]
INTERPOLATED = 0.02  # of a knee between points a tenth of a decade apart


@pytest.fixture(scope="module")
def study():
    return LoopStudy(Job.load("an225"))


# trends


@given(st.floats(0.5, 50), st.floats(0.1, 10), st.floats(0.05, 0.5))
def test_knee_of_a_floor_and_a_line(floor, slope, excess):
    exact = floor * math.sqrt((1 + excess) ** 2 - 1) / slope
    x = np.geomspace(exact / 30, exact * 30, 31)
    assert knee(x, np.hypot(floor, slope * x), floor, excess) == pytest.approx(exact, rel=INTERPOLATED)


def test_knee_at_the_ends():
    x = np.array([1.0, 2.0, 4.0])
    assert knee(x, [1.05, 1.0, 1.09], 1.0) == math.inf
    assert knee(x, [1.2, 1.0, 1.0], 1.0) is None
    assert knee(x, [1.0, 1.1, 2.0], 1.0) == pytest.approx(2.0)
    assert knee(x, [1.0, 3.0, 1.0], 1.0) < 2.0  # the first time that it leaves the floor


def test_crossing_and_power_of_power_laws():
    x = np.geomspace(1, 100, 12)
    assert crossing(x, x**2, 30.0) == pytest.approx(math.sqrt(30.0), rel=1e-12)
    assert crossing(x, x**2, 7 * x) == pytest.approx(7.0, rel=1e-12)
    assert crossing(x, x, 1000.0) is None
    assert crossing(x, 100 / x, 10.0) is None  # it falls below
    assert power(x, 3 * x**1.7) == pytest.approx(1.7, rel=1e-12)


@given(st.floats(1, 100), st.floats(-0.2, 0.2).filter(lambda c: abs(c) > 1e-3), st.sampled_from([1.0, 1.5, 2.0]))
def test_convergence_of_a_power_law(limit, share, order):
    steps = 1e-3 * 0.5 ** np.arange(4)
    found = Convergence.of(steps, limit * (1 + share * (steps / steps[0]) ** order))
    assert found.order == pytest.approx(order, rel=1e-6)
    assert found.limit == pytest.approx(limit, rel=1e-9)
    assert found.deviation == pytest.approx(abs(share), rel=1e-6)


def test_scatter_has_no_order_and_counts_in_full():
    found = Convergence.of([4, 2, 1], [10.0, 10.3, 10.1])
    assert (found.order, found.limit) == (None, 10.1)
    assert found.deviation == pytest.approx(0.3 / 10.1)
    assert Convergence.of([4, 2, 1], [10.0, 10.1, 10.3]).order is None  # it runs away
    still = Convergence.of([4, 2, 1], [5.0, 5.0, 5.0])
    assert (still.order, still.deviation) == (None, 0.0)


# cases


def test_the_default_study_has_at_least_60_simulations(study):
    simulated = {case.key for case in study.cases if case.mode == "simulated"}
    assert len(simulated) >= 60
    assert len({(case.key, *dict(case.tags).values()) for case in study.cases}) == len(study.cases)
    assert {dict(case.tags)["sweep"] for case in study.cases} == set(SWEEPS)
    periods = [dict(c.tags)["value"] for c in study.cases if dict(c.tags)["sweep"] == "loop_period"]
    assert (min(p for p in periods if p), max(periods)) == (1e-3, 1.0)
    servo = [dict(c.tags)["value"] for c in study.cases if dict(c.tags)["sweep"] == "servo_period"]
    assert (min(servo), max(servo)) == (2.5e-4, 8e-3)


def chosen(study, sweep, variant):
    return [case for case in study.cases if {"sweep": sweep, "variant": variant}.items() <= dict(case.tags).items()]


def test_variants_of_a_move_spiral(study):
    for case in chosen(study, "loop_period", AS_IT_IS):
        changed = case.settings
        value = dict(case.tags)["value"]
        assert changed == ({} if value == study.job.program["loop_period"] else {"program.loop_period": value})
    job = chosen(study, "loop_period", LOOP_ALONE)[-1].job()
    assert (job.program["acceleration"], job.program["wait_resolution"]) == (math.inf, 0.0)
    assert "ratio_bits" not in job.program
    assert {case.mode for case in chosen(study, "loop_period", PERFECT)} == {"perfect follower"}
    (no_loop,) = chosen(study, "loop_period", NO_LOOP)
    assert no_loop.job().program["loop_period"] == 0
    smooth = chosen(study, "servo_period", NO_FRICTION)[0]
    assert smooth.perturbation.friction < 1e-6
    assert smooth.job().servo.resolution == 0
    assert smooth.job().servo.integral_time == math.inf


def test_the_job_itself_is_run_once_for_all_sweeps(study):
    sweeps = {dict(case.tags)["sweep"] for case in study.cases if case.key == Case.of(study.job).key}
    assert sweeps == set(SWEEPS)


def test_slow_servos_are_run_at_no_finer_steps_than_their_theory_needs(study):
    steps = {dict(c.tags)["value"]: c.job().simulation.physics_step for c in chosen(study, "servo_period", NO_FRICTION)}
    own = study.job.built_machine.model.opt.timestep
    assert steps[2.5e-4] == steps[1e-3] == own / 4
    assert steps[2e-3] == own / 2
    assert steps[4e-3] in (None, own)
    assert steps[8e-3] in (None, own)


def test_a_program_bound_to_servo_ticks_keeps_to_them():
    study = LoopStudy(Job.load("an225", ["program.servo_period=0.001"]))
    for case in chosen(study, "servo_period", AS_IT_IS):
        job = case.job()
        assert job.program["servo_period"] == job.servo.period == dict(case.tags)["value"]


def test_physics_steps_halve_and_divide_the_servo_period(study):
    values = [dict(case.tags)["value"] for case in chosen(study, "physics_step", AS_IT_IS)]
    assert values == pytest.approx([2.5e-4 / 8, 2.5e-4 / 4, 2.5e-4 / 2, 2.5e-4])
    odd = LoopStudy(Job.load("an225", ["servo.period=0.0007"]), halvings=1)
    assert [dict(c.tags)["value"] for c in chosen(odd, "physics_step", AS_IT_IS)] == pytest.approx([7e-4 / 6, 7e-4 / 3])


def test_resolutions_of_rotary_axes_go_in_proportion():
    study = LoopStudy(Job.load("stage-outline"))
    own = {axis.name: axis.resolution for axis in study.job.built_machine.axes}
    case = chosen(study, "encoder_resolution", AS_IT_IS)[-1]
    given_ = dict(zip(own, case.job().servo.resolution, strict=True))
    assert given_["x"] == given_["y"] == dict(case.tags)["value"]
    assert given_["th"] / own["th"] == pytest.approx(given_["x"] / own["x"])


def test_a_program_without_a_loop_is_swept_in_what_it_has():
    study = LoopStudy(Job.load("fanuc-spiral"))
    assert {dict(case.tags)["sweep"] for case in study.cases} == {"servo_period", "encoder_resolution", "physics_step"}
    assert {dict(case.tags)["variant"] for case in study.cases} == {AS_IT_IS, NO_FRICTION}
    said = findings(study, [])
    assert said[0] == "No sweep has enough cases that went through to say anything of."
    assert said[1] == (
        "fanuc.Program has no program loop in the way of Trio's Move Spiral: the sweeps of its period and of the "
        "interpreter's time are left out."
    )


def test_the_continuous_limit_has_no_interpreter(study):
    continuous = study.job.changed({**FREE, "program.loop_period": 0.0})
    sweeps = {dict(case.tags)["sweep"] for case in LoopStudy(continuous).cases}
    assert sweeps == set(SWEEPS) - {"interpreter_time"}


# findings, of rows that are known


def row(sweep, variant, value, **figures):
    return {"sweep": sweep, "variant": variant, "value": value, "status": "ok", **figures}


def known_rows(floor=10.0, slope=2000.0, least=0.1):
    """A loop whose error is slope T over a floor, alone; as it is, with a least error at a period."""
    periods = np.geomspace(1e-3, 1.0, 31)
    rows = [row("loop_period", NO_LOOP, 0.0, contour_rms_um=floor)]
    for t in periods.tolist():
        rows.append(row("loop_period", LOOP_ALONE, t, contour_rms_um=math.hypot(floor, slope * t)))
        rows.append(row("loop_period", PERFECT, t, generation_rms_um=slope * t))
        if t > 4e-3:
            rows.append(row("loop_period", AS_IT_IS, t, contour_rms_um=300 * (t / least + least / t)))
        else:
            refused = {"sweep": "loop_period", "variant": AS_IT_IS, "value": t, "status": "refused: too fast"}
            rows.append(refused)
    return rows


def test_the_knee_of_known_rows(study):
    exact = 10 * math.sqrt(1.1**2 - 1) / 2000
    at, floor = loop_knee(known_rows())
    assert (at, floor) == (pytest.approx(exact, rel=INTERPOLATED), 10.0)
    summary, text = findings(study, known_rows())[:2]
    clause = (
        r"By itself, without the limits of ACCEL, WA and CONNECT, the loop would no longer matter below T = ([\d.]+) ms"
    )
    assert float(re.search(clause, summary)[1]) == pytest.approx(1e3 * exact, rel=INTERPOLATED)
    said = re.search(clause + ": the contour error is then within 10 % of the 10 µm that servo and machine", text)
    assert float(said[1]) == pytest.approx(1e3 * exact, rel=INTERPOLATED)
    assert "The loop's own part grows as T^1.00, 2 µm for each millisecond." in text


def test_a_faster_loop_that_is_worse_is_said_so_with_its_cause(study):
    summary, text = findings(study, known_rows())[:2]
    assert summary.startswith(
        "As the job is, a program loop of T = 100 ms is best, with a contour error of 600 µm (rms): a faster one is "
        "worse, because WA cuts every wait to a multiple of 1 ms. By itself, without"
    )
    assert text.startswith(
        "As the job is, the contour error (rms) is least at T = 100 ms, with 600 µm where the loop by itself would "
        "cost 200 µm"
    )
    assert "(ACCEL costs as much as a loop of 100 ms does)" in text
    said = re.search(r"a faster loop makes it worse, up to (\d+) µm at ([\d.]+) ms, ([\d.]+) times as much", text)
    worst = 300 * (float(said[2]) * 1e-2 + 1e2 / float(said[2]))
    assert float(said[1]) == pytest.approx(worst, rel=0.01)
    assert float(said[3]) == pytest.approx(worst / 600, rel=0.02)
    assert re.search(r"because WA cuts every wait to a multiple of 1 ms \(17\d µm if it did not\)", text)
    assert "and at 3.98 ms and below the spiral does not come to its end at all" in text


@pytest.mark.parametrize("resolution", [0, 1e-6])
def test_the_cause_is_not_wa_where_wa_hardly_cuts(resolution):
    free = LoopStudy(Job.load("an225", [f"wait_resolution={resolution}"]))
    summary, text = findings(free, known_rows())[:2]
    assert "a faster one is worse. " in summary
    assert "a faster loop makes it worse" in text
    assert "because" not in summary + text


def test_knees_at_the_ends_of_the_sweep(study):
    for paragraph in findings(study, known_rows(floor=1e5))[:2]:
        assert "the loop does not matter up to T = 1e+03 ms" in paragraph
    for paragraph in findings(study, known_rows(floor=0.5))[:2]:
        assert "the loop matters at every period down to T = 1 ms" in paragraph


def test_a_loop_whose_fastest_is_best_is_said_so(study):
    summary, text = findings(study, known_rows(least=1e-5))[:2]
    assert "is best, with a contour error of" in summary
    assert "worse" not in summary + text


def servo_rows(generation=100.0):
    """A servo whose error goes with the square of its period, hidden by the program's part as the job is."""
    rows = []
    for p in (2.5e-4, 5e-4, 1e-3, 2e-3, 4e-3, 8e-3):
        tracking = 10 * (p / 1e-3) ** 2
        values = {
            "contour_rms_um": math.hypot(generation, tracking),
            "tracking_rms_um": tracking,
            "generation_rms_um": generation,
            "steady_tracking_normal_rms_um": 3 * tracking,
        }
        rows.append(row("servo_period", AS_IT_IS, p, **values))
        bare = {"contour_rms_um": tracking, "steady_tracking_normal_rms_um": 0.9 * tracking}
        rows.append(row("servo_period", NO_LOOP, p, **bare))
        rows.append(row("servo_period", NO_FRICTION, p, steady_tracking_normal_rms_um=0.05, tracking_rms_um=0.3))
    return rows


def test_the_servo_is_told_as_the_job_is_and_without_the_loop(study):
    summary, text = findings(study, servo_rows())
    knee_said = (
        r"[Aa]s the job is, below a servo period of ([\d.]+) ms the servo no longer matters to the contour error"
    )
    for paragraph in (summary, text):
        at = float(re.search(knee_said, paragraph)[1])
        assert at == pytest.approx(math.sqrt(10 * math.sqrt(0.21)), rel=0.15)  # points an octave apart
        pays = "ithout the loop,? every shortening of the servo period down to 0.25 ms pays"
        assert re.search(pays, paragraph)
    assert (
        "the program's own part, at least 100 µm, hides it, and the tracking error exceeds that only above 3.16" in text
    )
    assert ": the contour error is 0.625 µm at 0.25 ms, 2.5 µm at 0.5 ms, 10 µm at 1 ms, 40 µm at 2 ms, 160" in text
    assert "(as period^2.0, for the gains follow from the period)" in text


def test_what_friction_costs_is_told_of_one_figure_of_one_program(study):
    assert (
        "Of the tracking error normal to the path in the middle 90 % of the time, 36 µm at 2 ms, 50 nm would be left "
        "without friction, encoder counts and integral term." in findings(study, servo_rows())[1]
    )


def test_a_program_s_part_that_hides_nothing_is_not_told(study):
    text = findings(study, servo_rows(generation=1e-3))[1]
    assert "As the job is, every shortening of the servo period down to 0.25 ms pays. Without the loop" in text
    assert "hides" not in text


def test_the_servo_of_a_program_without_a_loop():
    rows = [one for one in servo_rows(generation=0.0) if one["variant"] != NO_LOOP]
    summary, text = findings(LoopStudy(Job.load("fanuc-spiral")), rows)[:2]
    assert summary == "As the job is, every shortening of the servo period down to 0.25 ms pays."
    assert text.startswith(f"{summary[:-1]}: the contour error is 0.625 µm at 0.25 ms, ")
    assert "120 µm at 2 ms, 50 nm would be left without friction" in text


def test_the_encoder_of_known_rows(study):
    rows = []
    for q in (1e-4, 1e-3, 1e-2, 1e-1):
        rows.append(row("encoder_resolution", NO_LOOP, q, contour_rms_um=math.hypot(10, 290 * q)))
        rows.append(row("encoder_resolution", AS_IT_IS, q, speed_ripple=q))
    for text in findings(study, rows):
        count = float(re.search(r"Below ([\d.]+) µm per count the encoder no longer matters", text)[1])
        assert count == pytest.approx(1e3 * 10 * math.sqrt(0.21) / 290, rel=0.3)  # points a decade apart
    assert "the speed ripple goes from 0.01 % at 0.1 µm to 10 % at 100 µm" in text


def test_each_sweep_has_a_paragraph_of_its_own(study):
    said = findings(study, [*known_rows(), *servo_rows()])
    assert len(said) == 4  # with the cases without figures
    assert "servo" not in said[1].replace("servo and machine", "")
    assert "T = " not in said[2]


def stepped_rows(share, variant=AS_IT_IS):
    """AnalysisValues that come closer to 2 by half at each step, and a contour error that scatters by a share of 10."""
    rows = []
    columns = ("tracking_rms_um", "tracking_along_rms_um", "structure_rms_um", "spacing_std_mm")
    for k, h in enumerate((2.5e-4, 1.25e-4, 6.25e-5)):
        values = dict.fromkeys(columns, 2 + 0.06 * 0.5**k)
        rows.append(row("physics_step", variant, h, contour_rms_um=10.0 * (1 + share * (1, 0, 0.5)[k]), **values))
    return rows


def test_the_integrator_s_part_is_told(study):
    rows = stepped_rows(0.01)
    assert convergence(rows, AS_IT_IS)["tracking_rms_um"].order == pytest.approx(1.0)
    text = findings(study, rows)[1]
    assert text.startswith("The physics step was halved from 0.25 ms down to 0.0625 ms")
    assert "are no artefact of the integrator, they are off their limits by: contour error 1 % (scatter)" in text
    assert "tracking error 3 % (order 1.00)" in text
    smooth = findings(study, rows + stepped_rows(0.0, NO_FRICTION))[1]
    assert (
        "Without friction, which is not smooth: contour error 0 % (scatter), tracking error 3 % (order 1.00)" in smooth
    )


def test_a_figure_that_is_the_integrator_s_is_called_so(study):
    text = findings(study, stepped_rows(0.2))[1]
    assert (
        "these depend on the step, and so are the integrator's as well as the machine's: contour error 18 % (s" in text
    )
    assert "The others are no artefact of it, they are off their limits by: tracking error 3 % (order 1.00)" in text
    every = stepped_rows(0.0)
    for k, coarse in enumerate(every):
        coarse.update({key: 2 + 0.4 * 0.5**k for key in coarse if key.endswith(("um", "mm"))})
    text = findings(study, every)[1]
    assert "The figures of the job as it is all depend on the step, take a shorter one" in text


# from end to end


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    folder = tmp_path_factory.mktemp("loop")
    small = LoopStudy(Job.load("an225", SHORT), **SMALL)
    return small, folder, run_study(small, folder, workers=1)


def test_a_small_study_from_end_to_end(done):
    small, folder, outcome = done
    assert len(outcome.rows) == len(small.cases)
    assert outcome.findings[0].startswith("As the job is, a program loop of T = ")
    begins = (
        "As the job is, ",
        "The interpreter's time ",
        "As the job is, ",
        "",
        "The physics step was halved from 0.25",
    )
    for paragraph, begin in zip(outcome.findings[1:], begins, strict=False):
        assert paragraph.startswith(begin)
    for sweep in SWEEPS:
        assert (folder / "plots" / f"{sweep}.png").read_bytes().startswith(b"\x89PNG")
    report = (folder / "report.html").read_text()
    assert all(f">{title}</h2>" in report for title in SWEEPS.values())


def test_predictions_stand_over_the_points_of_the_plot(done):
    small, _, outcome = done
    (plot,) = [plot for plot in small.figures(outcome.rows) if plot.name == "loop_period"]
    drawn = {line.get_label(): line.get_xydata() for line in plot.figure.axes[0].lines}
    points, line = drawn["generation, loop alone"], drawn["stepped arcs against the involute"]
    on_line = np.exp(np.interp(np.log(points[:, 0]), np.log(line[:, 0]), np.log(line[:, 1])))
    np.testing.assert_allclose(points[:, 1], on_line, rtol=0.01)
    assert points[:, 0].tolist() == pytest.approx([10, 30, 100])  # in ms


def test_plots_of_a_study_in_which_nothing_went_through(study):
    rows = [{**dict(case.tags), "status": "refused: no"} for case in study.cases]
    plots = study.figures(rows)
    assert [plot.name for plot in plots] == list(SWEEPS)
    for plot in (plots[0], plots[-1]):
        plot.figure.draw_without_rendering()


def test_the_command(tmp_path, monkeypatch, gantrysim_command):
    from gantrysim.study import loop

    tiny = {**SMALL, "loop_periods": (0.05, 0.1), "servo_periods": (1e-3,), "halvings": 0}
    monkeypatch.setattr(loop, "LoopStudy", functools.partial(LoopStudy, **tiny))
    monkeypatch.setattr(LoopStudy, "figures", lambda self, rows: [])  # slow, and drawn above
    settings = [part for setting in SHORT for part in ("--set", setting)]
    status, output, said = gantrysim_command(
        "study", "loop", "an225", *settings, "--out", tmp_path / "a", "--workers", 1
    )
    assert (status, said) == (0, "")
    assert "As the job is, the contour error (rms) is least at T = " in " ".join(output.split())
    assert output.endswith(f"written to {tmp_path / 'a'}/: job.toml, plots, report.html, study.csv, study.toml\n")
    assert 'command = "gantrysim study loop job.toml"' in (tmp_path / "a" / "study.toml").read_text()


def test_the_command_refuses_what_is_not_in_order(tmp_path, gantrysim_command):
    status, _, said = gantrysim_command("study", "loop", "an226", "--out", tmp_path / "new")
    assert (status, said.split(":")[:2]) == (2, ["error", " unknown job 'an226'"])
    status, _, said = gantrysim_command("study", "loop", "--workers", "0", "--out", tmp_path / "new")
    assert status == 2
    assert "'--workers'" in said
    assert not (tmp_path / "new").exists()
