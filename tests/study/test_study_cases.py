"""Cases of a study, and their rows."""

import math
import pickle
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure

from gantrysim import Job, Machine
from gantrysim.glue.bead import Bead, HeightMap
from gantrysim.machine.perturbation import Perturbation
from gantrysim.metrics.analysis import Analysis, path_speed, speed_ripple, steady
from gantrysim.metrics.budget import Budget
from gantrysim.servo.stability.margins import margins_of
from gantrysim.study import Case, measure, simulated, values_row
from gantrysim.study.cases import verdict_row
from gantrysim.study.drawing import logarithmic, series

from support.studies import SHORT

NO_LAGS = {
    f"dispenser.{key}": None for key in ("dead_time", "opening", "closing", "start_lead", "stop_lead", "advance")
}
BEAD = 1e-3  # relative, of a width or volume that is known


@pytest.fixture(scope="module")
def job():
    return Job.load("an225", SHORT)


def test_a_case_is_a_value_that_can_be_sent(job):
    case = Case.of(
        job, {"program.loop_period": 0.1, "program.ratio_bits": None}, perturbation=Perturbation(payload=0.1), a=1
    )
    assert pickle.loads(pickle.dumps(case)) == case
    assert hash(pickle.loads(pickle.dumps(case))) == hash(case)
    assert case.settings == {"program.loop_period": 0.1, "program.ratio_bits": None}
    assert "ratio_bits" not in case.job().program
    assert case.job().program["loop_period"] == 0.1


def test_the_key_identifies_the_result_without_the_tags(job):
    case = Case.of(job, {"program.loop_period": 0.1})
    others = [
        Case.of(job),
        Case.of(job, {"program.loop_period": 0.2}),
        Case.of(job, {"program.loop_period": 0.1}, "perfect follower"),
        Case.of(job, {"program.loop_period": 0.1}, perturbation=Perturbation(payload=0.1)),
        Case.of(job.changed({"program.speed": 140.0}), {"program.loop_period": 0.1}),
    ]
    assert len({case.key, *(other.key for other in others)}) == 6
    assert case.tagged(sweep="a").key == case.key
    assert dict(case.tagged(sweep="a").tagged(sweep="b").tags) == {"sweep": "b"}


def test_values_that_the_job_has_already_are_no_overrides(job):
    own = {"program.loop_period": 0.05, "program.turns": 1, "program.wait_resolution": 1e-3, "servo.period": 1e-3}
    assert Case.of(job, own) == Case.of(job)
    assert Case.of(job, {**own, "program.turns": 2}).settings == {"program.turns": 2}
    for none in ({"program.lop_period": None}, {"name.x": 1}, {"servo.perod": 1}):
        assert Case.of(job, none).settings == none
        assert measure(Case.of(job, none))["status"].startswith("refused: unknown key")


def test_a_changed_case_shares_unchanged_parts_of_the_job(job):
    encoder, slower = Case.of(job, {"servo.resolution": 0.01}), Case.of(job, {"program.speed": 120.0})
    own, same = Case.of(job).job(), encoder.job()
    assert same is encoder.job()
    assert same.built_machine is own.built_machine
    assert same.controller is own.controller
    assert slower.job().controller is not own.controller
    assert slower.job().controller.speed == 120.0
    other = Case.of(job, {"machine": "xyz"}).job()
    assert other.built_machine.name == "xyz"
    fresh = Job.load("an225", [*SHORT, "servo.resolution=0.01"])
    assert measure(encoder).items() >= {"status": "ok", **values_row(fresh.run(engine="loop"), fresh.bead)}.items()


def test_the_key_belongs_to_a_version(job, monkeypatch):
    before = Case.of(job).key
    monkeypatch.setattr("gantrysim.study.cases.version", lambda _: "99")
    assert Case.of(job).key != before


def test_the_row_of_a_case_is_of_its_run(job):
    run = simulated(Case.of(job))
    row, analysis = measure(Case.of(job)), Analysis(job.run(engine="loop"))
    budget, figures = Budget(analysis), analysis.values
    verdict = job.run(engine="loop").verdict
    columns = {f"{aspect.name}_verdict": aspect.state for aspect in verdict.rows}
    columns |= {f"{aspect.name}_limit_use_percent": 100 * aspect.checks[0].usage for aspect in verdict.rows}
    checks = {f"{aspect.name}_check": row[f"{aspect.name}_check"] for aspect in verdict.rows}
    assert row == {"status": "ok", **values_row(run), **columns, **checks}
    for aspect in verdict.rows:
        assert str(aspect.checks[0]).startswith(checks[f"{aspect.name}_check"])
    assert row["contour_rms_um"] == pytest.approx(1e3 * figures.contour.rms)
    assert row["program_max_um"] == pytest.approx(1e3 * figures.program.max)
    assert row["servo_rms_um"] == pytest.approx(1e3 * budget.values.parts["servo"].rms)
    assert row["encoder_p95_um"] == pytest.approx(1e3 * budget.values.parts["encoder"].p95)
    assert row["structure_max_um"] == pytest.approx(1e3 * budget.values.parts["structure"].max)
    assert row["lag_max_um"] == pytest.approx(1e3 * budget.values.lag.max)
    assert row["following_x_rms_um"] == pytest.approx(1e3 * figures.following["x"].rms)
    assert row["following_along_rms_um"] == pytest.approx(1e3 * figures.following_along.rms)
    assert row["spacing_mean_mm"] is None  # of one turn
    assert row["speed_ripple"] == speed_ripple(run)
    bead = Bead(run, job.bead).values
    assert row["bead_width_mean_mm"] == pytest.approx(bead.width.mean)
    assert row["volume_error_percent"] == pytest.approx(bead.volume_error_percent)
    assert (row["end_x_mm"], row["end_y_mm"], row["end_z_mm"]) == figures.end_point


