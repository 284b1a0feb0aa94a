"""A run from setpoints in Python is judged, reported and filmed by its machine, servo and dispenser."""

import json
import pickle
import re
from dataclasses import replace

import numpy as np
import pytest

import gantrysim as gs
from gantrysim.base.quantity import NO_BREAK_SPACE
from gantrysim.job.basis import RigBasis
from gantrysim.report.writing import results_of

from support.jobs import job_run

pytestmark = pytest.mark.usefixtures("blank_pictures")

JOB = "an225"
DEFAULTS = "All tolerances, and the shape of the bead, are defaults."


@pytest.fixture(scope="module")
def job():
    return job_run(JOB).job


@pytest.fixture(scope="module")
def simulated(job):
    """The run of a built-in job, as somebody writes it without one."""
    return gs.simulate(job.built_machine, job.built_servo, job.setpoints, dispenser=job.dispenser)


def test_the_verdict_is_that_of_the_job_with_default_tolerances_and_bead(job, simulated):
    plain = job.model_copy(update={"tolerance": None, "bead": gs.BeadSettings()})
    expected = gs.Verdict.of(plain, job_run(JOB))
    assert simulated.job is None
    assert [row.state for row in simulated.verdict.rows] == [row.state for row in expected.rows]
    for row, other in zip(simulated.verdict.rows, expected.rows, strict=True):
        assert [check.value for check in row.checks] == [check.value for check in other.checks]
        assert [check.limit for check in row.checks] == [check.limit for check in other.checks]
        assert {check.source for check in row.checks} == {"default"}
    assert "(default)" in str(simulated)
    assert simulated.known_verdict is simulated.verdict


def test_margins_of_a_law_in_python_are_not_known(xy, simulated):
    """The servo's own loop has margins, but did not run."""
    spiral = gs.controllers.trio.MoveSpiral(60, 1, 10, 100)
    run = gs.simulate(xy, gs.Servo.derive(xy.axes), spiral, law=lambda tick: 0.0 * tick.error)
    assert run.rig.has_own_law
    assert not simulated.rig.has_own_law
    assert simulated.verdict["stability"].state == "pass"
    with_law = simulated.replaced(rig=replace(simulated.rig, has_own_law=True))
    assert with_law.verdict["stability"].state == "not judged"


def test_a_batch_has_a_rig_for_each_run(job):
    servos = [job.built_servo, job.built_servo.with_values(following_error_limit=9.0)]
    spiral = gs.controllers.trio.MoveSpiral(60, 1, 10, 100)
    runs = gs.simulate_batch(job.built_machine, servos, spiral)
    assert [run.rig.servo for run in runs] == servos


def test_a_job_s_run_keeps_no_rig_and_a_pickled_run_none(simulated):
    assert job_run(JOB).rig is None
    again = pickle.loads(pickle.dumps(simulated))
    assert again.rig is None
    np.testing.assert_array_equal(again.nozzle, simulated.nozzle)
    assert again.replaced(rig=simulated.rig).verdict.content() == simulated.verdict.content()


def test_the_report_says_that_the_tolerances_are_defaults(simulated, tmp_path):
    folder = tmp_path / "out"
    folder.mkdir()
    # of an earlier run of a job
    for name in ("job.toml", "video.mp4"):
        (folder / name).write_text("")
    (folder / "run.npz").write_bytes(b"")
    page = simulated.report(folder)
    files = ["card.png", "plots", "report.html", "run.npz", "summary.json"]
    assert sorted(file.name for file in folder.iterdir()) == files
    text = page.read_text(encoding="utf-8")
    assert DEFAULTS in text
    assert "simulation on xy" in text
    assert re.search(r"setpoints from Python, [0-9.]+ s, servo period 1 ms", text.replace(NO_BREAK_SPACE, " "))
    summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    assert summary["causes"] is None
    assert summary["notes"][0].endswith("in a job: gantrysim.Job.load.")
    assert summary["verdict"] == json.loads(json.dumps(simulated.verdict.content()))
    record = gs.Run.load(folder / "run.npz")
    assert (record.job_sha256, record.machine_sha256) == ("", simulated.rig.machine.digest)
    with pytest.raises(gs.InputError, match="written from Python, without a job, which commands need: read it "):
        gs.SavedRun.load(folder)


def test_the_film_has_the_machine_and_the_default_bead(simulated, monkeypatch):
    calls = []
    monkeypatch.setattr("gantrysim.render.save_video", lambda *given, **named: calls.append((given, named)) or 7)
    assert simulated.film("a.mp4", speed=2.0) == 7
    (((machine, filmed, file), named),) = calls
    assert (machine, filmed, file) == (simulated.rig.machine, simulated, "a.mp4")
    assert named == {"bead": gs.BeadSettings(), "label": "simulation", "verdict": simulated.verdict, "speed": 2.0}


def test_deliberate_faults_are_in_the_verdict_and_their_cost_is_not_known(job):
    fault = gs.faults.StuckAxis(time=2.0, axis="y", friction=0.01)
    run = gs.simulate(job.built_machine, job.built_servo, job.setpoints, dispenser=job.dispenser, faults=[fault])
    assert run.verdict.disturbances == (str(fault),)
    results = results_of(RigBasis(run.rig, run), run)
    assert results.losses is None
    assert results.basis.faults == (fault,)
    with pytest.raises(gs.InputError, match="the run has no job: it was simulated from setpoints in Python"):
        _ = results.job


def test_a_run_without_glue_is_judged_with_its_dispenser_on(xy):
    run = gs.simulate(xy, gs.Servo.derive(xy.axes), gs.controllers.trio.MoveSpiral(60, 1, 10, 100))
    assert run.verdict["path"].state in ("pass", "warn", "fail")
    assert run.verdict["glue"].remark == "nothing was laid: no glue is requested"


def test_simulating_imports_no_room_above(fresh, tmp_path):
    """What judges a run is imported where it is asked for."""
    code = (
        "import sys, gantrysim as gs\n"
        "m = gs.Machine('xy'); spiral = gs.controllers.trio.MoveSpiral(60, 1, 10, 100)\n"
        "run = gs.simulate(m, gs.Servo.derive(m.axes), spiral, engine='loop'); repr(run)\n"
        "rooms = {n.split('.')[1] for n in sys.modules if n.startswith('gantrysim.')}\n"
        "print(rooms & {'job', 'results', 'report', 'render'})"
    )
    assert fresh.run(code, tmp_path) == (0, "set()\n", "")
