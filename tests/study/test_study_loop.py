"""The loop study: its cases, its report of known rows, and a small study from end to end."""

import functools
import math
import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gantrysim import Job
from gantrysim import study as study_room
from gantrysim.controllers.loop_theory import Deviation, LoopErrors
from gantrysim.controllers.trio import MoveSpiral
from gantrysim.controllers.trio.theory import SpiralTheory
from gantrysim.study import Case, run_study
from gantrysim.study.acceptance import Acceptance, Scope
from gantrysim.study.cases import ASPECTS
from gantrysim.study.loop import (
    AS_IT_IS,
    LOOP_ALONE,
    NO_FRICTION,
    NO_LOOP,
    PERFECT,
    SWEEPS,
    LoopStudy,
)
from gantrysim.study.loop.limits import LEVERS, SweepVerdicts, draw_limits
from gantrysim.study.loop.plots import plots
from gantrysim.study.loop.report import question, report
from gantrysim.study.loop.trends import Convergence, convergence, crossing, knee, loop_knee, power

from support.soaked import suite_runs

pytestmark = pytest.mark.usefixtures("blank_pictures")

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


def test_slow_servos_run_at_no_finer_steps_than_necessary(study):
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


def test_a_program_without_a_loop_has_no_loop_sweeps():
    study = LoopStudy(Job.load("fanuc-spiral"))
    assert {dict(case.tags)["sweep"] for case in study.cases} == {"servo_period", "encoder_resolution", "physics_step"}
    assert {dict(case.tags)["variant"] for case in study.cases} == {AS_IT_IS, NO_FRICTION}
    empty = report(study, [])
    assert empty.question == "Which servo period does this job need?"
    assert empty.answer == "Too few cases were judged by the job's tolerance."
    assert (empty.chart, empty.table) == (None, None)
    assert empty.details.notes == [
        "fanuc.Program has no program loop: the sweeps of loop period and interpreter time are left out."
    ]


TEXT_LOOP = """' a comment of a FOR loop
SPEED=60: ACCEL=800: DECEL=800
MOVE(80,0)
REPEAT
  SPEED=60
  WA(50)
UNTIL MTYPE=0
"""


def test_a_loop_in_a_text_cannot_be_varied_and_what_can_is_named():
    program = {"controller": "trio.Basic", "text": TEXT_LOOP}
    job = Job.of_content({"name": "text", "program": program}, "job text")
    empty = report(LoopStudy(job), [])
    assert empty.question == "Which loop period does this job need?"
    assert empty.answer.startswith("Not known: the program's own loop, line 4, REPEAT, stands in its text, and no key")
    assert "What can be varied is servo.period and servo.resolution." in empty.answer
    assert empty.details.notes[0].startswith("trio.Basic has its loop in its text")
    straight = job.changed({"program.text": "SPEED=60: ACCEL=800: DECEL=800\nMOVE(80,0)\n"})
    assert question(LoopStudy(straight)) == "Which servo period does this job need?"


class OtherLoop(SpiralTheory):
    """The loop of another make, with its own words and twice the error."""

    ramps = "RAMP"
    wait = "PAUSE"
    first_order = "twice"

    def errors(self):
        known = super().errors()
        return known and LoopErrors(Deviation(2 * known.program.rms, 2 * known.program.max), known.spacing)


@pytest.mark.soak
def test_any_controller_with_a_theory_of_its_loop_is_studied(study, monkeypatch):
    """The study reports the errors and uses the words of the theory that the controller gives."""
    known = results(study, known_rows())
    monkeypatch.setattr(MoveSpiral, "loop_theory", classmethod(lambda cls, arguments: OtherLoop(arguments)))
    other = LoopStudy(Job.load("an225"))
    found = results(other, known_rows())
    assert found["loop period", AS_IT_IS, "loop period with the same error as RAMP"] == "100 ms"
    rounding = "program error without {}'s rounding to 1 ms, at "
    mine, theirs = (
        next(number(value) for key, value in table.items() if key[2].startswith(rounding.format(word)))
        for table, word in ((known, "WA"), (found, "PAUSE"))
    )
    assert theirs == pytest.approx(2 * mine, rel=0.01)


