"""Following error and torque of each axis over time, beside a machine without friction."""

import json
import math
from types import SimpleNamespace

import numpy as np
import pytest

from gantrysim import InputError, Job, Machine, Perturbation
from gantrysim.compare.comparison import Comparison
from gantrysim.compare.measured import Assignment, Trace
from gantrysim.compare.over_time import axis_differences, frictionless_run
from gantrysim.compare.page import headline
from gantrysim.machine.ideal import frictionless_machine
from gantrysim.tables.column_table import ColumnTable

from support.compared import circle_job

MACHINE = Machine("xy")
STROKES = "G21 G17 G90 G61\nF3000\nG0 X0 Y0\nM62 P0\nG1 X80\nG1 X0\nM63 P0\nM2\n"


@pytest.fixture(scope="module")
def job():
    return circle_job(text=STROKES)


@pytest.fixture(scope="module")
def run(job):
    return job.run()


@pytest.fixture(scope="module")
def rubbing(job):
    """The same program on a machine with twice the friction, as measured."""
    return job.run(machine=job.built_machine.perturbed(Perturbation(friction=2.0)))


@pytest.fixture(scope="module")
def wrong(job, run):
    return frictionless_run(run, job.built_machine, job.built_servo)


def rms(values):
    return float(np.sqrt(np.mean(values**2)))


@pytest.mark.soak
@pytest.mark.validates(
    "following error and torque over time, of a machine with twice the friction",
    "difference of the two records, tick by tick",
    "1 %",
)
def test_what_lies_along_a_straight_path_is_compared_over_time(run, rubbing, wrong):
    found = Comparison.of(Trace.of_run(rubbing, run), run, MACHINE, frictionless=wrong)
    rows = {(row.axis, row.quantity): row for row in found.over_time}
    of_x = rows["x", "following error"]
    following = [record.commanded[:, 0] - record.encoder[:, 0] for record in (rubbing, run, wrong)]
    assert of_x.measured.rms == pytest.approx(rms(following[0]), rel=0.01)
    assert of_x.simulated.rms == pytest.approx(rms(following[1]), rel=0.01)
    assert of_x.difference.rms == pytest.approx(rms(following[0] - following[1]), rel=0.01)
    assert of_x.frictionless.rms == pytest.approx(rms(following[0] - following[2]), rel=0.01)
    torque = rows["x", "torque"]
    assert torque.difference.rms == pytest.approx(rms(rubbing.demand[:, 0] - run.demand[:, 0]), rel=0.05)
    # across the path of x nothing of it shows
    assert found.unexplained["contour"].rms < 0.1 * of_x.difference.rms
    text = headline(found)
    assert "no difference is left" not in text
    assert "Following error over time: x" in text
    assert "(without friction" in text


def test_the_right_machine_and_the_wrong_one_are_told_apart(run, wrong):
    """Both records as measured, beside the same run: what once was no difference for either."""
    right = Comparison.of(Trace.of_run(run, run), run, MACHINE, frictionless=wrong)
    other = Comparison.of(Trace.of_run(wrong, run), run, MACHINE, frictionless=wrong)
    assert right.is_all_noise
    assert not other.is_all_noise
    assert "does not tell the machine from one without friction for" not in headline(right)
    assert "does not tell the machine from one without friction for x" in headline(other)


def test_an_encoder_alone_of_a_straight_path_shows_nothing_and_says_so(run):
    found = Comparison.of(Trace(run.time, {"encoder": np.array(run.encoder)}, None), run, MACHINE)
    text = headline(found)
    assert "no difference is left" not in text
    assert "Following error over time is not measured" in text
    assert "Torque over time is not measured" in text
    assert found.not_over_time["following error of x"] == "command or encoder are not measured"


def test_the_machine_without_friction_has_neither_dry_nor_viscous_friction(job, wrong):
    machine = frictionless_machine(job.built_machine)
    assert machine.axes[0].coulomb == 0
    assert machine.axes[0].viscous < 1e-6 * job.built_machine.axes[0].viscous
    np.testing.assert_array_equal(wrong.commanded, job.run().commanded)


def test_the_machine_without_friction_is_sent_the_same(run, wrong):
    for name in ("commanded", "dispense", "progress"):
        np.testing.assert_array_equal(getattr(wrong, name), getattr(run, name), err_msg=name)


def test_torques_of_a_log_are_read_in_their_unit(run):
    time = 1e-3 * np.arange(20)
    columns = {"t": time, "demand_x_Nm": time, "torque_x_Nm": 2 * time, "commanded_x_mm": time, "encoder_x_mm": time}
    trace = Trace.of(ColumnTable("log", columns, {"demand_x_Nm": "mN·m"}), Assignment({}), run)
    np.testing.assert_allclose(trace.torques["demand"][:, 0], 1e-3 * time)
    assert np.isnan(trace.torques["demand"][:, 1]).all()
    assert list(trace.torques) == ["demand"]
    given = Assignment.parse("time=t,encoder.x=encoder_x_mm,torque.x=torque_x_Nm*0.5 N·m")
    trace = Trace.of(ColumnTable("log", columns, {}), given, run)
    np.testing.assert_allclose(trace.torques["torque"][:, 0], time)


