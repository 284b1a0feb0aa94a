"""Cases, their rows, and studies that are interrupted and go on."""

import contextlib
import csv
import json
import math
import os
import pickle
import signal
import subprocess
import sys
import time
import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest
import typer

import gantrysim
from gantrysim import InputError, Job
from gantrysim.bead import Bead, HeightMap
from gantrysim.budget import Budget
from gantrysim.metrics import Analysis, path_speed, speed_ripple, steady
from gantrysim.perturbation import Perturbation
from gantrysim.study import (
    Case,
    Ledger,
    Plot,
    StudyInterrupted,
    figures_row,
    measure,
    run_cases,
    run_study,
    simulated,
)
from gantrysim.study.checks import NoFiguresError
from gantrysim.study.commands import carry_out
from gantrysim.study.ledger import LEDGER
from gantrysim.study.series import series

SHORT = ["turns=1", "diameter=30", "thickness=5", "speed=150", "loop_period=0.05", "simulation.settle=0.05"]
NO_LAGS = {
    f"dispenser.{key}": None for key in ("dead_time", "opening", "closing", "start_lead", "stop_lead", "advance")
}
BEAD = 1e-3  # relative, of a width or volume that is known
PATIENCE = 60.0  # with a process that has to be seen at work [s]


@pytest.fixture(scope="module")
def job():
    return Job.load("an225", SHORT)


def cases_of(job, values=(0.02, 0.03, 0.05, 0.08)):
    return [Case.of(job, {"program.loop_period": value}, value=value) for value in values]


# cases


def test_a_case_is_a_value_that_can_be_sent(job):
    case = Case.of(
        job, {"program.loop_period": 0.1, "program.ratio_bits": None}, perturbation=Perturbation(payload=0.1), a=1
    )
    assert pickle.loads(pickle.dumps(case)) == case
    assert hash(pickle.loads(pickle.dumps(case))) == hash(case)
    assert case.settings == {"program.loop_period": 0.1, "program.ratio_bits": None}
    assert "ratio_bits" not in case.job().program
    assert case.job().program["loop_period"] == 0.1


def test_the_key_tells_results_apart_and_tags_do_not_matter(job):
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


def test_what_the_job_has_anyway_is_no_change(job):
    own = {"program.loop_period": 0.05, "program.turns": 1, "program.wait_resolution": 1e-3, "servo.period": 1e-3}
    assert Case.of(job, own) == Case.of(job)
    assert Case.of(job, {**own, "program.turns": 2}).settings == {"program.turns": 2}
    for none in ({"program.lop_period": None}, {"name.x": 1}, {"servo.perod": 1}):
        assert Case.of(job, none).settings == none
        assert measure(Case.of(job, none))["status"].startswith("refused: unknown key")


def test_a_changed_case_shares_what_is_the_job_s_own(job):
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
    assert measure(encoder) == {"status": "ok", **figures_row(fresh.run(), fresh.bead)}


def test_the_key_belongs_to_a_version(job, monkeypatch):
    before = Case.of(job).key
    monkeypatch.setattr(gantrysim, "__version__", "99")
    assert Case.of(job).key != before


def test_the_row_of_a_case_is_of_its_run(job):
    run = simulated(Case.of(job))
    row, analysis = measure(Case.of(job)), Analysis(job.run())
    budget, figures = Budget(analysis), analysis.figures
    assert row == {"status": "ok", **figures_row(run)}
    assert row["contour_rms_um"] == pytest.approx(1e3 * figures.contour.rms)
    assert row["generation_max_um"] == pytest.approx(1e3 * figures.generation.max)
    assert row["tracking_rms_um"] == pytest.approx(1e3 * budget.figures.parts["tracking"].rms)
    assert row["measurement_p95_um"] == pytest.approx(1e3 * budget.figures.parts["measurement"].p95)
    assert row["structure_max_um"] == pytest.approx(1e3 * budget.figures.parts["structure"].max)
    assert row["lag_max_um"] == pytest.approx(1e3 * budget.figures.lag.max)
    assert row["tracking_x_rms_um"] == pytest.approx(1e3 * figures.tracking["x"].rms)
    assert row["tracking_along_rms_um"] == pytest.approx(1e3 * figures.tracking_along.rms)
    assert row["spacing_mean_mm"] is None  # of one turn
    assert row["speed_ripple"] == speed_ripple(run)
    bead = Bead(run, job.bead).figures
    assert row["bead_width_mean_mm"] == pytest.approx(bead.width.mean)
    assert row["bead_volume_error_percent"] == pytest.approx(bead.error_percent)
    assert (row["end_x_mm"], row["end_y_mm"], row["end_z_mm"]) == figures.end_point


