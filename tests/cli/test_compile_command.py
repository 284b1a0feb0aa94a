"""`gantrysim compile`: after it, a run compiles nothing."""

import os
import re
import subprocess
import sys

import pytest

RUN = """
import sys
from gantrysim.base.jit import count_compiled
from gantrysim.cli.main import main
try:
    main()
except SystemExit as stop:
    print(stop.code or 0, count_compiled())
"""


def test_what_is_compiled_needs_no_second_time(gantrysim_command):
    status, text, errors = gantrysim_command("compile", "an225")
    assert (status, errors) == (0, "")
    assert re.fullmatch(r"(\d+ functions compiled|nothing to compile): runs of an225 are ready\n", text)
    assert gantrysim_command("compile") == (0, "nothing to compile: runs of an225 are ready\n", "")


def test_an_unknown_job_is_refused(gantrysim_command):
    status, _, errors = gantrysim_command("compile", "an225", "an226")
    assert status == 2
    assert "an226" in errors


def test_without_a_folder_nothing_is_compiled(gantrysim_command, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", "compiled")
    status, _, errors = gantrysim_command("compile")
    assert status == 2
    assert errors == "error: folder of compiled functions compiled/gantrysim: must be an absolute path\n"


@pytest.mark.soak
def test_a_first_run_compiles_nothing_after_it(tmp_path):
    """With causes, improvements, plots and page; without it, the same run compiles about a hundred functions."""
    run = ("run", "an225", "--no-video", "--out", "out")

    def counts(*arguments, folder):
        environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / folder)}
        command = [sys.executable, "-c", RUN, *arguments]
        (tmp_path / "work").mkdir(exist_ok=True)
        done = subprocess.run(
            command, cwd=tmp_path / "work", env=environment, capture_output=True, text=True, check=True
        )
        status, count = done.stdout.split()[-2:]
        assert status == "0"
        return int(count)

    assert counts("compile", "an225", folder="ahead") > 50
    assert counts(*run, folder="ahead") == 0
    assert counts(*run, folder="empty") > 50
