"""Run every built-in job and every study in two checkouts and compare what they write, number for number.

    python scripts/compare_checkouts.py OLD NEW

OLD and NEW are folders of checkouts that `scripts/test.sh` has set up. Records, summaries and rows must be equal to the
last bit; of a sentence its numbers. Arrays that have another name are listed in RENAMED. Exit status 1 where anything
differs.
"""

import csv
import json
import re
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

JOBS = (
    "an225",
    "an225-3d",
    "delta-arc",
    "fanuc-conical",
    "fanuc-spiral",
    "softmc-arc",
    "softmc-helical",
    "stage-outline",
)
COMMANDS = {
    **{job: ("run", job, "--no-video", "--no-report") for job in JOBS},
    "loop": ("study", "loop", "an225", "--set", "turns=1", "--set", "diameter=40"),
    "speed": ("study", "speed", "softmc-arc", "--tolerance", "100"),
    "machine": ("study", "machine", "softmc-arc", "--tolerance", "20", "--samples", "12"),
    "circle": ("study", "circle"),
    "repeat": ("study", "repeat", "softmc-arc", "--repeats", "3"),
    "tune": ("tune", "softmc-arc", "--budget", "24", "--robust", "2", "--unseen", "2"),
}
RENAMED = {"asked": "flow_demand"}
UNLIKE = {"format"}  # the version of the file's format


def written(checkout: Path, name: str, folder: Path) -> dict:
    """Run a command of a checkout; return its numbers by file and key."""
    command = [str(checkout / ".venv/bin/gantrysim"), *COMMANDS[name], "--out", str(folder)]
    subprocess.run(command, check=True, cwd=checkout, capture_output=True)
    numbers = {}
    if (folder / "run.npz").exists():
        with np.load(folder / "run.npz") as arrays:
            numbers |= {RENAMED.get(key, key): arrays[key].tolist() for key in arrays if key not in UNLIKE}
        numbers |= json.loads((folder / "summary.json").read_text())
        numbers["job.toml"] = (folder / "job.toml").read_text()
    for file in ("study.csv", "curves.csv"):
        if (folder / file).exists():
            with (folder / file).open(newline="") as stream:
                numbers[file] = list(csv.reader(stream))
    return numbers


def plain(value: object) -> object:
    """Return a value with all its digits, and the numbers alone of sentences."""
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, list):
        return [plain(item) for item in value]
    return sorted(re.findall(r"\d[\d.e+-]*", value)) if isinstance(value, str) and ": " in value else repr(value)


def main(old: Path, new: Path) -> int:
    """Compare; return the number of commands whose numbers differ."""
    differ = 0
    with tempfile.TemporaryDirectory() as scratch:
        for name in COMMANDS:
            before, after = (written(place, name, Path(scratch) / f"{name}-{i}") for i, place in enumerate((old, new)))
            unlike = [key for key in {**before, **after} if plain(before.get(key)) != plain(after.get(key))]
            print(f"{name}: {f'differs in {unlike}' if unlike else f'{len(before)} entries equal'}", flush=True)
            differ += bool(unlike)
    return differ


if __name__ == "__main__":
    sys.exit(bool(main(*(Path(folder).absolute() for folder in sys.argv[1:3]))))
