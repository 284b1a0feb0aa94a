"""The command: its output, files, messages and exit statuses."""

import contextlib
import ctypes
import dataclasses
import io
import json
import math
import os
import re
import shutil
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image
from rich.console import Console
from typer.core import TyperCommand, TyperGroup

import gantrysim
from gantrysim import Fault, Job, Run, metrics
from gantrysim.base.files import PARTIAL, held_folder, replaced_file
from gantrysim.base.signals import ENDING
from gantrysim.cli.main import main
from gantrysim.cli.start import last_words
from gantrysim.cli.tables import outcome_table
from gantrysim.cli.terminal import interruptible
from gantrysim.job.loading import builtin_jobs
from gantrysim.metrics.budget import LINKS, Budget
from gantrysim.report.folder import SavedRun
from gantrysim.report.plots import pictures
from gantrysim.report.summary import summary
from gantrysim.results.quantities import ERROR_GROUP
from gantrysim.results.run_results import RunResults

from support.runs import turn, turntable
from support.soaked import suite_runs
from support.studies import PATIENCE

SHORT = [
    "--set",
    "diameter=40",
    "--set",
    "turns=2",
    "--set",
    "thickness=5",
    "--no-video",
    "--no-causes",
    "--no-improve",
]
QUICK = [*SHORT, "--no-report"]


@pytest.fixture(scope="module")
def run_with_report(tmp_path_factory):
    """A run with plots and report: its folder, and what the command printed."""
    out = tmp_path_factory.mktemp("reported") / "deep" / "out"
    printed = io.StringIO()
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(printed):
        patch.setattr(sys, "argv", ["gantrysim", "run", "an225", "--out", str(out), "-v", *SHORT])
        with pytest.raises(SystemExit) as ended:
            main()
    assert not ended.value.code
    return out, printed.getvalue()


@pytest.fixture
def reported(run_with_report):
    """The folder of a run with plots and report."""
    return run_with_report[0]


def test_a_run_writes_job_record_plots_and_summary(run_with_report):
    out, printed = run_with_report
    assert sorted(p.name for p in out.iterdir()) == [
        "card.png",
        "job.toml",
        "plots",
        "report.html",
        "run.npz",
        "summary.json",
    ]
    drawn = ["bead.png", "budget.png", "error.png", "plan.png", "spacing.png"]
    assert sorted(p.name for p in (out / "plots").iterdir()) == drawn
    assert sorted(p.name for p in out.parent.iterdir()) == ["out"]  # no scratch folder is left
    links = (*LINKS, "by x", "contour")
    outcome = ("following error x", "requested 5", "path speed", "end point", "Contour error: ")
    bead = ("bead width", "gap between turns", "coverage", "missing at start", "excess at stop", "volume error")
    assert printed.splitlines()[-1] == str(out / "report.html")
    for word in (*links, "largest contour error at t = ", *outcome, *bead):
        assert word in printed


def test_the_summary_has_the_documented_keys_and_the_values_of_the_record(gantrysim_command, tmp_path):
    gantrysim_command("run", "an225", "--out", tmp_path, *QUICK)
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert " ".join(summary) == (
        "verdict job machine error_budget causes glue_causes errors motion servo bead unstable_axes notes fault "
        "injected headline spoilt changes sections versions"
    )
    errors = summary["errors"]
    motion = summary["motion"]
    run = Run.load(tmp_path / "run.npz")
    values = metrics.values(run)
    written = summary["error_budget"]
    assert list(written) == [*LINKS, "contour", "servo_by_axis", "turns"]
    assert sum(written[link]["share_percent"] for link in LINKS) == pytest.approx(100)
    part = Budget(metrics.Analysis(run)).values.parts["servo"]
    assert [written["servo"][f"{name}_um"] for name in ("rms", "p95", "max")] == pytest.approx(
        [1e3 * part.rms, 1e3 * part.p95, 1e3 * part.max]
    )
    assert written["servo"]["at_max"] == {"s_mm": part.s, "time_s": part.time, "point_mm": list(part.point)}
    assert list(written["servo_by_axis"]) == ["x", "y"]
    assert [turn["turn"] for turn in written["turns"]] == [1, 2]
    assert written["turns"][0]["program"]["rms_um"] > written["turns"][0]["structure"]["rms_um"]
    assert summary["job"] == "an225"
    assert summary["machine"] == "xy"
    assert motion["requested_spacing_mm"] == 5.0
    assert errors["contour_max_um"] == pytest.approx(1e3 * values.contour.max)
    assert motion["spacing_std_mm"] == pytest.approx(values.spacing.std)
    assert [motion[f"end_{name}_mm"] for name in "xyz"] == pytest.approx(run.nozzle[-1].tolist())
    assert motion["duration_s"] == pytest.approx(run.time[run.dispense][-1])
    assert summary["causes"] is None
    assert summary["fault"] is None
    assert summary["versions"]["gantrysim"] == gantrysim.__version__


