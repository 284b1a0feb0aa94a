"""Standard output and error that are closed, read in part, or lead to a full disk."""

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from support.soaked import suite_runs
from support.studies import SHORT

SETTINGS = [word for setting in SHORT for word in ("--set", setting)]
RUN = ("run", "an225", *SETTINGS, "--no-video", "--no-improve", "--no-causes", "--out", "out")
ALL = {"card.png", "job.toml", "plots", "report.html", "run.npz", "summary.json"}
RECORDED = {"job.toml", "run.npz", "summary.json"}

pytestmark = pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")


def shell(folder, arguments, redirection):
    """Run the command by a shell, and return its exit status and what it prints."""
    line = f'"$@" {redirection}; exit ${{PIPESTATUS[0]}}'
    words = ["bash", "-c", line, "bash", sys.executable, "-m", "gantrysim", *arguments]
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True)
    return done.returncode, done.stdout, done.stderr


def names(folder):
    return {item.name for item in (folder / "out").iterdir()}


@pytest.mark.parametrize(
    ("redirection", "options", "written"),
    suite_runs(
        [
            ("| head -1", ("--no-report",), RECORDED),
            ("| true", ("--no-report",), RECORDED),
            (">&-", ("--no-report",), RECORDED),
            (">&- 2>&- <&-", (), ALL),
            (">&- 2>&- <&-", ("--no-report",), RECORDED),
        ],
        # the first lines alone of what is printed are read below, too
        4,
    ),
)
def test_a_closed_output_is_silence_and_all_is_written(tmp_path, redirection, options, written):
    status, printed, errors = shell(tmp_path, (*RUN, *options), redirection)
    assert (status, errors) == (0, "")
    assert printed.count("\n") == (redirection == "| head -1")
    assert names(tmp_path) == written


def test_a_full_disk_behind_the_output_is_named_and_the_run_is_kept(tmp_path):
    said = "error: standard output: cannot be written: No space left on device\n"
    assert shell(tmp_path, (*RUN, "--no-report"), ">/dev/full") == (2, "", said)
    assert names(tmp_path) == RECORDED
    assert shell(tmp_path, ("--version",), ">/dev/full") == (2, "", said)
    assert shell(tmp_path, ("info", "nosuch"), "2>/dev/full") == (2, "", "")


@pytest.mark.parametrize("arguments", suite_runs([["--help"], ["run", "--help"], ["info", "keys"]], 2))
def test_what_is_printed_may_be_read_in_part(tmp_path, arguments):
    status, printed, errors = shell(tmp_path, arguments, "| head -1")
    assert (status, printed.count("\n"), errors) == (0, 1, "")


def test_the_file_that_a_full_disk_cuts_off_is_named(tmp_path):
    line = 'ulimit -f 20; exec "$@"'
    words = ["bash", "-c", line, "bash", sys.executable, "-m", "gantrysim", *RUN]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True)
    file = tmp_path / "out" / "run.npz"
    assert (done.returncode, done.stderr) == (2, f"error: file {file}: cannot be written: File too large\n")
    assert not (tmp_path / "out").exists()


@pytest.mark.soak
def test_a_run_killed_while_it_looks_for_changes_is_kept(tmp_path):
    words = [sys.executable, "-m", "gantrysim", "run", "an225", *SETTINGS, "--no-video", "--out", "out"]
    with subprocess.Popen(words, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as process:
        assert process.stdout.readline().startswith(b"verdict")
        process.send_signal(signal.SIGKILL)
        assert names(tmp_path) >= RECORDED
    again = [sys.executable, "-m", "gantrysim", "export", "out"]
    assert subprocess.run(again, cwd=tmp_path, capture_output=True).returncode == 0