def test_studies_have_no_word_of_a_vendor():
    """What they know of a controller, they ask it, or take from the room of jobs."""
    vendors = re.compile(r"\b(?:trio|softmc|mc-basic|fanuc|linuxcnc|an-?225|move ?spiral)\b", flags=re.IGNORECASE)
    words = re.compile(r"\b(?:ACCEL|DECEL|WA|CONNECT|MHELICAL|SERVO_PERIOD|CIRCLE)\b")
    files = sorted(Path(study_room.__file__).parent.rglob("*.py"))
    assert len(files) > 30
    found = {file.name: [*vendors.findall(text), *words.findall(text)] for file in files for text in [file.read_text()]}
    assert {name: texts for name, texts in found.items() if texts} == {}


def test_the_continuous_limit_has_no_interpreter(study):
    continuous = study.job.changed(
        {f"program.{key}": value for key, value in study.theory.alone.items()} | {"program.loop_period": 0.0}
    )
    sweeps = {dict(case.tags)["sweep"] for case in LoopStudy(continuous).cases}
    assert sweeps == set(SWEEPS) - {"interpreter_time"}


# the report of known rows


def row(sweep, variant, value, **values):
    return {"sweep": sweep, "variant": variant, "value": value, "status": "ok", **values}


def results(study, rows):
    """The values of the results table by sweep, variant and result."""
    return {tuple(key): value for *key, value in report(study, rows).tables[0].rows}


def number(text):
    """The first number of a text."""
    return float(re.search(r"[\d.e+]+", text)[0])


def known_rows(floor=10.0, slope=2000.0, least=0.1):
    """A loop whose error is slope T over a floor, alone; as it is, with a least error at a period."""
    periods = np.geomspace(1e-3, 1.0, 31)
    rows = [row("loop_period", NO_LOOP, 0.0, contour_rms_um=floor)]
    for t in periods.tolist():
        rows.append(row("loop_period", LOOP_ALONE, t, contour_rms_um=math.hypot(floor, slope * t)))
        rows.append(row("loop_period", PERFECT, t, program_rms_um=slope * t))
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
    found = results(study, known_rows())
    assert number(found["loop period", LOOP_ALONE, "knee"]) == pytest.approx(1e3 * exact, rel=INTERPOLATED)
    assert found["loop period", NO_LOOP, "contour error"] == "10 µm"
    assert found["loop period", PERFECT, "growth of the program error"] == "T^1.00, 2 µm per ms"


@pytest.mark.soak
def test_a_faster_loop_that_is_worse_is_reported_with_its_cause(study):
    known = report(study, known_rows())
    assert "the contour error has knees at loop period (loop alone) " in known.answer
    found = results(study, known_rows())
    assert found["loop period", AS_IT_IS, "best period"] == "100 ms"
    assert found["loop period", LOOP_ALONE, "contour error at 100 ms"] == "200 µm"
    assert found["loop period", AS_IT_IS, "loop period with the same error as ACCEL"] == "100 ms"
    at, worst = next(
        (number(result.rpartition(" at ")[2]), value)
        for (_, variant, result), value in found.items()
        if variant == AS_IT_IS and value.endswith("times the least")
    )
    error, times = (number(part) for part in worst.split(","))
    assert error == pytest.approx(300 * (at * 1e-2 + 1e2 / at), rel=0.01)
    assert times == pytest.approx(error / 600, rel=0.02)
    uncut = next(value for key, value in found.items() if "without WA's rounding to 1 ms" in key[2])
    assert 170 <= number(uncut) < 180
    assert found["loop period", AS_IT_IS, "no values at and below"] == "3.981 ms"


@pytest.mark.parametrize("resolution", suite_runs([0, 1e-6], 0))
def test_the_cause_is_not_wa_where_its_rounding_is_small(resolution):
    free = LoopStudy(Job.load("an225", [f"wait_resolution={resolution}"]))
    found = results(free, known_rows())
    assert any(value.endswith("times the least") for value in found.values())
    assert not any("WA" in result for _, _, result in found)