def test_causes_are_found_by_default(gantrysim_command, tmp_path):
    quick = [word for word in QUICK if word != "--no-causes"]
    status, printed, _ = gantrysim_command("run", "an225", "--out", tmp_path, "-v", *quick)
    assert status == 0
    summary = json.loads((tmp_path / "summary.json").read_text())
    causes = summary["causes"]
    assert re.search(
        r"\. [\d.]+ of [\d.]+ µm due to program \([\w ]+\); without it [\d.]+ µm are left\.$",
        summary["headline"],
    )
    path, glue = summary["spoilt"]
    assert path.startswith("Path: ")
    assert f"{path} {glue}" in " ".join(printed.split())
    assert list(causes) == ["program", "sampling", "counts", "friction", "winding", "compliance"]
    assert causes["program"]["without"]["program"]["max_um"] < 1e-6
    lines = [line.split() for line in printed.splitlines()]
    rows = {name: cells for name, *cells in filter(None, lines) if cells and re.match(r"[−\d]", cells[0])}
    for name, effect in causes.items():
        without, worth = effect["without"], effect["worth"]["contour"]["rms_um"]
        shown = [without["contour"]["rms_um"], without["contour"]["max_um"], worth]
        shown += [without[link]["rms_um"] for link in LINKS]
        cells = [float(cell.replace("−", "-")) for cell in rows[name][: len(shown)]]
        assert cells == pytest.approx(shown, abs=0.051)
    assert "Effects do not add up" in " ".join(printed.split())


def test_a_run_that_ends_in_a_fault_has_no_causes(gantrysim_command, tmp_path):
    faulty = ["--set", "following_error_limit=0.01", "--causes"]
    status, printed, _ = gantrysim_command("run", "an225", "--out", tmp_path, *QUICK, *faulty)
    assert status == 3
    assert "causes skipped: the run ended in a fault" in printed
    assert json.loads((tmp_path / "summary.json").read_text())["causes"] is None


def test_the_written_job_repeats_the_run_to_the_last_bit(gantrysim_command, tmp_path):
    bare = ["--no-video", "--no-report", "--no-causes", "--no-improve"]
    gantrysim_command("run", "an225", "--out", tmp_path / "a", *QUICK, "--set", "loop_period=0.07")
    status, _, _ = gantrysim_command("run", tmp_path / "a" / "job.toml", "--out", tmp_path / "b", *bare)
    assert status == 0
    first, second = Run.load(tmp_path / "a" / "run.npz"), Run.load(tmp_path / "b" / "run.npz")
    for name in ("commanded", "encoder", "nozzle", "demand", "current", "flow"):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))
    assert (tmp_path / "a" / "job.toml").read_text() == (tmp_path / "b" / "job.toml").read_text()


def test_a_run_replaces_the_files_of_an_earlier_one(gantrysim_command, reported, tmp_path):
    shutil.copytree(reported, tmp_path, dirs_exist_ok=True)
    assert (tmp_path / "plots" / "spacing.png").exists()
    (tmp_path / "video.mp4").write_bytes(b"of the earlier run")
    (tmp_path / "notes.txt").write_text("mine")
    gantrysim_command("run", "an225", "--out", tmp_path, *SHORT, "--set", "turns=1")  # has no neighbouring turns
    assert not (tmp_path / "video.mp4").exists()
    assert sorted(p.name for p in (tmp_path / "plots").iterdir()) == ["bead.png", "budget.png", "error.png", "plan.png"]
    assert json.loads((tmp_path / "summary.json").read_text())["motion"]["spacing_mean_mm"] is None
    assert (tmp_path / "notes.txt").read_text() == "mine"


