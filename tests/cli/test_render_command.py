"""The command `gantrysim render`, as used at a terminal."""

import ctypes.util
import dataclasses
import signal
import subprocess
import sys
import time

import imageio.v2 as imageio
import numpy as np
import pytest
from PIL import Image

from gantrysim import InputError, Job, Run
from gantrysim.base.files import PARTIAL
from gantrysim.cli.render import size_of
from gantrysim.render import Film, Take
from gantrysim.render.header import labels_of
from gantrysim.render.panel import run_colours
from gantrysim.report.folder import SavedRun
from gantrysim.report.plots.style import INK

from support.films import cut, saved, shows, small_job

SMALLEST = ("--size", "300x200")
LITTLE = 10_000  # less than any of these pictures and films [bytes]
QUICK = (*SMALLEST, "--fps", "4")


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    """Two saved runs, the second one shorter and with another loop."""
    folder = tmp_path_factory.mktemp("runs")
    saved(folder / "slow", small_job())
    fast = small_job("loop_period=0.02")
    saved(folder / "fast", fast, cut(fast.run(), 900))
    return folder


@pytest.fixture
def folder(kept, tmp_path):
    """The same, to be written into."""
    for name in ("slow", "fast"):
        (tmp_path / name).mkdir()
        for item in (kept / name).iterdir():
            if item.is_file():
                (tmp_path / name / item.name).write_bytes(item.read_bytes())
    return tmp_path


@pytest.fixture
def no_simulation(monkeypatch):
    def refuse(*_, **__):
        raise AssertionError("simulated")

    monkeypatch.setattr("gantrysim.job.job.simulate", refuse)
    monkeypatch.setattr("gantrysim.job.job.perfect_follower", refuse)
    monkeypatch.setattr(Job, "run", refuse)


def names(folder):
    return sorted(item.name for item in folder.iterdir())


def test_a_saved_run_becomes_a_video_without_being_run_again(gantrysim_command, folder, no_simulation):
    before = names(folder / "slow")
    status, printed, errors = gantrysim_command("render", folder / "slow", *QUICK)
    assert (status, errors) == (0, "")
    assert names(folder / "slow") == sorted([*before, "render.mp4"])
    with imageio.get_reader(folder / "slow" / "render.mp4") as reader:
        frames = [np.asarray(frame) for frame in reader]
    end = SavedRun.load(folder / "slow").run.time[-1]
    assert len(frames) == int(np.ceil(4 * end)) + 1 + 4  # and the end card
    assert frames[0].shape == (200, 300, 3)
    said = f"written to {folder}/slow/render.mp4: {len(frames)} frames, {len(frames) / 4:.1f} s"
    assert printed.splitlines() == [said]


def test_options_reach_the_film(gantrysim_command, folder):
    out = folder / "a.gif"
    status, printed, _ = gantrysim_command(
        "render", folder / "slow", "--size", "400x200", "--fps", "30", "--speed", "4", "--colour", "error",
        "--camera", "top", "--label", "my own", "--out", out,
    )  # fmt: skip
    assert status == 0
    back = SavedRun.load(folder / "slow")
    take = Take(back.machine, back.run, "my own", back.job.bead, back.run.verdict)
    with Film([take], camera="top", size=(400, 200), colour="error") as film, Image.open(out) as gif:
        last = len(film.times(100 / 3, 4)) - 1
        count = last + 1 + 33  # and the end card
        assert gif.n_frames == count
        assert gif.info["duration"] == 30
        gif.seek(last)
        shown = np.asarray(gif.convert("RGB"), float)
        assert np.abs(shown - film.frame(film.end, 4.0)).mean() < 2
    assert printed.endswith(f"{count} frames, {0.03 * count:.1f} s\n")


