"""The commands `gantrysim tune` and `gantrysim run --servo`, in this process and interrupted in one of their own."""

import os
import re
import shlex
import signal
import subprocess
import sys
import time
import tomllib

import pytest

from gantrysim import InputError, Job
from gantrysim.cli.tune import write_words
from gantrysim.study.ledger import LEDGER
from gantrysim.study.tuning.servo import TUNED

from support.studies import PATIENCE, content, spoken
from support.tunings import circle, detuned

SMALL = ("--budget", 24, "--robust", 1, "--guards", 2, "--unseen", 2, "--workers", 1)
FEW = ("--budget", 16, "--robust", 1, "--guards", 2, "--unseen", 0)


@pytest.fixture
def file(tmp_path):
    """The file of a job with gains ten times too low."""
    path = tmp_path / "poor.toml"
    path.write_text(detuned(0.1).toml())
    return path


def test_a_tuned_job_runs_with_the_tuned_servo(gantrysim_command, tmp_path, file, monkeypatch):
    monkeypatch.chdir(tmp_path)
    status, output, said = gantrysim_command("tune", file, *SMALL)
    assert status == 0
    assert said == ""
    out = " ".join(output.split())
    assert out.startswith("Which gains minimise the rms contour error? Run with --servo tuned.toml: the rms contour")
    assert out.endswith("page: out/tune-circle/report.html")
    notes = tomllib.loads((tmp_path / "out" / "tune-circle" / "study.toml").read_text())["findings"]
    searched = "Nelder-Mead over kp, ki, kd, velocity_ff, acceleration_ff, one factor for all axes, seed 1: "
    assert any(note.startswith(searched) for note in notes)
    tuned = tmp_path / "out" / "tune-circle" / TUNED
    run = ("run", file, "--servo", tuned, "--no-video", "--no-report", "--no-causes", "--no-improve", "--out")
    status, _, said = gantrysim_command(*run, tmp_path / "a")
    assert (status, said) == (0, "")
    table = tomllib.loads(tuned.read_text())["servo"]
    job = Job.load(tmp_path / "a" / "job.toml")  # holds the servo, so that it can be run again
    assert all(dict(job.servo)[name] == value for name, value in table.items())
    status, _, _ = gantrysim_command(
        "run", tmp_path / "a" / "job.toml", "--no-video", "--no-report", "--no-causes", "--no-improve", "--out", "b"
    )
    assert status == 0
    assert (tmp_path / "b" / "summary.json").read_bytes() == (tmp_path / "a" / "summary.json").read_bytes()


@pytest.mark.soak
def test_another_search_with_other_settings_replaces_the_folder(gantrysim_command, tmp_path, file):
    few = ("--budget", 4, "--robust", 0, "--unseen", 1, "--workers", 1, "--out", tmp_path / "a")
    assert gantrysim_command("tune", file, *few)[0] == 0
    first = content(tmp_path / "a")
    few = (*few[:5], 0, *few[6:])
    overrides = (
        "--set",
        "servo.kp=[0.1, 0.2]",
        "--model",
        "xy",
        "--law",
        "pd",
        "--figure",
        "contour_max",
        "--per-axis",
    )
    status, output, _ = gantrysim_command("tune", file, *few, *overrides)
    assert status == 0
    assert "argest contour error, job's machine" in " ".join(output.split())
    described = tomllib.loads((tmp_path / "a" / "study.toml").read_text())["settings"]
    assert (described["law"], described["metric"], described["per_axis"]) == ("pd", "contour_max", True)
    assert Job.load(tmp_path / "a" / "job.toml").servo.kp == [0.1, 0.2]
    second = content(tmp_path / "a")
    assert set(first) - set(second) == {"plots/machines.png"}
    assert first[TUNED] != second[TUNED]


