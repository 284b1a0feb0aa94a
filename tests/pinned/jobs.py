"""Jobs from files of every kind: what is chosen, refused, placed, overridden and planned."""

import tempfile
import tomllib
from contextlib import chdir
from pathlib import Path

from gantrysim import InputError, Job
from gantrysim.job.key_list import controller_keys, sections
from gantrysim.job.loading import builtin_jobs, is_gcode, read_job, recognised_dialect, subprogram_files
from gantrysim.job.overrides import Override, settings_of
from gantrysim.job.plan import glue_note, speed_note
from gantrysim.job.programs import PROGRAMS, circle_program, reader
from gantrysim.job.tolerance import Tolerance, ToleranceSettings

SQUARE = "G21 G90 G64 P0.05\nF1200\nG0 X10 Y10 Z5\nG1 Z0.5\nG1 X50\nG1 Y30\nG1 X10\nG0 Z5\nM2\n"
FLAT = "G21 G90\nF1200\nG1 X40\nG1 Y30\nM2\n"
PRINT = "M83\nM104 S200\nG0 F6000 X10 Y10 Z0.2\nG1 F1800 X40 Y10 E0.9\nG1 X40 Y40 E0.9\n"
MACROS = "O1234\nG21 G90\n#1=20\nWHILE [#1 GT 5] DO1\nG1 X#1 F600\n#1=#1-5\nEND1\nM30\n"
TOML = '[program]\nfile = "flat.ngc"\n'
SVG = (
    '<svg xmlns="http://www.w3.org/2000/svg" width="60mm" height="40mm" viewBox="0 0 60 40">'
    '<path d="M5 5 H55 V35" fill="none" stroke="black"/></svg>'
)
FILES = {
    "square.ngc": SQUARE,
    "flat.ngc": FLAT,
    "print.gcode": PRINT,
    "macros.nc": MACROS,
    "plain.nc": FLAT,
    "high.ngc": FLAT.replace("G1 X40", "G1 Z30\nG1 X40"),
    "up, then down.ngc": FLAT.replace("G1 X40", "G1 X20 Z30\nG1 X40\nG1 Z26"),
    "wide.ngc": FLAT.replace("X40", "X400"),
    "huge.ngc": FLAT.replace("X40", "X8000").replace("Y30", "Y4000").replace("F1200", "F60000"),
    "far.ngc": FLAT.replace("X40", "X940").replace("G90", "G90\nG0 X900"),
    "turn.ngc": FLAT.replace("G1 Y30", "G1 A30"),
    "inches.ngc": FLAT.replace("G21", "G20").replace("X40", "X2").replace("Y30", "Y1"),
    "call.ngc": "G21 F600\no<side> call [20]\nM2\n",
    "side.ngc": "o<side> sub\nG1 X#1\no<side> endsub\n",
    "drawing.svg": SVG,
    "moves.bas": "BASE(0,1)\nUNITS AXIS(0)=1000\nSPEED=20\nMOVE(30,0)\nMOVE(0,20)\nWAIT IDLE\n",
    "moves.prg": "program\nmove {30, 0} vcruise = 20\nmove {30, 20}\nend program\n",
    "words": "Dear reader,\nthis is a letter.\n",
    "words.xyz": "Dear reader,\nthis is a letter.\n",
    "gcode.xyz": FLAT,
    "flat.toml": f'name = "flat"\n{TOML}',
    "unnamed.toml": TOML,
    "bad name.toml": f'name = "a/b"\n{TOML}',
    "no program.toml": 'name = "a"\n',
    "unknown key.toml": f'name = "a"\nmachin = "xy"\n{TOML}',
    "list.toml": f'name = "a"\nservo = [1]\n{TOML}',
    "both.toml": f'name = "a"\n{TOML}text = "G1 X1"\n',
    "lost.toml": 'name = "a"\n[program]\nfile = "lost.ngc"\n',
    "own.toml": f'name = "own"\nmachine = "xyz"\n{TOML}controller = "fanuc"\n[dispenser]\narea = 1.5\n',
    "true.toml": f'name = "a"\n{TOML}[servo]\nperiod = true\n',
    "faults.toml": f'name = "a"\n{TOML}[[faults]]\nkind = "stuck axis"\n',
    "no kind.toml": f'name = "a"\n{TOML}[[faults]]\ntime = 1\n',
    "wrong kind.toml": f'name = "a"\n{TOML}[[faults]]\nkind = "rust"\n',
    "code.toml": 'name = "a"\n[program]\ncontroller = "own.py:Own"\n',
    "servo.toml": "[servo]\nkp = [0.1, 0.2]\nkd = 0.001\n",
    "three.toml": "[servo]\nkp = [0.1, 0.2, 0.3]\n",
    "other.toml": "[servos]\nkp = 1\n",
}
# of a file, and what else is given
LOADED = {
    **{name: (name,) for name in FILES if name not in ("servo.toml", "three.toml", "other.toml", "side.ngc")},
    "an unknown job": ("an226",),
    "no job": ("",),
    "a lost file": ("lost.ngc",),
    "a built-in job, with a controller": ("an225", {"controller": "fanuc"}),
    "placed": ("square.ngc", {"placement": {"x": 30.0, "y": -5.0, "z": 0.4, "rotate": 90.0, "scale": 0.5}}),
    "flat, lowered": ("flat.ngc", {"placement": {"z": 0.4}}),
    "flat, turned": ("flat.ngc", {"placement": {"rotate": 45.0}}),
    "spiral, placed": ("fanuc-spiral", {"placement": {"x": 3.0}}),
    "outline, placed": ("stage-outline", {"placement": {"x": 3.0}}),
    "on xyz": ("flat.ngc", {"machine": "xyz"}),
    "on the stage": ("flat.ngc", {"machine": "stage"}),
    "on no machine": ("flat.ngc", {"machine": "xz"}),
    "with a servo": ("flat.ngc", {"servo": Path("servo.toml")}),
    "with a servo of three axes": ("flat.ngc", {"servo": Path("three.toml")}),
    "without a servo": ("flat.ngc", {"servo": Path("other.toml")}),
    "faster": ("flat.ngc", {"speed": 40.0}),
    "too fast": ("flat.ngc", {"speed": 4000.0}),
    "spiral, faster": ("fanuc-spiral", {"speed": 40.0}),
    "as a printer's": ("flat.ngc", {"controller": "slicer"}),
    "as FANUC's": ("plain.nc", {"controller": "FANUC"}),
    "as nothing": ("flat.ngc", {"controller": "grbl"}),
    "with glue": ("flat.ngc", {"overrides": {"dispenser.flow": 20.0}}),
    "with a gap": ("flat.ngc", {"overrides": {"bead.gap": 0.3}}),
    "with an acceleration": ("flat.ngc", {"overrides": {"program.acceleration": 200.0}}),
    "without integral": ("flat.ngc", {"overrides": ["law=pd"]}),
    "filament": ("print.gcode", {"overrides": ["filament=2.85"]}),
}


