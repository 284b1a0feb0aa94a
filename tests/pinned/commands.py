"""What commands print: check, show, gains, machine, compare, identify, studies."""

import io
import os
import sys
import tempfile
from contextlib import chdir, redirect_stderr, redirect_stdout
from functools import cache
from pathlib import Path
from unittest.mock import patch

import numpy as np

from gantrysim import Machine, Servo, simulate
from gantrysim.cli.main import main
from gantrysim.controllers.trio import Basic
from gantrysim.identify.log import Log
from gantrysim.identify.plan import excitation
from gantrysim.machine.perturbation import Perturbation
from gantrysim.record.setpoints import Setpoints

from support.blank_pictures import save_blank
from support.parsed_app import parsed_app

PART = "G21 G90 G64 P0.05\nF3600\nG0 X10 Y10\nG1 X50\nG1 Y30\nG1 X10 Y30\nM2\n"
# without an axis of glue: a dry program
DRY = "G21 G90\nF3600\nM5\nG1 X20\nM3\nM5\nM2\n"
# by files that a case may name
TEXTS = {
    "part.ngc": PART,
    "dry.ngc": DRY,
    "part.toml": (
        'name = "part"\nmachine = "xy"\n[program]\nfile = "part.ngc"\n[dispenser]\narea = 1.0\nopening = 0.03\n'
    ),
    "mill.ini": """[EMCMOT]
SERVO_PERIOD = 1000000
[KINS]
KINEMATICS = trivkins
[TRAJ]
COORDINATES = X Y
LINEAR_UNITS = mm
[JOINT_0]
TYPE = LINEAR
P = 50
FF1 = 1
FF2 = 0.002
MAX_VELOCITY = 100
MAX_ACCELERATION = 500
FERROR = 0.5
[JOINT_1]
TYPE = LINEAR
P = 40
D = 0.1
FF1 = 1
BACKLASH = 0.01
MAX_VELOCITY = 80
MAX_ACCELERATION = 400
""",
    "steps.ini": """[TRAJ]
COORDINATES = X Y Z
LINEAR_UNITS = inch
[JOINT_0]
STEPGEN_MAXACCEL = 25
P = 1000
SCALE = 4000
MAX_VELOCITY = 3
MAX_ACCELERATION = 20
[JOINT_1]
STEPGEN_MAXACCEL = 25
SCALE = 4000
MAX_VELOCITY = 3
MAX_ACCELERATION = 20
[JOINT_2]
STEPGEN_MAXACCEL = 25
SCALE = 8000
MAX_VELOCITY = 1
MAX_ACCELERATION = 10
""",
    "printer.cfg": """[printer]
kinematics: cartesian
max_velocity: 250
max_accel: 2500
square_corner_velocity: 6
max_z_velocity: 15
max_z_accel: 80
[stepper_x]
microsteps: 16
rotation_distance: 40
[stepper_y]
microsteps: 32
rotation_distance: 40
gear_ratio: 2:1
[stepper_z]
microsteps: 16
rotation_distance: 8
[input_shaper]
shaper_type: zvd
shaper_freq_x: 45
shaper_freq_y: 38
""",
    "soft.toml": """name = "soft"
arrangement = "bridge"
[masses]
bridge = 9.0
carriage = 3.0
[x]
travel = [-100, 100]
guides = { friction = 6.0, viscous = 20.0 }
[x.drive]
motor = "maxon-re30-48"
encoder = "us-digital-e5-1000"
voltage = 24
[x.drive.transmission]
kind = "belt"
teeth = 20
pitch = 2
ratio = 1
inertia = 1e-6
efficiency = 0.9
stiffness = 0.05
friction = 0.004
[y]
travel = [-100, 100]
guides = { friction = 6.0, viscous = 20.0 }
[y.drive]
motor = "maxon-re40-48"
encoder = "us-digital-e5-2500"
voltage = 48
[y.drive.transmission]
kind = "screw"
lead = 10
diameter = 12
length = 470
accuracy = "C7"
efficiency = 0.9
stiffness = 13
friction = 0.012
""",
    "weights.csv": (
        "pressure [kPa];time [s];mass [mg]\n100;60;33,2\n200;30;52,5\n300;20;68,3\n400;15;84,1\n500;10;80,2\n"
    ),
    "pump.csv": "pump speed [rpm],time [s],mass [mg]\n10,20,160.5\n20,20,321.2\n40,20,641.0\n80,20,1283.1\n",
    "drops.csv": "drops,mass [mg]\n100,48.1\n200,96.3\n400,192.2\n800,384.9\n",
    "beads.csv": (
        "speed [mm/s],pressure [kPa],gap [mm],width [mm]\n"
        "1,300,0.5,3.9\n2,300,0.5,2.45\n4,300,0.5,1.55\n6,300,0.5,1.22\n2,300,0.4,2.82\n"
    ),
}
GLUE = ("--density", "1.2", "--needle", "22Gx12.7")


