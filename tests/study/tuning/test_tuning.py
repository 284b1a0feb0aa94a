"""Tuning: objective against independent computations, search against a grid, resuming, files and report."""

import csv
import dataclasses
import json
import re
import tomllib

import numpy as np
import pytest

from gantrysim import Budget, InputError, Job, simulate
from gantrysim.base.errors import GantryError
from gantrysim.machine.perturbation import Perturbation
from gantrysim.machine.tolerances import Tolerances
from gantrysim.metrics.analysis import torque_ripple
from gantrysim.servo.stability.margins import margins_of
from gantrysim.study import StudyInterrupted, measure, run_study
from gantrysim.study.ledger import LEDGER
from gantrysim.study.tuning import TuningStudy, objective, report
from gantrysim.study.tuning.candidates import Candidate, TrialResult
from gantrysim.study.tuning.objective import METRICS, case_of, measure_together
from gantrysim.study.tuning.search import History
from gantrysim.study.tuning.servo import TUNED

from support.distinct import unaccounted
from support.soaked import suite_runs
from support.studies import content
from support.tunings import GAINS, best_of_grid, circle, detuned, searched, tuning

pytestmark = pytest.mark.usefixtures("blank_pictures")

OF_GRID = 1.05  # largest ratio of the metric found to the best of an exhaustive grid
EXACT = 1e-12  # relative
BUDGET = 16  # runs of the search that most tests share
NEAR = 1e-3  # relative, of margins found along another grid of frequencies


@pytest.fixture(scope="module")
def job():
    return circle()


@pytest.fixture(scope="module")
def poor():
    return detuned(0.1)


@pytest.fixture(scope="module")
def outcome_with_progress(poor, tmp_path_factory):
    """A finished study, its outcome, its folder, and what its progress was called with beside the news then."""
    folder = tmp_path_factory.mktemp("tune") / "out"
    calls = []
    study = tuning(poor, budget=BUDGET)
    done = run_study(study, folder, workers=1, progress=lambda *progress: calls.append((*progress, study.news)))
    return study, done, folder, calls


@pytest.fixture
def outcome(outcome_with_progress):
    """A finished study, its outcome and its folder."""
    return outcome_with_progress[:3]


# objective


def perturbations(job, count=3):
    return [None, *Tolerances().machines(job.built_machine, count, 5)]


def test_rows_equal_those_of_runs_measured_one_by_one(job):
    servo = job.built_servo.with_values(ki=(0.0, 0.0))
    cases = [case_of(job, servo, one, machine=k) for k, one in enumerate(perturbations(job))]
    for metric in METRICS:
        rows = measure_together(cases, metric)
        alone = [measure(case) for case in cases]
        for row, other in zip(rows, alone, strict=True):
            assert row["status"] == "ok"
            assert row[f"{metric}_um"] == pytest.approx(other[f"{metric}_um"], rel=EXACT)
            assert row["contour_rms_um"] == pytest.approx(other["contour_rms_um"], rel=EXACT)


def test_rows_are_of_runs_with_the_job_s_physics_step(job):
    fine = job.changed({"simulation.physics_step": 1e-4})
    for one in (job, fine):
        (row,) = measure_together([case_of(one, one.built_servo, None)])
        contour = Budget(one.run(engine="loop")).analysis.nozzle.distance
        assert row["contour_rms_um"] == pytest.approx(1e3 * np.sqrt(np.mean(contour**2)), rel=EXACT)


def test_torque_ripple_is_the_largest_of_all_axes_over_the_nominal_peak_torque(job):
    (one,) = perturbations(job, 1)[1:]
    (row,) = measure_together([case_of(job, job.built_servo, one)])
    run = job.run(machine=job.built_machine.perturbed(one))
    shares = torque_ripple(run) / [axis.peak_torque for axis in job.built_machine.axes]
    assert row["torque_ripple_percent"] == pytest.approx(100 * shares.max(), rel=EXACT)
    assert [row[f"{name}_{axis}"] for name in GAINS for axis in "xy"] == [
        gain for name in GAINS for gain in job.built_servo.per_axis(name)
    ]


