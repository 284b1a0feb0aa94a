"""Gains and limits to and from the files of controllers, input shapers, and runs as tables."""

import csv
import re
import tempfile
import tomllib
from functools import cache
from pathlib import Path

from gantrysim import InputError, Machine, Servo
from gantrysim.exchange.dialect import AxisLimits, program_lines
from gantrysim.exchange.gains import DIALECTS, export_gains, read_gains, sign_of_velocity_drives
from gantrysim.exchange.linuxcnc import IniFile, LinuxCNCIni, ini_text
from gantrysim.exchange.printer_config import PrinterConfig
from gantrysim.exchange.shaper import SHAPERS, klipper, pulses
from gantrysim.exchange.tables import WRITERS, export
from gantrysim.servo.gains import GAIN_NAMES

from support.remedies import SIDES, lines_job

STEPPERS = Path(__file__).parent.parent.parent / "examples" / "machines" / "stepper.toml"
PLAIN = {"notch_frequency": 0.0, "frequency": 10.0}
NO_FORWARD = {"acceleration_ff": 0.0, "velocity_ff": 0.0}
LONG = re.compile(r"\d+\.\d{6,}(?:e[-+]\d+)?|\d\.\d+e[-+]\d+")


def refusal(answer):
    try:
        return answer()
    except InputError as error:
        return str(error)


def short(text):
    """A text whose numbers have six digits, as the last ones of a derived gain are rounding."""
    return LONG.sub(lambda match: f"{float(match[0]):.6g}", text)


# machine, and settings of its servo
SERVOS = {
    "torque": ("xy", PLAIN),
    "damped output": ("xy", PLAIN | {"output_velocity": -2e-4, "resolution": [5e-4, 2e-3]}),
    "damped output, trio's terms": ("xy", PLAIN | NO_FORWARD | {"output_velocity": -2e-4, "period": 5e-4}),
    "no integral, no forward": ("xy", PLAIN | NO_FORWARD | {"integral_time": float("inf")}),
    "velocity": ("xy", PLAIN | {"mode": "velocity"}),
    "velocity, proportional": ("xy", PLAIN | {"mode": "velocity", "integral_time": float("inf"), "velocity_time": 0.0}),
    "velocity, fast": ("xy", PLAIN | {"mode": "velocity", "kp": (100.0, 99.99), "velocity_ff": 1.1}),
    "velocity, D": ("xy", PLAIN | {"mode": "velocity", "kd": 0.01, "acceleration_ff": 0.002}),
    "both modes": ("xy", PLAIN | {"mode": ["torque", "velocity"]}),
    "a turning axis": ("xyzr", PLAIN | NO_FORWARD | {"integral_time": float("inf")}),
    "load encoders, late": ("xy", PLAIN | {"feedback": "load", "delay": 2e-4, "feedback_delay": 2}),
    "notch and law": ("xy", {"notch_frequency": [0.0, 300.0], "frequency": 10.0, "law": ["pid", "friction"]}),
    "preview": ("xy", PLAIN | {"law": ["pid", "preview"]}),
    "no limits": ("xy", PLAIN | NO_FORWARD | {"torque_limit": float("inf"), "resolution": 0.0}),
    "kd of 0": ("xy", PLAIN | NO_FORWARD | {"kd": 0.0}),
    "positions": ("xy", {"mode": "position"}),
    "positions without counts": ("xy", {"mode": "position", "resolution": 0.0}),
    "positions and torque": ("xy", {"mode": ["position", "torque"]}),
    "steppers": (STEPPERS, {}),
}


# of which two dialects tell enough
OF_TWO = (
    "velocity, proportional",
    "velocity, fast",
    "velocity, D",
    "load encoders, late",
    "preview",
    "positions without counts",
    "positions and torque",
)


@cache
def servo_of(name):
    machine, settings = SERVOS[name]
    machine = Machine(machine)
    period = settings.get("period", 1e-3)
    return machine.axes, Servo.derive(machine.axes, **{"period": period} | settings)