def test_plots_are_not_blank(reported):
    for plot in ("plan", "error", "budget", "spacing", "bead"):
        picture = np.asarray(Image.open(reported / "plots" / f"{plot}.png").convert("RGB"), float)
        assert min(picture.shape[:2]) > 500
        drawn = picture.min(axis=2) < 150  # not the paper, nor the grid
        assert 0.005 < drawn.mean() < 0.5


def test_a_run_without_report_removes_the_plots_of_an_earlier_one(gantrysim_command, reported, tmp_path):
    shutil.copytree(reported, tmp_path, dirs_exist_ok=True)
    assert (tmp_path / "plots" / "plan.png").exists()
    gantrysim_command("run", "an225", "--out", tmp_path, *QUICK)
    assert sorted(item.name for item in tmp_path.iterdir()) == ["job.toml", "run.npz", "summary.json"]


def test_another_machine_by_name_and_by_file(gantrysim_command, tmp_path, rigid):
    gantrysim_command("run", "an225", "--out", tmp_path / "a", *QUICK, "--model", "xyz")
    assert json.loads((tmp_path / "a" / "summary.json").read_text())["machine"] == "xyz"
    source = rigid().source
    gantrysim_command("run", "an225", "--out", tmp_path / "b", *QUICK, "--model", source)
    assert json.loads((tmp_path / "b" / "summary.json").read_text())["machine"] == "rigid"
    assert Job.load(tmp_path / "b" / "job.toml").machine == str(source)


def test_a_fault_is_reported_recorded_and_has_its_own_exit_status(gantrysim_command, tmp_path):
    status, _, errors = gantrysim_command(
        "run", "an225", "--out", tmp_path, *QUICK, "--set", "frequency=300", "--set", "allow_unstable=true"
    )
    assert status == 3
    fault = json.loads((tmp_path / "summary.json").read_text())["fault"]
    assert fault["axis"] in ("x", "y")
    assert 0 < fault["time"] < 2
    assert f"fault: {fault['text']}" in errors.replace("\n", " ")


def test_errors_up_to_a_fault_are_evaluated_where_glue_was_laid(gantrysim_command, tmp_path):
    options = ("--set", "following_error_limit=0.05", "--no-report", "--no-video")
    status, output, errors = gantrysim_command("run", "fanuc-spiral", *options, "--out", tmp_path / "out")
    assert status == 3
    assert "following error" in errors
    assert "the dispenser was on" not in output
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["error_budget"] is not None


def test_a_fault_before_the_dispenser_is_on_is_recorded_too(gantrysim_command, tmp_path):
    out = tmp_path / "out"
    status, output, errors = gantrysim_command("run", "fanuc-spiral", "--set", "torque_limit=0.02", "--out", out)
    assert status == 3
    assert errors.startswith("fault: ")
    assert " on axis y at t = 0." in errors
    verdict, *_ = output.splitlines()
    assert verdict.startswith("verdict ✗ fail")
    assert "there are no errors to evaluate" in output
    assert sorted(path.name for path in out.iterdir()) == ["job.toml", "run.npz", "summary.json"]
    written = json.loads((out / "summary.json").read_text())
    assert written["error_budget"] is None
    assert written["fault"]["text"] in errors
    assert written["headline"].startswith(f"Fault: {written['fault']['text']}. The dispenser was never on")
    assert Run.load(out / "run.npz").time.size > 1


BAD = {
    "inner diameter below zero": (["--set", "turns=9"], "inner_diameter = -60 mm"),
    "NaN": (["--set", "speed=nan"], "speed = nan mm/s: must be finite"),
    "zero turns": (["--set", "turns=0"], "turns = 0: must be at least 1"),
    "speed above the limit": (
        ["--set", "speed=3000", "--set", "acceleration=inf"],
        "must be at most 1000 mm/s, the limit of machine xy",
    ),
    "path outside the travel": (["--set", "start=[100.0, 0.0]"], "must lie in the travel -150 to 150 mm of machine xy"),
    "unknown model": (["--model", "yx"], "unknown model 'yx': did you mean xy"),
    "unknown key": (["--set", "thicknes=3"], "unknown key 'thicknes': did you mean program.thickness"),
    "missing file": (["--model", "none/such.xml"], "none/such.xml: no such file"),
}


