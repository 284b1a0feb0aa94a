"""A controller of the user's own, in a file or a module: in jobs, records, studies, the tuner, and what is refused."""

import os
import pickle
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

from gantrysim import InputError, Job, causes_of
from gantrysim.render.header import labels_of
from gantrysim.report.folder import SavedRun
from gantrysim.study import Case, SpeedStudy, run_study
from gantrysim.study.cases import measure
from gantrysim.study.tuning import TuningStudy

from support import own_controllers
from support.doc_pages import TASKS, blocks_of
from support.films import saved
from support.studies import SHORT

QUICK = ["lines=1", "program.length=10", "simulation.settle=0.05"]
SOURCE = Path(own_controllers.__file__).read_text()
JOB = """
name = "{cls}"
[program]
controller = "{place}:{cls}"
speed = 40.0
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with controllers, which is not the working folder."""
    folder = tmp_path / "elsewhere"
    folder.mkdir()
    (folder / "mine.py").write_text(SOURCE)
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    return folder


@pytest.fixture
def forget_code(monkeypatch):
    """Forget the code that was imported, so that it runs again if it is imported again."""

    def forget():
        for name in [name for name in sys.modules if name.startswith("gantrysim_code_")]:
            monkeypatch.delitem(sys.modules, name)

    return forget


def job_of(folder, cls="Zigzag", place="mine.py", more="", overrides=()):
    file = folder / "job.toml"
    file.write_text(JOB.format(cls=cls, place=place) + more)
    return Job.load(file, overrides, allow_code=True)


@pytest.mark.parametrize("place", ["mine.py", "support.own_controllers"])
def test_a_user_s_controller_is_run_as_a_built_in_one(folder, place):
    builtin = Job.load("an225", SHORT)
    (folder / "job.toml").write_text(builtin.toml().replace("trio.MoveSpiral", f"{place}:Spiral"))
    job = Job.load(folder / "job.toml", allow_code=True)
    np.testing.assert_array_equal(job.run().encoder, builtin.run().encoder)
    assert job.notes == builtin.notes
    name = f"{folder}/mine.py:Spiral" if place == "mine.py" else f"{place}:Spiral"
    assert job.program == {**builtin.program, "controller": name}
    assert job.at_speed(100.0).program["speed"] == 100.0


def test_its_keys_are_the_fields_of_the_class(folder):
    job = job_of(folder, overrides=["pitch=5", "program.lines=2"])
    assert job.program == {
        "controller": f"{folder}/mine.py:Zigzag",
        "speed": 40.0,
        "lines": 2,
        "length": 20.0,
        "pitch": 5.0,
    }
    plan = job.plan()
    assert plan.length == pytest.approx(45.0)
    assert plan.duration == pytest.approx(45.0 / 40.0)
    assert job.changed({"program.length": 10.0}).plan().length == pytest.approx(25.0)
    assert pickle.loads(pickle.dumps(job)).controller == job.controller


def test_a_program_file_is_read_by_a_user_s_controller(folder, tmp_path, gantrysim_command):
    (folder / "points.xy").write_text("0 0\n30 0\n30 40\n")
    (folder / "job.toml").write_text(JOB.format(cls="Reader", place="mine.py") + 'file = "points.xy"\n')
    job = Job.load(folder / "job.toml", allow_code=True)
    assert job.plan().length == pytest.approx(70.0)
    assert job.source == "points.xy"
    status, out, _ = gantrysim_command(
        "check", folder / "points.xy", "--controller", f"{folder}/mine.py:Reader", "--set", "program.speed=20"
    )
    assert (status, "70.000 mm" in out, "3.500 s" in out) == (0, True, True)  # the caller's own choice needs no leave
    with pytest.raises(InputError, match="would run code of its own"):
        Job.load(folder / "job.toml")
    with pytest.raises(InputError, match=r"mine\.py:Zigzag': reads no program files: has no field text"):
        Job.load(folder / "points.xy", controller=f"{folder}/mine.py:Zigzag")


