"""Hostile inputs of every kind that gantrysim reads, drawn from a seed; each must be refused in one line, or read.

python tests/support/hostile.py FIRST_SEED COUNT [KIND]

Prints the inputs that ended otherwise, and the counts by kind.
"""

import io
import random
import signal
import sys
import tempfile
import time
import traceback
import warnings
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

SLOWEST = 20  # seconds of computing for one input
_WAITING = 300  # seconds by the clock, within which an input that computes nothing must end too
LONGEST = 2000  # characters of a message
NUMBERS = (
    *("1e308", "-1e308", "1e-308", "5e-324", "1e300", "1e150", "1e-150", "1e20", "-1e15", "1e-12", "1e-6", "0", "-0.0"),
    *("1e6", "-1", "0.5", "nan", "inf", "-inf", "1e999", "9223372036854775807", "9223372036854775808", "0.1"),
)
VALUES = (
    *NUMBERS,
    *('""', '"a"', "[]", "[[]]", "{}", "true", "1979-05-27", "[nan]", "[1, 2, 3]", "0x" + "f" * 5000, "1" * 5000),
    *("[" * 3000, '"' + "x" * 5000 + '"', "'\\n'", '"\\u0000"', "[1, [2, [3]]]"),
)
FILLERS = (
    "[",
    "(",
    "{",
    "<",
    '"',
    "'",
    " ",
    "\t",
    "_",
    ".",
    "1",
    "a",
    "-",
    "+",
    "*",
    ";",
    ",",
    "=",
    "#",
    "\n",
    "/*",
    "%",
)


class TooSlowError(Exception):
    """An input that takes longer than it may."""


def pumped(rng: random.Random, text: str) -> str:
    """A text with a run of one of its parts, or of a filler, somewhere in it."""
    at = rng.randrange(len(text) + 1)
    part = rng.choice((rng.choice(FILLERS), text[at : at + rng.randint(1, 30)], rng.choice(NUMBERS) + " "))
    return text[:at] + part * rng.choice((2, 50, 3000, 30_000)) + text[at:]


def replaced(rng: random.Random, text: str) -> str:
    """A text whose numbers are replaced here and there."""
    words = text.replace("=", " = ").split(" ") if rng.random() < 0.1 else text.split(" ")
    for _ in range(rng.randint(1, 3)):
        k = rng.randrange(len(words))
        digits = [i for i, sign in enumerate(words[k]) if sign.isdigit()]
        words[k] = words[k][: digits[0]] + rng.choice(NUMBERS) if digits else words[k]
    return " ".join(words)


def cut(rng: random.Random, text: str) -> str:
    """A text of whose lines some are dropped, repeated or exchanged."""
    lines = text.split("\n")
    for _ in range(rng.randint(1, 3)):
        a, b = rng.randrange(len(lines)), rng.randrange(len(lines))
        kind = rng.randrange(3)
        if kind == 0 and len(lines) > 1:
            del lines[a]
        elif kind == 1:
            lines[b:b] = [lines[a]] * rng.choice((1, 10, 1000))
        else:
            lines[a], lines[min(b, len(lines) - 1)] = lines[min(b, len(lines) - 1)], lines[a]
        if not lines:
            lines = [""]
    return "\n".join(lines)


def bytes_changed(rng: random.Random, text: str) -> str:
    content = bytearray(text.encode())
    for _ in range(rng.randint(1, 6)):
        if content:
            content[rng.randrange(len(content))] = rng.randrange(256)
    return content.decode("latin-1")


def changed(rng: random.Random, text: str) -> str:
    for _ in range(rng.randint(1, 2)):
        text = rng.choice((pumped, replaced, replaced, cut, bytes_changed))(rng, text)
    return text


@cache
def _jobs() -> dict[str, str]:
    from gantrysim.job.loading import builtin_jobs, job_text

    return {name: job_text(name) for name in builtin_jobs()}