@pytest.mark.parametrize(("arguments", "text"), BAD.values(), ids=BAD.keys())
def test_bad_input_is_one_line_and_exit_status_2_and_writes_nothing(gantrysim_command, tmp_path, arguments, text):
    out = tmp_path / "out"
    status, printed, errors = gantrysim_command("run", "an225", "--out", out, "--no-video", *arguments)
    assert status == 2
    assert printed == ""
    assert errors.startswith("error: ")
    assert text in errors
    assert errors.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_bad_job_and_bad_mjcf_and_bad_folder(gantrysim_command, tmp_path, rigid):
    status, _, errors = gantrysim_command("run", "an226")
    assert (status, errors) == (
        2,
        f"error: unknown job 'an226': did you mean an225? known: {', '.join(builtin_jobs())}\n",
    )
    source = rigid().source
    source.write_text(source.read_text().replace('name="nozzle"', 'name="tip"'))
    status, _, errors = gantrysim_command("run", "an225", "--model", source, "--out", tmp_path / "out")
    assert status == 2
    assert "has no site named 'nozzle'; it has: tip" in errors
    (tmp_path / "file").write_text("")
    status, _, errors = gantrysim_command("run", "an225", "--out", tmp_path / "file", *SHORT)
    assert status == 2
    assert "is a file, must be a folder" in errors


