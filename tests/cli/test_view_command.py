"""The command gantrysim view, with a window that only records what it shows."""

import dataclasses
import shutil
import signal
import subprocess
import sys

import numpy as np
import pytest

from gantrysim import Run
from gantrysim.cli.view import view
from gantrysim.job.job import Job
from gantrysim.metrics.analysis import Analysis
from gantrysim.render.view.source import STIFFNESS
from gantrysim.render.view.window import WindowClosedError

from support.views import write_run


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    return write_run(tmp_path_factory.mktemp("run"))


@pytest.fixture
def no_display(monkeypatch):
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)


@pytest.fixture
def display(monkeypatch):
    """A display that is there."""
    monkeypatch.setattr("gantrysim.render.view.window.check_display", lambda: None)


def test_nothing_is_simulated_without_a_display(saved, no_display, monkeypatch, gantrysim_command):
    monkeypatch.setattr(Job, "load", lambda *_: pytest.fail("a job was loaded"))
    monkeypatch.setattr("gantrysim.report.folder.SavedRun.load", lambda *_: pytest.fail("a run was loaded"))
    for shown in ("an225", saved):
        status, out, err = gantrysim_command("view", shown)
        assert (status, out) == (2, "")
        assert err.count("\n") == 1
        assert "gantrysim render" in err


@pytest.mark.parametrize("setting", [["--set", "speed=50"], ["--model", "xy"]])
def test_a_saved_run_cannot_be_changed(saved, gantrysim_command, setting):
    status, _, err = gantrysim_command("view", saved, *setting)
    assert status == 2
    said = "a saved run cannot be changed; --model and --set apply to live jobs only"
    assert " ".join(err.split()) == f"error: run {saved}: {said}"


def test_zero_speed_is_refused(gantrysim_command):
    assert gantrysim_command("view", "an225", "--speed", "0")[::2] == (2, "error: speed = 0: must be greater than 0\n")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["no-such-job"], "unknown job 'no-such-job'"),
        (["an225", "--camera", "behind"], "unknown camera 'behind'"),
        (["an225", "--colour", "red"], "unknown colour 'red'"),
        (["{folder}"], "holds no run"),
    ],
)
def test_bad_input_opens_no_window(display, arguments, said, tmp_path, monkeypatch, gantrysim_command):
    monkeypatch.setattr("gantrysim.render.view.window.open_window", lambda *_: pytest.fail("a window was opened"))
    status, _, err = gantrysim_command("view", *[text.format(folder=tmp_path) for text in arguments])
    assert status == 2
    assert said in err


def test_a_run_in_a_folder_with_the_name_of_a_job_is_replayed(display, saved, tmp_path, monkeypatch):
    seen = []
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("gantrysim.cli.view._replay", lambda *_: seen.append("replay"))
    monkeypatch.setattr("gantrysim.cli.view._live", lambda *_: seen.append("live"))
    (tmp_path / "an225").mkdir()
    view("an225")
    shutil.copy(saved / "run.npz", tmp_path / "an225")
    view("an225")
    assert seen == ["live", "replay"]


@pytest.mark.parametrize("name", ["run.npz", "video.mp4"])
def test_a_file_of_a_run_is_not_its_folder(display, saved, gantrysim_command, tmp_path, name):
    shutil.copy(saved / "run.npz", tmp_path)
    (tmp_path / "video.mp4").write_bytes(b"\xff")
    status, out, err = gantrysim_command("view", tmp_path / name)
    said = f"error: run {tmp_path / name}: is a file, must be a folder that gantrysim run has written\n"
    assert (status, out, err) == (2, "", said)


def test_the_job_file_of_a_run_runs_live(display, saved, monkeypatch):
    seen = []
    monkeypatch.setattr("gantrysim.cli.view._live", lambda *_: seen.append("live"))
    view(str(saved / "job.toml"))
    assert seen == ["live"]


def test_importing_the_command_opens_no_windows_library():
    code = "import sys, gantrysim.cli.main, gantrysim.cli.view; print('glfw' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "False\n"


@pytest.fixture
def window(display, monkeypatch):
    """What the command does with its window, which is closed once it says that the run has ended."""
    seen = []

    class Window:
        def __init__(self, scene, camera):
            self.scene = scene
            seen.append(("opened", scene, camera))

        def take_pressed_keys(self):
            states = [entry[1] for entry in seen if entry[0] == "shown"]
            if states[-1:] == ["ended"] or len(states) > 2000:
                raise WindowClosedError
            return []

        def pose(self, change):
            change()

        def show(self, texts, chart):
            seen.append(("shown", texts.values[-1][1], texts))

        def pushes(self):
            return np.zeros((self.scene.model.nbody, 6))

        def close(self):
            seen.append(("closed",))

    monkeypatch.setattr("gantrysim.render.view.window.ViewerWindow", Window)
    return seen


def test_a_live_run_ends_well(saved, window, gantrysim_command):
    status, out, err = gantrysim_command("view", saved / "job.toml", "--speed", "50", "--camera", "top")
    assert (status, out, err) == (0, "", "")
    kind, scene, camera = window[0]
    assert (kind, camera) == ("opened", "top")
    assert scene.model.vis.map.stiffness == STIFFNESS
    assert window[-1] == ("closed",)
    assert window[-2][2].values[0] == ("live", "short")


def test_a_fault_of_a_live_run_is_reported(saved, window, gantrysim_command):
    arguments = ["--speed", "50", "--set", "following_error_limit=0.05", "--set", "feedforward=0", "--model", "xy"]
    status, out, err = gantrysim_command("view", saved / "job.toml", *arguments)
    assert (status, out) == (3, "")
    assert err.startswith("fault: following error on axis ")
    assert err.count("\n") == 1
    assert window[-1] == ("closed",)


@pytest.mark.parametrize("digest", [None, "another"])
def test_a_replay_warns_where_the_machine_has_changed(saved, window, gantrysim_command, tmp_path, digest):
    shutil.copy(saved / "job.toml", tmp_path)
    own = Job.load(saved / "job.toml").built_machine.digest
    dataclasses.replace(Run.load(saved / "run.npz"), machine_sha256=digest or own).save(tmp_path / "run.npz")
    status, out, err = gantrysim_command("view", tmp_path, "--speed", "50", "--colour", "error")
    assert (status, out) == (0, "")
    changed = f"note: machine xy has changed since {tmp_path} was run; its present model is shown\n"
    assert err == (changed if digest == "another" else "")
    assert window[0][1].scale.title == "contour error"
    assert window[0][1].model.vis.map.stiffness != STIFFNESS


def test_a_coloured_live_run_has_the_scale_of_the_run_to_come(saved, window, gantrysim_command):
    assert gantrysim_command("view", saved / "job.toml", "--speed", "50", "--colour", "error")[0] == 0
    scale = window[0][1].scale
    error = 1e3 * Analysis(Job.load(saved / "job.toml").run()).nozzle.distance
    assert np.percentile(error, 95) <= scale.high <= 1.2 * error.max()


def test_an_interrupt_closes_the_window(saved, window, monkeypatch, gantrysim_command):
    monkeypatch.setattr("gantrysim.render.view.player.Player.picture", lambda _: signal.raise_signal(signal.SIGINT))
    before = signal.getsignal(signal.SIGINT)
    for shown in (saved, saved / "job.toml"):
        assert gantrysim_command("view", shown) == (130, "", "interrupted\n")
        assert window[-1] == ("closed",)
    assert signal.getsignal(signal.SIGINT) is before