@cache
def _keys(name: str) -> list[str]:
    import tomllib

    from gantrysim.job.overrides import known_keys

    return known_keys(tomllib.loads(_jobs()[name]))


def _planned(job: object) -> None:
    if job.controller.duration < 60:
        plan = job.plan()
        assert all(np.isfinite(value) for value in vars(plan).values() if isinstance(value, float)), plan


def settings_of_a_job(rng: random.Random, folder: Path) -> None:
    from gantrysim.job.job import Job

    name = rng.choice(list(_jobs()))
    settings = [f"{rng.choice(_keys(name))}={rng.choice(VALUES)}" for _ in range(rng.randint(1, 3))]
    print(name, [text[:90] for text in settings], file=sys.stderr)
    _planned(Job.load(name, settings))


def job_file(rng: random.Random, folder: Path) -> None:
    from gantrysim.job.job import Job

    text = changed(rng, rng.choice(list(_jobs().values())))
    (folder / "job.toml").write_text(text, encoding="utf-8", newline="")
    _planned(Job.load(folder / "job.toml"))


def study(rng: random.Random, folder: Path) -> None:
    """A study of a job, up to its first cases."""
    from gantrysim.job.job import Job
    from gantrysim.study.circle import CircleStudy
    from gantrysim.study.laws import LawsStudy
    from gantrysim.study.loop import LoopStudy
    from gantrysim.study.machine import MachineStudy, Tolerances
    from gantrysim.study.repeat import RepeatStudy
    from gantrysim.study.run import _check_job
    from gantrysim.study.speed import SpeedStudy

    def number() -> float:
        return float(rng.choice((*NUMBERS, "50", "100", "0.001")))

    name = rng.choice(list(_jobs()))
    settings = [f"{rng.choice(_keys(name))}={rng.choice(NUMBERS)}"] if rng.random() < 0.4 else []
    kind = rng.choice(("circle", "circle", "laws", "loop", "machine", "repeat", "speed"))
    print(kind, name, settings, file=sys.stderr)
    if kind == "circle":
        made = CircleStudy(rng.choice(("xy", "xyz", "delta", "stage")), number(), number(), ())
    else:
        job = Job.load(name, settings)
        factor = f"{rng.choice(('friction', 'payload', 'stiffness', 'x'))}={rng.choice(NUMBERS)}"
        made = {
            "laws": lambda: LawsStudy(job, number(), number()),
            "loop": lambda: LoopStudy(job),
            "machine": lambda: MachineStudy(
                job, number(), "contour_max", rng.choice((0, 1, 10**9)), Tolerances.parse(factor), 1
            ),
            "repeat": lambda: RepeatStudy(job, repeats=rng.choice((-1, 0, 2, 10**9)), friction=number(), seed=1),
            "speed": lambda: SpeedStudy(job, number(), rng.choice(("contour_max", "x"))),
        }[kind]()
    _check_job(made.job)
    next(made.rounds())