def test_the_lag_in_a_row_is_that_of_its_magnitude(job):
    """A lag of either sign: leading and lagging ticks count alike."""
    case = Case.of(job, {"servo.feedforward": 0.5})
    signed = Budget(case.job().run()).lag
    lag = np.abs(signed)
    assert np.percentile(signed, 95) < 0.95 * np.percentile(lag, 95)
    row = measure(case)
    expected = np.sqrt(np.mean(lag**2)), np.percentile(lag, 95), lag.max()
    assert [row[f"lag_{name}_um"] for name in ("rms", "p95", "max")] == pytest.approx([1e3 * one for one in expected])


def test_spacing_and_rotary_axes_in_a_row(job):
    row = measure(Case.of(job, {"program.turns": 2}, "perfect follower"))
    assert row["spacing_mean_mm"] == pytest.approx(5.0, abs=0.2)
    stage = measure(Case.of(Job.load("stage-outline"), mode="perfect follower"))
    assert "following_th_rms_mdeg" in stage
    assert "following_x_rms_um" in stage


def test_the_bead_in_a_row_is_the_job_s(job):
    glue = {"dispenser.flow": 0.0, "dispenser.area": 2.0, "bead.contact_angle": 90.0, "bead.squashed": False}
    row = measure(Case.of(job.changed(NO_LAGS), glue, "perfect follower"))
    assert row["bead_width_mean_mm"] == pytest.approx(math.sqrt(8 * 2.0 / math.pi), rel=BEAD)  # a half-disc
    assert row["volume_error_percent"] == pytest.approx(0, abs=100 * BEAD)


def test_a_slow_valve_withholds_the_flow_of_its_time_constant(job):
    opening, flow = 0.05, 200.0
    own = job.changed({**NO_LAGS, "dispenser.flow": flow, "program.acceleration": math.inf})
    prompt, late = (Case.of(own, {"dispenser.opening": T}, "perfect follower") for T in (0.0, opening))
    run = simulated(prompt)
    asked = flow * run.period * np.count_nonzero(run.dispense[:-1])  # at one speed all the way
    errors = [measure(case)["volume_error_percent"] for case in (prompt, late)]
    assert errors == pytest.approx([0, -100 * flow * opening / asked], abs=0.5)
    assert errors[1] - errors[0] == pytest.approx(-100 * flow * opening / asked, rel=0.01)


def test_a_row_takes_no_height_map(job, monkeypatch):
    monkeypatch.setattr(HeightMap, "of", None)
    assert measure(Case.of(job, {"program.turns": 2}))["bead_width_mean_mm"] > 0


def test_a_row_without_glue_has_no_bead(job):
    dry = dict.fromkeys(("flow", "area", "pressure"), 0.0)
    row = measure(Case.of(job, {f"dispenser.{key}": value for key, value in dry.items()}))
    assert row["status"] == "ok"
    assert row["bead_width_mean_mm"] is row["volume_error_percent"] is None


def test_the_steady_error_is_that_of_the_middle(job):
    run = simulated(Case.of(job))
    row, on = values_row(run), np.flatnonzero(run.dispense)
    middle = on[steady(on.size)]
    assert (middle[0] - on[0], on[-1] - middle[-1]) == (round(0.05 * on.size), round(0.05 * on.size))
    error = (run.commanded - run.encoder)[middle]
    both = row["steady_following_along_rms_um"] ** 2 + row["steady_following_normal_rms_um"] ** 2
    assert both == pytest.approx(1e6 * np.mean(np.sum(error**2, axis=1)), rel=1e-9)
    assert speed_ripple(run) == pytest.approx(path_speed(run)[middle].std() / path_speed(run)[middle].mean())


def test_a_perfect_follower_has_the_program_s_error_alone(job):
    row = measure(Case.of(job, mode="perfect follower"))
    assert row["contour_rms_um"] == row["program_rms_um"] > 1
    assert row["servo_rms_um"] == row["encoder_rms_um"] == row["structure_rms_um"] == 0


def test_a_perturbed_case(job):
    plain, smooth = measure(Case.of(job)), measure(Case.of(job, perturbation=Perturbation(friction=1e-3)))
    assert smooth["steady_following_normal_rms_um"] < 0.2 * plain["steady_following_normal_rms_um"]