def test_at_draws_one_picture(gantrysim_command, folder):
    assert gantrysim_command("render", folder / "slow", *SMALLEST, "--at", "0.5")[0] == 0
    picture = np.asarray(Image.open(folder / "slow" / "render.png"))
    back = SavedRun.load(folder / "slow")
    take = Take(back.machine, back.run, "an225", back.job.bead, back.run.verdict)
    with Film([take], size=(300, 200)) as film:
        np.testing.assert_array_equal(picture, film.frame(0.5))
        status, printed, _ = gantrysim_command("render", folder / "slow", *SMALLEST, "--out", folder / "b.png")
        assert (status, printed) == (0, f"written to {folder}/b.png: picture\n")
        np.testing.assert_array_equal(np.asarray(Image.open(folder / "b.png")), film.frame(film.end))


@pytest.mark.soak
def test_two_runs_become_a_comparison_beside_their_folders(gantrysim_command, folder, no_simulation):
    runs = folder / "slow", folder / "fast"
    status, printed, errors = gantrysim_command("render", *runs, "--size", "640x320", "--at", "0.5")
    assert (status, errors) == (0, "")
    assert printed == f"written to {folder}/comparison.png: picture\n"
    picture = np.asarray(Image.open(folder / "comparison.png"))
    for text, colour in zip(("loop_period = 0.1 s", "loop_period = 0.02 s"), run_colours(2), strict=True):
        assert shows(picture[:110], text, 10, colour, bold=True)
    assert gantrysim_command("render", *runs, "--size", "480x240", "--fps", "2", "--speed", "2")[0] == 0
    with imageio.get_reader(folder / "comparison.mp4") as reader:
        assert sum(1 for _ in reader) == len(np.arange(0, SavedRun.load(runs[0]).run.time[-1], 1.0)) + 1 + 2
    assert not list(folder.glob("*/render*"))


@pytest.mark.soak
def test_a_comparison_of_the_current_folder_is_written_beside_it(gantrysim_command, folder, monkeypatch):
    monkeypatch.chdir(folder / "slow")
    arguments = ("--size", "480x240", "--at", "0.2", "--label", "one", "--label", "two")
    assert gantrysim_command("render", ".", "../fast", *arguments)[0] == 0
    picture = np.asarray(Image.open(folder / "comparison.png"))
    assert shows(picture[:110], "two", 10, run_colours(2)[1], bold=True)


def test_a_later_run_removes_what_was_drawn_of_an_earlier_one(gantrysim_command, folder):
    for name in ("render.mp4", "render.gif", "render.png", "mine.gif"):
        (folder / "slow" / name).write_bytes(b"of the earlier run")
    small = [word for setting in ("diameter=40", "turns=1", "thickness=5") for word in ("--set", setting)]
    out = ("--out", folder / "slow", "--no-video", "--no-report", "--no-causes", "--no-improve")
    assert gantrysim_command("run", "an225", *small, *out)[0] == 0
    assert names(folder / "slow") == ["job.toml", "mine.gif", "run.npz", "summary.json"]


