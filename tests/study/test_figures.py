"""The figures of single runs and of batches, which are the rows that a study has of the same runs."""

import math
import sys

import pytest

import gantrysim as gs
from gantrysim.controllers.trio import MoveSpiral
from gantrysim.study import Case, measure, values_row

SHORT = MoveSpiral(diameter=40, turns=1, thickness=10, speed=100)
JOB = {
    "name": "short",
    "machine": "xy",
    "program": {"controller": "trio.MoveSpiral", "diameter": 40, "turns": 1, "thickness": 10, "speed": 100},
    "dispenser": {"flow": 200},
}


@pytest.fixture(scope="module")
def job():
    return gs.Job.model_validate(JOB)


@pytest.fixture(scope="module")
def batch():
    machine = gs.Machine("xy")
    servo = gs.Servo.derive(machine.axes)
    machines = [machine, machine.perturbed(gs.Perturbation(friction=2.0))]
    return gs.simulate_batch(machines, servo, SHORT.setpoints(servo.period), dispenser=gs.Dispenser(flow=200))


@pytest.mark.first
def test_the_figures_of_a_job_s_run_are_the_row_of_a_study(job):
    assert gs.figures(job.run(engine="loop")) == measure(Case.of(job))


@pytest.mark.first
def test_the_figures_of_a_perturbed_machine_are_those_of_a_study_s_case(job):
    off = gs.Perturbation(payload=1.0, friction={"x": 2.0})
    machine = job.built_machine.perturbed(off)
    row = gs.figures(job.run(machine=machine, engine="loop"), machine)
    assert row == measure(Case.of(job, perturbation=off))
    assert row != gs.figures(
        job.run(machine=machine, engine="loop")
    )  # whose margins are those of the job's own machine


def test_a_run_without_a_job_has_its_values_and_no_verdict(batch):
    run = batch[0]
    row = gs.figures(run)
    assert row == {"status": "ok", **values_row(run)}
    assert row["contour_rms_um"] == pytest.approx(1e3 * run.budget.contour_values.rms)
    assert not [key for key in row if key.endswith("_verdict")]


def test_the_frame_of_a_batch_has_the_figures_of_each_run(batch):
    frame = batch.to_frame()
    assert len(frame) == len(batch) == 2
    for k, run in enumerate(batch):
        row = gs.figures(run)
        assert list(frame.columns) == list(row)
        for name, value in row.items():
            found = frame[name][k]
            assert found == value or (value is None and (found is None or math.isnan(found)))
    assert frame["contour_rms_um"][1] > frame["contour_rms_um"][0]


def test_a_frame_without_pandas_says_what_to_install(batch, monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(
        gs.InputError, match=r'^Runs\.to_frame: pandas is not installed: pip install "gantrysim\[tables\]"$'
    ):
        batch.to_frame()


def test_what_is_no_run_has_no_figures(job):
    with pytest.raises(gs.InputError, match=r"run is of type Job: must be a Run; write \.run\(\) behind it"):
        gs.figures(job)