def mjcf(rng: random.Random, folder: Path) -> None:
    from gantrysim import Machine, Servo
    from gantrysim.machine.checks import notes
    from gantrysim.servo.stability.margins import margins_of

    root = ET.fromstring(_flat(rng.choice(("xy", "xyz", "stage", "delta"))))
    for _ in range(rng.randint(1, 2)):
        element = rng.choice([item for item in root.iter() if item.attrib])
        key = rng.choice(list(element.attrib))
        parts = element.get(key, "").split() or [""]
        parts[rng.randrange(len(parts))] = rng.choice((*NUMBERS, "1" * 400, "x", ""))
        element.set(key, " ".join(parts))
    if rng.random() < 0.3:
        world = root.find("worldbody")
        count = rng.choice((2, 30, 100))
        for k in range(count):
            body = ET.SubElement(world, "body", pos=f"{0.02 * k} 9 9")
            ET.SubElement(body, "freejoint")
            ET.SubElement(
                body, "geom", size=rng.choice(("0.05", "1e-8", "1e8")), mass=rng.choice(("1", "1e-9", "1e12"))
            )
    if rng.random() < 0.2:
        sizes = {"nrow": rng.choice(("3", "90000", "-1", "1e9")), "ncol": rng.choice(("3", "90000"))}
        ET.SubElement(ET.SubElement(root, "asset"), "hfield", name="h", size="1 1 1 1", **sizes)
    if rng.random() < 0.2:
        attribute = rng.choice(("memory", "nuserdata", "nuser_body", "nuser_geom", "njmax", "nconmax", "nstack"))
        ET.SubElement(root, "size", {attribute: rng.choice(("-1", "0", "1e9", "1T", "2000000000", "x"))})
    if rng.random() < 0.1:
        copies = ET.SubElement(root.find("worldbody"), "replicate", count=rng.choice(("5", "10000000", "-2")))
        ET.SubElement(copies, "site")
    file = folder / "model.xml"
    file.write_bytes(ET.tostring(root))
    machine = Machine(file)
    notes(machine)
    margins_of(machine, Servo.derive(machine.axes))


@cache
def _flat(name: str) -> str:
    from importlib.resources import files

    import mujoco

    spec = mujoco.MjSpec.from_file(str(files("gantrysim.models") / f"{name}.xml"))
    spec.compile()
    return str(spec.to_xml())


def machine_table(rng: random.Random, folder: Path) -> None:
    from gantrysim import Machine, Servo

    tables = sorted((Path(__file__).parents[2] / "examples" / "machines").glob("*.toml"))
    text = changed(rng, rng.choice(tables).read_text(encoding="utf-8"))
    (folder / "machine.toml").write_text(text, encoding="utf-8", newline="")
    Servo.derive(Machine(folder / "machine.toml").axes)


@cache
def _programs() -> list[tuple[str, str]]:
    from support.guided import program_seeds

    pages = {
        "trio.Basic": ("trio-basic.md", "basic"),
        "softmc.Basic": ("mc-basic.md", "basic"),
        "linuxcnc.Program": ("g-code.md", "gcode"),
        "slicer.Program": ("g-code.md", "gcode"),
        "fanuc.Program": ("controllers.md", "gcode"),
    }
    found = [(name, seed.decode()) for name, page in pages.items() for seed in program_seeds(name, *page)]
    softmc = [
        (
            "softmc.Program",
            "Move G1 {10, 0} Vtran=40 Acc=1000 Jerk=1e5 PrfType=2\nCircle Angle=90 CircleCenter={0, 0}\n",
        )
    ]
    return found + softmc * 3


def program(rng: random.Random, folder: Path) -> None:
    from gantrysim.job.programs import PROGRAMS

    name, text = rng.choice(_programs())
    kind: Any = PROGRAMS[name]
    key = "program" if name == "softmc.Program" else kind.text_argument
    built = kind(**{key: changed(rng, text)})
    if built.duration < 60:
        assert np.isfinite(built.setpoints(0.001).position).all()