@pytest.mark.soak
def test_knees_at_the_ends_of_the_sweep(study):
    key = ("loop period", LOOP_ALONE, "knee")
    assert results(study, known_rows(floor=1e5))[key] == "> 1000 ms"
    assert results(study, known_rows(floor=0.5))[key] == "< 1 ms"


def test_a_faster_loop_is_worse_only_if_it_is(study):
    found = results(study, known_rows(least=1e-5))
    assert ("loop period", AS_IT_IS, "best period") in found
    assert not any(value.endswith("times the least") for value in found.values())


def servo_rows(program=100.0):
    """A servo whose error goes with the square of its period, hidden by the program's part as the job is."""
    rows = []
    for p in (2.5e-4, 5e-4, 1e-3, 2e-3, 4e-3, 8e-3):
        tracking = 10 * (p / 1e-3) ** 2
        values = {
            "contour_rms_um": math.hypot(program, tracking),
            "servo_rms_um": tracking,
            "program_rms_um": program,
            "steady_following_normal_rms_um": 3 * tracking,
        }
        rows.append(row("servo_period", AS_IT_IS, p, **values))
        bare = {"contour_rms_um": tracking, "steady_following_normal_rms_um": 0.9 * tracking}
        rows.append(row("servo_period", NO_LOOP, p, **bare))
        rows.append(row("servo_period", NO_FRICTION, p, steady_following_normal_rms_um=0.05, servo_rms_um=0.3))
    return rows


def test_the_servo_is_reported_as_it_is_and_without_the_loop(study):
    found = results(study, servo_rows())
    at = number(found["servo period", AS_IT_IS, "knee"])
    assert at == pytest.approx(math.sqrt(10 * math.sqrt(0.21)), rel=0.15)  # points an octave apart
    assert found["servo period", NO_LOOP, "knee"] == "< 0.25 ms"
    assert found["servo period", AS_IT_IS, "least program error, which hides the servo's"] == "100 µm"
    assert found["servo period", AS_IT_IS, "servo error exceeds program error above"].startswith("3.16")
    errors = [found["servo period", NO_LOOP, f"contour error at {period} ms"] for period in (0.25, 0.5, 1, 2, 4)]
    assert errors == ["0.625 µm", "2.5 µm", "10 µm", "40 µm", "160 µm"]
    assert found["servo period", NO_LOOP, "growth of the contour error"] == "period^2.0"


def test_the_steady_error_is_given_with_and_without_friction(study):
    found = results(study, servo_rows())
    assert found["servo period", NO_LOOP, "steady normal following error at 2 ms"] == "36 µm"
    assert found["servo period", NO_FRICTION, "steady normal following error at 2 ms"] == "0.05 µm"


def test_a_small_program_error_hides_nothing(study):
    found = results(study, servo_rows(program=1e-3))
    assert found["servo period", AS_IT_IS, "knee"] == "< 0.25 ms"
    assert not any("hides" in result for _, _, result in found)


def test_the_servo_of_a_program_without_a_loop():
    fanuc = LoopStudy(Job.load("fanuc-spiral"))
    rows = [one for one in servo_rows(program=0.0) if one["variant"] != NO_LOOP]
    assert report(fanuc, rows).answer.endswith("has knees at servo period (as it is) < 0.25 ms.")
    found = results(fanuc, rows)
    assert found["servo period", AS_IT_IS, "contour error at 0.25 ms"] == "0.625 µm"
    assert found["servo period", AS_IT_IS, "steady normal following error at 2 ms"] == "120 µm"


