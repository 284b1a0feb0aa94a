"""What a stranger does first, in fresh processes that have imported nothing of gantrysim before."""

import dataclasses
import os
import re
import shlex
import shutil
from pathlib import Path

import numpy as np
import pytest

from gantrysim import Job, Machine, Servo, simulate
from gantrysim.controllers.trio import Basic
from gantrysim.identify.log import Log
from gantrysim.identify.plan import excitation
from gantrysim.job.loading import builtin_jobs
from gantrysim.record.setpoints import Setpoints

from support.doc_pages import run_in_turn
from support.soaked import suite_runs

ROOT = Path(__file__).parent.parent
PAGE = (ROOT / "docs" / "command.md").read_text(encoding="utf-8")

TICKS = 200
LOADED = """
import sys
import gantrysim as gs
run = gs.Run.load(sys.argv[1])
print(type(run.requested).__name__, repr(run.requested.length), len(run.time), run.machine, *run.injected)
"""


@pytest.mark.parametrize("name", suite_runs(builtin_jobs(), 6))
def test_a_record_of_every_built_in_job_is_loaded(fresh, tmp_path, name):
    job = Job.load(name)
    record = job.follow()
    short = {
        field.name: getattr(record, field.name)[:TICKS]
        for field in dataclasses.fields(record)
        if hasattr(getattr(record, field.name), "shape")
    }
    dataclasses.replace(record, **short).save(tmp_path / "run.npz")
    done = fresh.run(LOADED, tmp_path, tmp_path / "run.npz")
    path = record.requested
    assert done.error == ""
    assert done.output.split() == [type(path).__name__, repr(path.length), str(TICKS), record.machine]