def drawing(rng: random.Random, folder: Path) -> None:
    from gantrysim.controllers.drawings import Drawing

    from support.drawings import circle, csv, dxf, line, polyline, svg

    count = rng.choice((3, 30, 300, 3000))
    points = [(rng.uniform(-50, 50), rng.uniform(-50, 50)) for _ in range(count)]
    zigzag = [(rng.choice((1e-9, 1e-5, 0.01, 1)) * k, rng.choice((1e-9, 1e-3, 10)) * (k % 2)) for k in range(count)]
    shape = '<path style="stroke:red" transform="rotate(10)" d="M0 0 C1 2 3 4 5 6 L10 0 A5 5 0 0 1 10 10 z"/>'
    texts = (
        csv(points),
        csv(zigzag),
        "x [mm],y,glue,speed\n" + "\n".join(f"{x:.3f},{y:.3f},1,20" for x, y in zigzag),
        svg(f"<style>.a{{stroke:red}}</style>{shape * rng.choice((1, 50))}"),
        svg(f'<polyline points="{" ".join(f"{x:.3f},{y:.3f}" for x, y in points)}"/>'),
        dxf(line((0, 0), (3, 0)) + line((3, 0), (3, 4)) + circle((0, 0), 5.0)),
        dxf(polyline([(x, y, 0.3) for x, y in zigzag[:30]])),
    )
    text = rng.choice(texts)
    text = text if rng.random() < 0.3 else changed(rng, text)
    tolerance = rng.choice(("1e-12", "1e-6", "0.05", "10", "1e6"))
    built = Drawing(
        text=text,
        curve=rng.choice(("lines", "spline")),
        corner_tolerance=float(tolerance),
        chord_tolerance=float(rng.choice(("1e-12", "1e-3", "0.01", "1"))),
        unit=rng.choice(("auto", "mm", "um", "m")),
        order=rng.choice(("drawn", "nearest")),
    )
    if built.duration < 60:
        assert np.isfinite(built.setpoints(0.001).position).all()


def trace(rng: random.Random, folder: Path) -> None:
    from gantrysim.tables.reading import read_table

    rows = "\n".join(f"{0.001 * k:.4f},{k},{k % 7}" for k in range(300))
    texts = (
        f"time [s],x position [mm],x_torque [N·m]\n{rows}\n",
        rows,
        "Sampling period is 1000000 ns\n" + "\n".join(f"a {k} b {k}" for k in range(100)),
        "TABLE(0, " + ", ".join(map(str, range(100))) + ")",
    )
    file = folder / "log.csv"
    file.write_text(changed(rng, rng.choice(texts)), encoding="utf-8", newline="")
    read_table(file, rng.choice((0, 0, 1, 2)))


def log(rng: random.Random, folder: Path) -> None:
    from gantrysim.identify.log import read_log

    head = "time [s],x demand [N·m],x position [mm]"
    rows = "\n".join(f"{0.001 * k:.4f},{np.sin(k):.4f},{k % 7}" for k in range(200))
    file = folder / "log.csv"
    file.write_text(
        changed(rng, head) + "\n" + rows if rng.random() < 0.5 else changed(rng, f"{head}\n{rows}"), newline=""
    )
    read_log(file, _xy())


@cache
def _xy() -> object:
    from gantrysim import Machine

    return Machine("xy")


@cache
def _record() -> bytes:
    from support.guided import _records

    return _records()[0]


def record(rng: random.Random, folder: Path) -> None:
    from gantrysim import Run

    from support.damage import inside, members, raw

    draw = np.random.default_rng(rng.randrange(1 << 30))
    content = raw(draw, _record()) if rng.random() < 0.5 else inside(draw, members(_record()))
    (folder / "run.npz").write_bytes(content)
    run = Run.load(folder / "run.npz")
    assert np.isfinite(run.nozzle).all()


# A servo's gains in the parameters of each dialect, written by hand: an export refuses gains that its controller lacks.
GAINS = {
    "softmc": "x.KPP = 30\nx.KVP = 2.5\ny.KPP = 28 ' comment\ny.KVP = 2\n",
    "linuxcnc": "setp pid.x.Pgain 50\nsetp pid.x.Dgain 0.5 # comment\nsetp pid.y.Pgain 40\nsetp pid.y.FF1 1\n",
    "linuxcnc-ini": "[JOINT_0]\nP = 50\nI = 0\nD = 0.5\nFF1 = 1\n[JOINT_1]\nP = 48 # comment\nFF1 = 1\n",
    "trio": "BASE(0)\nP_GAIN = 1.5\nD_GAIN = 0.2\nP_GAIN AXIS(1) = 1.4 ' comment\nVFF_GAIN AXIS(1) = 3\n",
    "fanuc": "%\nN01825Q1 A1P3000 A2P2900\n%\n",
}