def test_rows_do_not_depend_on_the_cases_measured_together(job):
    cases = [
        case_of(job, job.built_servo.with_values(kp=(kp, kp)), one)
        for kp in (0.2, 0.4, 0.6, 20.0)
        for one in perturbations(job)
    ]
    together = measure_together(cases)
    assert together == [measure_together([case])[0] for case in cases]
    assert together == measure_together(cases[::-1])[::-1]


def test_the_row_of_a_fault_has_its_time_and_no_metric(job):
    wild = job.built_servo.with_values(kp=tuple(40 * kp for kp in job.built_servo.per_axis("kp")))
    (row,) = measure_together([case_of(job, wild, None)])
    assert row["status"].startswith("fault: ")
    assert 0 < row["fault_time_s"] < 1.0
    assert "contour_rms_um" not in row


def test_a_refused_case_leaves_the_others_intact(job, monkeypatch):
    good, bad = case_of(job, job.built_servo, None), case_of(job, job.built_servo, Perturbation(payload=0.3))
    whole = objective.simulate_batch

    def refusing(machines, *arguments, **more):
        if any(machine is not job_machine for machine in machines):
            raise InputError("simulation 1 of the batch: too heavy")
        return whole(machines, *arguments, **more)

    (first,) = measure_together([good])
    job_machine = objective._machine(good)
    monkeypatch.setattr(objective, "simulate_batch", refusing)
    assert measure_together([good, bad]) == [first, {"status": "refused: simulation 1 of the batch: too heavy"}]


def test_a_case_that_changes_more_than_gains_is_refused(job):
    other = dataclasses.replace(case_of(job, job.built_servo, None), overrides=(("servo.period", "0.002"),))
    with pytest.raises(GantryError, match=r"changes servo\.period: only servo\."):
        measure_together([other])


# search


@pytest.mark.soak
def test_the_search_reaches_the_best_of_an_exhaustive_grid():
    """From gains ten times too low, on the same objective within the same bounds."""
    study = tuning(detuned(0.1), law="pd", budget=150, robust=0, unseen=0)
    history = study.history(searched(study))
    scale = 10 ** np.linspace(-1, 1, 15)
    shares = {"velocity_ff": (0.0, 2.0), "acceleration_ff": (0.5, 1.0)}
    grid, runs = best_of_grid(study, {"kp": scale, "kd": scale, **shares})
    assert runs > 100
    assert history.best.metric <= OF_GRID * grid
    assert history.best.order(0.02)[0] == 1
    assert history.start.metric > 20 * grid


@pytest.mark.soak
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_search_reaches_the_best_of_a_fine_grid_on_machines_that_differ(seed):
    """The grid is fine where the coarse one has its best: 4 gains, 3 machines."""
    study = tuning(detuned(0.1), law="pd", budget=300, robust=2, unseen=0, seed=seed)
    history = study.history(searched(study))
    fine = {"kp": 10 ** np.linspace(0.0, 0.6, 25), "kd": 10 ** np.linspace(-0.5, 0.1, 25)}
    grid, runs = best_of_grid(study, {**fine, "velocity_ff": (0.0, 5.0), "acceleration_ff": (0.6, 0.8, 1.0)})
    assert runs > 1000
    assert history.best.metric <= OF_GRID * grid


def test_the_result_is_run_on_all_machines_and_meets_all_limits(outcome):
    study, done, _ = outcome
    history = study.history(done.rows)
    assert len(history.best.results) == 2
    assert history.best.metric < 0.5 * history.start.metric
    runs = [
        simulate(machine, history.best.servo, study.job.setpoints, dispenser=study.job.dispenser, engine="loop")
        for machine in study.machines
    ]
    errors = [1e3 * np.sqrt(np.mean(Budget(run).analysis.nozzle.distance ** 2)) for run in runs]
    assert history.best.metric == pytest.approx(max(errors), rel=EXACT)
    assert study.stability.machines == 2 + study.guards
    assert float(study.stability.excess(history.best.servo).max()) <= 0
    assert history.best.ripple <= 0.02


