"""Studies, cases and processes that several test files ask for."""

import subprocess
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar

from gantrysim.report.document import Table
from gantrysim.study import Case, Details, Plot, Report, Study
from gantrysim.study.drawing import series
from gantrysim.study.ledger import LEDGER

SHORT = ["turns=1", "diameter=30", "thickness=5", "speed=150", "loop_period=0.05", "simulation.settle=0.05"]
PATIENCE = 60.0  # with a process that has to be seen at work [s]


def cases_of(job, values=(0.02, 0.03, 0.05, 0.08)):
    return [Case.of(job, {"program.loop_period": value}, value=value) for value in values]


class Counted:
    """Counts the cases it measures, and is interrupted before one of them."""

    def __init__(self, interrupted_at=None):
        self.seen, self.interrupted_at = [], interrupted_at

    def __call__(self, case):
        value = case.job().program["loop_period"]
        if len(self.seen) == self.interrupted_at:
            raise KeyboardInterrupt
        self.seen.append(value)
        return {"status": "ok", "third": value / 3, "pair": [value, 2 * value]}


@dataclass(frozen=True)
class Toy(Study):
    """A study in two rounds: the second starts at the largest value of the first."""

    counted: Counted = field(default_factory=Counted)
    broken: bool = False
    values: tuple = (0.3, 0.5, 0.4)
    name: ClassVar[str] = "toy"
    title: ClassVar[str] = "A toy"
    plots: ClassVar[tuple] = ("curve",)

    @property
    def measure(self):
        return self.counted

    @property
    def settings(self):
        return {"values": self.values}

    def rounds(self):
        rows = yield cases_of(self.job, self.values)
        best = max(row["third"] for row in rows) * 3
        yield cases_of(self.job, (best, best + 0.01))

    def report(self, rows):
        from matplotlib.figure import Figure

        if self.broken:
            raise ZeroDivisionError
        figure = Figure()
        figure.add_subplot().plot(*series(rows, "value", "third"))
        table = Table(["rows"], [[len(rows)]])
        plots = [Plot("curve", "The curve", "It rises.", figure)]
        return Report("How large is a third?", f"{len(rows)} rows", plots[0], table, Details(["a note"]))


def content(folder):
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def spoken(folder):
    """Rows in a folder's ledger."""
    file = folder / LEDGER
    return max(file.read_bytes().count(b"\n") - 1, 0) if file.exists() else 0


def begun(folder, rows=1):
    """A `study loop` in a process group of its own that has finished some rows."""
    settings = [part for setting in SHORT for part in ("--set", setting)]
    command = [
        sys.executable,
        "-m",
        "gantrysim",
        "study",
        "loop",
        "an225",
        *settings,
        "--out",
        str(folder),
        "--workers",
        "2",
    ]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True)
    until = time.monotonic() + PATIENCE
    while spoken(folder) < rows:
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < until
        time.sleep(0.01)
    return process


def members(group):
    """Processes of a group that are alive."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, _, of = stat.read_text().rpartition(")")[2].split()[:3]
        except OSError:  # it has ended
            continue
        if int(of) == group and state != "Z":
            found.append(int(stat.parent.name))
    return found