def test_the_encoder_of_known_rows(study):
    rows = []
    for q in (1e-4, 1e-3, 1e-2, 1e-1):
        rows.append(row("encoder_resolution", NO_LOOP, q, contour_rms_um=math.hypot(10, 290 * q)))
        rows.append(row("encoder_resolution", AS_IT_IS, q, speed_ripple=q))
    found = results(study, rows)
    count = number(found["encoder resolution", NO_LOOP, "knee"])
    assert count == pytest.approx(1e3 * 10 * math.sqrt(0.21) / 290, rel=0.3)  # points a decade apart
    assert found["encoder resolution", AS_IT_IS, "speed ripple at 0.1 µm"] == "0.01 %"
    assert found["encoder resolution", AS_IT_IS, "speed ripple at 100 µm"] == "10 %"


def stepped_rows(share, variant=AS_IT_IS):
    """AnalysisValues that come closer to 2 by half at each step, and a contour error that scatters by a share of 10."""
    rows = []
    columns = ("servo_rms_um", "following_along_rms_um", "structure_rms_um", "spacing_std_mm")
    for k, h in enumerate((2.5e-4, 1.25e-4, 6.25e-5)):
        values = dict.fromkeys(columns, 2 + 0.06 * 0.5**k)
        rows.append(row("physics_step", variant, h, contour_rms_um=10.0 * (1 + share * (1, 0, 0.5)[k]), **values))
    return rows


def test_the_convergence_over_the_physics_step_is_reported(study):
    rows = stepped_rows(0.01)
    assert convergence(rows, AS_IT_IS)["servo_rms_um"].order == pytest.approx(1.0)
    known = report(study, rows + stepped_rows(0.0, NO_FRICTION))
    cells = {tuple(cells[:2]): cells[2:] for cells in known.tables[-1].cells}
    assert cells["contour error", AS_IT_IS] == ["1", "scatter"]
    assert cells["servo error", AS_IT_IS] == ["3", "1.00"]
    assert cells["contour error", NO_FRICTION] == ["0", "scatter"]
    assert cells["servo error", NO_FRICTION] == ["3", "1.00"]
    assert "at a physics step of 0.25 ms" in known.tables[-1].caption
    assert list(known.details.notes) == []


def test_the_convergence_is_drawn_as_the_distance_from_the_limit(study):
    (plot,) = (plot for plot in plots(study, stepped_rows(0.01)) if plot.name == "physics_step")
    lines = {line.get_label(): line for line in plot.figure.axes[0].lines}
    (servo,) = (
        line for label, line in lines.items() if label.startswith("servo error") and label.endswith("order 1.00")
    )
    assert servo.get_ydata() == pytest.approx([0.03, 0.015, 0.0075])
    assert servo.get_xdata() == pytest.approx([0.25, 0.125, 0.0625])


def test_a_value_that_depends_on_the_physics_step_is_noted(study):
    (note,) = report(study, stepped_rows(0.2)).details.notes
    assert note == "More than 5 % off due to the physics step: contour error."


# from end to end


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    folder = tmp_path_factory.mktemp("loop")
    small = LoopStudy(Job.load("an225", SHORT), **SMALL)
    return small, folder, run_study(small, folder, workers=1)


def test_a_small_study_from_end_to_end(done):
    small, folder, outcome = done
    assert len(outcome.rows) == len(small.cases)
    assert outcome.report.chart.name == "limits"
    assert [row[1] for row in outcome.report.table.rows] == [
        "program.loop_period", "program.interpreter_time", "servo.period", "servo.resolution"
    ]  # fmt: skip
    values, _ = outcome.report.details.tables
    assert {row[0] for row in values.rows} == {"loop period", "interpreter time", "servo period", "encoder resolution"}
    for sweep in SWEEPS:
        assert (folder / "plots" / f"{sweep}.png").read_bytes().startswith(b"\x89PNG")
    report = (folder / "report.html").read_text()
    assert all(f">{title}</h2>" in report for title in SWEEPS.values())