def test_the_row_of_the_start_equals_a_run_of_the_job(outcome):
    study, done, _ = outcome
    row = done.rows[0]
    assert (row["stage"], row["machine"]) == ("start", 0)
    contour = Budget(study.run(study.job.built_servo)).analysis.nozzle.distance
    assert row["contour_rms_um"] == pytest.approx(1e3 * np.sqrt(np.mean(contour**2)), rel=EXACT)


def test_the_final_check_runs_start_and_result_on_other_machines(outcome):
    study, done, _ = outcome
    start, tuned = study.unseen_rows(done.rows, "start"), study.unseen_rows(done.rows, "tuned")
    assert len(start) == len(tuned) == 2
    assert not set(map(repr, study.perturbations)) & set(map(repr, study.unseen_perturbations))
    servo = study.history(done.rows).best.servo
    machine = study.job.built_machine.perturbed(study.unseen_perturbations[1])
    contour = Budget(
        simulate(machine, servo, study.job.setpoints, dispenser=study.job.dispenser, engine="loop")
    ).analysis.nozzle.distance
    assert tuned[1]["contour_rms_um"] == pytest.approx(1e3 * np.sqrt(np.mean(contour**2)), rel=EXACT)
    assert tuned[1]["contour_rms_um"] < start[1]["contour_rms_um"]


@pytest.mark.soak
@pytest.mark.parametrize("workers", [2])
def test_the_result_does_not_depend_on_the_number_of_workers(outcome, poor, tmp_path, workers):
    _, done, folder = outcome
    other = run_study(tuning(poor, budget=BUDGET), tmp_path / "b", workers=workers)
    assert other.rows == done.rows
    assert (tmp_path / "b" / TUNED).read_bytes() == (folder / TUNED).read_bytes()


class Interrupted(TuningStudy):
    """Measures one by one, and is interrupted before one of the cases."""

    at = 10**9

    @property
    def measure_together(self):
        def measure_some(cases):
            rows = []
            for case in cases:
                if len(self._measured) == self.at:
                    raise KeyboardInterrupt
                self._measured.append(case.key)
                rows += measure_together([case], self.metric)
            return rows

        return measure_some

    @property
    def _measured(self):
        return self.__dict__.setdefault("_measured_", [])


@pytest.mark.parametrize("at", suite_runs([3, BUDGET + 1], 0))
def test_an_interrupted_search_resumes_to_the_same_result(outcome, poor, tmp_path, at):
    _, done, folder = outcome
    settings = {"budget": BUDGET, "robust": 1, "guards": 2, "unseen": 2}
    broken = Interrupted(poor, **settings)
    object.__setattr__(broken, "at", at)
    with pytest.raises(StudyInterrupted) as interrupted:
        run_study(broken, tmp_path / "a", workers=1)
    kept = interrupted.value.done
    assert list(content(tmp_path / "a")) == [LEDGER]
    rest = Interrupted(poor, **settings)
    again = run_study(rest, tmp_path / "a", workers=1)
    assert again.resumed == kept
    assert len(rest._measured) == len(done.rows) - kept
    assert again.rows == done.rows
    assert content(tmp_path / "a") == content(folder)


@pytest.mark.soak
def test_a_start_that_faults_is_replaced_by_feasible_gains():
    study = tuning(detuned(1.0, kp=40.0, ki=40.0), budget=24)
    rows = searched(study)
    history = study.history(rows)
    assert history.start.order(0.02)[0] == 4
    assert history.best.order(0.02)[0] == 1
    assert report.answer(study, rows).partition(";")[0] == (
        "Run with --servo tuned.toml: the rms contour error, worst of 2 machines, is "
        f"{history.best.metric:.4g} µm instead of fault"
    )
    assert "contour_rms: fault at the start, " in study.text(TUNED, rows)
    assert results(study, rows)["rms contour error, worst of 2 machines [µm]"][0] is None


