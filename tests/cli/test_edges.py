"""Input at the edges: home folders that do not exist, extreme numbers, deep nesting, other people's settings."""

import json
import subprocess
import sys
import tracemalloc

import numpy as np
import pytest

from gantrysim import InputError, Job, Machine, Run
from gantrysim.base.input_files import read_text
from gantrysim.cli import study, terminal
from gantrysim.report.document import Table
from gantrysim.report.plots.style import sheet

from support.soaked import suite_runs
from support.studies import SHORT

QUICK = [*(word for setting in SHORT for word in ("--set", setting)), "--no-video", "--no-report", "--no-improve"]
# runs commands in this process, each to the exit status 0
IN_TURN = """
import json
import sys

from gantrysim.cli.start import main

for words in json.loads(sys.argv[1]):
    sys.argv[1:] = words
    try:
        main()
    except SystemExit as stop:
        if stop.code:
            raise
"""
LINES = {
    "job in a home": (["check", "~nobody-here/x.toml"], "~nobody-here/x.toml: no such home folder"),
    "output in a home": (["run", "an225", "--out", "~nobody-here/x"], "~nobody-here/x: no such home folder"),
    "machine in a home": (["check", "an225", "--machine", "~nobody-here/x.xml"], "no such home folder"),
    "long period": (["check", "an225", "--set", "servo.period=1e308"], "servo period = 1e+308 s: must be at most 1 s"),
    "large gain": (["check", "an225", "--set", "servo.kp=1e308"], "kp = 1e+308: must be at most 1e+18"),
    "deep list": (["check", "an225", "--set", f"kp={'[' * 5000}{']' * 5000}"], "is nested too deeply"),
    "backend": (
        ["study", "loop", "an225", "--backend", "multiprocessing"],
        "--backend multiprocessing: gives no results before all are there; use loky, threading, sequential or dask",
    ),
}


@pytest.mark.parametrize(("arguments", "line"), LINES.values(), ids=LINES.keys())
def test_bad_input_is_one_line_and_status_2(gantrysim_command, tmp_path, monkeypatch, arguments, line):
    monkeypatch.chdir(tmp_path)
    status, _, errors = gantrysim_command(*arguments)
    assert status == 2
    assert errors.startswith("error: ")
    assert line in errors
    assert errors.count("\n") == 1
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


def test_a_deeply_nested_job_file_is_refused(gantrysim_command, tmp_path):
    file = tmp_path / "deep.toml"
    file.write_text(f"x = {'[' * 5000}{']' * 5000}\n")
    status, _, errors = gantrysim_command("check", file)
    assert status == 2
    assert "is nested too deeply" in errors


KEYS = (
    "speed",
    "diameter",
    "thickness",
    "loop_period",
    "acceleration",
    "servo.damping",
    "frequency",
    "flow",
    "gap",
    "cell",
)


@pytest.mark.parametrize("key", KEYS)
@pytest.mark.parametrize("value", suite_runs(["1e308", "-1e308", "1e-308", "nan", "inf"], 0, 3))
def test_extreme_numbers_never_end_in_a_traceback(gantrysim_command, key, value):
    status, _, errors = gantrysim_command("check", "an225", "--set", f"{key}={value}")
    assert status in (0, 2)
    assert (status == 0) is (not errors)


def test_a_users_matplotlibrc_does_not_change_the_plots():
    import matplotlib

    def drawn():
        with sheet(3.0, 2.0) as figure:
            figure.add_subplot().plot([0, 1], [0, 1])
            figure.canvas.draw()
            return np.asarray(figure.canvas.buffer_rgba()).copy()

    plain = drawn()
    foreign = {"font.size": 30, "axes.facecolor": "red", "text.usetex": True, "lines.linewidth": 9}
    with matplotlib.rc_context(foreign):
        assert np.array_equal(drawn(), plain)


@pytest.mark.parametrize("columns", [20, 60, 400])
def test_no_number_of_a_study_is_cut_in_a_narrow_terminal(monkeypatch, capsys, columns):
    heads = [f"quantity {k} of many" for k in range(12)]
    rows = [[f"{1000 * a + k + 0.125:.3f}" for k in range(12)] for a in range(3)]
    monkeypatch.setenv("COLUMNS", str(columns))
    terminal.show(study._terminal_table(Table(heads, rows)))
    shown = capsys.readouterr().out
    words = shown.split()
    for row in rows:
        assert [word for word in words if word in row] == row
    assert words.count("quantity") == 12


@pytest.mark.soak
def test_the_command_works_where_python_drops_docstrings(tmp_path):
    """One process for all, as Python compiles most of its libraries anew there."""
    words = ["run", "an225", *QUICK, "--no-causes", "--out", "out"]
    commands = [["info", "servo.damping"], ["info", "keys"], ["info", "gains"], words]
    command = [sys.executable, "-OO", "-c", IN_TURN, json.dumps(commands)]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    said = "descriptions of commands and keys are missing: Python drops them under PYTHONOPTIMIZE=2 and -OO\n"
    assert (done.returncode, done.stderr) == (0, 3 * said)
    assert (tmp_path / "out" / "summary.json").exists()


@pytest.mark.parametrize("name", ["a\0b", "a\0b.toml", "a\0b.ngc"])
def test_a_path_with_a_zero_character_is_one_line(name):
    said = r"^'a\\x00b.*': has a zero character, which no path can have$"
    with pytest.raises(InputError, match=said):
        Job.load(name)
    with pytest.raises(InputError, match=r"has a zero character"):
        Run.load(name)
    with pytest.raises(InputError, match=r"has a zero character"):
        Machine(name)


def test_a_small_file_takes_little_memory(tmp_path):
    """Where the address space is limited, and a file could be long."""
    file = tmp_path / "a.txt"
    file.write_text("x" * 400)
    tracemalloc.start()
    try:
        assert read_text(file) == "x" * 400
        assert tracemalloc.get_traced_memory()[1] < 1 << 22
    finally:
        tracemalloc.stop()