@cache
def first_lines(dialect):
    """Lines of the first servo of which a dialect has a text."""
    for name in SERVOS:
        lines = refusal(lambda name=name: text_lines(dialect, name))
        if not isinstance(lines, str):
            return lines
    raise AssertionError(dialect)


def text_lines(dialect, name):
    return [line for line in short(export_gains(dialect, *servo_of(name))[0]).splitlines() if line]


def written(dialect, name):
    """Lines of a file that the first servo's lacks, and how many there are in all."""

    def answer():
        lines = text_lines(dialect, name)
        _, notes = export_gains(dialect, *servo_of(name))
        own = [line for line in lines if line not in first_lines(dialect)] or lines
        return {"lines": own, "count": [len(lines), len(notes)]}

    return refusal(answer)


def gains_of(servo, axes):
    names = (*GAIN_NAMES, "velocity_gain", "velocity_time")
    return {name: list(servo.per_axis(name)) for name in names if any(servo.per_axis(name))} | {
        "as torques": sign_of_velocity_drives(axes, servo)
    }


def read(dialect, text, mode):
    def answer():
        axes, servo = servo_of({"torque": "torque", "velocity": "velocity"}[mode])
        found, notes = read_gains(dialect, text, axes, servo, "file")
        return {**gains_of(found, axes), "notes": notes}

    return refusal(answer)


MILL = """
[EMCMOT]
SERVO_PERIOD = 500000
[KINS]
KINEMATICS = trivkins coordinates=YXA
[TRAJ]
COORDINATES = X Y Z
LINEAR_UNITS = inch
[JOINT_0]
TYPE = LINEAR
P = 40
I = 3
FF1 = 1.01   ; as every velocity drive
DEADBAND = 0.0001
MAX_ERROR = 0.1
MAX_OUTPUT = 20
[JOINT_1]
PGAIN = 50
D = 0.5
P = 51
P = 99
FF2 = -0.002
BACKLASH = 0.004
FERROR = 0.05
MIN_FERROR = 0.01
[JOINT_2]
TYPE = ANGULAR
P = 60
"""
HAL = """
loadrt pid names=pid.x,pid.y
setp pid.x.Pgain 0.5   # of the error
setp pid.x.Igain 12
SETP PID.X.DGAIN 4e-3
setp x.FF1 1e-5
setp pid.x.maxoutput 0.5
setp pid.x.maxerrorI 0.25
setp pid.1.Pgain .25
setp pid.1.Dgain 2.e-3
setp pid.1.FF2 3e-5
setp pid.1.deadband 0.002
setp pid.q.Pgain 7
setp pid.x.Pgain half
"""
TRIO = """
' P_GAIN=9
BASE(0)
P_GAIN=1.5: I_GAIN = 0.05
d_gain=12 : VFF_GAIN=0.03
OV_GAIN=-0.5
UNITS=1000
FE_LIMIT=5
FE_RANGE=2
SPEED=300
P_GAIN AXIS(1)=2
D_GAIN AXIS ( 1 ) = 1.4E1
OUTLIMIT AXIS(1)=1024
P_GAIN AXIS(2)=3
"""
SOFTMC = """
x.KPP = 80
x.KPI=900 ' per second squared
X.KVP = 0.3
x.KPVFR = 1.0
x.KPAFR = 9e-4
y.kpp = 70
y.KVP = 0.4
y.KVI = 200
a3.KPP = 1
"""
FANUC = """%
N01825Q1 A1P3000 A2P4500 A3P1
N2092 A1P9800A2P10000
N1851A1P5
%
"""
FILES = {
    "ini": ("linuxcnc-ini", MILL),
    "ini in mm": ("linuxcnc-ini", MILL.replace("inch", "mm").replace("500000", "1000000")),
    "ini in units of half a millimetre": ("linuxcnc-ini", MILL.replace("inch", "2.0 # per mm")),
    "ini in yards": ("linuxcnc-ini", MILL.replace("inch", "yard")),
    "ini by the letters of the trajectory": ("linuxcnc-ini", MILL.replace(" coordinates=YXA", "")),
    "ini of other kinematics": ("linuxcnc-ini", MILL.replace("trivkins coordinates=YXA", "genhexkins")),
    "ini by older axes": ("linuxcnc-ini", MILL.replace("JOINT_0", "AXIS_Y").replace("JOINT_1", "AXIS_X")),
    "ini with bias": ("linuxcnc-ini", MILL.replace("FF2 = -0.002", "BIAS = 0.5")),
    "ini of a turning joint": ("linuxcnc-ini", MILL.replace("PGAIN", "TYPE = ANGULAR\nPGAIN")),
    "ini with a word": ("linuxcnc-ini", MILL.replace("P = 40", "P = [SPINDLE]P")),
    "ini of steps": ("linuxcnc-ini", MILL.replace("PGAIN", "STEPGEN_MAXACCEL = 9\nPGAIN")),
    "hal": ("linuxcnc", HAL),
    "hal with a term of its own": ("linuxcnc", HAL.replace("maxerrorI", "FF3")),
    "hal of one axis": ("linuxcnc", HAL.replace("pid.1.", "pid.c.")),
    "trio": ("trio", TRIO),
    "trio, 16 bits": ("trio", TRIO + "DAC_SCALE=-32\nDAC_SCALE AXIS(1)=16\n"),
    "trio, other edges": ("trio", TRIO.replace("UNITS=1000", "UNITS=1009")),
    "trio, nearly the same edges": ("trio", TRIO.replace("UNITS=1000", "UNITS=1011")),
    "trio, other period": ("trio", TRIO + "SERVO_PERIOD=250\n"),
    "trio, other limits": ("trio", TRIO.replace("FE_LIMIT=5", "FE_LIMIT=4")),
    "softmc": ("softmc", SOFTMC),
    "softmc without KPAFR": ("softmc", SOFTMC.replace("x.KPAFR", "' x.KPAFR")),
    "softmc of one axis": ("softmc", SOFTMC.replace("y.", "z.")),
    "fanuc": ("fanuc", FANUC),
    "fanuc of one axis": ("fanuc", FANUC.replace("A2P4500", "").replace("A2P10000", "")),
    "nothing": ("fanuc", "%\n%\n"),
}