@pytest.mark.soak
def test_a_machine_with_rotary_axes_is_tuned(tmp_path):
    job = Job.load("stage-outline", ["speed=150", "simulation.settle=0.05"])
    study = tuning(job, budget=20, robust=1, unseen=1)
    rows = searched(study)
    history = study.history(rows)
    assert history.best.order(0.02)[0] == 1
    tables = {plot.name: plot.tables for plot in report.plots(study, rows)}
    assert [row[:3] for row in tables["gains"][0].rows] == [
        [axis, unit, phase] for axis, unit in (("th", "deg"), ("x", "mm"), ("y", "mm")) for phase in ("start", "tuned")
    ]
    (tmp_path / TUNED).write_text(study.text(TUNED, rows))
    assert "# One value per axis: th [deg], x [mm], y [mm].\n" in (tmp_path / TUNED).read_text()
    again = Job.load("stage-outline", ["speed=150"], servo=tmp_path / TUNED)
    assert again.built_servo == history.best.servo


@pytest.mark.soak
def test_axes_tuned_separately_for_the_tracking_error():
    crooked = detuned(0.3)
    crooked = crooked.changed({"servo.kp": [0.1 * crooked.servo.kp[0], crooked.servo.kp[1]]})
    study = tuning(crooked, metric="servo_max", per_axis=True, budget=40, robust=0, unseen=0)
    rows = searched(study)
    history = study.history(rows)
    assert history.best.order(0.02)[0] == 1
    assert history.best.metric == next(
        row["servo_max_um"]
        for row in rows
        if (row["round"], row["candidate"]) == (history.best.round, history.best.number)
    )
    kp = [
        new / old
        for new, old in zip(history.best.servo.per_axis("kp"), history.start.servo.per_axis("kp"), strict=True)
    ]
    assert kp[0] > 2 * kp[1]
    assert "the largest servo error, job's machine, is " in report.answer(study, rows)
    assert any("each axis by itself" in note for note in report.notes(study, rows))


OF_EVOLUTION = 14.57  # least servo_max of the circle in 1840 runs of SciPy's differential evolution [µm]


@pytest.mark.soak
def test_the_largest_error_is_minimised_in_the_better_of_its_two_valleys(monkeypatch):
    """Velocity feed-forward far above the viscous torque compensates friction; a descent from its share stays there."""
    study = tuning(circle(), metric="servo_max", budget=60, robust=0, unseen=0)
    assert study.history(searched(study)).best.metric < 1.1 * OF_EVOLUTION
    monkeypatch.setattr("gantrysim.study.tuning.study.OF_LARGEST", frozenset())
    assert study.history(searched(study)).best.metric > 1.5 * OF_EVOLUTION


@pytest.mark.soak
def test_a_search_on_the_job_s_own_machine_alone():
    study = tuning(detuned(0.1), robust=0, unseen=0, budget=30)
    rows = searched(study)
    assert {row["machine"] for row in rows} == {0}
    assert study.history(rows).runs == len(rows) == 30
    assert "the rms contour error, job's machine, is " in report.answer(study, rows)
    assert not any("unseen" in name for name in results(study, rows))
    assert [plot.name for plot in report.plots(study, rows)] == ["path", "budget", "search", "gains", "loop"]


def test_the_answer_names_the_constraint_that_the_start_misses(job, monkeypatch):
    study = tuning(job, budget=4, robust=0, unseen=0)
    start = Candidate(0, 1, job.built_servo, 0.5, {0: TrialResult(10.0, 0.01)})
    best = Candidate(1, 1, job.built_servo, -0.1, {0: TrialResult(20.0, 0.01)})
    monkeypatch.setattr(
        TuningStudy, "history", lambda study, rows: History([start, best], [start, best], 0, 2, 1, "budget")
    )
    assert report.answer(study, []).startswith(
        "Run with --servo tuned.toml: the rms contour error, job's machine, is 20 µm instead of 10 µm (margin too "
        "small); "
    )
    restless = Candidate(1, 1, job.built_servo, -0.1, {0: TrialResult(20.0, 0.5)})
    monkeypatch.setattr(
        TuningStudy, "history", lambda study, rows: History([start, restless], [start, restless], 0, 2, 1, "budget")
    )
    assert report.answer(study, []) == (
        "No gains within the limits of the search found: with the best of the others the rms contour error, job's "
        "machine, is 20 µm (torque ripple too high) instead of 10 µm (margin too small)."
    )