def test_spacing_and_rotary_axes_in_a_row(job):
    row = measure(Case.of(job, {"program.turns": 2}, "perfect follower"))
    assert row["spacing_mean_mm"] == pytest.approx(5.0, abs=0.2)
    stage = measure(Case.of(Job.load("stage-outline"), mode="perfect follower"))
    assert "tracking_th_rms_mdeg" in stage
    assert "tracking_x_rms_um" in stage


def test_the_bead_in_a_row_is_the_job_s(job):
    glue = {"dispenser.flow": 0.0, "dispenser.area": 2.0, "bead.contact_angle": 90.0, "bead.squashed": False}
    row = measure(Case.of(job.changed(NO_LAGS), glue, "perfect follower"))
    assert row["bead_width_mean_mm"] == pytest.approx(math.sqrt(8 * 2.0 / math.pi), rel=BEAD)  # a half-disc
    assert row["bead_volume_error_percent"] == pytest.approx(0, abs=100 * BEAD)


def test_a_valve_that_opens_slowly_withholds_its_time_constant_s_flow(job):
    opening, flow = 0.05, 200.0
    own = job.changed({**NO_LAGS, "dispenser.flow": flow, "program.acceleration": math.inf})
    prompt, late = (Case.of(own, {"dispenser.opening": T}, "perfect follower") for T in (0.0, opening))
    run = simulated(prompt)
    asked = flow * run.period * np.count_nonzero(run.dispense[:-1])  # at one speed all the way
    errors = [measure(case)["bead_volume_error_percent"] for case in (prompt, late)]
    assert errors == pytest.approx([0, -100 * flow * opening / asked], abs=0.5)
    assert errors[1] - errors[0] == pytest.approx(-100 * flow * opening / asked, rel=0.01)


def test_a_row_takes_no_height_map(job, monkeypatch):
    monkeypatch.setattr(HeightMap, "of", None)
    assert measure(Case.of(job, {"program.turns": 2}))["bead_width_mean_mm"] > 0


def test_a_row_without_glue_has_no_bead(job):
    dry = dict.fromkeys(("flow", "area", "pressure"), 0.0)
    row = measure(Case.of(job, {f"dispenser.{key}": value for key, value in dry.items()}))
    assert row["status"] == "ok"
    assert row["bead_width_mean_mm"] is row["bead_volume_error_percent"] is None


def test_the_steady_error_is_that_of_the_middle(job):
    run = simulated(Case.of(job))
    row, on = figures_row(run), np.flatnonzero(run.dispense)
    middle = on[steady(on.size)]
    assert (middle[0] - on[0], on[-1] - middle[-1]) == (round(0.05 * on.size), round(0.05 * on.size))
    error = (run.commanded - run.encoder)[middle]
    both = row["steady_tracking_along_rms_um"] ** 2 + row["steady_tracking_normal_rms_um"] ** 2
    assert both == pytest.approx(1e6 * np.mean(np.sum(error**2, axis=1)), rel=1e-9)
    assert speed_ripple(run) == pytest.approx(path_speed(run)[middle].std() / path_speed(run)[middle].mean())


def test_a_perfect_follower_has_the_program_s_error_alone(job):
    row = measure(Case.of(job, mode="perfect follower"))
    assert row["contour_rms_um"] == row["generation_rms_um"] > 1
    assert row["tracking_rms_um"] == row["measurement_rms_um"] == row["structure_rms_um"] == 0


def test_a_perturbed_case(job):
    plain, smooth = measure(Case.of(job)), measure(Case.of(job, perturbation=Perturbation(friction=1e-3)))
    assert smooth["steady_tracking_normal_rms_um"] < 0.2 * plain["steady_tracking_normal_rms_um"]