@cache
def log_text():
    """A log of the axis x of a machine with more friction and load than the nominal one, by its excitation."""
    machine = Machine("xy")
    whole = Basic(excitation(machine, "trio")[0]).setpoints(1e-3)
    position = np.concatenate([np.zeros((100, 1)), whole.position[:3000, :1]])
    setpoints = Setpoints(1e-3, ("x",), position, np.ones(len(position), bool), whole.requested)
    true = machine.perturbed(Perturbation(friction=1.3, payload=0.4))
    run = simulate(true, Servo.derive(machine.axes, 1e-3), setpoints)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "log.csv"
        Log.of(run).save(file, {"x": "mm", "y": "mm"})
        # y does not move, and is not to be fitted
        return file.read_text(encoding="utf-8").replace("y demand", "a")


RUN = ("run", "part.toml", "--no-video", "--no-report")
BRIEF_RUN = (*RUN, "--no-causes", "--no-improve")
WEAK = ("--set", "servo.torque_limit=0.02", "--set", "servo.following_error_limit=0.5")
VELOCITY = ("--set", "servo.mode='velocity'", "--set", "servo.notch_frequency=0")
PLAIN = ("--set", "servo.notch_frequency=0", "--set", "servo.acceleration_ff=0")
# commands in a folder of their own, of which the output of the last is pinned
COMMANDS = {
    "check": [
        ("check", "part.ngc"),
        ("check", "part.ngc", "--at", "20,10,1", "--rotate", "90", "--scale", "2", "--speed", "30"),
        ("check", "dry.ngc"),
    ],
    "run and show": [(*RUN, "--causes", "--repeat", "2"), ("show", "out/part"), ("show", "out/part", "all")],
    "compare": [
        BRIEF_RUN,
        ("show", "out/part", "faults", "scatter", "levers", "causes"),
        (*BRIEF_RUN, "--set", "servo.damping=0.5", "--out", "out/soft"),
        ("compare", "out/part", "out/soft", "-v"),
        ("compare", "out/part", "--measured", "out/soft", "--no-contrast"),
    ],
    "without glue": [
        ("run", "dry.ngc", "--no-video", "--no-report"),
        (*BRIEF_RUN, *WEAK),
        ("show", "out/part"),
    ],
    "gains": [
        ("gains", "part.toml"),
        ("gains", "part.toml", "--export", "linuxcnc-ini", "--set", "servo.notch_frequency=0"),
        ("gains", "part.toml", "--export", "softmc", *VELOCITY),
        ("gains", "part.toml", "--export", "fanuc", *VELOCITY, "--set", "servo.integral_time=inf"),
        ("gains", "part.toml", "--export", "klipper"),
        ("gains", "part.toml", "--export", "trio", *PLAIN, "--out", "gains.bas"),
    ],
    "gains from files": [
        ("gains", "part.toml", "--from", "linuxcnc-ini", "mill.ini"),
        ("gains", "part.toml", "--from", "linuxcnc-ini", "steps.ini"),
        ("gains", "slicer-square", "--from", "klipper", "printer.cfg"),
        ("gains", "part.toml", "--export", "trio", *PLAIN, "--out", "gains.bas"),
        ("gains", "part.toml", "--from", "trio", "gains.bas"),
    ],
    "machine new": [("machine", "new", "soft.toml", "--job", "part.toml")],
    "identify": [("identify", "log.csv", "--machine", "xy", "--rows", "1:2200")],
    "identify a dispenser": [
        ("identify", "dispenser", "weights.csv", "beads.csv", *GLUE),
        ("identify", "dispenser", "pump.csv", "--density", "1.2"),
        ("identify", "dispenser", "drops.csv", "--density", "1.2"),
    ],
    "studies": [
        ("study", "speed", "part.toml", "--workers", "1", "--tolerance", "60"),
        ("study", "circle", "--machine", "xy", "--radius", "10", "--speed", "60", "--workers", "1"),
    ],
    "info": [("info", "servo.damping"), ("info", "dispenser.stop_lead")],
    "info of names": [
        ("info",),
        ("info", "xyz"),
        ("info", "softmc-arc"),
        ("info", "stage.OutlineTrace"),
        ("info", "servo.dampig"),
        ("info", "machines"),
        ("info", "gains"),
    ],
    "fail on": [
        (*BRIEF_RUN, "--fail-on", "warn"),
        (*BRIEF_RUN, "--fail-on", "fail", "--set", "servo.frequency=3"),
        (*BRIEF_RUN, "--fail-on", "glory"),
        ("run", "part.toml", "--servo", "soft.toml"),
        ("run", "lost.toml"),
    ],
    "improve": [
        ("improve", "part.toml", "--workers", "1", "--no-by-place", "--no-fastest", "--apply", "better.toml"),
        ("check", "better.toml"),
        ("improve", "part.toml", "--lever", "glory"),
    ],
    "export": [
        BRIEF_RUN,
        ("export", "out/part", "--out", "run.csv"),
        ("export", "out/part", "--out", "run.mat"),
        ("export", "out/part", "--out", "run"),
        ("export", "out/part", "--format", "xls"),
        ("export", "out/lost"),
    ],
    "tune": [
        ("tune", "part.toml", "--budget", "10", "--workers", "1", "--unseen", "1"),
        ("tune", "part.toml", "--budget", "0"),
        ("tune", "part.toml", "--figure", "glory"),
    ],
    "plan": [
        ("identify", "axes", "--plan", "--machine", "xy", "--out", "moves.bas"),
        ("identify", "lost.csv", "--machine", "xy"),
        ("replay", "log.csv", "--machine", "xy"),
    ],
    "compare a record": [
        BRIEF_RUN,
        ("compare", "out/part", "--measured", "out/part", "--align", "time", "--no-contrast"),
        ("compare", "out/part", "--measured", "out/part", "--align", "glory"),
        ("compare", "out/part"),
        ("compare", "out/part", "out/lost"),
    ],
}
RULES = str.maketrans(dict.fromkeys("┏┓━┳┃┡╇┩│└┘┴─├┤┼╪", " "))


