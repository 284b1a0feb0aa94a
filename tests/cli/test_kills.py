"""Commands that are killed at any moment: their files are those of the earlier result or of the new one, and whole."""

import csv
import json
import os
import random
import shutil
import signal
import subprocess
import time
import tomllib
from pathlib import Path

import pytest
from PIL import Image

from gantrysim import Run
from gantrysim.base.files import SWAP, complete
from gantrysim.study.ledger import LEDGER

from support.kills import KILLS, Commands
from support.studies import PATIENCE, SHORT, content

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="kills copies of a process")

SETTINGS = [word for setting in SHORT for word in ("--set", setting)]
REPEAT = ("study", "repeat", "an225", *SETTINGS)
TUNE = ("--budget", "12", "--robust", "1", "--unseen", "1", *SETTINGS)
# arguments of the earlier result, of the new one, and of both
COMMANDS = {
    "run": (
        ("--set", "feedforward=0.5"),
        (),
        ("run", "an225", *SETTINGS, "--no-video", "--no-report", "--no-causes", "--no-improve"),
    ),
    "report": (("--no-report",), (), ("run", "an225", *SETTINGS, "--no-video", "--no-causes", "--no-improve")),
    "video": (("--no-video",), ("--no-report",), ("run", "an225", *SETTINGS, "--no-causes", "--no-improve")),
    "study": (
        ("--set", "feedforward=0.5"),
        (),
        ("study", "repeat", "an225", *SETTINGS, "--repeats", "6", "--workers", "2"),
    ),
    "alone": (
        ("--set", "feedforward=0.5"),
        (),
        ("study", "repeat", "an225", *SETTINGS, "--repeats", "3", "--workers", "1"),
    ),
    "tune": (("--seed", "1"), ("--seed", "2"), ("tune", "an225", *TUNE, "--workers", "2")),
    "render": (("--fps", "2"), ("--fps", "3"), ("render", "--size", "300x200")),
}

RECORDED = ("job.toml", "run.npz", "summary.json")


@pytest.fixture(scope="module")
def commands():
    with Commands() as run:
        yield run


def shown(folder):
    """Files that a user sees."""
    return {name: text for name, text in content(folder).items() if not name.startswith(".")} if folder.exists() else {}


def check_files(folder):
    """Every file can be read to its end."""
    readers = {
        ".toml": lambda file: tomllib.loads(file.read_text()),
        ".json": lambda file: json.loads(file.read_text()),
        ".npz": Run.load,
        ".png": lambda file: Image.open(file).load(),
        ".csv": lambda file: len({len(row) for row in csv.reader(file.read_text().splitlines())}) == 1,
        ".html": lambda file: file.read_text().rstrip().endswith("</html>"),
        ".mp4": check_film,
    }
    for name in shown(folder):
        assert readers[Path(name).suffix](folder / name) is not False


def check_film(file):
    from imageio_ffmpeg import get_ffmpeg_exe

    done = subprocess.run([get_ffmpeg_exe(), "-v", "error", "-i", file, "-f", "null", "-"], capture_output=True)
    assert (done.returncode, done.stderr) == (0, b"")


class Killed:
    """A command and its results before and after, in a folder of its own.

    Attributes:
        old, new: files of the earlier result and of the new one, by name.
        complete: those of the new one once its run is complete.
        seen: how often the command touches the folder.
        takes: how long it takes [s].
        longest: how long it took to end after a signal, at most [s].
    """

    def __init__(self, commands, kind, folder):
        self.commands, self.kind, self.folder = commands, kind, folder / "out"
        earlier, new, both = COMMANDS[kind]
        place = ("--out", self.folder)
        if kind == "render":
            assert commands([*COMMANDS["run"][2], "--out", self.folder], self.folder)[0] == 0
            place = (self.folder,)
        self.longest = 0.0
        self.arguments = (*both, *new, *place)
        status, _, _, said = commands([*both, *earlier, *place], self.folder)
        assert status == 0, said
        self.old = content(self.folder)
        shutil.copytree(self.folder, folder / "old")
        began = time.monotonic()
        status, self.seen, _, said = commands(self.arguments, self.folder)
        assert status == 0, said
        self.takes = time.monotonic() - began
        check_files(self.folder)
        self.new = content(self.folder)
        # what a run writes before it shows anything
        is_run = kind in ("run", "report", "video")
        self.complete = {name: text for name, text in self.new.items() if not is_run or name in RECORDED}
        assert set(self.new) | set(self.old) == set(shown(self.folder)) | set(self.old)  # nothing hidden is left
        assert self.old != self.new

    def __call__(self, number, at=None, after=None, *, empty=False, resume=True):
        """Kill the command, check what is left, and run it to its end."""
        shutil.rmtree(self.folder, ignore_errors=True)
        old = {} if empty and self.kind != "render" else self.old
        if old:
            shutil.copytree(self.folder.parent / "old", self.folder)
        status, _, ending, said = self.commands(self.arguments, self.folder, at, after, number)
        what = f"{self.kind} {number.name} at={at} after={after} empty={empty}: status {status}\n{said}"
        left = shown(self.folder)
        assert "Traceback" not in said, what
        assert status in (0, -number, 128 + number), what
        assert not (number == signal.SIGKILL and status > 0), what
        if number != signal.SIGKILL:
            self.longest = max(self.longest, ending)
            assert not (self.folder / SWAP).exists(), what
            hidden = set(content(self.folder)) - set(left) if self.folder.exists() else set()
            assert hidden <= {LEDGER}, what
            if "nothing is written" in said or "are kept" in said:
                assert left == old, what
            if "record and summary are" in said:
                assert left == self.complete, what
            elif status == 0:
                assert left == self.new, what
            elif "complete" in said:  # of a run record and summary take their places first
                assert left in (self.complete, self.new), what
        if (self.folder / SWAP).exists():
            assert left.items() <= old.items() or left.items() <= self.new.items(), what
            complete(self.folder, "here")
            assert shown(self.folder) in (old, self.complete, self.new), what
        else:
            assert left in (old, self.complete, self.new), what
        if resume:
            status, _, _, said = self.commands(self.arguments, self.folder)
            assert status == 0, what + said
            assert content(self.folder) == self.new, what  # byte for byte, and nothing hidden


def test_a_few_kills(commands, tmp_path):
    killed = Killed(commands, "run", tmp_path)
    for back, number in ((12, KILLS[0]), (8, KILLS[1])):
        killed(number, killed.seen - back, resume=back == 12)


@pytest.mark.soak
@pytest.mark.parametrize(
    ("kind", "count"),
    [("run", 80), ("report", 25), ("video", 15), ("study", 25), ("alone", 20), ("tune", 15), ("render", 20)],
)
def test_many_kills(commands, kind, count, tmp_path, record_property):
    killed = Killed(commands, kind, tmp_path)
    chance = random.Random(kind)
    for k in range(count):
        injected = k % 2 == 0
        # most accesses are at the end, where files take their place
        at = chance.randrange(killed.seen) if injected else None
        after = None if injected else chance.uniform(0, killed.takes)
        killed(chance.choice(KILLS), at, after, empty=k % 5 == 4, resume=killed.takes < 3 or k % 3 == 0)
    assert killed.longest < PATIENCE
    record_property("attack", "commands that write, killed (INT, TERM, HUP, KILL) at any time and at any file access")
    record_property("tries", count)