def test_refused_and_faulted_cases_are_rows(job):
    assert measure(Case.of(job, {"program.turns": 9})) == {
        "status": "refused: job an225: inner_diameter = -60 mm (diameter 30 - 2 x turns 9 x thickness 5): "
        "must be at least 0 mm; use turns at most 2 or thickness below 1.66667 mm"
    }
    assert measure(Case.of(job, {"servo.perod": 1}))["status"].startswith(
        "refused: unknown key 'servo.perod': did you mean servo.period, "
    )
    assert measure(Case.of(job, {"program.start": [1e3, 0.0]}))["status"].startswith("refused: x = ")
    fault = measure(Case.of(job, {"servo.following_error_limit": 1e-3}))
    assert list(fault) == ["status"]
    assert fault["status"].startswith("fault: following error on axis")


def test_series_takes_the_rows_with_tags_and_columns(job):
    rows = [
        {"status": "ok", "sweep": "a", "value": 2.0, "error": 4.0},
        {"status": "ok", "sweep": "a", "value": 1.0, "error": 1.0},
        {"status": "ok", "sweep": "a", "value": 3.0, "error": None},
        {"status": "refused: no", "sweep": "a", "value": 4.0},
        {"status": "ok", "sweep": "b", "value": 5.0, "error": 25.0},
    ]
    value, error = series(rows, "value", "error", sweep="a")
    np.testing.assert_array_equal(value, [1, 2])
    np.testing.assert_array_equal(error, [1, 4])
    assert [column.size for column in series(rows, "value", "error", sweep="c")] == [0, 0]
    assert math.isclose(series(rows, "error")[0].sum(), 30)


@pytest.mark.parametrize(
    ("low", "high", "expected"),
    [
        (1.0, 10.0, [1, 2, 5, 10]),  # four round numbers are enough
        (0.2, 20.0, [0.2, 0.5, 1, 2, 5, 10, 20]),
        (1.0, 5.0, [1, 1.5, 2, 3, 5]),
        (1.0, 2.0, [1, 1.2, 1.5, 2]),
    ],
)
@pytest.mark.parametrize("direction", ["x", "y"])
def test_a_logarithmic_axis_has_four_round_numbers_at_least(direction, low, high, expected):
    axes = Figure().subplots()
    logarithmic(axes, direction, [high, low, math.sqrt(low * high)])
    axis = axes.xaxis if direction == "x" else axes.yaxis
    assert axis.get_scale() == "log"
    assert axis.get_majorticklocs() == pytest.approx(expected)
    assert len(axis.get_minorticklocs()) == 0
    assert [axis.get_major_formatter()(tick) for tick in expected] == [f"{tick:g}" for tick in expected]
    margin = 1.06 * (high / low) ** 0.03
    assert axis.get_view_interval() == pytest.approx([low / margin, high * margin])


def test_the_machine_of_a_case_is_built_once(job, monkeypatch):
    """Its run and the verdict on it have the same one."""
    built = []
    perturbed = Machine.perturbed

    def counted(machine, perturbation):
        built.append(perturbation)
        return perturbed(machine, perturbation)

    monkeypatch.setattr(Machine, "perturbed", counted)
    perturbation = Perturbation(payload=0.123)
    assert measure(Case.of(job, perturbation=perturbation))["status"] == "ok"
    # what may be perturbed besides is the nominal machine, for what all cases share
    assert built.count(perturbation) == 1


def test_the_feet_of_a_case_do_not_depend_on_the_cases_before(job):
    """The path at the feet of the command is remembered from run to run of a program."""
    perturbations = [Perturbation(payload=0.2), Perturbation(stiffness=0.5)]
    first, second = (simulated(Case.of(job, perturbation=perturbation)) for perturbation in perturbations)
    Analysis(first).commanded, Analysis(second).commanded
    afterwards = Analysis(second)
    alone = Analysis(second.replaced(requested=replace(second.requested)))
    for name in ("commanded", "nozzle"):
        for column, values in vars(getattr(alone, name)).items():
            assert np.array_equal(values, getattr(getattr(afterwards, name), column))


def test_the_verdict_on_a_perturbed_case_has_the_margins_of_its_machine(job):
    """Motors of twice the constant double the gain of the loops."""
    run = job.follow()
    limits = job.limits(run.face)
    least = []
    for perturbation in (None, Perturbation(motor_constant=2.0)):
        machine = job.built_machine if perturbation is None else job.built_machine.perturbed(perturbation)
        margins = margins_of(machine, job.built_servo)
        least.append(min(axis.least_gain for axis in margins))
        use = max(limits.gain_margin / least[-1], max(axis.sensitivity for axis in margins) / limits.sensitivity)
        row = verdict_row(Case.of(job, perturbation=perturbation), run)
        assert row["stability_limit_use_percent"] == pytest.approx(100 * use, rel=1e-6)
    assert least[1] < 0.9 * least[0]