def refusal(answer, folder=""):
    try:
        return answer()
    except InputError as error:
        return str(error).replace(f"{folder}/", "") if folder else str(error)


def in_folder(answer):
    """What is answered in a folder with the files."""
    with tempfile.TemporaryDirectory() as folder, chdir(folder):
        for name, text in FILES.items():
            Path(name).write_text(text, encoding="utf-8")
        return refusal(answer, str(Path(folder).resolve()))


def flat(table, prefix=""):
    """The values of nested tables by their dotted keys."""
    found = {}
    for key, value in table.items():
        if isinstance(value, dict):
            found |= flat(value, f"{prefix}{key}.")
        else:
            found[prefix + key] = value
    return found


def loaded(name, given=None):
    def answer():
        job = Job.load(name, **(given or {}))
        values = flat(tomllib.loads(job.toml()))
        usual = flat(tomllib.loads(DEFAULT.toml()))
        changes = {
            key: value
            for key, value in values.items()
            if usual.get(key) != value and key not in ("name", "program.text", "program.controller")
        }
        named = ("program.placement", "program.start", "program.feed", "program.axis_speeds", "program.subprograms")
        changes = {key: changes[key] for key in changes if not key.startswith("program.") or key.startswith(named)}
        plan = job.plan()
        return {
            "as": [job.name, job.program["controller"], job.source or "", plan.machine],
            "values": changes,
            "notes": job.notes,
            "plan": [plan.length, plan.way, plan.glue, plan.duration, plan.ticks, plan.speed, plan.glue_speed],
            "box": plan.box,
        }

    return in_folder(answer)


