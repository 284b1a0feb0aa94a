"""Tuning: the objective against other ways to it, the search against a grid, resuming, and what is written."""

import csv
import dataclasses
import re
import tomllib

import numpy as np
import pytest

from gantrysim import Budget, InputError, Job, Servo, simulate
from gantrysim.errors import GantryError
from gantrysim.machine.perturbation import Perturbation
from gantrysim.machine.tolerances import Tolerances
from gantrysim.metrics.analysis import torque_ripple
from gantrysim.study import StudyInterrupted, measure, run_study
from gantrysim.study.ledger import LEDGER
from gantrysim.tuning import TuningStudy, findings, objective
from gantrysim.tuning.objective import FIGURES, case_of, measure_together
from gantrysim.tuning.search import Candidate
from gantrysim.tuning.servo import TUNED

from support.studies import content
from support.tunings import GAINS, best_of_grid, circle, detuned, searched, tuning

OF_GRID = 1.05  # the figure found over the best one of an exhaustive grid, at most
EXACT = 1e-12  # relative


@pytest.fixture(scope="module")
def job():
    return circle()


@pytest.fixture(scope="module")
def poor():
    return detuned(0.1)


@pytest.fixture(scope="module")
def outcome(poor, tmp_path_factory):
    """A study carried out, and its folder."""
    folder = tmp_path_factory.mktemp("tune") / "out"
    study = tuning(poor, budget=44)
    return study, run_study(study, folder, workers=1), folder


# objective


def perturbations(job, count=3):
    return [None, *Tolerances().machines(job.built_machine, count, 5)]


def test_a_row_holds_what_a_study_of_runs_one_by_one_would_tell(job):
    servo = dataclasses.replace(job.built_servo, ki=(0.0, 0.0))
    cases = [case_of(job, servo, one, machine=k) for k, one in enumerate(perturbations(job))]
    for figure in FIGURES:
        rows = measure_together(cases, figure)
        alone = [measure(case) for case in cases]
        for row, other in zip(rows, alone, strict=True):
            assert row["status"] == "ok"
            assert row[f"{figure}_um"] == pytest.approx(other[f"{figure}_um"], rel=EXACT)
            assert row["contour_rms_um"] == pytest.approx(other["contour_rms_um"], rel=EXACT)


def test_torque_ripple_is_the_largest_of_all_axes_over_the_nominal_peak_torque(job):
    (one,) = perturbations(job, 1)[1:]
    (row,) = measure_together([case_of(job, job.built_servo, one)])
    run = job.run(machine=job.built_machine.perturbed(one))
    shares = torque_ripple(run) / [axis.peak_torque for axis in job.built_machine.axes]
    assert row["torque_ripple_percent"] == pytest.approx(100 * shares.max(), rel=EXACT)
    assert [row[f"{name}_{axis}"] for name in GAINS for axis in "xy"] == [
        gain for name in GAINS for gain in getattr(job.built_servo, name)
    ]


def test_rows_do_not_depend_on_what_is_measured_beside_them(job):
    cases = [
        case_of(job, dataclasses.replace(job.built_servo, kp=(kp, kp)), one)
        for kp in (0.2, 0.4, 0.6, 20.0)
        for one in perturbations(job)
    ]
    together = measure_together(cases)
    assert together == [measure_together([case])[0] for case in cases]
    assert together == measure_together(cases[::-1])[::-1]


def test_a_fault_has_its_time_and_no_figures(job):
    wild = dataclasses.replace(job.built_servo, kp=tuple(40 * kp for kp in job.built_servo.kp))
    (row,) = measure_together([case_of(job, wild, None)])
    assert row["status"].startswith("fault: ")
    assert 0 < row["fault_time_s"] < 1.0
    assert "contour_rms_um" not in row


def test_one_that_is_refused_spoils_no_other(job, monkeypatch):
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


def test_a_case_that_changes_more_than_gains_is_not_measured(job):
    other = dataclasses.replace(case_of(job, job.built_servo, None), overrides=(("servo.period", "0.002"),))
    with pytest.raises(GantryError, match=r"changes servo\.period: only servo\."):
        measure_together([other])


# search


def test_the_search_reaches_the_best_of_an_exhaustive_grid():
    """From gains ten times too low, on the same objective within the same bounds."""
    study = tuning(detuned(0.1), law="pd", budget=150, robust=0, unseen=0)
    history = study.history(searched(study))
    scale = 10 ** np.linspace(-1, 1, 15)
    shares = {"velocity_ff": (0.0, 2.0), "acceleration_ff": (0.5, 1.0)}
    grid, runs = best_of_grid(study, {"kp": scale, "kd": scale, **shares})
    assert runs > 100
    assert history.best.figure <= OF_GRID * grid
    assert history.best.order(0.02)[0] == 1
    assert history.start.figure > 20 * grid


