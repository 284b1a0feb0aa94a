"""Code that a job names runs only where the caller allows it, or where the job lies in the present folder."""

import pickle
import sys
from pathlib import Path

import pytest

from gantrysim import InputError, Job, Machine
from gantrysim.cli import study as study_commands
from gantrysim.cli import tune as tune_command
from gantrysim.job.servo_file import servo_of_file
from gantrysim.report.folder import SavedRun
from gantrysim.study import Case

from support import own_laws
from support.films import saved
from support.soaked import suite_runs
from support.studies import SHORT

CODE = f"""
from pathlib import Path
Path(__file__).with_name("has-run").touch()
{Path(own_laws.__file__).read_text()}
from gantrysim.controllers.trio import MoveSpiral
class Spiral(MoveSpiral):
    pass
"""
# what a job file has, and what it names instead: its key, the built-in name, the code
LAW = ("servo.law", "pid", "mine.py:pd")
CONTROLLER = ("program.controller", "trio.MoveSpiral", "mine.py:Spiral")
TABLE = Path(__file__).parents[2] / "examples" / "machines" / "belt-gantry.toml"
QUICK = ["--no-video", "--no-report", "--no-causes", "--no-improve"]
COMMANDS = {
    "run": ("run", "JOB", *QUICK),
    "check": ("check", "JOB"),
    "gains": ("gains", "JOB"),
    "study loop": ("study", "loop", "JOB"),
    "study speed": ("study", "speed", "JOB"),
    "study machine": ("study", "machine", "JOB"),
    "study repeat": ("study", "repeat", "JOB"),
    "study laws": ("study", "laws", "JOB"),
    "tune": ("tune", "JOB"),
    "machine new": ("machine", "new", "TABLE", "--job", "JOB"),
    "info": ("info", "--model", "xy", "--job", "JOB"),
    "view": ("view", "JOB"),
    "servo file": ("run", "an225", "--servo", "JOB", *QUICK),
}


def stranger_with(tmp_path, monkeypatch, code):
    """Return a folder with a job that brings code, and work in another; the code's file tells when it has run."""
    key, builtin, named = code
    last = key.rpartition(".")[2]
    folder = tmp_path / "stranger"
    folder.mkdir()
    (folder / "mine.py").write_text(CODE)
    text = Job.load("an225", SHORT).toml().replace(f'{last} = "{builtin}"', f'{last} = "{named}"')
    (folder / "job.toml").write_text(text)
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    return folder


@pytest.fixture
def stranger(tmp_path, monkeypatch):
    return stranger_with(tmp_path, monkeypatch, LAW)


@pytest.fixture(params=[LAW, CONTROLLER], ids=["law", "controller"])
def code(request):
    return request.param


@pytest.fixture
def either(tmp_path, monkeypatch, code):
    return stranger_with(tmp_path, monkeypatch, code)


def refused(folder, label, code=LAW):
    return (
        f"{label} would run code of its own, {code[0]} = {folder}/{code[2]}: if you trust it, allow it with "
        f"--allow-code, in Python with allow_code=True, or go to its folder, {folder}"
    )


def has_run(folder):
    return (folder / "has-run").exists()


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_refuses_a_stranger_s_code_in_one_line(
    either, code, tmp_path, gantrysim_command, monkeypatch, name
):
    monkeypatch.setattr("gantrysim.render.view.window.check_display", lambda: None)
    table = tmp_path / "table.toml"
    table.write_bytes(TABLE.read_bytes())
    if name == "servo file" and code is CONTROLLER:
        pytest.skip("a servo file has no program")
    job = either / "job.toml"
    arguments = [{"JOB": job, "TABLE": table}.get(word, word) for word in COMMANDS[name]]
    label = f"servo {job}" if name == "servo file" else f"job {job}"
    status, _, errors = gantrysim_command(*arguments)
    assert (status, errors) == (2, f"error: {refused(either, label, code)}\n")
    assert not has_run(either)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["here", "stranger", "table.toml"]
    assert not list((tmp_path / "here").iterdir())


@pytest.mark.parametrize("name", suite_runs(sorted(COMMANDS.keys() - {"view"}), 0, 3, 6, 9))
def test_every_command_takes_the_permission(either, code, tmp_path, gantrysim_command, monkeypatch, name):
    """As far as the job's own: a study and the tuner would take long."""
    if name == "servo file" and code is CONTROLLER:
        pytest.skip("a servo file has no program")
    studied = []
    monkeypatch.setattr(study_commands, "carry_out", lambda study, *_: studied.append(study.job))
    monkeypatch.setattr(tune_command, "carry_out", lambda study, *_: studied.append(study.job))
    monkeypatch.setattr(tune_command, "write_words", lambda *_: None)
    table = tmp_path / "table.toml"
    table.write_bytes(TABLE.read_bytes())
    words = {"JOB": either / "job.toml", "TABLE": table}
    status, _, errors = gantrysim_command(*[words.get(word, word) for word in COMMANDS[name]], "--allow-code")
    assert "--allow-code" not in errors
    assert studied or status == 0
    assert studied or has_run(either) or (code is LAW and name in ("gains", "check"))