def printed(arguments):
    """What a command prints in the working folder: status, output and errors."""
    out, err = io.StringIO(), io.StringIO()
    status = 0
    with (
        patch.object(sys, "argv", ["gantrysim", *arguments]),
        redirect_stdout(out),
        redirect_stderr(err),
        patch("matplotlib.figure.Figure.savefig", save_blank),
        patch("gantrysim.cli.main.app", parsed_app()),
    ):
        try:
            main()
        except SystemExit as stop:
            status = stop.code or 0
    return status, out.getvalue(), err.getvalue()


def answer(commands):
    with (
        tempfile.TemporaryDirectory() as folder,
        chdir(folder),
        patch.dict(os.environ, {"COLUMNS": "120", "SOURCE_DATE_EPOCH": "1700000000"}),
    ):
        for name, text in TEXTS.items():
            Path(name).write_text(text, encoding="utf-8")
        if any("log.csv" in command for command in commands):
            Path("log.csv").write_text(log_text(), encoding="utf-8")
        return {" ".join(command): told(*printed(command)) for command in commands}


def told(status, output, said):
    """Status and lines of a command, without the lines and walls of tables."""
    lines = [" ".join(line.translate(RULES).split()) for line in output.splitlines()]
    return {"status": status, "prints": [line for line in lines if line], "says": said.splitlines()}


def parameters():
    """Options with their usual values and help, and the commands that have them."""
    found = {}
    groups = [("gantrysim", parsed_app())]
    while groups:
        path, command = groups.pop()
        groups += [(f"{path} {name}", sub) for name, sub in getattr(command, "commands", {}).items()]
        for item in command.params:
            usual = item.default if isinstance(item.default, str | int | float) and item.default is not False else ""
            words = (*item.opts, *item.secondary_opts, usual, item.help or "")
            found.setdefault(" ".join(map(str, words)), []).append(path.removeprefix("gantrysim "))
    return {words: " ".join(sorted(paths)) for words, paths in sorted(found.items())}


CASES = {name: lambda commands=commands: answer(commands) for name, commands in COMMANDS.items()}
CASES["parameters"] = parameters