def test_bad_input_is_one_line_and_nothing_is_written(gantrysim_command, folder, tmp_path):
    slow, fast = folder / "slow", folder / "fast"
    (tmp_path / "empty").mkdir()
    before = names(folder), names(slow)
    for arguments, text in (
        ((slow, fast, slow), "number of runs = 3: must be 1, 2 or 4"),
        ((slow,) * 5, "number of runs = 5: must be 1, 2 or 4"),
        ((slow, "--label", "a", "--label", "b"), "number of labels = 2: must be 1, one per run"),
        ((folder / "none",), f"run {folder}/none: no such folder; gantrysim run JOB --out {folder}/none makes one"),
        ((tmp_path / "empty",), f"run {tmp_path}/empty: holds no run: job.toml and run.npz missing"),
        ((slow, "--camera", "topp"), "unknown camera 'topp': did you mean top? known: "),
        ((slow, "--colour", "eror"), "unknown colour 'eror': did you mean error? known: error, plain, verdict, width"),
        ((slow, "--size", "960"), "--size 960: must be width x height in pixels, as in 960x720"),
        ((slow, "--size", "0x0"), "width of the film = 0: must be at least 1"),
        ((slow, "--size", "301x200"), "size of the video = 301 x 200: must be even numbers of pixels"),
        ((slow, "--fps", "0"), "frames per second = 0 1/s: must be greater than 0 1/s"),
        ((slow, "--speed", "-1"), "speed of the film = -1: must be greater than 0"),
        ((slow, "--at", "0.5", "--fps", "-3"), "frames per second = -3 1/s: must be greater than 0 1/s"),
        ((slow, "--at", "0.5", "--speed", "-3"), "speed of the film = -3: must be greater than 0"),
        ((slow, "--size", "9" * 5000 + "x9"), "--size 9"),
        ((slow, "--out", "a.avi"), "--out a.avi: suffix = '.avi': must be .mp4, .gif or .png"),
        ((slow, "--out", folder / "no" / "a.mp4"), f"file {folder}/no/a.mp4: no such folder {folder}/no"),
        (
            (slow, "--at", "0.5", "--out", "a.mp4"),
            "--at 0.5 (.png) and --out a.mp4 (.mp4): must ask for files of one kind; --at and --poster draw a single",
        ),
        ((slow, "--gif", "--poster"), "--gif (.gif) and --poster (.png): must ask for files of one kind"),
        ((slow, "--poster", "--at", "0.5"), "--poster with --at 0.5: the poster is the last frame"),
        ((slow, "--at", "20"), "time = 20 s: must be from 0 s to the end of the run, 1.444 s"),
        ((slow, "--fps", "many"), "Invalid value for '--fps'"),
        ((), "Missing argument 'RUN_DIR'"),
    ):
        status, printed, errors = gantrysim_command("render", *arguments)
        assert (status, printed) == (2, ""), arguments
        assert errors.startswith(f"error: {text}"), errors
        assert errors.count("\n") == 1
    assert (names(folder), names(slow)) == before


@pytest.mark.soak
def test_the_poster_is_the_last_frame_and_a_gif_a_film(gantrysim_command, folder):
    status, printed, _ = gantrysim_command("render", folder / "slow", *SMALLEST, "--poster")
    assert (status, printed) == (0, f"written to {folder}/slow/render.png: picture\n")
    back = SavedRun.load(folder / "slow")
    take = Take(back.machine, back.run, "an225", back.job.bead, back.run.verdict)
    with Film([take], size=(300, 200)) as film:
        np.testing.assert_array_equal(np.asarray(Image.open(folder / "slow" / "render.png")), film.frame(film.end))
    assert gantrysim_command("render", folder / "slow", *SMALLEST, "--gif", "--fps", "2")[0] == 0
    with Image.open(folder / "slow" / "render.gif") as gif:
        assert gif.n_frames > 2


def test_without_opengl_the_packages_are_named(gantrysim_command, folder, monkeypatch):
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    find = ctypes.util.find_library
    monkeypatch.setattr(ctypes.util, "find_library", lambda name: None if name in ("EGL", "OSMesa") else find(name))
    before = names(folder / "slow")
    status, printed, errors = gantrysim_command("render", folder / "slow")
    assert (status, printed) == (2, "")
    assert errors.startswith("error: no offscreen OpenGL")
    assert "libegl1" in errors
    assert errors.count("\n") == 1
    assert names(folder / "slow") == before


def test_a_changed_machine_is_reported(gantrysim_command, folder):
    record = folder / "slow" / "run.npz"
    dataclasses.replace(Run.load(record), machine_sha256="0").save(record)
    status, _, errors = gantrysim_command("render", folder / "slow", *SMALLEST, "--at", "0.1")
    assert status == 0
    assert errors == f"note: machine xy has changed since {folder}/slow was run\n"