def test_a_servo_file_for_a_machine_alone_brings_code_with_permission_only(stranger):
    """As of `gantrysim identify --replay`, which has no job."""
    file = stranger / "job.toml"
    machine = Machine("xy")
    with pytest.raises(InputError) as error:
        servo_of_file(file, machine, 1e-3)
    assert str(error.value) == refused(stranger, f"servo {file}").replace(f"= {stranger}/", "= ")
    assert not has_run(stranger)
    # it is imported where a motion begins
    assert servo_of_file(file, machine, 1e-3, allow_code=True).period == 1e-3


def test_in_the_present_folder_code_runs_unasked(either, tmp_path, gantrysim_command, monkeypatch):
    monkeypatch.chdir(either)
    assert gantrysim_command("run", "job.toml", *QUICK)[0] == 0
    assert has_run(either)
    (tmp_path / "link").symlink_to("stranger")
    monkeypatch.chdir(tmp_path / "link")
    Job.load("job.toml")
    Job.load(either / "job.toml")
    monkeypatch.chdir(tmp_path / "here")
    Job.load("../stranger/job.toml", allow_code=True)
    (tmp_path / "here" / "job.toml").symlink_to("../stranger/job.toml")  # the file lies where its link leads
    (tmp_path / "here" / "below").mkdir()
    (tmp_path / "here" / "below" / "job.toml").write_bytes((either / "job.toml").read_bytes())
    for file in ("job.toml", "below/job.toml", tmp_path / "link" / "job.toml"):
        with pytest.raises(InputError, match="would run code of its own"):
            Job.load(file)


def test_what_the_caller_names_may_run_and_what_is_replaced_need_not(stranger):
    own = f'servo.law="{stranger}/mine.py:pd"'
    assert Job.load("an225", [*SHORT, own]).run().fault is None
    (stranger / "plain.toml").write_text(Job.load("an225", SHORT).toml())
    Job.load(stranger / "plain.toml", [own]).check_code()
    assert Job.load(stranger / "job.toml", ["servo.law=pd"]).servo.law == "pd"
    assert Job.load(stranger / "job.toml", servo=_servo(stranger, "pid")).servo.law == ["pid", "friction"]
    with pytest.raises(InputError, match=r"^servo "):
        Job.load("an225", servo=_servo(stranger, "mine.py:pd"))
    with pytest.raises(InputError, match=r"servo\.law = shutil:rmtree: if"):
        Job.load("an225", servo=_servo(stranger, "shutil:rmtree"))


def _servo(folder, law):
    file = folder / "servo.toml"
    file.write_text(f'[servo]\nlaw = ["{law}", "friction"]\n')
    return file


def test_a_record_is_read_without_its_code_and_its_job_does_not_run(either, code, gantrysim_command, monkeypatch):
    job = Job.load(either / "job.toml", allow_code=True)
    folder = saved(either / "run", job)
    (either / "has-run").unlink()
    for name in [name for name in sys.modules if name.startswith("gantrysim_code_")]:
        monkeypatch.delitem(sys.modules, name)  # so that code that is imported again runs again
    for command in (("export", folder), ("render", folder, "--at", 0, "--size", "300x200")):
        assert gantrysim_command(*command)[0] == 0
    log = either / "log.csv"
    rows = zip(*(SavedRun.load(folder).run.time, *SavedRun.load(folder).run.nozzle.T), strict=True)
    log.write_text("time [s],x [mm],y [mm],z [mm]\n" + "".join(f"{','.join(map(str, row))}\n" for row in rows))
    columns = "time=time,x=x,y=y,z=z"
    assert gantrysim_command("compare", folder, "--measured", log, "--columns", columns)[0] == 0
    read = SavedRun.load(folder).job
    assert not has_run(either)
    for work in (
        read.run,
        lambda: read.margins if code is LAW else read.controller,
        lambda: read.changed({"program.loop_period": 0.02}).run(),
        lambda: read.with_overrides(["loop_period=0.02"]).run(),
        lambda: read.at_speed(10.0).run(),
        lambda: pickle.loads(pickle.dumps(read)).run(),
        lambda: Case.of(read),
    ):
        with pytest.raises(InputError) as caught:
            work()
        assert str(caught.value) == refused(either, f"job {folder / 'job.toml'}", code).replace(
            f"go to its folder, {either}", f"go to its folder, {folder}"
        )
    key, builtin, _ = code
    replaced = read.changed({key: builtin})
    assert replaced.built_servo.laws.names == ("pid",)
    assert replaced.controller.speed == read.program["speed"]
    assert not has_run(either)


def test_permission_goes_with_the_job(either):
    job = Job.load(either / "job.toml", allow_code=True)
    for same in (job.changed({"program.loop_period": 0.02}), pickle.loads(pickle.dumps(job)), Case.of(job).job()):
        same.check_code()
        assert same.built_servo.laws.names == job.built_servo.laws.names
        assert type(same.controller).__name__ == type(job.controller).__name__