def test_files_that_the_caller_names_are_relative_to_the_working_folder(folder, tmp_path):
    shutil.copy(folder / "mine.py", tmp_path / "here" / "local.py")
    for key, value, name in (
        ("program.controller", "local.py:Spiral", "controller"),
        ("servo.law", "local.py:law", "law"),
    ):
        job = Job.load("an225", [*SHORT, f"{key}={value}"])
        table = job.program if name == "controller" else dict(job.servo)
        assert table[name] == f"{tmp_path}/here/{value}"
    (tmp_path / "here" / "points.xy").write_text("0 0\n30 0\n")
    job = Job.load("points.xy", ["program.speed=20"], controller="local.py:Reader")
    assert job.program["controller"] == f"{tmp_path}/here/local.py:Reader"


FRESH = """
import sys
from gantrysim.render.header import labels_of
from gantrysim.report.folder import SavedRun
saved = SavedRun.load(sys.argv[1])
print(saved.run.requested.length, saved.job.program["lines"], saved.job.margins[0].stable)
assert not [name for name in sys.modules if "mine" in name or "gantrysim_code" in name]
"""


def test_a_record_loads_in_a_fresh_process_without_the_code(fresh, folder):
    run = saved(folder / "run", job_of(folder))
    (folder / "mine.py").write_text("raise SystemExit('code has run')")
    done = fresh.run(FRESH, folder, run)
    assert (done.status, done.output.split(), done.error) == (0, ["68.0", "3", "True"], "")
    (folder / "mine.py").unlink()
    assert SavedRun.load(run).run.requested.length == pytest.approx(68.0)


def test_a_record_in_the_present_folder_loads_without_the_code_and_runs_with_it(folder, forget_code, monkeypatch):
    job = job_of(folder)
    run = saved(folder / "run", job)
    monkeypatch.chdir(run)
    forget_code()
    (folder / "mine.py").write_text("raise SystemExit('code has run')")
    job_again = SavedRun.load(".").job
    assert job_again.program == job.program
    with pytest.raises(InputError, match="code has run"):
        job_again.run()
    (folder / "mine.py").write_text(SOURCE)
    np.testing.assert_array_equal(job_again.run().encoder, job.run().encoder)


def test_what_a_method_raises_reaches_the_caller(folder):
    (folder / "mine.py").write_text(SOURCE.replace("        corners = [(0.0, 0.0)]", "        corners = [1 / 0]"))
    with pytest.raises(ZeroDivisionError):
        job_of(folder).plan()


def test_records_side_by_side_are_labelled_without_the_code(folder, forget_code):
    runs = [saved(folder / name, job_of(folder, overrides=[f"pitch={name}"])) for name in ("4", "6")]
    forget_code()
    (folder / "mine.py").write_text("raise SystemExit('code has run')")
    assert labels_of([SavedRun.load(run) for run in runs]) == ["pitch = 4", "pitch = 6"]


def test_a_run_writes_everything(folder, tmp_path, gantrysim_command):
    job_of(folder)
    status, out, errors = gantrysim_command("run", folder / "job.toml", "--allow-code", "--causes", "--no-video", "-v")
    assert (status, errors) == (0, "")
    written = {file.name for file in (tmp_path / "here" / "out" / "Zigzag").iterdir()}
    assert written >= {"job.toml", "run.npz", "summary.json", "report.html", "plots"}
    assert "causes" in out or "switched off" in out


def test_causes_studies_and_cases(folder):
    job = job_of(folder)
    assert {effect.cause.name for effect in causes_of(job).effects} >= {"program", "friction"}
    assert measure(Case.of(job, {"program.pitch": 6.0}))["path_length_mm"] == pytest.approx(72.0, rel=1e-2)


@pytest.mark.soak
def test_a_study_in_other_processes(folder, tmp_path):
    study = SpeedStudy(job_of(folder, overrides=QUICK), tolerance=0.05)
    rows = run_study(study, tmp_path / "out", workers=2).rows
    assert {row["status"] for row in rows if row["speed_mm_s"] <= 40.0} == {"ok"}