def test_the_installed_command_from_another_folder(tmp_path):
    """In a process of its own: no traceback, and the right status and streams."""
    command = [sys.executable, "-m", "gantrysim", "run", "an225", "--set", "turns=-1"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr == "error: job an225: turns = -1: must be at least 1\n"
    version = subprocess.run([*command[:3], "--version"], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert version.stdout.strip() == gantrysim.__version__


@pytest.mark.parametrize(
    ("arguments", "text"),
    [(["run", "--sped", "3"], "error: No such option: --sped"), (["runn"], "error: No such command 'runn'")],
)
def test_an_unknown_command_or_option_is_one_line(gantrysim_command, arguments, text):
    status, printed, errors = gantrysim_command(*arguments)
    assert status == 2
    assert printed == ""
    assert errors.startswith(text)
    assert errors.count("\n") == 1


def test_without_arguments_the_command_shows_its_help(gantrysim_command):
    status, printed, _ = gantrysim_command()
    assert status == 0
    assert "run" in printed


def test_a_run_interrupted_while_it_simulates_writes_nothing(gantrysim_command, tmp_path, monkeypatch):
    def interrupted(*arguments, **keywords):
        signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr("gantrysim.job.job.Job.run", interrupted)
    before = signal.getsignal(signal.SIGINT)
    status, printed, errors = gantrysim_command("run", "an225", "--out", tmp_path / "out", *SHORT)
    assert (status, printed, errors) == (130, "", "interrupted: nothing is written\n")
    assert not list(tmp_path.iterdir())
    assert signal.getsignal(signal.SIGINT) is before


@pytest.mark.parametrize("place", ["gantrysim.cli.evaluation.show_verdict", "gantrysim.report.plots.save_plots"])
def test_a_run_interrupted_once_it_is_complete_keeps_record_and_summary(
    gantrysim_command, reported, tmp_path, monkeypatch, place
):
    """Before the first table, and while what is drawn is written; files of an earlier run do not stay beside them."""

    def interrupted(*arguments, **keywords):
        signal.raise_signal(signal.SIGINT)

    out = tmp_path / "out"
    shutil.copytree(reported, out)
    assert (out / "report.html").exists()
    assert "feedforward = 1.0" in (out / "job.toml").read_text()
    monkeypatch.setattr(place, interrupted)
    status, printed, errors = gantrysim_command("run", "an225", "--out", out, *SHORT, "--set", "feedforward=0.5")
    assert status == 130
    assert errors == f"interrupted: the run is complete, what is known of it is in {out}/\n"
    assert "written to" not in printed
    assert sorted(item.name for item in out.iterdir()) == ["job.toml", "run.npz", "summary.json"]
    assert "feedforward = 0.5" in (out / "job.toml").read_text()
    assert SavedRun.load(out).run.dispense.any()


@pytest.mark.parametrize("number", ENDING)
def test_an_interrupt_that_became_another_error_ends_the_run(gantrysim_command, tmp_path, monkeypatch, number):
    """ctypes raises an error of its own when the conversion of an argument is interrupted, as in calls of OpenGL."""

    class Argument:
        @classmethod
        def from_param(cls, value):
            signal.raise_signal(number)

    function = ctypes.PYFUNCTYPE(None, Argument)(lambda _: None)
    monkeypatch.setattr("gantrysim.render.save_video", lambda *_, **__: function(1))
    arguments = [word for word in QUICK if word != "--no-video"]
    status, _, errors = gantrysim_command("run", "an225", "--out", tmp_path / "out", *arguments)
    said = f"interrupted: the run is complete, what is known of it is in {tmp_path / 'out'}/\n"
    assert (status, errors) == (128 + number, said)


def test_a_lost_interrupt_ends_the_next_step(gantrysim_command, tmp_path, monkeypatch):
    def lost(sections, folder, progress):
        with contextlib.suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        progress(0.5)
        pytest.fail("went on")

    monkeypatch.setattr("gantrysim.report.figures.figures_ahead", lost)
    assert gantrysim_command("run", "an225", "--out", tmp_path / "out", *SHORT)[0] == 130


@pytest.mark.parametrize(
    ("kind", "command"),
    [
        (TyperGroup, ["--version"]),
        (TyperCommand, ["run", "an225", *SHORT]),
        (TyperCommand, ["study", "loop", "an225"]),
    ],
)
def test_an_interrupt_that_would_be_lost_while_arguments_are_read_ends_the_command(
    gantrysim_command, tmp_path, monkeypatch, kind, command
):
    """As pydantic loses it, with which typer reads a path."""
    read = kind.parse_args

    def lost(*arguments):
        with contextlib.suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        return read(*arguments)

    monkeypatch.setattr(kind, "parse_args", lost)
    monkeypatch.chdir(tmp_path)
    assert gantrysim_command(*command) == (130, "", "interrupted\n")
    assert not list(tmp_path.iterdir())


def test_an_interrupt_lost_in_a_finaliser_is_not_reported_and_other_errors_are(monkeypatch):
    reported = []
    monkeypatch.setattr(sys, "unraisablehook", lambda lost: reported.append(lost.exc_type))

    class Final:
        def __init__(self, leave):
            self.leave = leave

        def __del__(self):
            self.leave()

    def interrupted():
        with interruptible():
            Final(lambda: 1 / 0)
            Final(lambda: signal.raise_signal(signal.SIGINT))
            time.sleep(PATIENCE)  # nothing asks for a pending interrupt
            pytest.fail("went on")

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    Final(lambda: 1 / 0)
    assert reported == [ZeroDivisionError, ZeroDivisionError]


def test_other_errors_are_raised_unchanged(gantrysim_command, tmp_path, monkeypatch):
    def broken(*_, **__):
        raise ctypes.ArgumentError("argument 1")

    monkeypatch.setattr("gantrysim.cli.evaluation.write_run", broken)
    with pytest.raises(ctypes.ArgumentError, match="argument 1"):
        gantrysim_command("run", "an225", "--out", tmp_path / "out", *SHORT)


def test_every_command_reports_an_interrupt(gantrysim_command, monkeypatch):
    def interrupted():
        raise KeyboardInterrupt

    monkeypatch.setattr("gantrysim.cli.info.overview_table", interrupted)
    assert gantrysim_command("info") == (130, "", "interrupted\n")


@pytest.mark.parametrize("number", ENDING)
def test_an_interrupt_while_modules_are_imported_is_one_line(tmp_path, number):
    """A module that is imported early sends the signal, so that the test does not depend on timing."""
    (tmp_path / "rich.py").write_text(f"import os, signal, time\nos.kill(os.getpid(), {number.value})\ntime.sleep(9)\n")
    done = subprocess.run(
        [sys.executable, "-m", "gantrysim", "info"],
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), *sys.path])},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )
    assert (done.returncode, done.stdout, done.stderr) == (128 + number, "", "interrupted: nothing is written\n")