@pytest.mark.soak
def test_the_start_stays_where_nothing_better_is_found(outcome):
    first, done, folder = outcome
    found = Job.load(folder / "job.toml", servo=folder / TUNED)
    study = tuning(found, budget=4)
    rows = searched(study)
    history = study.history(rows)
    assert history.start.metric == first.history(done.rows).best.metric
    assert history.best is history.start
    text = f"No better gains found: rms contour error, worst of 2 machines, stays at {history.start.metric:.4g} µm; "
    assert report.answer(study, rows).startswith(text)


def test_settings_are_the_arguments_and_name_gains_that_are_held(job):
    settings = tuning(job).settings
    assert settings["budget"] == 40
    assert "held" not in settings
    assert tuning(job, held=("kd",)).settings == {**settings, "held": ["kd"]}


def test_the_law_is_that_of_the_job_by_default(job):
    assert tuning(job).space.name == "pid"
    assert tuning(circle(integral_time=float("inf"))).space.name == "pd"
    assert tuning(job, law="pd").space.name == "pd"
    assert tuning(job).settings["law"] == "pid"


# what is refused


@pytest.mark.parametrize(
    ("settings", "text"),
    [
        ({"budget": 3}, "budget = 3: must be at least 4, start and one candidate per machine"),
        ({"budget": 1, "robust": 0}, "budget = 1: must be at least 2, start and one candidate per machine"),
        ({"law": "pod"}, "unknown law 'pod': did you mean pd? known: pd, pid"),
        ({"metric": "contour"}, "unknown metric 'contour': did you mean contour_"),
        ({"margin": 1.0}, "margin = 1: must be greater than 1, the gain factor at which a loop turns unstable"),
        ({"ripple": 0.0}, "ripple = 0 %: must be greater than 0 %"),
        ({"guards": 257}, "guards = 257: must be at most 256"),
        ({"batch": 0}, "batch = 0: must be at least 1"),
        ({"robust": -1}, "robust = -1: must be at least 0"),
        ({"robust": 65, "budget": 999}, "robust = 65: must be at most 64"),
        ({"unseen": -1}, "unseen = -1: must be at least 0"),
        ({"seed": 2**32}, "seed = 4294967296: must be at most 4294967295"),
        (
            {"spread": Tolerances(0, 0, 0, 0, 0)},
            "spread: must be above 0 for at least one factor, or robust and unseen be 0",
        ),
    ],
)
def test_settings_out_of_bounds_are_refused(job, settings, text):
    with pytest.raises(InputError, match=f"^{re.escape(text)}"):
        tuning(job, **settings)


def test_a_job_without_glue_is_refused_before_anything_is_written(tmp_path):
    job = circle().changed({"program.program": CIRCLE_WITHOUT_GLUE})
    with pytest.raises(InputError, match="the dispenser is never on in this run"):
        run_study(tuning(job), tmp_path / "a", workers=1)
    assert not list(tmp_path.iterdir())


CIRCLE_WITHOUT_GLUE = """
%
O0001
N10 G17 G21 G90
N20 G00 X10 Y0
N30 M30
%
"""


def test_a_machine_that_cannot_run_the_job_is_refused_before_anything_is_written(tmp_path):
    job = circle()
    study = tuning(job)
    slow = study.machines[1]
    slow.plain_axes = tuple(dataclasses.replace(axis, declared_speed=50.0) for axis in slow.plain_axes)
    with pytest.raises(InputError, match=r"speed of . = .* must be at most 50 mm/s"):
        run_study(study, tmp_path / "a", workers=1)
    assert not list(tmp_path.iterdir())


# what is written