def test_an_interrupt_leaves_what_was_there(folder):
    (folder / "slow" / "render.mp4").write_bytes(b"earlier")
    before = names(folder / "slow")
    arguments = [sys.executable, "-m", "gantrysim", "render", str(folder / "slow"), "--speed", "0.02", *SMALLEST]
    process = subprocess.Popen(arguments, stderr=subprocess.PIPE, text=True, preexec_fn=_heed_interrupts)
    while not list((folder / "slow").glob(f"{PARTIAL}*/*")):
        assert process.poll() is None
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 130
    assert errors == "interrupted: nothing is written; the earlier render.mp4 is kept\n"
    assert names(folder / "slow") == before
    assert (folder / "slow" / "render.mp4").read_bytes() == b"earlier"


@pytest.mark.parametrize(
    "arguments",
    [("--out", "a.mp4"), pytest.param(("--out", "a.gif"), marks=pytest.mark.soak), ("--at", "1", "--out", "a.png")],
)
def test_a_full_disk_is_reported_with_file_and_reason(gantrysim_command, folder, monkeypatch, arguments):
    """A bound on the size of files fails as a full disk does, in the words of another errno; a film lacks frames."""
    resource = pytest.importorskip("resource")
    before = names(folder), names(folder / "slow")
    size = SMALLEST if "--at" in arguments else QUICK
    monkeypatch.chdir(folder)
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (LITTLE, limits[1]))
    try:
        status, _, said = gantrysim_command("render", "slow", *size, *arguments)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert status == 2
    assert said.startswith(f"error: file {arguments[-1]}: cannot be written: "), said
    assert said.endswith(("File too large\n", "MB are free\n"))
    assert said.count("\n") == 1
    assert (names(folder), names(folder / "slow")) == before


def _heed_interrupts():
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.mark.parametrize("arguments", [("--fps", "2"), ("--at", "0.1")])
def test_a_film_is_not_put_beside_a_later_run(gantrysim_command, folder, monkeypatch, arguments):
    record = Run.load(folder / "slow" / "run.npz")
    monkeypatch.setattr(Film, "__enter__", lambda film: (record.save(folder / "slow" / "run.npz"), film)[1])
    status, printed, errors = gantrysim_command("render", folder / "slow", *SMALLEST, *arguments)
    said = f"error: run {folder}/slow: has been run again meanwhile: render it again\n"
    assert (status, printed, errors) == (2, "", said)
    assert not [name for name in names(folder / "slow") if "render" in str(name)]


def test_a_later_run_removes_the_files_of_a_killed_process(gantrysim_command, folder):
    left = folder / "slow" / f"{PARTIAL}xyz"
    left.mkdir()
    (left / "render.mp4").write_bytes(b"half")
    small = [word for setting in ("diameter=40", "turns=1", "thickness=5") for word in ("--set", setting)]
    gantrysim_command(
        "run", "an225", *small, "--out", folder / "slow", "--no-video", "--no-report", "--no-causes", "--no-improve"
    )
    assert not left.exists()


def test_the_video_of_a_run_is_headed_by_its_job(gantrysim_command, tmp_path, monkeypatch):
    seen = {}
    monkeypatch.setattr("gantrysim.render.save_video", lambda machine, run, file, **named: seen.update(named))
    small = [word for setting in ("diameter=40", "turns=1", "thickness=5") for word in ("--set", setting)]
    gantrysim_command("run", "an225", *small, "--out", tmp_path, "--no-report", "--no-causes", "--no-improve")
    assert seen["label"] == "an225"


def test_sizes_are_read():
    assert size_of("960x720") == size_of(" 960×720 ") == (960, 720)
    for text in ("960", "x720", "960x", "9.5x7", "-1x10", "960 720"):
        with pytest.raises(InputError, match=r"must be width x height in pixels, as in 960x720"):
            size_of(text)


def labelled(*jobs, folders=None):
    """Labels of runs of these jobs; what the machine did makes no difference."""

    class Kept:
        def __init__(self, job, folder):
            self.job, self.folder = job, folder

    from pathlib import Path

    folders = folders or [f"out/run-{k}" for k in range(len(jobs))]
    return labels_of([Kept(job, Path(folder)) for job, folder in zip(jobs, folders, strict=True)])