def test_a_run_that_fails_without_a_share_of_a_limit_stands_at_the_top_of_the_chart():
    passing = Acceptance(dict.fromkeys(ASPECTS, "pass"), dict.fromkeys(ASPECTS, 50.0), {})
    failing = Acceptance({**passing.states, "machine": "fail"}, {**passing.uses, "machine": None}, {})
    study = SimpleNamespace(job=SimpleNamespace(program={"loop_period": 0.002}))
    for judged, expected in (({0.001: passing, 0.002: failing}, [0.002]), ({0.001: passing, 0.002: passing}, None)):
        verdicts = SweepVerdicts(LEVERS["loop_period"], judged, Scope(ASPECTS))
        (panel,) = draw_limits(study, {"loop_period": verdicts}).axes
        drawn = {line.get_label(): list(line.get_xdata()) for line in panel.lines}
        assert drawn.get("fails without a share") == expected
        assert drawn["keeps the limits"] == [value for value in judged if judged[value] is passing]
        assert drawn["does not"] == []


def test_the_chart_has_the_limit_and_the_jobs_own_value_beside_every_run(done):
    _, _, outcome = done
    panel = outcome.report.chart.figure.axes[0]
    drawn = {line.get_label(): line.get_xydata() for line in panel.lines}
    assert set(drawn["limit"][:, 1]) == {100.0}
    assert set(drawn["the job's own value"][:, 0]) == {0.05}
    points = drawn["does not"]
    rows = [row for row in outcome.rows if (row["sweep"], row["variant"]) == ("loop_period", "as it is")]
    uses = {
        row["value"]: max(row[f"{name}_limit_use_percent"] for name in ("path", "stability", "machine")) for row in rows
    }
    assert dict(points.tolist()) == pytest.approx(uses)


def test_the_points_of_the_plot_lie_on_the_predictions(done):
    _, _, outcome = done
    (plot,) = [plot for plot in outcome.report.plots if plot.name == "loop_period"]
    drawn = {line.get_label(): line.get_xydata() for line in plot.figure.axes[0].lines}
    points, line = drawn["program, loop alone"], drawn["stepped arcs against the involute"]
    on_line = np.exp(np.interp(np.log(points[:, 0]), np.log(line[:, 0]), np.log(line[:, 1])))
    np.testing.assert_allclose(points[:, 1], on_line, rtol=0.01)
    assert points[:, 0].tolist() == pytest.approx([10, 30, 100])  # in ms


@pytest.mark.soak
def test_plots_of_a_study_without_values(study):
    rows = [{**dict(case.tags), "status": "refused: no"} for case in study.cases]
    plots = study.report(rows).plots
    assert [plot.name for plot in plots] == list(SWEEPS)  # the first answers
    for plot in (plots[0], plots[-1]):
        plot.figure.draw_without_rendering()


def test_the_command(tmp_path, monkeypatch, gantrysim_command):
    from gantrysim.study import loop

    tiny = {**SMALL, "loop_periods": (0.05, 0.1), "servo_periods": (1e-3,), "halvings": 0}
    monkeypatch.setattr(loop, "LoopStudy", functools.partial(LoopStudy, **tiny))
    monkeypatch.setattr("gantrysim.study.loop.report.plots", lambda study, rows: [])  # slow, and drawn above
    settings = [part for setting in SHORT for part in ("--set", setting)]
    status, output, said = gantrysim_command(
        "study", "loop", "an225", *settings, "--out", tmp_path / "a", "--workers", 1
    )
    assert (status, said) == (0, "")
    assert output.startswith("Which loop period does this job need?\n\nNo loop period tried, ")
    assert output.endswith(f"page: {tmp_path / 'a' / 'report.html'}\n")
    assert 'command = "gantrysim study loop job.toml"' in (tmp_path / "a" / "study.toml").read_text()


def test_the_command_refuses_bad_input(tmp_path, gantrysim_command):
    status, _, said = gantrysim_command("study", "loop", "an226", "--out", tmp_path / "new")
    assert (status, said.split(":")[:2]) == (2, ["error", " unknown job 'an226'"])
    status, _, said = gantrysim_command("study", "loop", "--workers", "0", "--out", tmp_path / "new")
    assert status == 2
    assert "'--workers'" in said
    assert not (tmp_path / "new").exists()