@pytest.mark.soak
def test_an_invalid_mujoco_gl_is_one_line():
    environment = {**os.environ, "MUJOCO_GL": "foo"}
    command = [sys.executable, "-m", "gantrysim", "info"]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    text = "error: MUJOCO_GL = foo: must be egl, osmesa, off or unset\n"
    assert (done.returncode, done.stdout, done.stderr) == (2, "", text)
    program = subprocess.run(
        [sys.executable, "-c", "import gantrysim; gantrysim.Machine"],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert program.stderr.startswith("Traceback")  # a program keeps the traceback


def test_other_errors_keep_their_traceback(capsys):
    error = RuntimeError("another")
    last_words(RuntimeError, error, None)
    assert capsys.readouterr().err == "RuntimeError: another\n"
    error.__cause__ = ImportError("numpy")
    error.__cause__.__context__ = KeyboardInterrupt()
    with pytest.raises(SystemExit, match="130"):
        last_words(RuntimeError, error, None)


@pytest.mark.parametrize("option", ["--version", "--help"])
def test_version_and_help_import_no_simulation(option):
    """The command answers at once: what takes long to import is imported by the commands that need it."""
    code = f"""
import sys
import time
from gantrysim.cli.start import main
sys.argv[1:] = [{option!r}]
try:
    main()
except SystemExit:
    print([name for name in ("gymnasium", "matplotlib", "mujoco", "numba", "scipy") if name in sys.modules])
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"


def test_the_help_shows_brackets(gantrysim_command, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    assert "table [servo] of values that replace" in " ".join(gantrysim_command("run", "--help")[1].split())


def test_files_of_the_user_are_neither_overwritten_nor_removed(gantrysim_command, tmp_path, monkeypatch):
    (tmp_path / "job.toml").write_text("# mine\n" + Job.load("an225", ["diameter=40", "turns=2", "thickness=5"]).toml())
    monkeypatch.chdir(tmp_path)
    status, _, errors = gantrysim_command(
        "run", "job.toml", "--out", ".", "--no-video", "--no-report", "--no-causes", "--no-improve"
    )
    assert status == 2
    assert "--out .: holds job.toml, which no run has written" in errors
    assert (tmp_path / "job.toml").read_text().startswith("# mine")
    out = tmp_path / "out"
    (out / "plots").mkdir(parents=True)
    (out / "plots" / "my-own.png").write_bytes(b"mine")
    for _ in range(2):
        assert (
            gantrysim_command(
                "run", "job.toml", "--out", out, "--no-video", "--no-report", "--no-causes", "--no-improve"
            )[0]
            == 0
        )
    assert (out / "plots" / "my-own.png").read_bytes() == b"mine"
    assert sorted(item.name for item in out.iterdir()) == ["job.toml", "plots", "run.npz", "summary.json"]


def test_partial_files_of_killed_runs_are_removed_and_those_of_active_ones_stay(gantrysim_command, tmp_path):
    left = tmp_path / f"{PARTIAL}ab"
    left.mkdir()
    (left / "run.npz").write_bytes(b"half of it")
    with replaced_file(tmp_path / "mine.png") as active:
        active.write_bytes(b"mine")
        assert gantrysim_command("run", "an225", "--out", tmp_path, *QUICK)[0] == 0
        assert not left.exists()
    assert (tmp_path / "mine.png").read_bytes() == b"mine"


def test_a_plot_that_fails_costs_nothing_else(gantrysim_command, tmp_path, monkeypatch):
    save = Figure.savefig

    def broken(figure, file, **options):
        if getattr(file, "name", "") == "error.png":
            raise ValueError("no\nnumbers")
        save(figure, file, **options)

    monkeypatch.setattr(Figure, "savefig", broken)
    status, printed, errors = gantrysim_command("run", "an225", "--out", tmp_path, *SHORT)
    assert (status, errors) == (1, "error: no plot: error.png: ValueError: no numbers\n")
    assert "Contour error: " in printed
    assert sorted(p.name for p in tmp_path.iterdir()) == [
        "card.png",
        "job.toml",
        "plots",
        "report.html",
        "run.npz",
        "summary.json",
    ]
    assert sorted(p.stem for p in (tmp_path / "plots").iterdir()) == ["bead", "budget", "plan", "spacing"]


def test_a_drawing_that_fails_costs_its_plot_and_the_page(gantrysim_command, tmp_path, monkeypatch):
    def broken(*_, **__):
        raise ValueError("no numbers")

    monkeypatch.setattr(pictures, "draw_error", broken)
    status, _, errors = gantrysim_command("run", "an225", "--out", tmp_path, *SHORT)
    sentences = ("no plot: error.png: ValueError: no numbers", "no report: ValueError: no numbers")
    assert (status, errors) == (1, "".join(f"error: {sentence}\n" for sentence in sentences))
    assert sorted(p.stem for p in (tmp_path / "plots").iterdir()) == ["bead", "budget", "plan", "spacing"]


@pytest.mark.parametrize("place", suite_runs(["bead_section", "draw_page"], 0))
def test_a_page_that_fails_costs_nothing_else(gantrysim_command, tmp_path, monkeypatch, place):
    def broken(*_, **__):
        raise ValueError("no numbers")

    monkeypatch.setattr(f"gantrysim.report.page.{place}", broken)
    status, _, errors = gantrysim_command("run", "an225", "--out", tmp_path, *SHORT, "--set", "turns=1")
    assert (status, errors) == (1, "error: no report: ValueError: no numbers\n")
    assert len(list((tmp_path / "plots").iterdir())) == 4


def test_without_an_encoder_a_run_lacks_its_video_alone(gantrysim_command, tmp_path, monkeypatch):
    monkeypatch.setenv("IMAGEIO_FFMPEG_EXE", str(tmp_path / "ffmpeg"))
    arguments = [word for word in SHORT if word != "--no-video"]
    status, _, errors = gantrysim_command("run", "an225", "--out", tmp_path / "out", *arguments, "--no-report")
    said = f"no encoder: {tmp_path}/ffmpeg cannot be run: reinstall imageio-ffmpeg or unset IMAGEIO_FFMPEG_EXE\n"
    assert (status, errors) == (0, f"no video: {said}")
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == ["job.toml", "run.npz", "summary.json"]
    assert gantrysim_command("render", tmp_path / "out", "--size", "300x200") == (2, "", f"error: {said}")
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == ["job.toml", "run.npz", "summary.json"]


def test_of_two_runs_into_one_folder_the_second_is_refused(gantrysim_command, tmp_path):
    with held_folder(tmp_path, "here"):
        status, printed, errors = gantrysim_command("run", "an225", "--out", tmp_path, *QUICK)
    assert (status, printed, errors) == (2, "", f"error: --out {tmp_path}: in use by another command\n")
    assert not list(tmp_path.iterdir())


def test_what_stands_in_the_way_of_a_run_is_named_before_it_begins(gantrysim_command, tmp_path, monkeypatch):
    monkeypatch.setattr(Job, "run", lambda *_: pytest.fail("begun"))
    (tmp_path / "run.npz" / "mine").mkdir(parents=True)
    status, _, errors = gantrysim_command("run", "an225", "--out", tmp_path, *QUICK)
    said = f"error: --out {tmp_path}: run.npz in it is a folder, must be a file: move it away\n"
    assert (status, errors) == (2, said)
    assert [item.name for item in tmp_path.iterdir()] == ["run.npz"]


def test_names_with_markup_are_printed_as_they_are(gantrysim_command, tmp_path):
    folder = tmp_path / "o[red]x"
    status, printed, _ = gantrysim_command("run", "an225", "--out", folder, *QUICK)
    assert status == 0
    assert "o[red]x/: job.toml, run.npz, summary.json" in printed


@pytest.mark.soak
def test_a_machine_without_cameras_gets_a_video(gantrysim_command, tmp_path, rigid):
    arguments = [*(word for word in QUICK if word != "--no-video"), "--set", "turns=1", "--set", "speed=200"]
    status, _, errors = gantrysim_command(
        "run", "an225", "--out", tmp_path / "out", "--model", rigid().source, *arguments
    )
    assert (status, errors) == (0, "")
    assert (tmp_path / "out" / "video.mp4").stat().st_size > 1000


def test_a_fault_without_finite_numbers_is_written_as_null(tmp_path):
    run = Job.load("an225", ["diameter=40", "turns=1"]).run()
    faulted = dataclasses.replace(run, fault=Fault("diverged", "x", 0.1, math.nan, math.inf, "mm"))
    job = Job.load("an225")
    written = summary(RunResults(job, job.built_machine, Budget(metrics.Analysis(faulted))))
    assert written["fault"] == {
        "kind": "diverged",
        "axis": "x",
        "time": 0.1,
        "value": None,
        "limit": None,
        "unit": "mm",
        "reaction": "",
        "text": str(faulted.fault),
    }
    json.dumps(written, allow_nan=False)


def test_a_write_error_is_one_line(gantrysim_command, tmp_path, monkeypatch):
    def full(*arguments, **keywords):
        raise OSError(28, "No space left on device", "run.npz")

    monkeypatch.setattr(Run, "save", full)
    status, _, errors = gantrysim_command("run", "an225", "--out", tmp_path / "a" / "b", *SHORT)
    assert (status, errors) == (2, "error: file run.npz: cannot be written: No space left on device\n")
    assert not list(tmp_path.iterdir())


def test_errors_of_rotary_axes_are_in_thousandths_of_a_degree(tmp_path, capsys):
    machine = turntable(tmp_path)
    run = turn(machine, 90.0)
    budget = Budget(metrics.Analysis(run))
    values = budget.analysis.values
    error = 1e3 * (run.commanded - run.encoder)
    assert values.following["th"].max == pytest.approx(1e-3 * np.abs(error[:, 0]).max())
    job = Job.load("an225")
    written = ERROR_GROUP.contents(RunResults(job, machine, budget))
    assert written["following_th_max_mdeg"] == pytest.approx(np.abs(error[:, 0]).max())
    assert "following_x_max_um" in written
    Console().print(outcome_table(budget.analysis, None, None))
    printed = capsys.readouterr().out
    rms, largest = np.sqrt(np.mean(error[:, 0] ** 2)), np.abs(error[:, 0]).max()
    assert f"{rms:.1f} mdeg" in printed
    assert f"{largest:.1f} mdeg" in printed
    assert printed.count("mdeg") == 2


@pytest.mark.parametrize(
    ("words", "error"),
    [
        (("gains", "an225", "--export", "trio", "--from", "trio", "x.bas"), "--export and --from: must be one of them"),
        (("info", "an225", "--model", "xy"), "'an225': give either NAME or --model"),
        (("improve", "an225", "--apply", "job.txt"), "--apply job.txt: must end in .toml, as a job file does"),
        (
            ("improve", "an225", "--apply", "own.toml"),
            "--apply own.toml: exists and is not a job file; give another name",
        ),
        (
            ("improve", "an225", "--apply", "bad.toml"),
            "--apply bad.toml: exists and is not a job file; give another name",
        ),
    ],
)
def test_options_that_contradict_are_refused_before_anything_runs(
    gantrysim_command, tmp_path, monkeypatch, words, error
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "own.toml").write_text("name = 'something else'\n")
    (tmp_path / "bad.toml").write_text("name = \n")
    assert gantrysim_command(*words) == (2, "", f"error: {error}\n")
    assert {file.name for file in tmp_path.iterdir()} == {"own.toml", "bad.toml"}


@pytest.mark.parametrize("error", [ValueError("MUJOCO_GL"), OSError("MUJOCO_GL: foo")])
def test_an_error_of_another_kind_that_names_the_variable_keeps_its_traceback(capsys, error):
    last_words(type(error), error, None)
    assert capsys.readouterr().err == f"{type(error).__name__}: {error}\n"
    invalid = RuntimeError("invalid value for environment variable MUJOCO_GL: foo")
    with pytest.raises(SystemExit, match="2"):
        last_words(RuntimeError, invalid, None)
    assert capsys.readouterr().err == "error: MUJOCO_GL = foo: must be egl, osmesa, off or unset\n"