OF_BOTH = ("ini", "ini with bias", "hal", "trio", "softmc", "softmc without KPAFR", "fanuc")


def signs():
    """Why gains are no torques: without D, with D beyond 2 J / T, and with a feed-forward of half the torque."""
    axes, servo = servo_of("torque")
    unstable = 2 * axes[1].inertia / servo.period
    forward = 0.5 * servo.drives[0].torque_limit / axes[0].speed_limit
    changes = {
        "P alone": {"kd": 0.0},
        "P with a damped output": {"kd": 0.0, "output_velocity": -1e-3},
        "nearly unstable": {"kd": (1e-3, 0.999 * unstable)},
        "unstable": {"kd": (1e-3, 1.001 * unstable)},
        "much forward": {"velocity_ff": (0.999 * forward, 0.0), "output_velocity": 0.0},
        "too much forward": {"velocity_ff": (1.001 * forward, 0.0), "output_velocity": 0.0},
        "nothing": {"kp": 0.0, "kd": 0.0},
    }
    return {name: sign_of_velocity_drives(axes, servo.with_values(**values)) for name, values in changes.items()}


LIMITS = """[TRAJ]
COORDINATES = XZ
LINEAR_UNITS = cm
[AXIS_X]
MAX_VELOCITY = 3
MAX_ACCELERATION = 25
[JOINT_0]
MAX_VELOCITY = 4
MAX_ACCELERATION = 20
STEP_SCALE = -800
FERROR = 0.1
[JOINT_1]
MAX_VELOCITY = 2
FERROR = 0
[AXIS_Y]
MAX_VELOCITY = 5
MAX_ACCELERATION = 1e3
"""
INIS = {
    "of joints and axes": LIMITS,
    "in inches": LIMITS.replace("cm", "IMPERIAL"),
    "of a gantry": LIMITS.replace("COORDINATES = XZ", "COORDINATES = XYYZ"),
    "of other kinematics": "[KINS]\nKINEMATICS = scarakins\n" + LIMITS,
    "without units": LIMITS.replace("LINEAR_UNITS = cm\n", ""),
    "with gains": LIMITS + "[JOINT_2]\nFF1 = 1\n",
    "with a word": LIMITS.replace("= 5", "= fast"),
    "with comments": "# [JOINT_0]\n;X = 1\n" + LIMITS.replace("= 4", "= 4 # fast").replace("[AXIS_X]", "[AXIS_X] # x"),
    "without limits": "[TRAJ]\nCOORDINATES = X\n",
}