@pytest.mark.soak
def test_the_tuner(folder, tmp_path):
    study = TuningStudy(job_of(folder, overrides=QUICK), budget=8, robust=1, guards=2, unseen=1, seed=1)
    assert any(row["status"] == "ok" for row in run_study(study, tmp_path / "out", workers=1).rows)


def test_a_file_that_has_changed_is_read_anew_even_within_the_second_and_at_the_same_size(folder):
    assert job_of(folder).plan().length == pytest.approx(68.0)
    file = folder / "mine.py"
    stamp = file.stat()
    file.write_text(SOURCE.replace("length: float = 20.0", "length: float = 30.0"))
    os.utime(file, ns=(stamp.st_atime_ns, stamp.st_mtime_ns))
    assert job_of(folder).plan().length == pytest.approx(98.0)
    file.write_text(SOURCE.replace("    pitch: float", "    step: float").replace("self.pitch", "self.step"))
    with pytest.raises(InputError, match=r"unknown key program\.pitch"):
        job_of(folder, more="pitch = 4.0\n")
    assert not list(folder.glob("__pycache__"))


@pytest.mark.parametrize(
    ("cls", "text"),
    [
        ("Missing", "mine.py has no class 'Missing'"),
        ("function", "is not a class but a function: must be a class"),
        ("instance", "is not a class but a Lines: must be a class"),
        (
            "NoController",
            "must derive from gantrysim.controllers.controller.Controller; it lacks requested, duration, axes, "
            "setpoints, with_speeds",
        ),
        ("Alike", "must derive from gantrysim.controllers.controller.Controller"),
        (
            "Unfinished",
            "is not a complete controller: it lacks requested, duration, with_speeds, see "
            "gantrysim.controllers.controller.Controller",
        ),
        ("Changing", "must be a frozen dataclass, @dataclass(frozen=True)"),
        ("Plain", "must be a frozen dataclass, @dataclass(frozen=True)"),
        ("Reserved", "has a field controller, which is a key of every program"),
        ("Raising", "its constructor raised KeyError: 'no such turn'"),
        ("Exiting", "its constructor raised SystemExit: 0"),
        ("Arrays", "its fields cannot be keys of a job file"),
        ("Undefined", "its fields have a type that is none: NameError: name 'Nowhere' is not defined"),
        ("Complex", "pole cannot stand in a job file"),
    ],
)
def test_a_class_that_is_no_controller_is_refused_in_one_line(folder, gantrysim_command, cls, text):
    with pytest.raises(InputError) as caught:
        job_of(folder, cls)
    assert text in str(caught.value)
    assert f"mine.py:{cls}'" in str(caught.value)
    status, _, errors = gantrysim_command("check", folder / "job.toml", "--allow-code")
    assert (status, errors.count("\n")) == (2, 1)


@pytest.mark.parametrize(("cls", "text"), [("Nothing", "returned a value of type NoneType"), ("MyPath", "a MyTrack")])
def test_setpoints_that_no_record_can_hold_are_refused_in_one_line(folder, cls, text):
    with pytest.raises(InputError, match=text):
        job_of(folder, cls).run()


@pytest.mark.parametrize(
    ("more", "text"),
    [
        ("pich = 4.0\n", "unknown key program.pich: did you mean pitch"),
        ("lines = 1.5\n", "program.lines = 1.5"),
        ("pitch = true\n", "pitch = true: true and false are not numbers"),
        ("pitch = 1e20\n", "pitch = 1e+20: must be 0 or from 1e-100 to 1e+12 in magnitude"),
    ],
)
def test_wrong_keys_are_named(folder, more, text):
    with pytest.raises(InputError) as caught:
        job_of(folder, more=more)
    assert text in str(caught.value)


