"""What a study's workers import: nothing from the working folder, as the command itself."""

import subprocess
import sys
from pathlib import Path

import pytest

from support.studies import SHORT

COMMAND = Path(sys.executable).with_name("gantrysim")


@pytest.mark.skipif(not COMMAND.exists(), reason="needs the installed command")
def test_workers_import_nothing_from_the_working_folder(tmp_path):
    for name in ("numpy", "joblib", "scipy", "json"):
        (tmp_path / f"{name}.py").write_text("raise SystemExit('imported from the working folder')\n")
    settings = [word for setting in SHORT for word in ("--set", setting)]
    words = [COMMAND, "study", "repeat", "an225", *settings, "--repeats", "2", "--workers", "2"]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