PACKAGE = ROOT / "gantrysim"
MODULES = sorted(
    ".".join(file.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
    for file in PACKAGE.rglob("*.py")
    if file.stem != "__main__"
)
ROOMS = [module for module in MODULES if module.count(".") == 1]


@pytest.mark.parametrize(
    "modules", [ROOMS, pytest.param(MODULES, marks=pytest.mark.soak)], ids=["rooms", "every-module"]
)
def test_a_module_is_imported_alone(fresh, tmp_path, modules):
    assert len(ROOMS) > 20
    failed = {}
    for module in modules:
        done = fresh.run(f"import {module}", tmp_path)
        if done != (0, "", ""):
            failed[module] = done
    assert failed == {}


PART = """G21 G90 G64 P0.05
G0 X0 Y0
M3
G1 X10 F3000
G3 X15 Y5 I0 J5
G1 Y12
M5
M2
"""
JOB = """name = "mine"
machine = "xy"
[program]
controller = "trio.MoveSpiral"
diameter = 14
turns = 1
thickness = 5
speed = 80
loop_period = 0.02
[dispenser]
flow = 100
"""
COMMANDS = [line.partition("#")[0].strip() for line in PAGE.split("```")[1].strip().splitlines()]
# what stands in the page's commands, and in ours instead
OURS = {
    "an225": "my-job.toml",
    "fanuc-spiral": "my-job.toml",
    "softmc-helical": "my-job.toml",
    "trio-basic": "my-job.toml",
    "out/an225": "out/mine",
}
WEIGHINGS = """pressure [kPa],time [s],mass [mg],density [g/cm³],bore [mm],length [mm]
100,10,212,1.2,0.41,12.7
150,10,341,1.2,0.41,12.7
200,10,478,1.2,0.41,12.7
250,10,611,1.2,0.41,12.7
300,10,752,1.2,0.41,12.7
"""
QUICK = {
    "gantrysim run trio-basic --repeat 16": "--repeat 3 --no-video --no-report --no-improve",
    "gantrysim run": "--set turns=1 --no-video --no-report --no-improve",
    "gantrysim run an225 --set loop_period=0.01 --set speed=150 --out out/fast": "--no-video --no-report --no-improve",
    "gantrysim run my-job.toml --machine my-machine.xml": "--no-video --no-improve",
    "gantrysim run part.ngc --at 20,-10 --rotate 90": "--no-video --no-report --no-improve",
    "gantrysim run an225 --no-causes --no-improve": "--no-video --no-report",
    "gantrysim study loop an225": "--backend threading",
    "gantrysim tune fanuc-spiral": "--budget 4 --robust 0 --guards 0 --unseen 0 --batch 1 --backend threading",
    "gantrysim render out/an225 --colour error": "--size 320x240 --fps 5",
}


@pytest.fixture(scope="module")
def folder(fresh, tmp_path_factory):
    """Files of one's own, and a run of the job among them."""
    folder = tmp_path_factory.mktemp("stranger")
    (folder / "my-job.toml").write_text(JOB)
    (folder / "part.ngc").write_text(PART)
    shutil.copy(ROOT / "examples" / "machines" / "belt-gantry.toml", folder / "my-gantry.toml")
    machine = Machine("xy")
    (folder / "my-machine.xml").write_text(machine.source.read_text().replace('file="', f'file="{PACKAGE}/models/'))
    moves = Basic(excitation(machine, "trio")[0]).setpoints(1e-3)
    position = np.concatenate([np.zeros((100, 1)), moves.position[:3000, :1]])
    logged = Setpoints(1e-3, ("x",), position, np.ones(len(position), bool), moves.requested)
    log = Log.of(simulate(machine, Servo.derive(machine.axes), logged))
    moved = Log(("x",), log.period, log.position[:, :1], log.torque[:, :1], log.held)  # y stands still
    moved.save(folder / "log.csv", {"x": "mm"})
    # as most loggers do, with the command beside
    rows = (folder / "log.csv").read_text().splitlines()
    commands = ["x command [mm]", *(f"{command:.9g}" for command in position[:, 0])]
    (folder / "log.csv").write_text("\n".join(f"{a},{b}" for a, b in zip(rows, commands, strict=True)) + "\n")
    (folder / "glue.csv").write_text(WEIGHINGS)
    for command in (
        ("run", "my-job.toml", "--no-video", "--no-report", "--no-causes", "--no-improve"),
        ("export", "out/mine", "--out", "trace.csv"),
    ):
        done = fresh.command(folder, *command)
        assert (done.status, done.error) == (0, ""), done
    return folder


def ours(line):
    """The words of a line of the page, behind the name of the program, for files of one's own."""
    return [*(OURS.get(word, word) for word in shlex.split(line)[1:]), *QUICK.get(line, "").split()]


VIEW = "gantrysim view out/an225"


# commands that simulate a job more than once, or draw
LONG = {"compare", "identify", "improve", "render", "replay", "run", "study", "tune"}
SHORT = [line for line in COMMANDS if line.split()[1] not in LONG and line != VIEW]


@pytest.mark.parametrize(
    "lines", suite_runs([SHORT, [line for line in COMMANDS if line != VIEW]], 0), ids=["short", "all"]
)
def test_the_page_s_commands_on_files_of_one_s_own(fresh, folder, lines):
    assert len(lines) in (len(SHORT), len(COMMANDS) - 1)
    done = run_in_turn(fresh, folder, [("command", *ours(line)) for line in lines])
    for line, printed in zip(lines, done, strict=True):
        assert printed.error == "", line
        assert printed.output, line


@pytest.mark.parametrize(
    "line", [line if line == VIEW else pytest.param(line, marks=pytest.mark.soak) for line in COMMANDS]
)
def test_each_of_the_page_s_commands_in_a_process_of_its_own(fresh, folder, line):
    done = fresh.command(folder, *ours(line))
    if line == VIEW and not {"DISPLAY", "WAYLAND_DISPLAY"} & os.environ.keys():
        assert (done.status, done.output) == (2, "")
        assert re.fullmatch(r"error: cannot open a window: .*\n", done.error)
        return
    assert (done.status, done.error) == (0, "")
    assert done.output


def test_every_quick_option_belongs_to_a_command_of_the_page():
    assert QUICK.keys() <= set(COMMANDS)