def test_tuned_gains_in_the_words_of_a_controller_are_read_back(gantrysim_command, tmp_path, file):
    out = tmp_path / "a"
    few = ("--budget", 8, "--robust", 0, "--unseen", 0, "--workers", 1, "--out", out)
    status, _, said = gantrysim_command("tune", file, *few, "--export", "trio")
    assert status == 2
    assert said.startswith("error: trio has no parameter for acceleration_ff (")
    assert not out.exists()
    sayable = ("--set", "servo.acceleration_ff=0", "--set", "servo.notch_frequency=0")
    status, output, said = gantrysim_command("tune", file, *sayable, *few, "--export", "trio")
    assert status == 0
    assert "Nelder-Mead over kp, ki, kd, velocity_ff, one factor" in (out / "study.toml").read_text()
    words = out / "tuned-trio.bas"
    assert f"written to {words}" in " ".join(output.split())
    assert "note: assumed of trio: " in said
    assert list(tomllib.loads((out / TUNED).read_text())["servo"]) == ["kp", "ki", "kd", "velocity_ff"]
    tuned = Job.load(file, sayable[1::2], servo=out / TUNED).built_servo.values()
    assert tuned["kp"] != Job.load(file).servo.kp  # it found others than those that it began with
    # the manual's unit: a demand of 2048 DAC steps is the torque limit, an error of one encoder edge the resolution
    gains = [float(one) for one in re.findall(r"^P_GAIN=(.*)$", words.read_text(), re.M)]
    for gain, kp, edge, most in zip(
        gains, *(tuned[name] for name in ("kp", "resolution", "torque_limit")), strict=True
    ):
        assert gain == pytest.approx(kp * edge * 2048 / most, rel=1e-9)
    assert tuned["acceleration_ff"] == (0, 0)
    status, _, _ = gantrysim_command("gains", file, "--from", "trio", words, "--out", tmp_path / "back.toml")
    assert status == 0
    back = tomllib.loads((tmp_path / "back.toml").read_text())["servo"]
    assert back["kp"] == pytest.approx(tuned["kp"], rel=1e-9)
    # another search leaves no words of this one
    for name, left in (("linuxcnc-ini", {TUNED, "tuned-linuxcnc-ini.ini"}), (None, {TUNED})):
        write_words(out, name)
        assert {item.name for item in out.glob("tuned*")} == left


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("--budget", 9), "budget = 9: must be at least 10, start and one candidate per machine"),
        (("--spread", "mass=1"), "unknown tolerance 'mass'"),
        (("--law", "p"), "unknown law 'p': did you mean pd? known: pd, pid"),
        (("--export", "fanuk"), "unknown controller 'fanuk': did you mean fanuc? known: fanuc, linuxcnc"),
        (("--budget", "many"), "Invalid value for '--budget'"),
    ],
)
def test_bad_input_is_a_one_line_error_and_nothing_is_written(gantrysim_command, tmp_path, file, arguments, text):
    status, output, error = gantrysim_command("tune", file, *arguments, "--out", tmp_path / "a")
    assert (status, output) == (2, "")
    assert error.startswith("error: ")
    assert text in error
    assert error.count("\n") == 1
    assert not (tmp_path / "a").exists()


def test_a_job_whose_runs_all_fault_exits_with_the_fault_status(gantrysim_command, tmp_path):
    job = circle().changed({"servo.following_error_limit": 1e-6})
    (tmp_path / "lost.toml").write_text(job.toml())
    status, output, error = gantrysim_command(
        "tune", tmp_path / "lost.toml", "--budget", 4, "--robust", 0, "--workers", 1, "--out", tmp_path / "a"
    )
    assert (status, output) == (3, "")
    assert "fault: none of the study's" in error
    assert "following error on axis" in error
    assert not (tmp_path / "a").exists()