DEFAULT = Job.of_content(
    {"name": "a", "program": {"controller": "linuxcnc.Program", "text": "G21\nF600\nG1 X1\n"}}, "a"
)

TEXTS = {
    "flat": FLAT,
    "print": PRINT,
    "macros": MACROS,
    "comments": "(only)\n; comments\n",
    "letters": FILES["words"],
    "half": "G1 X1\nhello\n",
    "more than half": "G1 X1\nG1 Y1\nhello\n",
    "no motion": "M3\nM5\nG21\n",
    "codes of motion alone": "M3 S1\nG5.1 Q1\n",
    "feeds alone": "X1\nY2\n",
    "percent": "%\nO0001 (PART)\nG1 X1\n%\n",
    "an O word": "o100 sub\nG1 X1\no100 endsub\n",
    "a goto": "N10 G1 X1\nGOTO 10\n",
    "if without an O word": "IF [#1 EQ 2] THEN #2 = 3\nG1 X1\n",
    "mirror": "G51.1 X0\nG1 X1\n",
    "a rounded corner": "G1 X10, R2\nG1 Y10\n",
    "a call": "G65 P100 A1\nG1 X1\n",
    "coordinate rotation": "G68 X0 Y0 R30\nG1 X1\n",
    "a commented rotation": "(G68)\nG1 X1\n",
    "fed": "G1 X1 E0.5\n",
    "fed alone": "G1 E0.5\nG1 X1\n",
    "heater": "M104 S200\nG1 X1\n",
    "an own code": "M101\nG1 X1\n",
    "linear advance": "M900 K0.1\nG1 X1\n",
    "a macro": "START_PRINT BED=60\nG1 X1\n",
    "grbl": "$H\nG1 X1\n",
}


def recognised():
    return {name: [is_gcode(text), *recognised_dialect(text)] for name, text in TEXTS.items()}


OVERRIDES: dict[str, Override] = {
    "a full key": "servo.period=0.002",
    "its last part": "period=0.002",
    "an ambiguous part": "x=1",
    "another ambiguous part": "acceleration=1",
    "a text": "dispenser.kind=valve",
    "a text in quotes": "law='pd'",
    "a list": "servo.law=['pid','friction']",
    "nothing": "servo.period=",
    "no sign": "servo.period",
    "an unknown key": "servo.perod=0.002",
    "a far key": "qqqqqq=1",
    "a table": "servo=1",
    "a fault that there is not": "faults.0.time=1",
    "infinite": "integral_time=inf",
    "true": "servo.period=true",
    "a negative value": "servo.period=-1",
    "a word": "servo.period=fast",
    "an extreme": "program.acceleration=1e300",
    "a pair": ("servo.period", 0.002),
    "a pair of nothing": ("servo.period", None),
    "a pair of a part": ("damping", 0.8),
    "a machine": "machine=xyz",
    "a code": "program.controller=fanuc.Program",
}


def overridden(setting):
    def answer():
        job = DEFAULT.with_overrides([setting])
        values = flat(tomllib.loads(job.toml()))
        usual = flat(tomllib.loads(DEFAULT.toml()))
        return {key: value for key, value in values.items() if usual.get(key) != value}

    return refusal(answer)


