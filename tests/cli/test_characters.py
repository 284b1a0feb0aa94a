"""Terminals, file names and homes that are not those of everyone: ASCII output, names that are no text, no home."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from gantrysim.cli import terminal

from support.studies import SHORT

ASCII = {"PYTHONIOENCODING": "ascii", "LC_ALL": "C", "COLUMNS": "100"}
SETTINGS = [word for setting in SHORT for word in ("--set", setting)]
PROGRAM = "G21 G90\nF6000 G1 X10\nX20\nM2\n"


def command(*arguments, cwd, **environment):
    return subprocess.run(
        [sys.executable, "-m", "gantrysim", *arguments],
        cwd=cwd,
        env={**os.environ, **environment},
        capture_output=True,
        timeout=300,
        check=False,
    )


@pytest.mark.parametrize(
    "arguments",
    [
        pytest.param(("info",), marks=pytest.mark.soak),
        pytest.param(("check", "an225"), marks=pytest.mark.soak),
        ("run", "an225", "--no-video", "--no-report", "--no-causes", "--no-improve", "-v", *SETTINGS),
    ],
    ids=["info", "check", "run"],
)
def test_output_in_ascii(tmp_path, arguments):
    done = command(*arguments, cwd=tmp_path, **ASCII)
    assert (done.returncode, done.stderr) == (0, b"")
    text = done.stdout.decode("ascii")  # raises for anything else
    if arguments[0] == "run":
        assert "error normal to the path [um]" in text
    assert "?" not in text.replace("[?", "")


@pytest.mark.soak
def test_bad_input_in_ascii(tmp_path):
    done = command("check", "µ.toml", cwd=tmp_path, **ASCII)
    assert done.returncode == 2
    assert done.stderr.decode("ascii").startswith("error: job u.toml: no such file; built-in jobs: ")
    assert b"Traceback" not in done.stderr


def test_characters_are_spelled_out(monkeypatch):
    terminal.spell_out()
    assert "5 µm² × 3 · 2° → 1…".encode("ascii", "gantrysim") == b"5 um2 x 3 * 2deg -> 1..."
    assert "\udcff字".encode("ascii", "gantrysim") == b"??"
    assert "a\udcffb".encode("utf-8", "gantrysim") == b"a?b"
    with pytest.raises(UnicodeDecodeError):
        b"\xff".decode("utf-8", "gantrysim")


@pytest.mark.skipif(os.name != "posix", reason="names are text there")
def test_a_program_file_whose_name_is_no_text(gantrysim_command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / os.fsdecode(b"a\xff.ngc")).write_text(PROGRAM)
    status, _, errors = gantrysim_command(
        "run", os.fsdecode(b"a\xff.ngc"), "--no-video", "--no-report", "--no-causes", "--no-improve", "--out", "o"
    )
    assert (status, errors) == (0, "")
    assert 'source = "a\N{REPLACEMENT CHARACTER}.ngc"' in (tmp_path / "o" / "job.toml").read_text()


@pytest.mark.skipif(os.name != "posix", reason="names are text there")
def test_a_machine_file_whose_name_is_no_text(gantrysim_command, tmp_path):
    status, _, errors = gantrysim_command("check", "an225", "--model", os.fsdecode(b"/m\xff.xml"))
    assert status == 2
    assert "its name must be text in UTF-8" in errors


@pytest.mark.skipif(not Path("/dev/zero").exists(), reason="there is none")
def test_a_job_without_an_end(gantrysim_command):
    status, _, errors = gantrysim_command("check", "/dev/zero")
    assert (status, errors) == (2, "error: job /dev/zero: is a device: must be a regular file\n")


def test_a_job_that_is_too_long(gantrysim_command, monkeypatch, tmp_path):
    monkeypatch.setattr("gantrysim.base.input_files._MOST_BYTES", 1 << 16)
    (tmp_path / "long.toml").write_bytes(b"#" * 70_000)
    status, _, errors = gantrysim_command("check", tmp_path / "long.toml")
    assert (status, errors) == (2, f"error: job {tmp_path}/long.toml: is longer than 6.55e+04 bytes\n")


def test_a_file_does_not_command_the_terminal(gantrysim_command, tmp_path):
    """An escape sequence in a file's text can set a terminal's title or clipboard."""
    (tmp_path / "job.toml").write_text(
        '"\\u001b]0;mine\\u0007\\u009b2J" = 1\n[program]\ncontroller = "trio.MoveSpiral"\n'
    )
    status, printed, errors = gantrysim_command("check", tmp_path / "job.toml")
    assert status == 2
    assert "\\x1b]0;mine" in errors
    assert not {"\x1b", "\x07", "\x9b"} & set(printed + errors)