def test_a_saved_record_is_compared_as_measured(tmp_path, gantrysim_command, rubbing):
    folder = tmp_path / "out"
    (tmp_path / "job.toml").write_text(circle_job(text=STROKES).toml())
    options = ("--no-video", "--no-report", "--no-causes", "--no-improve")
    assert gantrysim_command("run", tmp_path / "job.toml", "--out", folder, *options)[0] == 0
    rubbing.save(tmp_path / "real.npz")
    status, out, err = gantrysim_command("compare", folder, "--measured", tmp_path / "real.npz")
    assert (status, err) == (0, "")
    words = " ".join(out.split())
    assert "Following error over time: x" in words
    assert "no friction: difference between the trace and the same machine without friction" in words
    assert "no difference is left" not in words
    (tmp_path / "none.npz").write_bytes(b"no archive")
    status, _, err = gantrysim_command("compare", folder, "--measured", tmp_path / "none.npz")
    assert status == 2
    assert err.startswith(f"error: --measured {tmp_path / 'none.npz'}: ")
    content = json.loads((folder / "compare" / "compare.json").read_text())
    assert {row["quantity"] for row in content["over_time"]} == {"following error", "torque"}
    assert content["over_time"][0]["difference_without_friction_rms"] > 0
    assert "Over time" in (folder / "compare" / "report.html").read_text()
    # the run's own folder, beside itself
    status, out, err = gantrysim_command("compare", folder, "--measured", folder, "--out", tmp_path / "same")
    assert (status, err) == (0, "")
    assert "no difference is left: all is measured" in " ".join(out.split())
    status, _, err = gantrysim_command("compare", folder, "--measured", tmp_path / "real.npz", "--period", 0.001)
    assert status == 2
    assert "--period: describes a log" in " ".join(err.split())


def test_a_law_of_the_run_s_own_is_not_run(tmp_path, gantrysim_command, monkeypatch):
    monkeypatch.chdir(tmp_path)
    law = "    torque[:] = 0.02 * tick.error + 5e-4 * (tick.demand_velocity - tick.measured_velocity)"
    law = f"def law(tick, state, torque):\n{law}\n"
    (tmp_path / "mine.py").write_text(law)
    (tmp_path / "job.toml").write_text(circle_job(text=STROKES).toml())
    options = ("--no-video", "--no-report", "--no-causes", "--no-improve")
    status, _, err = gantrysim_command(
        "run",
        "job.toml",
        "--out",
        "out",
        *options,
        "--set",
        'servo.law="mine.py:law"',
        "--set",
        "simulation.allow_unstable=true",
    )
    assert status == 0, err
    (tmp_path / "mine.py").write_text("raise SystemExit('it has run')\n")
    monkeypatch.chdir(tmp_path / "out")
    status, out, err = gantrysim_command("compare", ".", "--measured", ".", "--out", tmp_path / "same")
    assert (status, err) == (0, "")
    assert "the machine without friction is not simulated beside the run: its servo is code" in " ".join(out.split())


def test_a_record_of_other_axes_is_refused(run):
    other = Job.load("fanuc-conical").follow()
    with pytest.raises(InputError, match="must be those of the run, x, y"):
        Trace.of_run(other, run)


def fields_of_run(**values):
    """What `frictionless_run` reads of a record before it simulates."""
    return SimpleNamespace(**{"injected": (), "fault": None} | values)


def test_a_run_with_deliberate_faults_or_a_contrast_that_ends_early_is_no_contrast(job, run, monkeypatch):
    with pytest.raises(InputError, match=r"^it has deliberate faults$"):
        frictionless_run(fields_of_run(injected=("slip",)), job.built_machine, job.built_servo)
    monkeypatch.setattr(
        "gantrysim.compare.over_time.simulate", lambda *_, **__: fields_of_run(fault="following error of x")
    )
    with pytest.raises(InputError, match=r"^it ends in a fault: following error of x$"):
        frictionless_run(run, job.built_machine, job.built_servo)


def test_torques_and_errors_are_compared_where_they_are_measured():
    """Of three samples the second is missing: rms and largest of 3 and 4, differences of 1 and 2, of 3 and 4."""
    values = np.array([[3.0], [np.nan], [-4.0]])
    rest = np.zeros((3, 1))

    def record(following, torque):
        return SimpleNamespace(axes=("x",), units=("mm",), commanded=following, encoder=rest, demanded=torque)

    trace = SimpleNamespace(axes={"commanded": values, "encoder": rest}, torques={"demanded": values})
    simulated = np.array([[2.0], [9.0], [-2.0]])
    found = axis_differences(trace, record(values, values), record(simulated, simulated), record(rest, rest))
    assert [(row.axis, row.quantity, row.unit) for row in found] == [
        ("x", "following error", "µm"),
        ("x", "torque", "mN·m"),
    ]
    for row in found:
        for size, expected in (
            (row.measured, (3.0, 4.0)),
            (row.simulated, (2.0, 2.0)),
            (row.difference, (1.0, 2.0)),
            (row.frictionless, (3.0, 4.0)),
        ):
            assert size.rms == pytest.approx(math.hypot(*expected) / math.sqrt(2))
            assert size.max == pytest.approx(max(expected))
    # what is not measured is not compared
    trace = SimpleNamespace(axes={"commanded": values, "encoder": np.full((3, 1), np.nan)}, torques={})
    assert axis_differences(trace, record(values, values), record(simulated, simulated), None) == []
