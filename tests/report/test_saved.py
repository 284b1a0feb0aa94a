"""A saved run is read back unchanged; a folder without a run, or a changed machine, is refused in one line."""

import dataclasses
import json

import numpy as np
import pytest

from gantrysim import InputError, Job
from gantrysim.machine.machine import builtin_models
from gantrysim.report.folder import SavedRun

from support.films import SMALL, saved, small_job

FOLLOWER = (
    f'name = "mine"\nmachine = "machine.xml"\n[program]\ncontroller = "trio.MoveSpiral"\nspeed = 50.0\n{SMALL[0]}.0\n'
    "turns = 1\nthickness = 5.0\nloop_period = 0.0\n"
)
SEEN = '<geom type="box" size="0.1 0.1 0.1" pos="0 0 -2" contype="0" conaffinity="0" rgba="0 1 0 1"/>'


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return saved(tmp_path_factory.mktemp("saved") / "one", small_job())


@pytest.fixture
def own(tmp_path, rigid):
    """The folder of a run on a user's machine, and the machine's file."""
    source = rigid().source
    machine = tmp_path / "machine.xml"
    machine.write_text(source.read_text().replace("<worldbody>", f"<worldbody>{SEEN}"))
    (tmp_path / "job.toml").write_text(FOLLOWER)
    job = Job.load(tmp_path / "job.toml")
    return saved(tmp_path / "run", job, job.follow()), machine


def test_job_record_and_machine_are_read_back(folder):
    job = small_job()
    back = SavedRun.load(folder)
    assert back.folder == folder
    assert back.job.model_dump() == job.model_dump()
    np.testing.assert_array_equal(back.run.nozzle, job.run().nozzle)
    assert back.machine.name == "xy"
    assert back.machine.axis_names == back.run.axes
    assert back.changed is False
    assert SavedRun.load(str(folder)).run.fault is None


def test_a_run_that_is_replaced_while_it_is_read_is_read_again(folder, tmp_path, monkeypatch):
    other = small_job("loop_period=0.02")
    place = saved(tmp_path / "run", small_job())
    read = Job.of_record
    left = [lambda: saved(place, other)]

    def meanwhile(*arguments):
        if left:
            left.pop()()
        return read(*arguments)

    monkeypatch.setattr(Job, "of_record", meanwhile)
    back = SavedRun.load(place)
    assert back.job.program["loop_period"] == 0.02
    np.testing.assert_array_equal(back.run.nozzle, other.run().nozzle)
    assert back.is_current


def test_a_home_folder_is_expanded(folder, monkeypatch):
    monkeypatch.setenv("HOME", str(folder.parent))
    assert SavedRun.load("~/one").job.name == "an225"


def test_a_machine_has_changed_when_its_physics_have(own):
    folder, machine = own
    assert SavedRun.load(folder).changed is False
    text = machine.read_text()
    machine.write_text(text.replace('rgba="0 1 0 1"', 'rgba="1 0 0 1"'))
    assert machine.read_text() != text
    assert SavedRun.load(folder).changed is False
    machine.write_text(text.replace('mass="1"', 'mass="1.1"'))
    assert SavedRun.load(folder).changed is True


def test_without_a_summary_the_record_knows_its_machine(own):
    folder, machine = own
    (folder / "summary.json").unlink()
    assert SavedRun.load(folder).changed is False
    machine.write_text(machine.read_text().replace('mass="1"', 'mass="1.1"'))
    assert SavedRun.load(folder).changed is True


def test_a_record_without_a_digest_counts_as_unchanged(own):
    """As one that Python has saved over that of the folder."""
    folder, machine = own
    dataclasses.replace(SavedRun.load(folder).run, machine_sha256="").save(folder / "run.npz")
    machine.write_text(machine.read_text().replace('mass="1"', 'mass="1.1"'))
    assert SavedRun.load(folder).changed is False