@pytest.mark.soak
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_search_reaches_the_best_of_a_fine_grid_on_machines_that_differ(seed):
    """The grid is fine where the coarse one has its best: 4 gains, 3 machines."""
    study = tuning(detuned(0.1), law="pd", budget=300, robust=2, unseen=0, seed=seed)
    history = study.history(searched(study))
    fine = {"kp": 10 ** np.linspace(0.0, 0.6, 25), "kd": 10 ** np.linspace(-0.5, 0.1, 25)}
    grid, runs = best_of_grid(study, {**fine, "velocity_ff": (0.0, 5.0), "acceleration_ff": (0.6, 0.8, 1.0)})
    assert runs > 1000
    assert history.best.figure <= OF_GRID * grid


def test_the_answer_is_run_on_all_machines_and_within_all_bounds(outcome):
    study, done, _ = outcome
    history = study.history(done.rows)
    assert len(history.best.measured) == 2
    assert history.best.figure < 0.5 * history.start.figure
    runs = [
        simulate(machine, history.best.servo, study.job.setpoints, dispenser=study.job.dispenser)
        for machine in study._machines
    ]
    figures = [1e3 * np.sqrt(np.mean(Budget(run).analysis.nozzle.distance ** 2)) for run in runs]
    assert history.best.figure == pytest.approx(max(figures), rel=EXACT)
    assert float(study.stability.excess(history.best.servo).max()) <= 0
    assert history.best.ripple <= 0.02


def test_the_start_is_measured_as_the_job_is(outcome):
    study, done, _ = outcome
    row = done.rows[0]
    assert (row["stage"], row["machine"]) == ("start", 0)
    contour = Budget(study.job.run()).analysis.nozzle.distance
    assert row["contour_rms_um"] == pytest.approx(1e3 * np.sqrt(np.mean(contour**2)), rel=EXACT)


def test_machines_of_the_check_are_others_and_see_start_and_answer(outcome):
    study, done, _ = outcome
    before, after = study.checked(done.rows, "before"), study.checked(done.rows, "after")
    assert len(before) == len(after) == 2
    assert not set(map(repr, study.perturbations)) & set(map(repr, study.unseen_perturbations))
    servo = study.history(done.rows).best.servo
    run = study.job.built_machine.perturbed(study.unseen_perturbations[1])
    contour = Budget(simulate(run, servo, study.job.setpoints, dispenser=study.job.dispenser)).analysis.nozzle.distance
    assert after[1]["contour_rms_um"] == pytest.approx(1e3 * np.sqrt(np.mean(contour**2)), rel=EXACT)
    assert after[1]["contour_rms_um"] < before[1]["contour_rms_um"]


@pytest.mark.parametrize("workers", [2])
def test_the_answer_does_not_depend_on_the_number_of_workers(outcome, poor, tmp_path, workers):
    _, done, folder = outcome
    other = run_study(tuning(poor, budget=44), tmp_path / "b", workers=workers)
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
                if len(self._seen) == self.at:
                    raise KeyboardInterrupt
                self._seen.append(case.key)
                rows += measure_together([case], self.figure)
            return rows

        return measure_some

    @property
    def _seen(self):
        return self.__dict__.setdefault("_seen_", [])


@pytest.mark.parametrize("at", [3, 45])
def test_an_interrupted_search_goes_on_and_ends_as_if_it_had_not_been(outcome, poor, tmp_path, at):
    _, done, folder = outcome
    settings = {"budget": 44, "robust": 1, "unseen": 2}
    broken = Interrupted(poor, **settings)
    object.__setattr__(broken, "at", at)
    with pytest.raises(StudyInterrupted) as interrupted:
        run_study(broken, tmp_path / "a", workers=1)
    kept = interrupted.value.done
    assert list(content(tmp_path / "a")) == [LEDGER]
    rest = Interrupted(poor, **settings)
    again = run_study(rest, tmp_path / "a", workers=1)
    assert again.kept == kept
    assert len(rest._seen) == len(done.rows) - kept
    assert again.rows == done.rows
    assert content(tmp_path / "a") == content(folder)