def test_runs_are_labelled_by_the_values_in_which_their_jobs_differ():
    base = Job.load("an225")
    assert labelled(base) == ["an225"]

    def against(*settings):
        return labelled(base, base.with_overrides(settings))

    assert against("loop_period=1.0") == ["loop_period = 0.1 s", "loop_period = 1 s"]
    assert against("feedforward=0") == ["feedforward = 1", "feedforward = 0"]
    assert against("servo.period=0.0005") == ["period = 0.001 s", "period = 0.0005 s"]
    assert against("servo.frequency=12") == ["frequency = default", "frequency = 12 Hz"]
    assert against("servo.integral_time=inf") == ["integral_time = 0.03 s", "integral_time = inf s"]
    assert against("dispenser.flow=100") == ["flow = 200 mm³/s", "flow = 100 mm³/s"]
    assert against("bead.contact_angle=45") == ["contact_angle = 60 deg", "contact_angle = 45 deg"]
    assert against("simulation.settle=0.5") == ["settle = 0.25 s", "settle = 0.5 s"]
    assert against("clockwise=false") == ["clockwise = true", "clockwise = false"]
    assert against("machine=xyz") == ["machine = xy", "machine = xyz"]
    assert against("name=other") == ["run-0", "run-1"]
    assert against("speed=50", "turns=3") == ["turns = 4, speed = 100 mm/s", "turns = 3, speed = 50 mm/s"]
    # one word for two keys says the keys in full
    assert against("servo.period=0.0005", "servo.damping=0.9", "speed=50") == [
        "speed = 100 mm/s, period = 0.001 s, damping = 1",
        "speed = 50 mm/s, period = 0.0005 s, damping = 0.9",
    ]
    # more than can be read is counted
    assert against("speed=50", "turns=3", "diameter=100", "feedforward=0") == [
        "diameter = 120 mm, turns = 4, speed = 100 mm/s, 1 more",
        "diameter = 100 mm, turns = 3, speed = 50 mm/s, 1 more",
    ]
    four = [base.with_overrides([f"loop_period={period}"]) for period in (1.0, 0.3, 0.1, 0.01)]
    assert labelled(*four) == [f"loop_period = {period} s" for period in ("1", "0.3", "0.1", "0.01")]


def test_parts_of_a_program_have_their_units_and_ambiguous_keys_are_given_in_full():
    base = Job.load("softmc-arc")
    assert labelled(base, base.with_overrides(["program.group.velocity=120"]))[1] == "velocity = 120 mm/s"
    recorded = base.changed({"program.record": {"points": 10, "gap": 2, "what": ["PCMD"]}})
    other = recorded.with_overrides(["program.record.gap=4", "bead.gap=0.4"])
    assert labelled(recorded, other)[1] == "program.record.gap = 4, bead.gap = 0.4 mm"


def test_runs_with_long_differences_are_labelled_by_their_folders():
    base = Job.load("fanuc-spiral")
    other = base.changed({"program.program": str(base.program["program"]).replace("F6000", "F5000")})
    assert labelled(base, other) == ["run-0", "run-1"]
    slower = other.with_overrides(["dispenser.flow=100"])
    assert [label.rpartition(", ")[2] for label in labelled(base, slower)] == ["1 more"] * 2
    assert labelled(base, base, folders=["a/out", "b/out"]) == ["a/out", "b/out"]
    assert labelled(base, base, folders=["a", "../b"]) == ["a", "b"]


def test_the_picture_names_the_job(gantrysim_command, folder):
    gantrysim_command("render", folder / "slow", "--size", "480x360", "--at", "0.3")
    picture = np.asarray(Image.open(folder / "slow" / "render.png"))
    assert shows(picture[:66], "an225", 10, INK, bold=True)