def limits_of(text):
    def answer():
        ini = IniFile.of(text)
        return {
            "letters": ini.letters,
            "length": ini.length,
            "gains": LinuxCNCIni().has_gains(text),
            "limits": [limit.in_words() for limit in ini.limits],
            "program": program_lines(ini.limits),
        }

    return refusal(answer)


def included():
    """INI files that include others, from folders of their own."""
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        (place / "parts").mkdir()
        (place / "mill.ini").write_text("[TRAJ]\n#INCLUDE parts/x.inc\n# INCLUDE no.inc\nA = 1\n", encoding="utf-8")
        (place / "parts" / "x.inc").write_text("#INCLUDE y.inc  \nX = 1", encoding="utf-8")
        (place / "parts" / "y.inc").write_text("Y = 1\n", encoding="utf-8")
        return [
            ini_text(place / "mill.ini"),
            LinuxCNCIni().file_text(place / "parts" / "x.inc"),
            refusal(lambda: ini_text(place / "absent.ini")).replace(folder, ""),
            refusal(lambda: DIALECTS["trio"].file_text(place / "absent.bas")).replace(folder, ""),
        ]


PRINTER = """
[include parts/*.cfg]
[printer]
kinematics: corexy
max_velocity: 300   # mm/s
max_accel = 3000 ; mm/s2
max_z_velocity: 12.5
[stepper_x]
microsteps: 16
rotation_distance: 40
full_steps_per_rotation: 400
[stepper_y]
rotation_distance: 40
gear_ratio: 80:16, 3:2
microsteps: 4
[gcode_macro A]
gcode:
  max_accel: 7
"""
SHAPER = """
#*# [input_shaper]
#*# shaper_type = zv
#*# shaper_freq_x = 60.5
#*# shaper_freq_y = 41
#*# damping_ratio_y = 0.05
"""
PRINTERS = {
    "without shapers": PRINTER,
    "zv": PRINTER + SHAPER,
    "zvd of y": PRINTER + SHAPER.replace("type =", "type_y = zvd\n#*# shaper_type =").replace("_x = 60.5", "_x = 0"),
    "two kinds": PRINTER + SHAPER.replace("type =", "type_y = zvd\n#*# shaper_type ="),
    "default kind": PRINTER + SHAPER.replace("#*# shaper_type = zv\n", ""),
    "slow in z": PRINTER.replace("max_z", "max_z_accel: 100\nmax_z").replace("[stepper_x]", "minimum_cruise_ratio: 0"),
    "fast in z": PRINTER.replace("12.5", "400").replace("[stepper_x]", "square_corner_velocity: 0\n[stepper_x]"),
    "gears without teeth": PRINTER.replace("3:2", "3:0"),
    "gears of one number": PRINTER.replace("80:16, 3:2", "5"),
    "no number": PRINTER.replace("12.5", "fast"),
    "a negative number": PRINTER.replace("12.5", "-1"),
    "no acceleration": PRINTER.replace("max_accel", "max_accel_to_decel"),
    "acceleration of 0": PRINTER.replace("3000", "0"),
    "no printer": PRINTER.replace("[printer]", "[machine]"),
}