def test_a_missing_key_and_what_the_constructor_refuses_are_named(folder):
    file = folder / "job.toml"
    file.write_text('name = "a"\n[program]\ncontroller = "mine.py:Zigzag"\n')
    with pytest.raises(InputError, match=r"program\.speed is missing"):
        Job.load(file, allow_code=True)
    with pytest.raises(InputError, match="speed = -1 mm/s: must be greater than 0 mm/s"):
        Job.load(file, ["program.speed=-1"], allow_code=True)


@pytest.mark.parametrize(
    ("source", "text"),
    [
        (None, "cannot be imported: FileNotFoundError: No such file or directory"),
        ("import nowhere_at_all", "cannot be imported: ModuleNotFoundError: No module named 'nowhere_at_all'"),
        ("def broken(:", "cannot be imported: SyntaxError"),
        ("import sys; sys.exit(0)", "cannot be imported: SystemExit: 0"),
        ("\0", "cannot be imported"),
        ("1 / 0", "cannot be imported: ZeroDivisionError: division by zero"),
    ],
)
def test_a_file_that_cannot_be_imported_is_one_line(folder, gantrysim_command, source, text):
    (folder / "mine.py").unlink()
    if source is not None:
        (folder / "mine.py").write_text(source)
    (folder / "job.toml").write_text(JOB.format(cls="Zigzag", place="mine.py"))
    for _ in range(2):  # a failed import leaves nothing
        status, _, errors = gantrysim_command("check", folder / "job.toml", "--allow-code")
        assert (status, errors.count("\n")) == (2, 1)
        assert text in errors


@pytest.mark.parametrize("make", [os.mkfifo, Path.mkdir], ids=["pipe", "folder"])
def test_what_is_no_regular_file_is_refused_at_once(folder, make):
    (folder / "mine.py").unlink()
    make(folder / "mine.py")
    with pytest.raises(InputError, match="must be a regular file"):
        job_of(folder)


def test_a_stranger_s_controller_is_not_looked_at_for_the_keys_that_are_set(folder):
    (folder / "mine.py").write_text("raise SystemExit('code has run')")
    file = folder / "job.toml"
    file.write_text(JOB.format(cls="Zigzag", place="mine.py"))
    for overrides in ([], ["program.speed=20"], ["pitch=5"], ["servo.period=0.002"]):
        with pytest.raises(InputError, match="would run code of its own"):
            Job.load(file, overrides)
    with pytest.raises(InputError, match="would run code of its own"):
        Job.load(file, placement={"x": 5.0})
    with pytest.raises(InputError, match=r"program\.diameter is missing"):
        Job.load(file, ["program.controller=trio.MoveSpiral"])  # replaced, so that nothing is refused


def test_the_example_of_the_documentation_runs(tmp_path, monkeypatch, gantrysim_command):
    for block in blocks_of(TASKS["Write a controller"]):
        if block.title:
            (tmp_path / block.title).write_text(block.text, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    job = Job.load("wave.toml")
    assert job.plan().length == pytest.approx(60 * np.pi)
    assert gantrysim_command("check", "wave.toml", "--speed", "25")[0] == 0


def test_a_name_between_colons_is_printed_as_it_is(folder, tmp_path, gantrysim_command, monkeypatch):
    """Rich would print :ring: as a picture of a ring."""
    (folder / "mine.py").write_text(SOURCE.replace("class Zigzag(", "class Ring("))
    (folder / "job.toml").write_text(JOB.format(cls="Ring", place="mine.py"))
    _, _, errors = gantrysim_command("check", folder / "job.toml")
    assert f"program.controller = {folder}/mine.py:Ring: if you trust it" in errors
    monkeypatch.chdir(folder)
    (folder / "ring:ring:.toml").write_text(JOB.format(cls="Ring", place="mine.py"))
    assert gantrysim_command("check", "ring:ring:.toml")[0] == 0
    _, out, _ = gantrysim_command(
        "run", "ring:ring:.toml", "--out", "x:ring:y", "--no-video", "--no-report", "--no-causes", "--no-improve"
    )
    assert "written to x:ring:y/" in out