def begun(folder, file, rows):
    """A search in a process group of its own that has finished some runs."""
    settings = [str(word) for word in FEW]
    process = subprocess.Popen(
        [sys.executable, "-m", "gantrysim", "tune", str(file), *settings, "--out", str(folder), "--workers", "2"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,
    )
    until = time.monotonic() + PATIENCE
    while spoken(folder) < rows:
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < until
        time.sleep(0.01)
    return process


@pytest.mark.soak
def test_ctrl_c_keeps_the_runs_and_the_same_command_resumes(gantrysim_command, tmp_path, file):
    folder = tmp_path / "tune"
    process = begun(folder, file, 2)
    os.killpg(process.pid, signal.SIGINT)
    output, said = (text.decode() for text in process.communicate(timeout=PATIENCE))
    assert (process.returncode, output) == (130, "")
    done = spoken(folder)
    assert done >= 2
    assert f"the rows of {done} finished cases are kept in {folder}/; run the same command again to resume" in said
    assert list(content(folder)) == [LEDGER]
    status, _, error = gantrysim_command("tune", file, *FEW, "--out", folder, "--workers", 1)
    assert status == 0
    assert f"note: resumed with the rows of {done} cases from an interrupted run" in error
    rows = (folder / "study.csv").read_text().splitlines()
    assert done < len(rows) - 1 <= 16


# gantrysim run --servo

SERVO = "[servo]\nperiod = 0.001\nkp = [0.4, 0.5]\nkd = [0.004, 0.005]\n"


def test_a_servo_file_replaces_the_loop_of_the_job_and_keeps_what_it_does_not_give(tmp_path):
    (tmp_path / "s.toml").write_text(SERVO)
    own = Job.load("fanuc-spiral")
    others = ["servo.delay=0.0005", 'servo.feedback="load"']
    (tmp_path / "job.toml").write_text(Job.load("fanuc-spiral", others).toml())
    job = Job.load(tmp_path / "job.toml", servo=tmp_path / "s.toml")
    assert (job.built_servo.delay, job.built_servo.per_axis("feedback")) == (0.0005, ("load", "load"))
    assert (own.servo.integral_time, job.servo.integral_time) == (0.03, float("inf"))
    assert job.built_servo.per_axis("kp") == (0.4, 0.5)
    assert job.built_servo.per_axis("ki") == (0.0, 0.0)
    assert job.program == own.program
    after = Job.load("fanuc-spiral", ["servo.kp=0.3"], servo=tmp_path / "s.toml")
    assert after.built_servo.per_axis("kp") == (0.3, 0.3)
    assert after.built_servo.per_axis("kd") == (0.004, 0.005)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (None, r"no such file"),
        ("kp = [", r"is not TOML: .*"),
        ("", r"has no table \[servo\]; it has: nothing"),
        ("name = 'a'\n[program]\n", r"has no table \[servo\]; it has: name, program"),
        ("servo = 3\n", r"has no table \[servo\]; it has: servo"),
        (
            "[servo]\nkpp = 1.0\n",
            r"unknown key kpp: did you mean kp\? all keys: gantrysim info keys",
        ),
        ("[servo]\nkp = 'high'\n", r"kp = 'high': .*"),
        ("[servo]\nkp = [1.0]\n", r"kp has 1 values: must be one or 2, of the axes x, y of machine xy"),
        ("[servo]\nkd = [1.0, 2.0, 3.0]\n", r"kd has 3 values: must be one or 2, of the axes x, y of machine xy"),
    ],
)
def test_an_invalid_servo_file_is_a_one_line_error(gantrysim_command, tmp_path, text, said):
    file = tmp_path / "s.toml"
    if text is not None:
        file.write_text(text)
    with pytest.raises(InputError, match=rf"^servo {file}: {said}$"):
        Job.load("fanuc-spiral", servo=file)
    status, output, error = gantrysim_command("run", "fanuc-spiral", "--servo", file, "--out", tmp_path / "a")
    assert (status, output, error.count("\n")) == (2, "", 1)
    assert error.startswith(f"error: servo {file}: ")
    assert not (tmp_path / "a").exists()


def test_a_folder_as_servo_file_cannot_be_read(tmp_path):
    with pytest.raises(InputError, match=f"^servo {tmp_path}: is a folder: must be a regular file$"):
        Job.load("an225", servo=tmp_path)


def test_gains_of_a_changed_job_are_run_with_the_job_beside_them(gantrysim_command, tmp_path, file):
    """The file of gains alone would be laid over a job that has the notch which --set takes away."""
    few = ("--budget", 2, "--robust", 0, "--unseen", 0, "--guards", 0, "--workers", 1)
    changed = ("--set", "servo.notch_frequency=0", "--set", "servo.delay=0.00025")
    status, _, said = gantrysim_command("tune", file, *few, *changed, "--out", tmp_path / "a b")
    assert status == 0, said
    job = tmp_path / "a b" / "job.toml"
    tuned = tmp_path / "a b" / TUNED
    (note,) = (line for line in said.splitlines() if line.startswith("note: tuned with the values of --set"))
    assert note.endswith(f": gantrysim run '{job}' --servo '{tuned}'")
    words = shlex.split(note.rpartition(": gantrysim run ")[2])
    servo = Job.load(words[0], servo=words[2]).built_servo
    assert set(servo.per_axis("notch_frequency")) == {0.0}
    assert servo.delay == 0.00025
    assert list(servo.per_axis("kp")) == tomllib.loads(tuned.read_text())["servo"]["kp"]
    assert "Usage: gantrysim run job.toml --servo tuned.toml" in tuned.read_text()