def test_gains_that_fault_are_left_for_such_that_go_through(tmp_path):
    study = tuning(detuned(1.0, kp=40.0, ki=40.0), budget=40)
    done = run_study(study, tmp_path / "a", workers=1)
    history = study.history(done.rows)
    assert history.start.order(0.02)[0] == 4
    assert history.best.order(0.02)[0] == 1
    assert "With the job's own gains a fault ends the run. Those found go through" in done.findings[0]
    table = (tmp_path / "a" / TUNED).read_text()
    assert "before none, a fault" in table
    assert "before" in (tmp_path / "a" / "report.html").read_text()


def test_a_machine_with_rotary_axes_is_tuned(tmp_path):
    job = Job.load("stage-outline", ["speed=150", "simulation.settle=0.05"])
    study = tuning(job, budget=20, robust=1, unseen=1)
    rows = searched(study)
    history = study.history(rows)
    assert history.best.order(0.02)[0] == 1
    assert study.findings(rows)[2].startswith("The gains of th, x and y kp times ")
    (tmp_path / TUNED).write_text(study.text(TUNED, rows))
    assert "# One value per axis: th [deg], x [mm], y [mm].\n" in (tmp_path / TUNED).read_text()
    again = Job.load("stage-outline", ["speed=150"], servo=tmp_path / TUNED)
    assert again.built_servo == history.best.servo


def test_each_axis_may_have_its_own_and_the_tracking_error_be_the_figure():
    crooked = detuned(0.3)
    crooked = crooked.changed({"servo.kp": [0.1 * crooked.servo.kp[0], crooked.servo.kp[1]]})
    study = tuning(crooked, figure="tracking_max", per_axis=True, budget=40, robust=0, unseen=0)
    rows = searched(study)
    history = study.history(rows)
    assert history.best.order(0.02)[0] == 1
    assert history.best.figure == next(
        row["tracking_max_um"] for row in rows if row["kp_x"] == history.best.servo.kp[0]
    )
    found = study.findings(rows)
    assert "each axis by itself" in found[-1]
    assert re.match(r"The gains of x kp times .*; of y kp times ", found[2])


def test_without_other_machines_the_job_s_own_alone_counts():
    study = tuning(detuned(0.1), robust=0, unseen=0, budget=30)
    rows = searched(study)
    assert {row["machine"] for row in rows} == {0}
    assert study.history(rows).runs == len(rows) == 30
    found = study.findings(rows)
    assert "over the job's own machine" not in found[0]
    assert not any("has not seen" in paragraph for paragraph in found)
    assert [plot.name for plot in study.figures(rows)] == ["budget", "path", "search", "gains", "loop"]


def test_where_gains_are_in_order_only_at_the_cost_of_the_figure_it_is_said(job):
    study = tuning(job, budget=4, robust=0, unseen=0)
    start = objective.Measured(10.0, 0.01)
    text = findings._outcome(
        study,
        Candidate(0, 1, job.built_servo, 0.5, {0: start}),
        Candidate(1, 1, job.built_servo, -0.1, {0: dataclasses.replace(start, figure=20.0)}),
    )
    assert text == (
        "The job's own gains, with a rms contour error of 10 µm, miss the margin (peak of |S| 1.65 times the bound). "
        "The best gains found that are in order have 20 µm."
    )


def test_where_nothing_better_is_found_the_start_stays(outcome):
    first, done, folder = outcome
    found = Job.load(folder / "job.toml", servo=folder / TUNED)
    study = tuning(found, budget=4)
    rows = searched(study)
    history = study.history(rows)
    assert history.start.figure == first.history(done.rows).best.figure
    assert history.best is history.start
    assert study.findings(rows)[0].startswith("No gains were found that are better than the job's own")


def test_the_law_is_that_of_the_job_unless_another_is_asked_for(job):
    assert tuning(job).searched_law == "pid"
    assert tuning(circle(integral_time=float("inf"))).searched_law == "pd"
    assert tuning(job, law="pd").searched_law == "pd"
    assert tuning(job).settings["law"] == "pid"


# what is refused


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"budget": 3}, "budget = 3: must be at least 4, the start and one candidate on 2 machines each"),
        ({"budget": 1, "robust": 0}, "budget = 1: must be at least 2, the start and one candidate on one machine each"),
        ({"law": "pod"}, "unknown law 'pod': did you mean pd? known: pd, pid"),
        ({"figure": "contour"}, "unknown figure 'contour': did you mean contour_"),
        ({"margin": 1.0}, "margin = 1: must be greater than 1, the factor at which a loop is lost"),
        ({"ripple": 0.0}, "ripple = 0 %: must be greater than 0 %"),
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
def test_settings_out_of_bounds_are_refused(job, settings, said):
    with pytest.raises(InputError, match=f"^{re.escape(said)}"):
        tuning(job, **settings)