@pytest.mark.parametrize(
    ("old", "new"), [("speed = 50.0", "speed = 51.0"), ('name = "mine"', 'name = "yours"'), ("settle = 0.25", "")]
)
def test_the_job_of_another_run_is_noticed(own, old, new):
    folder, _ = own
    job = folder / "job.toml"
    text = job.read_text()
    assert old in text
    job.write_text(text.replace(old, new))
    with pytest.raises(InputError, match=r"job.toml is not the job that run.npz was made from: put that one back, or"):
        SavedRun.load(folder)
    job.write_text("# another comment\n" + text)
    assert SavedRun.load(folder).job.name == "mine"


def test_records_of_two_runs_exchanged_are_noticed(folder, own, tmp_path):
    other, _ = own
    record = (other / "run.npz").read_bytes()
    (other / "run.npz").write_bytes((folder / "run.npz").read_bytes())
    with pytest.raises(InputError, match=r"is not the job that run.npz was made from"):
        SavedRun.load(other)
    (other / "run.npz").write_bytes(record)
    assert SavedRun.load(other).job.name == "mine"


def test_a_machine_with_other_axes_is_refused(own):
    folder, machine = own
    text = machine.read_text()
    machine.write_text(
        text.replace('name="x"', 'name="v"').replace('joint="x"', 'joint="v"').replace('actuator="x"', 'actuator="v"')
    )
    with pytest.raises(
        InputError, match=r"its record has the axes x, y; its machine machine has v, y now: run .*job.toml again"
    ):
        SavedRun.load(folder)


def test_a_machine_with_other_units_is_refused(folder):
    back = SavedRun.load(folder)
    other = dataclasses.replace(back.run, units=("mm", "deg"))
    with pytest.raises(InputError, match="its record has the units mm, deg; its machine xy has mm, mm now"):
        SavedRun(back.folder, back.job, other, back.machine, False)


def test_a_missing_machine_is_named_with_a_remedy(own):
    folder, machine = own
    (folder / "moved").mkdir()
    machine.rename(folder / "moved" / "its.xml")
    known = ", ".join(builtin_models())
    text = f"run {folder}: its machine {machine} is missing: set machine in {folder}/job.toml to a file, or to one of "
    with pytest.raises(InputError) as refused:
        SavedRun.load(folder)
    assert str(refused.value) == text + known
    # the remedy works, with a path relative to the run's folder
    job = folder / "job.toml"
    job.write_text(job.read_text().replace(str(machine), "moved/its.xml"))
    back = SavedRun.load(folder)
    assert back.machine.source == folder / "moved" / "its.xml"
    assert back.changed is False
    # an unknown machine name gets the same message
    job.write_text(job.read_text().replace("moved/its.xml", "yx"))
    with pytest.raises(InputError, match=r"its machine yx is missing: set machine in .*/job.toml to"):
        SavedRun.load(folder)


def test_what_is_no_run_is_refused(folder, tmp_path):
    for place, text in (
        (tmp_path / "none", "no such folder; gantrysim run JOB --out .*/none makes one"),
        (folder / "run.npz", "is a file, must be a folder that gantrysim run has written"),
        (tmp_path, "holds no run: job.toml and run.npz missing"),
    ):
        with pytest.raises(InputError, match=f"run {place}: {text}"):
            SavedRun.load(place)
    (tmp_path / "run.npz").write_bytes((folder / "run.npz").read_bytes())
    with pytest.raises(InputError, match=r"holds no run: job.toml missing"):
        SavedRun.load(tmp_path)
    (tmp_path / "job.toml").write_bytes((folder / "job.toml").read_bytes())
    (tmp_path / "run.npz").write_bytes((folder / "run.npz").read_bytes()[:1000])
    with pytest.raises(InputError, match=r"run.npz: is not a record of a run"):
        SavedRun.load(tmp_path)
    summary = json.loads((folder / "summary.json").read_text())
    assert set(summary["versions"]) >= {"machine_sha256"}
