"""The start of the command: signals that arrive while its modules are imported, and Python without docstrings."""

import os
import signal
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import pytest

from gantrysim.base import signals
from gantrysim.cli.start import last_words

from support.soaked import suite_runs
from support.studies import SHORT

COMMANDS = {
    "script": [str(Path(sys.executable).with_name("gantrysim")), "info", "machines"],
    "module": [sys.executable, "-m", "gantrysim", "info", "machines"],
}
# raises a signal in this process when a module is imported
SITE = """
import os
import sys


class Raised:
    def find_spec(self, name, path=None, target=None):
        if name == os.environ["RAISED_AT"]:
            import signal

            sys.meta_path.remove(self)
            signal.raise_signal(int(os.environ["RAISED"]))


sys.meta_path.insert(0, Raised())
"""


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
@pytest.mark.parametrize(("command", "number"), [("script", signal.SIGINT), ("module", signal.SIGTERM)])
@pytest.mark.parametrize(
    "module", ["lazy_loader", "gantrysim.cli.start", "gantrysim.cli.main", "numpy", "datetime", "typer", "pydantic"]
)
def test_a_signal_during_an_import_ends_the_command_without_a_traceback(tmp_path, command, number, module):
    (tmp_path / "sitecustomize.py").write_text(SITE)
    environment = {**os.environ, "PYTHONPATH": str(tmp_path), "RAISED_AT": module, "RAISED": str(int(number))}
    done = subprocess.run(COMMANDS[command], env=environment, capture_output=True, text=True, cwd=tmp_path)
    said = (done.returncode, done.stdout, done.stderr)
    early = (-number, "", "")
    assert said in (early, (128 + number, "", "interrupted: nothing is written\n"))
    assert (said == early) == (module in ("lazy_loader", "gantrysim.cli.start"))


def test_the_package_leaves_the_signals_of_a_program_that_imports_it():
    code = "import signal, gantrysim; print(signal.getsignal(signal.SIGINT) is signal.default_int_handler)"
    for arguments in ([], ["gantrysim"], ["-m", "gantrysim"]):
        done = subprocess.run([sys.executable, "-c", code, *arguments], capture_output=True, text=True, check=True)
        assert done.stdout == "True\n"


@pytest.mark.parametrize(
    ("level", "arguments", "is_told"),
    suite_runs([("1", ("info", "keys"), False), ("2", ("run", "--help"), True)], 1),
)
def test_without_docstrings_the_command_states_why_descriptions_are_missing(level, arguments, is_told):
    said = "descriptions of commands and keys are missing: Python drops them under PYTHONOPTIMIZE=2 and -OO\n"
    command = [*COMMANDS["module"][:3], *arguments]
    environment = {**os.environ, "PYTHONOPTIMIZE": level}
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, said if is_told else "")
    assert "servo.law" in done.stdout or "Usage" in done.stdout


@pytest.mark.parametrize(
    "arguments", suite_runs([["info", "machines"], ["study", "repeat", "an225", "--repeats", "2", "--workers", "2"]], 0)
)
def test_neither_the_command_nor_its_workers_import_from_the_working_folder(tmp_path, arguments):
    trap = f"open({str(tmp_path / 'imported')!r}, 'a').write(__name__)\nraise SystemExit\n"
    for name in ("numpy", "joblib", "cloudpickle", "matplotlib", "mujoco", "typer", "scipy", "json"):
        (tmp_path / f"{name}.py").write_text(trap)
    if arguments[0] == "study":
        arguments = [*arguments, *(word for setting in SHORT for word in ("--set", setting)), "--out", "out"]
    done = subprocess.run([COMMANDS["script"][0], *arguments], cwd=tmp_path, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    assert not (tmp_path / "imported").exists()


def chained(*errors):
    """The first error, with each of the others as what it was raised from."""
    for error, cause in pairwise(errors):
        error.__cause__ = cause
    return errors[0]


@pytest.mark.parametrize(
    ("error", "status", "told"),
    [
        (KeyboardInterrupt(), 130, "interrupted: nothing is written\n"),
        (chained(ImportError("broken"), KeyboardInterrupt()), 130, "interrupted: nothing is written\n"),
        (
            chained(ImportError("broken"), KeyError("module"), KeyboardInterrupt()),
            130,
            "interrupted: nothing is written\n",
        ),
        (RuntimeError("invalid MUJOCO_GL: glfw"), 2, "error: MUJOCO_GL = glfw: must be egl, osmesa, off or unset\n"),
        (RuntimeError("invalid: glfw"), None, "RuntimeError: invalid: glfw\n"),
        (ValueError("MUJOCO_GL: glfw"), None, "ValueError: MUJOCO_GL: glfw\n"),
    ],
)
def test_the_last_words_are_a_line_for_what_the_user_has_done(capsys, monkeypatch, error, status, told):
    monkeypatch.setattr("gantrysim.cli.start._left", ": nothing is written")
    # those of commands that other tests have run in this process
    signals.forget()
    if status is None:
        last_words(type(error), error, None)
    else:
        with pytest.raises(SystemExit) as ended:
            last_words(type(error), error, None)
        assert ended.value.code == status
    assert capsys.readouterr().err == told