def test_refused_and_faulted_cases_are_rows(job):
    assert measure(Case.of(job, {"program.turns": 9})) == {
        "status": "refused: job an225: inner_diameter = -60 mm (diameter 30 - 2 x turns 9 x thickness 5): "
        "must be at least 0 mm; use turns at most 2 or thickness below 1.66667 mm"
    }
    assert measure(Case.of(job, {"servo.perod": 1}))["status"].startswith(
        "refused: unknown key 'servo.perod': did you mean servo.period?"
    )
    assert measure(Case.of(job, {"program.start": [1e3, 0.0]}))["status"].startswith("refused: x = ")
    fault = measure(Case.of(job, {"servo.following_error_limit": 1e-3}))
    assert list(fault) == ["status"]
    assert fault["status"].startswith("fault: following error on axis")


# the runner


def test_rows_do_not_depend_on_the_number_of_workers(job):
    cases = [*cases_of(job), Case.of(job, {"program.turns": 9}, value=0.0)]
    cases.insert(2, Case.of(job, {"program.loop_period": 0.04}, "perfect follower", value=0.04))
    rows = {}
    for workers in (1, 2):
        with Ledger(None, {}) as ledger:
            rows[workers] = run_cases(cases, ledger, workers=workers)
    assert rows[1] == rows[2]
    assert [row["value"] for row in rows[1]] == [0.02, 0.03, 0.04, 0.05, 0.08, 0.0]
    assert [row["status"] == "ok" for row in rows[1]] == [True] * 5 + [False]


def test_another_backend_of_joblib_gives_the_same_rows(job):
    from joblib import parallel_config

    cases = cases_of(job, (0.02, 0.05))
    with Ledger(None, {}) as alone:
        expected = run_cases(cases, alone, workers=1)
    with parallel_config(backend="threading", n_jobs=2), Ledger(None, {}) as ledger:
        assert run_cases(cases, ledger) == expected
    counted = Counted()  # in a process of its own it would not count here
    with parallel_config(backend="threading"), Ledger(None, {}) as ledger:
        run_cases(cases, ledger, measure=counted)
    assert sorted(counted.seen) == [0.02, 0.05]


def test_no_worker_is_none(job):
    with Ledger(None, {}) as ledger, pytest.raises(InputError, match="workers = 0: must be at least 1"):
        run_cases(cases_of(job), ledger, workers=0)


def leaves_interrupts(case):
    return {"status": "ok", "ignored": signal.getsignal(signal.SIGINT) == signal.SIG_IGN, "process": os.getpid()}


def processes(job, monkeypatch, cores, workers, cases=8):
    """How many processes measure the cases, where there are so many cores."""
    monkeypatch.setattr("joblib.parallel.cpu_count", lambda only_physical_cores=False: cores)
    monkeypatch.setattr("joblib._parallel_backends.cpu_count", lambda only_physical_cores=False: cores)
    asked = []
    monkeypatch.setattr("joblib.Parallel", lambda **options: asked.append(parallel_n_jobs()) or Once())
    with Ledger(None, {}) as ledger:
        run_cases(cases_of(job, [0.01 * (k + 1) for k in range(cases)]), ledger, workers=workers, measure=Counted())
    return asked[0]


def parallel_n_jobs():
    from joblib.parallel import get_active_backend

    return get_active_backend()[1]


class Once:
    """Does its jobs one after the other."""

    def __call__(self, jobs):
        return [function(*values, **named) for function, values, named in jobs]


def test_there_are_never_more_processes_than_cores_or_cases(job, monkeypatch):
    assert processes(job, monkeypatch, cores=4, workers=100_000) == 4
    assert processes(job, monkeypatch, cores=4, workers=3) == 3
    assert processes(job, monkeypatch, cores=4, workers=None) == 4
    assert processes(job, monkeypatch, cores=4, workers=100_000, cases=2) == 2
    assert processes(job, monkeypatch, cores=4, workers=None, cases=2) == 2


def test_workers_leave_ctrl_c_to_the_study(job, monkeypatch):
    monkeypatch.setattr("joblib._parallel_backends.cpu_count", lambda only_physical_cores=False: 2)
    before = signal.getsignal(signal.SIGINT)
    with Ledger(None, {}) as ledger:
        rows = run_cases(cases_of(job), ledger, workers=2, measure=leaves_interrupts)
    assert all(row["ignored"] and row["process"] != os.getpid() for row in rows)
    assert signal.getsignal(signal.SIGINT) is before


class Counted:
    """Counts the cases it measures, and is interrupted before one of them."""

    def __init__(self, interrupted_at=None):
        self.seen, self.interrupted_at = [], interrupted_at

    def __call__(self, case):
        value = case.job().program["loop_period"]
        if len(self.seen) == self.interrupted_at:
            raise KeyboardInterrupt
        self.seen.append(value)
        return {"status": "ok", "third": value / 3, "pair": [value, 2 * value]}