def changed():
    """Changes by full keys, and what removes a value."""
    job = DEFAULT.changed({"servo.period": 0.002, "bead.gap": 0.3, "program.placement.x": 4.0})
    back = job.changed({"servo.period": None, "bead.gap": None})
    answers = {
        "there": [job.servo.period, job.bead.gap, job.program["placement"]["x"], job.name],
        "back": [back.servo.period, back.bead.gap, back.program["placement"]["x"]],
        "not a mapping": refusal(lambda: job.changed("servo.period=1")),
        "a part": refusal(lambda: job.changed({"period": 1.0})),
        "one text": refusal(lambda: settings_of("servo.period=1")),
        "a number": refusal(lambda: settings_of([3])),
        "same digest": job.changed({"machine": "xyz"}).digest == job.digest,
        "other digest": back.digest == job.digest,
    }
    return answers | {"machine": job.changed({"machine": "xyz"}).built_machine.name}


def tolerances():
    """Limits from a needle, counts, a width, and values that a job gives."""
    cases = {
        "defaults": ({}, 1.2, (), 2.0),
        "fine needle, coarse counts": ({}, 0.4, (0.05, 0.01), 1.0),
        "given": ({"path_max": 0.3, "least_gain_margin": 2.0, "bead_width": 5.0}, 1.2, (0.001,), 2.0),
        "no width": ({"path_p95": 0.01}, 1.2, (), float("nan")),
    }
    answers = {}
    for name, (values, needle, counts, width) in cases.items():
        limits = Tolerance.of(ToleranceSettings(**values), needle, counts, width)
        answers[name] = [
            {key: value for key, value in vars(limits).items() if key != "given"},
            sorted(limits.given),
            limits.source("path_max"),
            list(limits.bound("gain_margin", at_least=True)),
        ]
    return answers


def notes_of_plans():
    answers = {}
    for name, given in {"flat.ngc": {}, "square.ngc": {}, "print.gcode": {}}.items():
        with tempfile.TemporaryDirectory() as folder, chdir(folder):
            for file, text in FILES.items():
                Path(file).write_text(text, encoding="utf-8")
            plan = Job.load(name, **given).plan()
        # just beside the share of the speed that counts as all of it
        speeds = (5.0, plan.speed, 500.0, plan.glue_speed / 0.979, plan.glue_speed / 0.981)
        answers[name] = [glue_note(plan), *(speed_note(plan, speed) for speed in speeds)]
    return answers


def called_files():
    def answer():
        found = read_job("call.ngc")
        text = "o<side> call\no<lost> call\nM98 P20012\nG65 P7\n(o<gone> call)\n"
        Path("0012.nc").write_text("M98 P8\n", encoding="utf-8")
        Path("O0008").write_text("M99\n", encoding="utf-8")
        return [found.content["program"]["subprograms"], found.label, subprogram_files(text, Path())]

    return in_folder(answer)


def keys():
    """How many keys there are, and those of one table with their defaults."""
    found = sections()
    answers = {name: len(items) for name, items in found.items()}
    shown = [" | ".join(map(str, key))[:100] for key in found["`[bead]`"] + found["`[simulation]`"]]
    return [answers, shown, {name: len(controller_keys(name)) for name in PROGRAMS}]


def readers():
    given = [(".ngc", None), (".NC", None), (".bas", None), (".prg", None), (".xyz", None)]
    given += [(".ngc", "FANUC"), (".ngc", "fanuc.Program"), (".ngc", "stage"), (".ngc", "grbl"), (".dxf", "linuxcnc")]
    return {
        f"{suffix} {name}": refusal(lambda suffix=suffix, name=name: reader(suffix, name)) for suffix, name in given
    }


CASES = {f"load, {name}": lambda given=given: loaded(*given) for name, given in LOADED.items()}
CASES |= {f"set, {name}": lambda setting=setting: overridden(setting) for name, setting in OVERRIDES.items()}
CASES |= {
    "recognised": recognised,
    "changed": changed,
    "tolerances": tolerances,
    "notes of plans": notes_of_plans,
    "called files": called_files,
    "keys": keys,
    "readers": readers,
    "circle": lambda: circle_program(10.0, 20.0, 300.0, 720.0),
    "built-in": builtin_jobs,
}