def printer_answer(text, modes=("torque",) * 3):
    def answer():
        with tempfile.TemporaryDirectory() as folder:
            place = Path(folder)
            (place / "parts").mkdir()
            for name, letter in (("b.cfg", "y"), ("a.cfg", "z"), ("c.txt", "x")):
                content = f"[stepper_{letter}]\nrotation_distance: 8\nmicrosteps: 32\n"
                (place / "parts" / name).write_text(content, encoding="utf-8")
            (place / "printer.cfg").write_text(text, encoding="utf-8")
            try:
                found, notes = PrinterConfig.load(place / "printer.cfg").tables("xyz", modes)
            except InputError as error:
                return str(error).replace(f"{folder}/", "")
            return {
                "text": [line for line in found.splitlines() if line],
                "notes": notes,
                "servo": tomllib.loads(found).get("servo"),
            }

    return answer()


def shaper_answer(source):
    def answer():
        text, notes = klipper(Machine(source).axes, "ei")
        return {"text": text.splitlines(), "notes": notes}

    return refusal(answer)


def shapers():
    given = [(kind, frequency, damping) for kind in SHAPERS for frequency, damping in ((40.0, 0.0), (25.0, 0.1))]
    bad = [("zv", 40.0, 1.0), ("zv", 0.0, 0.1), ("mzv", 40.0, -0.1), ("2hump_ei", 40.0, 0.1)]
    return [list(pulses(*each)) for each in given] + [refusal(lambda each=each: pulses(*each)) for each in bad]


def lines():
    """Limits of an axis in words, and tables of jobs from limits that are known in part."""
    limits = [
        AxisLimits("x", 100.0, 500.0),
        AxisLimits("z", 25.4, 0.0, 157.48, 0.127),
        AxisLimits("y", 1 / 3, 1e3, 0.0, 2.0),
    ]
    return [
        [limit.in_words() for limit in limits],
        program_lines(limits),
        program_lines(limits[:1], 300.0),
        program_lines([]),
    ]


def table_answer(kind):
    """Head and middle of a run's table, and how many rows it has."""
    run = lines_job(SIDES).run()
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / f"run.{kind}"
        refused = refusal(lambda: export(run, file, kind))
        if refused is not None:
            return refused
        if kind == "mat":
            from scipy.io import loadmat

            content = loadmat(file, squeeze_me=True)["run"]
            return {name: float(content[name].item()[100]) for name in content.dtype.names}
        texts = file.read_text(encoding="utf-8").splitlines()
    head = [line for line in texts if line.startswith("#") and "version" not in line]
    names, *rows = csv.reader(line for line in texts if not line.startswith("#"))
    middle = [float(f"{float(value):.4g}") for value in rows[100]]
    return {"head": head, "count": len(rows), "row": dict(zip(names, middle, strict=True))}


CASES = {
    f"{dialect}, {name}": lambda dialect=dialect, name=name: written(dialect, name)
    for name in SERVOS
    for dialect in DIALECTS
    if name not in OF_TWO or dialect in ("linuxcnc-ini", "fanuc")
}
CASES |= {
    f"read {name} for {mode}": lambda file=file, mode=mode: read(*file, mode)
    for name, file in FILES.items()
    for mode in ("torque", "velocity")
    if mode == "torque" or name in OF_BOTH
}
CASES |= {f"limits {name}": lambda text=text: limits_of(text) for name, text in INIS.items()}
CASES |= {f"printer {name}": lambda text=text: printer_answer(text) for name, text in PRINTERS.items()}
CASES |= {"printer of steppers": lambda: printer_answer(PRINTER + SHAPER, ("torque", "stepper", "torque"))}
CASES |= {f"shaper of {Path(name).name}": lambda name=name: shaper_answer(name) for name in ("xy", "xyzr", STEPPERS)}
CASES |= {f"table as {kind}": lambda kind=kind: table_answer(kind) for kind in ("csv", "mat", "xlsx")}
CASES |= {
    "signs": signs,
    "included": included,
    "shapers": shapers,
    "lines": lines,
    "kinds of tables": lambda: sorted(WRITERS),
}