def test_cases_that_differ_in_tags_alone_run_once(job):
    counted, told = Counted(), []
    cases = [Case.of(job, {"program.loop_period": 0.1}, sweep=s) for s in "ab"] + cases_of(job, (0.2,))
    with Ledger(None, {}) as ledger:
        rows = run_cases(cases, ledger, workers=1, measure=counted, progress=lambda *a: told.append(a))
    assert counted.seen == [0.1, 0.2]
    assert told == [(0, 2), (1, 2), (2, 2)]
    assert [row.get("sweep") for row in rows] == ["a", "b", None]
    assert rows[0]["third"] == rows[1]["third"] == 0.1 / 3


# the ledger


def test_the_ledger_forgives_a_line_that_was_cut_off(tmp_path):
    with Ledger(tmp_path, {"study": "x"}) as ledger:
        ledger.add("one", {"value": 1 / 3})
        ledger.add("two", {"value": 2.0})
    whole = (tmp_path / LEDGER).read_bytes()
    for cut in (3, 1):  # in the middle of the last line, and before its end
        (tmp_path / LEDGER).write_bytes(whole[:-cut])
        with Ledger(tmp_path, {"study": "x"}) as ledger:
            assert (ledger.kept, "one" in ledger, "two" in ledger) == (1, True, False)
            assert ledger["one"] == {"value": 1 / 3}
            ledger.add("two", {"value": 2.0})
        assert (tmp_path / LEDGER).read_bytes() == whole


def test_a_row_is_on_the_disk_as_soon_as_it_is_finished_and_half_a_row_is_gone_at_once(tmp_path):
    with Ledger(tmp_path, {"study": "x"}) as ledger:
        ledger.add("one", {"value": 1})
        assert (tmp_path / LEDGER).read_bytes().endswith(b'["one", {"value": 1}]\n')
    whole = (tmp_path / LEDGER).read_bytes()
    (tmp_path / LEDGER).write_bytes(whole + b'["two", {"val')
    with Ledger(tmp_path, {"study": "x"}):
        assert (tmp_path / LEDGER).read_bytes() == whole


@pytest.mark.parametrize("found", [b"", b"{", b'{"study"', b"\xff\xfe\n", b"nonsense\n"])
def test_a_ledger_without_a_whole_first_line_is_begun_anew(tmp_path, found):
    (tmp_path / LEDGER).write_bytes(found)
    with Ledger(tmp_path, {"study": "x"}) as ledger:
        assert (ledger.kept, ledger.discarded) == (0, None)
        ledger.add("one", {"value": 1})
    with Ledger(tmp_path, {"study": "x"}) as ledger:
        assert ledger.kept == 1


def test_another_study_s_rows_are_discarded_and_said_so(tmp_path):
    with Ledger(tmp_path, {"study": "x", "version": 1}) as ledger:
        ledger.add("one", {"value": 1})
    with Ledger(tmp_path, {"study": "x", "version": 2}) as ledger:
        assert (ledger.kept, len(ledger), ledger.discarded) == (0, 0, "they differ in version")
    with Ledger(tmp_path, {"study": "x", "version": 2}) as ledger:
        assert ledger.discarded is None
    (tmp_path / LEDGER).write_text("[1]\n")
    with Ledger(tmp_path, {"study": "x"}) as ledger:
        assert ledger.discarded == "they are no study's"


# studies


@dataclass(frozen=True)
class Toy:
    """A study in two rounds: the second looks on where the first found the largest value."""

    job: Job
    measure: Counted = field(default_factory=Counted)
    broken: bool = False
    values: tuple = (0.3, 0.5, 0.4)
    name: ClassVar[str] = "toy"
    title: ClassVar[str] = "A toy"
    plots: ClassVar[tuple] = ("curve",)

    @property
    def settings(self):
        return {"values": self.values}

    def rounds(self):
        rows = yield cases_of(self.job, self.values)
        best = max(row["third"] for row in rows) * 3
        yield cases_of(self.job, (best, best + 0.01))

    def findings(self, rows):
        return [f"{len(rows)} rows", "a second paragraph"]

    def figures(self, rows):
        from matplotlib.figure import Figure

        if self.broken:
            raise ZeroDivisionError
        figure = Figure()
        figure.add_subplot().plot(*series(rows, "value", "third"))
        return [Plot("curve", "The curve", "It rises.", figure)]