def gains(rng: random.Random, folder: Path) -> None:
    from gantrysim import Servo
    from gantrysim.exchange.gains import import_gains

    name = rng.choice(list(GAINS))
    axes = _xy().axes
    import_gains(name, changed(rng, GAINS[name]), axes, Servo.derive(axes), "gains")


KINDS: dict[str, tuple[int, Callable[[random.Random, Path], None]]] = {
    "--set": (20, settings_of_a_job),
    "job files": (10, job_file),
    "studies": (10, study),
    "MJCF": (12, mjcf),
    "machine tables": (6, machine_table),
    "programs": (16, program),
    "drawings": (10, drawing),
    "traces": (5, trace),
    "logs": (4, log),
    "records": (5, record),
    "gains": (2, gains),
}


def _alarm(number: int, frame: object) -> None:
    raise TooSlowError(f"longer than {SLOWEST} s")


def attempt(kind: str, seed: int) -> str:
    """Return "read", "refused", or what is wrong: the traceback of another error, a long message, files left behind."""
    from gantrysim.base.errors import InputError

    rng = random.Random(f"{kind} {seed}")
    said = io.StringIO()
    before, sys.stderr = sys.stderr, said
    for timer in (signal.SIGALRM, signal.SIGPROF):
        signal.signal(timer, _alarm)
    with tempfile.TemporaryDirectory() as name, warnings.catch_warnings():
        warnings.simplefilter("error")
        signal.setitimer(signal.ITIMER_PROF, SLOWEST)
        signal.setitimer(signal.ITIMER_REAL, _WAITING)
        try:
            KINDS[kind][1](rng, Path(name))
            outcome = "read"
        except InputError as error:
            text = str(error)
            outcome = (
                "refused" if "\n" not in text and len(text) < LONGEST else f"message of {len(text)}: {text[:300]!r}"
            )
        except BaseException:
            outcome = traceback.format_exc()
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0)
            signal.setitimer(signal.ITIMER_REAL, 0)
            sys.stderr = before
        names = [path.name for path in Path(name).iterdir()]
    if len(names) > 1:
        outcome += f"; left behind: {names}"
    return outcome if outcome in ("read", "refused") else f"{said.getvalue()[:300]}\n{outcome}"


def prepare() -> None:
    """Import and compile what the inputs call: an alarm within an import leaves half a module behind."""
    from gantrysim.job.job import Job

    for name in ("an225", "fanuc-spiral", "linuxcnc-flanges", "softmc-arc", "stage-outline", "trio-basic", "delta-arc"):
        Job.load(name).plan()
    draw = random.Random(0)
    for _, read in KINDS.values():
        for _ in range(3):
            with tempfile.TemporaryDirectory() as folder, suppress(Exception):
                read(draw, Path(folder))


def drawn(seed: int) -> str:
    """The kind of the input of a seed, in the kinds' proportions."""
    return random.Random(seed).choices(list(KINDS), [weight for weight, _ in KINDS.values()])[0]


if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parents[1]))
    first, count = int(sys.argv[1]), int(sys.argv[2])
    prepare()
    counts: Counter[tuple[str, str]] = Counter()
    for seed in range(first, first + count):
        kind = sys.argv[3] if len(sys.argv) > 3 else drawn(seed)
        begun = time.process_time()
        outcome = attempt(kind, seed)
        taken = time.process_time() - begun
        counts[kind, outcome if outcome in ("read", "refused") else "FAILED"] += 1
        if outcome not in ("read", "refused"):
            print(f"=== {kind} {seed} {taken:.1f} s\n{outcome[-1800:]}", flush=True)
        elif taken > SLOWEST / 3:
            print(f"--- slow: {kind} {seed} {taken:.1f} s {outcome}", flush=True)
    for key, number in sorted(counts.items()):
        print(*key, number)
