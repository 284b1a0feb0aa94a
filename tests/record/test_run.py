"""The record of a run, in memory and in a file."""

import dataclasses
import subprocess
import sys

import numpy as np
import pytest

from gantrysim import Dispenser, InputError, Needle, Run, Servo, perfect_follower, simulate
from gantrysim.controllers.trio import MoveSpiral
from gantrysim.paths.arcs import ArcChain
from gantrysim.record.setpoints import Setpoints

from support.runs import archimedean, turn, turntable

PATHS = {
    "involute": MoveSpiral(60, 1, 10, 100).requested,
    "arcs": MoveSpiral(60, 1, 10, 100).generated,
    "chain": archimedean(30, 10, 1.5, clockwise=False),
    "line": ArcChain((0, 0), 0.3, [0.0], [50.0]),
}


@pytest.fixture
def run(xy) -> Run:
    return simulate(
        xy, Servo.derive(xy.axes), MoveSpiral(60, 1, 10, 100).setpoints(1e-3).hold(0.1), dispenser=Dispenser(flow=80.0)
    )


@pytest.mark.parametrize("path", PATHS.values(), ids=PATHS.keys())
def test_a_saved_run_is_loaded_to_the_last_bit(xy, tmp_path, path):
    run = simulate(xy, Servo.derive(xy.axes), Setpoints.along(path, 80.0, 1e-3), dispenser=Dispenser(flow=80.0))
    run.save(tmp_path / "run.npz")
    again = Run.load(tmp_path / "run.npz")
    for field in dataclasses.fields(Run):
        ours, theirs = getattr(run, field.name), getattr(again, field.name)
        if isinstance(ours, np.ndarray):
            np.testing.assert_array_equal(ours, theirs)
            assert ours.dtype == theirs.dtype
        elif field.name not in ("requested", "rig"):
            assert ours == theirs
    s = np.linspace(0, path.length, 50)
    np.testing.assert_array_equal(again.requested.position(s), run.requested.position(s))


def test_a_fault_survives_the_file(xy, tmp_path):
    servo = Servo.derive(xy.axes, following_error_limit=0.01)
    run = simulate(xy, servo, MoveSpiral(60, 1, 10, 100).setpoints(1e-3))
    assert run.fault is not None
    run.save(tmp_path / "run.npz")
    assert Run.load(tmp_path / "run.npz").fault == run.fault


def test_shapes_and_times(run):
    n = len(run.time)
    assert run.period == pytest.approx(1e-3)
    np.testing.assert_allclose(np.diff(run.time), 1e-3, atol=1e-12)
    for name in ("commanded", "encoder", "demand", "torque", "current", "voltage"):
        assert getattr(run, name).shape == (n, 2)
    for name in ("commanded_tip", "encoder_tip", "nozzle"):
        assert getattr(run, name).shape == (n, 3)
    assert run.flow.shape == run.dispense.shape == (n,)
    assert (run.flow == np.where(run.dispense, 80.0, 0.0)).all()
    assert (~run.dispense).sum() == 100


def test_arrays_are_read_only(run):
    with pytest.raises(ValueError, match="read-only"):
        run.nozzle[0, 0] = 1.0


def test_torque_is_the_motor_constant_times_the_current(run, xy):
    constant = xy.axes[0].motor_constant
    np.testing.assert_allclose(run.torque, constant * run.current, rtol=1e-12, atol=1e-15)


def test_units_of_the_axes_and_of_a_fault_survive_the_file(tmp_path):
    run = turn(turntable(tmp_path), 90.0, following_error_limit=1e-3)
    assert run.axes == ("th", "x")
    assert run.units == ("deg", "mm")
    assert run.fault is not None
    assert run.fault.unit == "deg"
    run.save(tmp_path / "run.npz")
    again = Run.load(tmp_path / "run.npz")
    assert (again.units, again.fault) == (run.units, run.fault)


@pytest.mark.parametrize("content", [b"", b"no archive", None])
def test_a_file_that_is_no_record_is_refused(tmp_path, content):
    file = tmp_path / "run.npz"
    if content is not None:
        file.write_bytes(content)
    with pytest.raises(InputError, match="is not a record of a run"):
        Run.load(file)


def test_another_archive_is_refused(tmp_path):
    np.savez(tmp_path / "run.npz", a=1)
    with pytest.raises(InputError, match="is not a record of a run"):
        Run.load(tmp_path / "run.npz")


def test_a_record_keeps_its_name(run, tmp_path):
    run.save(tmp_path / "record")
    assert Run.load(tmp_path / "record").machine == "xy"


@pytest.mark.parametrize("number", [0, 4, 5, 6, 7, 9, 99])
def test_a_record_of_another_format_is_refused_in_a_line_that_names_the_one_that_is_read(run, tmp_path, number):
    run.save(tmp_path / "run.npz")
    with np.load(tmp_path / "run.npz") as arrays:
        content = {**arrays, "format": number}
    np.savez(tmp_path / "other.npz", **content)
    with pytest.raises(InputError) as refused:
        Run.load(tmp_path / "other.npz")
    said = f"its format is {number}, only format 8 is read: run its job.toml again"
    assert str(refused.value).endswith(f": {said}")
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("name", ["sha256", "injected", "job_sha256", "machine_sha256", "face", "flow_demand"])
def test_a_record_that_lacks_a_member_is_refused(run, tmp_path, name):
    run.save(tmp_path / "run.npz")
    with np.load(tmp_path / "run.npz") as arrays:
        content = dict(arrays)
    del content[name]
    np.savez(tmp_path / "less.npz", **content)
    with pytest.raises(InputError, match=f"{name} is missing$"):
        Run.load(tmp_path / "less.npz")


def test_a_record_has_arrays_of_its_own(run):
    mine = run.encoder.copy()
    changed = dataclasses.replace(run, encoder=mine)
    mine[0, 0] = 77.0
    assert changed.encoder[0, 0] != 77.0


def test_a_fault_at_the_first_tick_leaves_a_record_of_one(xy):
    servo = Servo.derive(xy.axes, resolution=40.0)
    run = simulate(xy, servo, MoveSpiral(60, 1, 10, 100, start=(9.0, 9.0)).setpoints(1e-3))
    assert run.fault is not None
    assert len(run.time) == 1
    assert run.period == 1e-3


def test_a_record_holds_its_needle(run, tmp_path):
    wide = dataclasses.replace(run, face=1.65, needle_length=12.7)
    wide.save(tmp_path / "run.npz")
    loaded = Run.load(tmp_path / "run.npz")
    assert (loaded.face, loaded.needle_length) == (1.65, 12.7)


@pytest.mark.parametrize("needle", [Needle("14G", length=12.7), Needle(1.2, outer=1.9), None])
def test_a_run_has_the_needle_of_its_dispenser_or_that_of_its_machine(xy, needle):
    setpoints = MoveSpiral(60, 1, 10, 100).setpoints(1e-3)
    run = perfect_follower(xy, setpoints, dispenser=Dispenser(flow=100.0, needle=needle))
    expected = (0.82, 25.4) if needle is None else (needle.face, needle.length)
    assert (run.face, run.needle_length) == pytest.approx(expected)


def test_a_record_is_loaded_by_a_script_that_imports_nothing_else(run, tmp_path):
    file = tmp_path / "run.npz"
    run.save(file)
    code = f"from gantrysim import Run; print(len(Run.load({str(file)!r}).time))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