def content(folder):
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def test_a_study_writes_its_folder(tmp_path, job):
    outcome = run_study(Toy(job), tmp_path / "a" / "b", workers=1)
    folder = tmp_path / "a" / "b"
    files = ["curves.csv", "job.toml", "plots/curve.png", "report.html", "study.csv", "study.toml"]
    assert list(content(folder)) == files
    assert outcome.written == ["curves.csv", "job.toml", "plots", "report.html", "study.csv", "study.toml"]
    with (folder / "study.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [float(row["value"]) for row in rows] == [0.3, 0.5, 0.4, 0.5, 0.51]
    assert [float(row["third"]) for row in rows] == [row["third"] for row in outcome.rows]
    described = tomllib.loads((folder / "study.toml").read_text())
    assert described["study"] == "toy"
    assert described["cases"] == 5
    assert described["settings"] == {"values": [0.3, 0.5, 0.4]}
    assert described["findings"] == outcome.findings
    assert described["versions"]["machine_sha256"] == job.built_machine.digest
    assert Job.load(str(folder / "job.toml")).toml() == job.toml()
    report = (folder / "report.html").read_text()
    assert "A toy" in report
    assert "a second paragraph" in report
    assert "It rises." in report


def test_a_study_that_is_done_again_replaces_its_files_and_leaves_others(tmp_path, job):
    run_study(Toy(job), tmp_path, workers=1)
    (tmp_path / "notes.txt").write_text("mine")
    outcome = run_study(Toy(job, values=(0.3, 0.4)), tmp_path, workers=1)
    assert (len(outcome.rows), outcome.kept, outcome.discarded) == (4, 0, None)
    assert (tmp_path / "notes.txt").read_text() == "mine"


def test_a_run_s_folder_is_no_study_s(tmp_path, job):
    (tmp_path / "report.html").write_text("of a run")
    (tmp_path / "run.npz").write_bytes(b"")
    with pytest.raises(InputError, match=r"holds report.html, which no study has written: name another folder"):
        run_study(Toy(job), tmp_path, workers=1)
    assert (tmp_path / "report.html").read_text() == "of a run"
    assert not (tmp_path / LEDGER).exists()


def test_a_job_that_is_refused_as_it_stands_is_no_study(tmp_path, job):
    refused = {
        "must lie in the travel": {"program.start": [1e3, 0.0]},
        "physics_step = 1 s: must be at most": {"simulation.physics_step": 1.0},
        "must be a multiple of the physics step": {"servo.delay": 0.0123e-3},
    }
    jobs = {text: job.changed(values) for text, values in refused.items()}
    rapid = {"controller": "fanuc.Program", "program": "N10 G00 X5 Y5\n"}
    jobs["the dispenser is never on"] = Job(name="rapid", program=rapid)
    for text, refused_job in jobs.items():
        study = Toy(refused_job)
        with pytest.raises(InputError, match=text):
            run_study(study, tmp_path / "new", workers=1)
        assert study.measure.seen == []
        assert not (tmp_path / "new").exists()


def test_a_study_that_fails_at_its_end_keeps_its_rows_and_writes_nothing(tmp_path, job):
    with pytest.raises(ZeroDivisionError):
        run_study(Toy(job, broken=True), tmp_path, workers=1)
    assert list(content(tmp_path)) == [LEDGER]
    mended = Toy(job)
    assert run_study(mended, tmp_path, workers=1).kept == 4
    assert mended.measure.seen == []


@pytest.mark.parametrize("at", [1, 3])
def test_an_interrupted_study_goes_on_and_ends_as_if_it_had_not_been(tmp_path, job, at):
    whole, broken = tmp_path / "whole", tmp_path / "broken"
    expected = run_study(Toy(job), whole, workers=1)
    with pytest.raises(StudyInterrupted) as interrupted:
        run_study(Toy(job, Counted(interrupted_at=at)), broken, workers=1)
    assert interrupted.value.done == at
    assert list(content(broken)) == [LEDGER]
    rest = Toy(job)
    outcome = run_study(rest, broken, workers=1)
    assert len(rest.measure.seen) == 4 - at
    assert (outcome.kept, outcome.rows, outcome.findings) == (at, expected.rows, expected.findings)
    assert content(broken) == content(whole)


def test_a_study_that_is_interrupted_before_its_first_row_leaves_nothing(tmp_path, job, capsys):
    with pytest.raises(typer.Exit):
        carry_out(Toy(job, Counted(interrupted_at=0)), tmp_path / "a" / "b", 1)
    assert capsys.readouterr().err == "interrupted: no case was finished, nothing is kept\n"
    assert not list(tmp_path.iterdir())


class Failing(Counted):
    """Fails at one of its cases."""

    def __init__(self, at):
        super().__init__()
        self.at = at

    def __call__(self, case):
        if len(self.seen) == self.at:
            raise ZeroDivisionError
        return super().__call__(case)


def test_a_study_whose_first_case_fails_leaves_nothing_and_a_later_one_its_rows(tmp_path, job):
    with pytest.raises(ZeroDivisionError):
        run_study(Toy(job, Failing(0)), tmp_path / "a" / "b", workers=1)
    assert not list(tmp_path.iterdir())
    with pytest.raises(ZeroDivisionError):
        run_study(Toy(job, Failing(1)), tmp_path / "a" / "b", workers=1)
    assert list(content(tmp_path)) == [f"a/b/{LEDGER}"]


def test_what_lay_in_the_folder_stays_where_nothing_was_finished(tmp_path, job):
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(ZeroDivisionError):
        run_study(Toy(job, Failing(0)), tmp_path, workers=1)
    assert list(content(tmp_path)) == ["notes.txt"]


class Ending(Counted):
    """Gives every case one of some statuses, in turn."""

    def __init__(self, *statuses):
        super().__init__()
        self.statuses = statuses

    def __call__(self, case):
        status = self.statuses[len(self.seen) % len(self.statuses)]
        return {**super().__call__(case), "status": status}


def test_a_study_in_which_no_case_has_figures_says_so_and_writes_nothing(tmp_path, job, capsys):
    with pytest.raises(NoFiguresError, match=r"^none of the study's 5 cases has figures: refused: no$"):
        carry_out(Toy(job, Ending("refused: no")), tmp_path / "new", 1)
    with pytest.raises(typer.Exit) as stopped:
        carry_out(Toy(job, Ending("refused: no", "fault: trip")), tmp_path / "new", 1)
    assert stopped.value.exit_code == 3
    assert capsys.readouterr() == ("", "fault: none of the study's 5 cases has figures: fault: trip\n")
    assert not list(tmp_path.iterdir())
    carry_out(Toy(job, Ending("refused: no", "fault: trip", "ok")), tmp_path / "new", 1)
    assert (tmp_path / "new" / "report.html").exists()


def test_another_study_in_the_folder_begins_anew(tmp_path, job):
    with pytest.raises(StudyInterrupted):
        run_study(Toy(job, Counted(interrupted_at=2)), tmp_path, workers=1)
    other = Toy(job, values=(0.3, 0.6))
    outcome = run_study(other, tmp_path, workers=1)
    assert (outcome.kept, outcome.discarded) == (0, "they differ in settings")
    assert len(other.measure.seen) == 3


def spoken(folder):
    """Rows in a folder's ledger."""
    file = folder / LEDGER
    return max(file.read_bytes().count(b"\n") - 1, 0) if file.exists() else 0


def begun(folder, rows=1):
    """A `study loop` in a process group of its own that has finished some rows."""
    settings = [part for setting in SHORT for part in ("--set", setting)]
    command = [
        sys.executable,
        "-m",
        "gantrysim",
        "study",
        "loop",
        "an225",
        *settings,
        "--out",
        str(folder),
        "--workers",
        "2",
    ]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True)
    until = time.monotonic() + PATIENCE
    while spoken(folder) < rows:
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < until
        time.sleep(0.01)
    return process