def test_the_folder_holds_rows_servo_report_and_plots(outcome):
    study, done, folder = outcome
    names = set(content(folder))
    assert names == {
        "study.csv", "study.toml", "job.toml", "report.html", TUNED, *(f"plots/{name}.png" for name in study.plots),
    }  # fmt: skip
    with (folder / "study.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == len(done.rows)
    assert list(rows[0])[:5] == ["stage", "round", "candidate", "machine", "status"]
    described = tomllib.loads((folder / "study.toml").read_text())
    assert described["command"] == "gantrysim tune job.toml"
    assert described["settings"] == {
        "law": "pid", "metric": "contour_rms", "budget": BUDGET, "robust": 1, "guards": 2, "batch": 1, "margin": 2.0,
        "ripple": 2.0, "per_axis": False, "unseen": 2, "seed": 1, "spread": dataclasses.asdict(Tolerances()),
    }  # fmt: skip
    page = (folder / "report.html").read_text()
    for title in ("Error budget", "Error along the path", "Search", "Gains", "Loops and margins", "Unseen machines"):
        assert page.count(f">{title}</h2>") == 1


def test_start_and_tuned_lie_over_one_another_on_one_scale(outcome):
    """Each line is the error of its own servo, simulated again."""
    study, done, _ = outcome
    (plot,) = (plot for plot in report.plots(study, done.rows) if plot.name == "path")
    contour = plot.figure.axes[0]
    lines = {line.get_label(): line for line in contour.lines}
    runs = json.loads(plot.viewer)["runs"]
    assert [run["name"] for run in runs] == ["start", "tuned"]
    for phase, servo in (("start", study.job.built_servo), ("tuned", study.history(done.rows).best.servo)):
        lateral = 1e3 * Budget(simulate(study.job.built_machine, servo, study.job.setpoints)).contour.lateral
        shown = lines[phase].get_ydata()
        assert (np.nanmin(shown), np.nanmax(shown)) == pytest.approx((lateral.min(), lateral.max()), rel=EXACT)
        assert contour.get_ylim()[0] < lateral.min() < lateral.max() < contour.get_ylim()[1]


def test_the_tuned_servo_is_written_exactly(outcome):
    study, done, folder = outcome
    history = study.history(done.rows)
    table = tomllib.loads((folder / TUNED).read_text())["servo"]
    # what was tuned alone: all else is the job's
    assert list(table) == ["kp", "ki", "kd", "velocity_ff", "acceleration_ff"]
    again = Job.load(folder / "job.toml", servo=folder / TUNED)
    assert again.built_servo == history.best.servo
    contour = Budget(again.run(engine="loop")).analysis.nozzle.distance
    row = next(
        row
        for row in done.rows
        if (row["round"], row["candidate"], row["machine"]) == (history.best.round, history.best.number, 0)
    )
    assert 1e3 * np.sqrt(np.mean(contour**2)) == pytest.approx(row["contour_rms_um"], rel=EXACT)
    text = (folder / TUNED).read_text()
    values = f"{history.start.metric:.4g} µm at the start, {history.best.metric:.4g} µm tuned"
    assert f"# contour_rms: {values}, the worst of 2 machines.\n" in text
    start = ", ".join(f"{value:.4g}" for value in history.start.servo.per_axis("kd"))
    assert re.search(rf"^kd = \[.*\]  # \[N·m·s/mm\], was {re.escape(start)}$", text, re.MULTILINE)


def test_the_results_name_the_gains_that_changed_from_and_to(outcome):
    study, done, _ = outcome
    history = study.history(done.rows)
    start = history.start.servo
    best = history.best.servo
    table = results(study, done.rows)
    units = {"kp": "N·m/mm", "ki": "N·m/(mm·s)", "kd": "N·m·s/mm", "velocity_ff": "N·m·s/mm"}
    units["acceleration_ff"] = "N·m·s²/mm"
    changed = {
        f"{name} of {axis} [{unit}]": [start.per_axis(name)[a], best.per_axis(name)[a], None]
        for name, unit in units.items()
        for a, axis in enumerate("xy")
        if f"{start.per_axis(name)[a]:.4g}" != f"{best.per_axis(name)[a]:.4g}"
    }
    assert changed
    assert {name: cells for name, cells in table.items() if " of x [" in name or " of y [" in name} == changed


def results(study, rows):
    """The table of results: start, tuned and limit by quantity."""
    (table,) = report.tables(study, rows)
    return {name: cells for name, *cells in table.rows}


def test_the_report_has_the_values_of_the_rows(outcome):
    study, done, folder = outcome
    history, table = study.history(done.rows), results(study, done.rows)
    start, best = history.start, history.best
    answer = report.answer(study, done.rows)
    name = "rms contour error, worst of 2 machines"
    assert answer.startswith(f"Run with --servo tuned.toml: the {name}, is {best.metric:.4g} µm instead of ")
    # the clause on the verdict is that of a run with the tuned gains
    verdict = Job.load(folder / "job.toml", servo=folder / TUNED).run().verdict
    failing = [aspect for aspect in ("path", "stability", "machine") if verdict[aspect].state == "fail"]
    assert ("; the job then still fails (" in answer) is bool(failing)
    assert ("; the job then keeps " in answer) is (not failing)
    assert table["rms contour error, worst of 2 machines [µm]"] == [start.metric, best.metric, None]
    budgets = [
        Budget(simulate(study.job.built_machine, servo, study.job.setpoints)).values.contour
        for servo in (start.servo, best.servo)
    ]
    assert table["rms contour error, job's machine [µm]"][:2] == [1e3 * own.rms for own in budgets]
    assert table["largest contour error, job's machine [µm]"][:2] == [1e3 * own.max for own in budgets]
    gain, phase, peak = (table[name] for name in ("gain margin alone", "phase margin [deg]", "peak of |S|"))
    assert gain[1] >= gain[2] == study.margin
    assert phase[1] >= phase[2] == pytest.approx(28.955, abs=1e-3)
    assert peak[1] <= peak[2] == 2.0
    assert table["relative torque ripple [%]"] == [100 * start.ripple, 100 * best.ripple, study.ripple]
    assert (
        f"{history.runs} runs (budget {BUDGET}) of {len(history.candidates)} candidates"
        in report.notes(study, done.rows)[-2]
    )


def test_every_value_of_a_phase_stands_in_its_column(outcome):
    """Against the two servos' own margins and budgets, on every machine."""
    study, done, folder = outcome
    page = {plot.name: plot.tables for plot in report.plots(study, done.rows)}
    servos = {
        "start": study.job.built_servo,
        "tuned": Job.load(folder / "job.toml", servo=folder / TUNED).built_servo,
    }
    assert servos["start"] != servos["tuned"]
    table, (loops,), (gains,), (links,) = (
        report.tables(study, done.rows)[0],
        page["loop"],
        page["gains"],
        page["budget"],
    )
    cells = {name: dict(zip(table.heads[1:], row, strict=True)) for name, *row in table.rows}
    assert loops.heads == [
        "axis", "", "gain margin alone", "lower gain margin", "phase margin [deg]", "delay margin [ms]", "peak of |S|",
        "crossover [Hz]",
    ]  # fmt: skip
    for phase, servo in servos.items():
        by_machine = [margins_of(machine, servo) for machine in study.guarded]
        every = [axis for machine in by_machine for axis in machine]
        assert cells["gain margin alone"][phase] == pytest.approx(min(one.gain for one in every), rel=NEAR)
        assert cells["phase margin [deg]"][phase] == pytest.approx(min(one.phase for one in every), rel=NEAR)
        assert cells["peak of |S|"][phase] == pytest.approx(max(one.sensitivity for one in every), rel=NEAR)
        for a, axis in enumerate("xy"):
            own = [machine[a] for machine in by_machine]
            (shown,) = (row[2:] for row in loops.rows if row[:2] == [axis, phase])
            assert shown == pytest.approx(
                [
                    min(one.gain for one in own),
                    max(one.gain_lower for one in own),
                    min(one.phase for one in own),
                    1e3 * min(one.delay for one in own),
                    max(one.sensitivity for one in own),
                    own[0].crossover,
                ],
                rel=NEAR,
            )
            (shown,) = (row[3:] for row in gains.rows if row[0] == axis and row[2] == phase)
            assert shown == [servo.per_axis(head.split()[0])[a] for head in gains.heads[3:]]
        budget = Budget(simulate(study.job.built_machine, servo, study.job.setpoints)).values
        for link, *row in links.rows:
            part = {**budget.parts, "contour": budget.contour}[link]
            shown = dict(zip(links.heads[1:], row, strict=True))
            expected = {"rms [µm]": 1e3 * part.rms, "95 % [µm]": 1e3 * part.p95, "max [µm]": 1e3 * part.max}
            expected["share [%]"] = 100 * part.share
            for head, value in expected.items():
                assert (shown[f"{head}, {phase}"] or 0.0) == pytest.approx(value, abs=1e-6)
        unseen = sorted(row["contour_rms_um"] for row in study.unseen_rows(done.rows, phase))
        for name, value in (("median", unseen[0]), ("95 %", unseen[1]), ("worst", unseen[1])):
            assert cells[f"rms contour error, {name} of 2 unseen [µm]"][phase] == value


def test_every_number_of_the_text_is_in_a_table(outcome):
    study, done, _ = outcome
    tables = report.tables(study, done.rows)
    assert unaccounted(report.answer(study, done.rows).partition(";")[0], tables, 2) == []
    links = [table for plot in report.plots(study, done.rows) if plot.name == "budget" for table in plot.tables]
    notes = [note for note in report.notes(study, done.rows) if note.startswith("Largest part")]
    assert len(notes) == 1
    assert unaccounted(notes[0], links) == []


@pytest.mark.soak
def test_the_seed_chooses_the_candidates_and_the_machines(poor):
    def rows(seed):
        return searched(tuning(poor, budget=8, robust=1, unseen=1, seed=seed))

    first, again, other = rows(1), rows(1), rows(2)
    assert first == again
    tried = [[(row["kp_x"], row["kd_x"]) for row in one if row["candidate"] > 1] for one in (first, other)]
    assert tried[0] != tried[1]
    machines = [tuning(poor, seed=seed).perturbations[1] for seed in (1, 1, 2)]
    assert machines[0] == machines[1] != machines[2]


def test_the_median_of_unseen_machines_is_that_of_the_lower_half(outcome):
    study, done, _ = outcome
    table = results(study, done.rows)
    for k, phase in enumerate(("start", "tuned")):
        errors = [row["contour_rms_um"] for row in study.unseen_rows(done.rows, phase)]
        assert table["rms contour error, median of 2 unseen [µm]"][k] == min(errors)
        assert table["rms contour error, worst of 2 unseen [µm]"][k] == max(errors)
        servo = study.history(done.rows).phases[phase].servo
        peaks = [max(axis.sensitivity for axis in study.unseen_stability.margins(servo, machine)) for machine in (0, 1)]
        assert table["unseen machines within all limits"][k] == sum(peak <= 2.0 for peak in peaks)


@pytest.mark.soak
def test_a_note_says_that_tuning_cannot_fix_errors_of_the_program():
    job = Job.load("an225", ["turns=1", "diameter=40", "simulation.settle=0.05"])
    study = tuning(job, budget=8, robust=0, unseen=0)
    notes = " ".join(report.notes(study, searched(study)))
    assert "Largest part of the tuned contour error: program, " in notes
    assert "Tuning cannot fix program errors; the metric servo_rms is the servo's error alone." in notes


def test_progress_covers_all_rounds_and_shows_the_best_metric_so_far(outcome_with_progress):
    study, done, _, calls = outcome_with_progress
    counts = [count for count, _, _ in calls]
    assert counts == sorted(counts)
    assert counts[-1] == len(done.rows)
    # the runs of the search, and of start and result on two unseen machines
    assert {every for _, every, _ in calls[:-1]} == {BUDGET + 4}
    best = study.history(done.rows).best
    assert calls[-1][2] == f"best {best.metric:.3g} µm"


def test_a_study_does_not_repeat_its_own_search_for_its_report(poor):
    """Another one replays it from the rows."""
    study = tuning(poor, budget=4, unseen=0)
    rows = searched(study)
    leaders = len(study.leaders)
    history = study.history(rows)
    assert study.history(list(rows)) is history
    assert len(study.leaders) == len(history.leaders) == leaders
    other = tuning(poor, budget=4, unseen=0)
    replayed = other.history(rows)
    assert replayed.best.servo == history.best.servo
    assert replayed.runs == history.runs == len(rows)
    # rows of a search that has gone otherwise
    worse = [{**row, "contour_rms_um": 2 * row.get("contour_rms_um", 0.0)} for row in rows]
    assert study.history(worse).start.metric == pytest.approx(2 * history.start.metric)