def test_a_job_that_lays_nothing_is_refused_before_anything_is_written(tmp_path):
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
    slow = study._machines[1]
    slow.axes = tuple(dataclasses.replace(axis, declared_speed=50.0) for axis in slow.axes)
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
    assert list(rows[0])[:5] == ["stage", "generation", "candidate", "machine", "status"]
    described = tomllib.loads((folder / "study.toml").read_text())
    assert described["command"] == "gantrysim tune job.toml"
    assert described["settings"] == {
        "law": "pid", "figure": "contour_rms", "budget": 44, "robust": 1, "margin": 2.0, "ripple": 2.0,
        "per_axis": False, "unseen": 2, "seed": 1, "spread": dataclasses.asdict(Tolerances()),
    }  # fmt: skip
    page = (folder / "report.html").read_text()
    for title in (
        "Before and after", "Error along the path", "The search", "The gains", "The loops and their margin",
        "Machines that the search has not seen",
    ):  # fmt: skip
        assert page.count(f">{title}</h2>") == 1


def test_the_servo_that_is_written_is_the_servo_that_was_found(outcome):
    study, done, folder = outcome
    history = study.history(done.rows)
    table = tomllib.loads((folder / TUNED).read_text())["servo"]
    assert Servo.derive(study.job.built_machine.axes, **table) == history.best.servo
    again = Job.load(folder / "job.toml", servo=folder / TUNED)
    contour = Budget(again.run()).analysis.nozzle.distance
    row = next(
        row
        for row in done.rows
        if (row["generation"], row["candidate"], row["machine"]) == (history.best.generation, history.best.number, 0)
    )
    assert 1e3 * np.sqrt(np.mean(contour**2)) == pytest.approx(row["contour_rms_um"], rel=EXACT)
    text = (folder / TUNED).read_text()
    assert f"# contour_rms of {history.best.figure:.4g} µm, before {history.start.figure:.4g} µm" in text
    assert "the largest of 2 machines" in text
    assert re.search(r"^kd = \[.*\]  # \[N·m·s/mm\]$", text, re.MULTILINE)


def test_findings_give_the_figures_of_the_rows(outcome):
    study, done, _ = outcome
    history = study.history(done.rows)
    start, best = history.start, history.best
    assert done.findings[0].startswith(
        f"The gains found bring the rms contour error from {start.figure:.4g} µm to {best.figure:.4g} µm"
    )
    before, after = (
        Budget(simulate(study.job.built_machine, servo, study.job.setpoints)).values
        for servo in (start.servo, best.servo)
    )
    tracking = f"tracking {1e3 * before.parts['tracking'].rms:.3g} to {1e3 * after.parts['tracking'].rms:.3g}"
    assert tracking in done.findings[1]
    assert "no generation" in done.findings[1]
    assert f"kp times {best.servo.kp[0] / start.servo.kp[0]:.3g}" in done.findings[2]
    checked = [row["contour_rms_um"] for row in study.checked(done.rows, "after")]
    assert f"{min(checked):.4g} µm on the median one" in done.findings[4]
    assert f"{max(checked):.4g} µm on the worst" in done.findings[4]
    assert f"{history.runs} runs of {len(history.candidates)} candidates" in done.findings[-1]


def test_of_an_error_that_is_mostly_generation_it_is_said_that_no_gain_mends_it():
    job = Job.load("an225", ["turns=1", "diameter=40", "simulation.settle=0.05"])
    study = tuning(job, budget=8, robust=0, unseen=0)
    links = study.findings(searched(study))[1]
    assert "is generation: the controller's program, which no gain mends." in links
    assert "tracking_rms is the figure that tells how well the servo does" in links


def test_progress_goes_over_all_rounds_and_tells_the_best_so_far(poor, tmp_path):
    told = []
    study = tuning(poor, budget=20)
    done = run_study(study, tmp_path / "a", workers=1, progress=lambda *a: told.append((*a, study.news)))
    counts = [count for count, _, _ in told]
    assert counts == sorted(counts)
    assert counts[-1] == len(done.rows)
    assert {every for _, every, _ in told[:-1]} == {24}
    best = study.history(done.rows).best
    assert told[-1][2] == f"best {best.figure:.3g} µm"