def test_ctrl_c_in_a_terminal_ends_the_command_with_a_word_of_how_to_go_on(tmp_path):
    folder = tmp_path / "loop"
    process = begun(folder)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to the workers too
    output, said = (text.decode() for text in process.communicate(timeout=PATIENCE))
    assert process.returncode == 130
    done = spoken(folder)
    assert done >= 1
    assert f"interrupted: the rows of {done} finished cases are kept in {folder}/; the same command goes on" in said
    assert "Traceback" not in said
    assert output == ""
    assert list(content(folder)) == [LEDGER]


def test_an_interrupt_that_is_lost_in_a_finaliser_ends_the_study_at_the_next_row(tmp_path, job, capsys):
    class Lost(Counted):
        def __call__(self, case):
            if len(self.seen) == 1:
                with contextlib.suppress(KeyboardInterrupt):
                    signal.raise_signal(signal.SIGINT)
            return super().__call__(case)

    with pytest.raises(typer.Exit) as stopped:
        carry_out(Toy(job, Lost()), tmp_path, 1)
    assert stopped.value.exit_code == 130
    assert "the rows of 2 finished cases are kept" in capsys.readouterr().err


def test_a_polite_kill_is_an_interrupt_and_the_next_start_says_what_it_found(tmp_path, job, capsys):
    class Killed(Counted):
        def __call__(self, case):
            if len(self.seen) == 2:
                os.kill(os.getpid(), signal.SIGTERM)
            return super().__call__(case)

    before = signal.getsignal(signal.SIGTERM)
    with pytest.raises(typer.Exit) as stopped:
        carry_out(Toy(job, Killed()), tmp_path, 1)
    assert stopped.value.exit_code == 130
    assert "the rows of 2 finished cases are kept" in capsys.readouterr().err
    assert signal.getsignal(signal.SIGTERM) is before
    carry_out(Toy(job), tmp_path, 1)
    output, said = capsys.readouterr()
    assert said == "note: the rows of 2 cases were there from an interrupted start\n"
    assert output.startswith("5 rows\n\na second paragraph\n\nwritten to ")
    with pytest.raises(typer.Exit):
        carry_out(Toy(job, Counted(interrupted_at=1)), tmp_path, 1)
    carry_out(Toy(job, values=(0.3,)), tmp_path, 1)
    assert "which were not taken: they differ in settings" in capsys.readouterr().err


def test_two_studies_in_one_folder_at_once(tmp_path, gantrysim_command):
    folder = tmp_path / "loop"
    process = begun(folder)
    try:
        before = (folder / LEDGER).read_bytes()
        status, _, said = gantrysim_command("study", "repeat", "an225", "--set", "turns=1", "--out", folder)
        assert status == 2
        assert said == f"error: --out {folder}: another study is at work in this folder\n"
        assert (folder / LEDGER).read_bytes().startswith(before)
        assert process.poll() is None
    finally:
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
    with Ledger(folder, json.loads(before.splitlines()[0])) as ledger:  # the lock has gone with its process
        assert ledger.kept >= 1


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="asks the system for processes by their group")
def test_workers_end_with_a_study_that_is_killed(tmp_path):
    process = begun(tmp_path / "loop")
    assert len(members(process.pid)) >= 2
    process.kill()  # it alone
    process.communicate()
    until = time.monotonic() + PATIENCE
    while left := members(process.pid):
        assert time.monotonic() < until, left
        time.sleep(0.1)


def members(group):
    """Processes of a group that are alive."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, _, of = stat.read_text().rpartition(")")[2].split()[:3]
        except OSError:  # it has ended
            continue
        if int(of) == group and state != "Z":
            found.append(int(stat.parent.name))
    return found


def test_a_killed_study_goes_on_and_ends_as_if_it_had_not_been(tmp_path):
    folder = tmp_path / "loop"
    process = begun(folder)
    os.killpg(process.pid, signal.SIGKILL)
    process.communicate()
    done = spoken(folder)
    assert list(content(folder)) == [LEDGER]
    from gantrysim.study.loop import LoopStudy

    study = LoopStudy(Job.load("an225", SHORT))
    lines = [json.loads(line) for line in (folder / LEDGER).read_bytes().splitlines()[1 : done + 1]]
    first = [case for case in study.cases if case.key in {key for key, _ in lines}]
    with Ledger(None, {}) as ledger:
        alone = run_cases(first, ledger, workers=1)
        assert {case.key: ledger[case.key] for case in first} == dict(lines)
    identity = json.loads((folder / LEDGER).read_bytes().splitlines()[0])
    with Ledger(folder, identity) as ledger:
        assert ledger.kept == done
        assert run_cases(first, ledger, measure=None) == alone  # none is measured again


def test_series_takes_the_rows_that_have_what_is_asked(job):
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


def test_paths_of_folders(tmp_path, job):
    file = tmp_path / "file"
    file.write_text("")
    with pytest.raises(InputError, match=f"--out {file}: is a file, must be a folder"):
        run_study(Toy(job), Path(file), workers=1)
