"""Logs as they are read, fits to logs of axes that are known, what is said of spoiled logs, and dispensers."""

import math
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from pinned.runs import digits

from gantrysim import InputError, Machine
from gantrysim.identify.checks.units import inertia_hint, position_slips, torque_slips
from gantrysim.identify.dispenser.identification import identify_dispenser
from gantrysim.identify.dispenser.measurements import needle_of, read_measurements
from gantrysim.identify.dispenser.output import tables_text
from gantrysim.identify.identification import identify
from gantrysim.identify.instants import instants_of
from gantrysim.identify.log import Rows, read_log
from gantrysim.identify.plan import CONTROLLERS, excitation, strokes

from support.identification_logs import MACHINE, random_log

RATE = 1e-3  # period of the logs [s]
TURNING = Machine("xyzr")


def refusal(answer):
    try:
        return answer()
    except InputError as error:
        return str(error)


def log_text(heads, columns, rows=120, sign=","):
    """A table whose columns are functions of the time."""
    times = RATE * np.arange(rows)
    values = [np.broadcast_to(column(times), times.shape) for column in columns]
    lines = [sign.join(f"{value:.9g}" for value in row) for row in zip(*values, strict=True)]
    return "\n".join([sign.join(heads), *lines]) + "\n"


def seconds(t):
    return t


def position(t):
    return 0.02 * np.sin(40 * t)


def speed(t):
    return 0.8 * np.cos(40 * t)


def torque(t):
    return 0.05 + t


def twice(function, factor=2.0):
    return lambda t: factor * function(t)


def stamps(period, digits_of=9):
    return lambda t: np.round(t / RATE * period, digits_of)


PLAIN = log_text(["time [s]", "x position [mm]", "x torque [N·m]"], [seconds, position, torque])
BOTH = ["time", "x position", "x velocity", "x torque"]


def with_rows(text, change):
    lines = text.splitlines()
    return "\n".join([lines[0], *change(lines[1:])]) + "\n"


# text, columns that are named, and what else is given
LOGS = {
    "plain": (PLAIN,),
    "in SI": (log_text(["t", "x_position", "X torque"], [seconds, position, torque]), {"time": "t"}),
    "units in heads": (
        log_text(["time [ms]", "x position [um]", "x torque [mN*m]"], [twice(seconds, 1e3), position, torque]),
    ),
    "motor's turns": (log_text(["time", "x position [rev]", "x demand"], [seconds, position, torque]),),
    "counts": (log_text(["time", "x position [counts]", "x demand"], [seconds, twice(position, 1e5), torque]),),
    "degrees": (log_text(["time", "r position", "r torque"], [seconds, position, torque]), {}, {"machine": TURNING}),
    "demand and torque": (
        log_text(["time", "x position", "x demand", "x torque"], [seconds, position, torque, twice(torque)]),
    ),
    "torque that is named": (
        log_text(["time", "x position", "x demand", "I"], [seconds, position, torque, twice(torque)]),
        {"x torque": "I*0.0302 N·m"},
    ),
    "two axes, one torque": (
        log_text(["time", "x position", "y position", "x torque"], [seconds, position, position, torque]),
    ),
    "mixed torques": (
        log_text(
            ["time", "x position", "y position", "x torque", "y demand"], [seconds, position, position, torque, torque]
        ),
    ),
    "velocity": (log_text(["time", "x velocity", "x torque"], [seconds, speed, torque]),),
    "velocity, with a gap": (
        with_rows(
            log_text(["time", "x velocity", "x torque"], [seconds, speed, torque]), lambda rows: rows[:80] + rows[85:]
        ),
    ),
    "velocity in rpm": (log_text(["time", "x velocity [rpm]", "x torque"], [seconds, twice(speed, 60), torque]),),
    "velocity in counts": (log_text(["time", "x velocity [counts/s]", "x torque"], [seconds, speed, torque]),),
    "both agree": (log_text(BOTH, [seconds, position, speed, torque], 600),),
    "both, near the bound": (log_text(BOTH, [seconds, position, twice(speed, 1.09), torque], 600),),
    "both, 1000 times": (log_text(BOTH, [seconds, position, twice(speed, 1e3), torque], 600),),
    "both, 12 % too much": (log_text(BOTH, [seconds, position, twice(speed, 1.12), torque], 600),),
    "both, another motion": (log_text(BOTH, [seconds, position, lambda t: 0.8 * np.sin(40 * t), torque], 600),),
    "both, at rest": (log_text(BOTH, [seconds, twice(position, 0), twice(speed, 0), torque], 600),),
    "both, short": (log_text(BOTH, [seconds, position, speed, torque]),),
    "position named, velocity in a head": (
        log_text(["time", "P", "x velocity", "x torque"], [seconds, position, twice(speed), torque], 600),
        {"x position": "P [m]"},
    ),
    "exported": (
        log_text(["time_s", "encoder_x_mm", "demand_x_Nm", "torque_x_Nm"], [seconds, position, torque, torque]),
    ),
    "no time": (log_text(["x position", "x torque"], [position, torque]),),
    "a period": (log_text(["x position", "x torque"], [position, torque]), {}, {"period": 5e-4}),
    "a period of 0": (PLAIN, {}, {"period": 0.0}),
    "samples": (
        log_text(["n", "x position", "x torque"], [twice(seconds, 1e3), position, torque]),
        {"time": "n [samples]"},
        {"period": 2e-3},
    ),
    "no torque": (log_text(["time", "x position"], [seconds, position]),),
    "no motion": (log_text(["time", "x torque"], [seconds, torque]),),
    "an unknown column": (PLAIN, {"q position": "time"}),
    "a lost column": (PLAIN, {"x position": "P"}),
    "a wrong unit": (PLAIN, {"x position": "x torque [N·m] [mm]"}),
    "rows": (PLAIN, {}, {"rows": Rows.parse("11:115")}),
    "too few rows": (PLAIN, {}, {"rows": Rows.parse(":99")}),
    "rows beyond": (PLAIN, {}, {"rows": Rows.parse("20:121")}),
    "a gap": (with_rows(PLAIN, lambda rows: rows[:30] + rows[33:]),),
    "an empty cell": (with_rows(PLAIN, lambda rows: [*rows[:25], rows[25].rpartition(",")[0] + ",", *rows[26:]]),),
    "a short piece": (with_rows(PLAIN, lambda rows: rows[:15] + rows[17:]),),
    "begun anew": (with_rows(PLAIN * 1, lambda rows: rows[:60] + rows[:60]),),
    "uneven": (with_rows(PLAIN, lambda rows: [*rows[:40], rows[40].replace("0.04,", "0.0402,", 1), *rows[41:]]),),
    "nearly even": (with_rows(PLAIN, lambda rows: [*rows[:40], rows[40].replace("0.04,", "0.04009,", 1), *rows[41:]]),),
    "time that stands": (with_rows(PLAIN, lambda rows: [*rows[:40], "0.039" + rows[40][4:], *rows[41:]]),),
    "rounded stamps": (
        log_text(["time", "x position", "x torque"], [stamps(RATE, 2), position, torque], 240),
        {},
        {"period": RATE},
    ),
    "stamps of another period": (
        log_text(["time", "x position", "x torque"], [stamps(1.03e-3), position, torque], 240),
        {},
        {"period": RATE},
    ),
    "stamps of nearly the period": (
        log_text(["time", "x position", "x torque"], [stamps(1.009e-3), position, torque], 240),
        {},
        {"period": RATE},
    ),
}


def read(text, columns=None, given=None):
    given = dict(given or {})
    machine = given.pop("machine", MACHINE)

    def answer():
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "log.csv"
            file.write_text(text, encoding="utf-8")
            try:
                log = read_log(file, machine, columns, **given)
            except InputError as error:
                return str(error).replace(f"{folder}/", "")
        return {
            "axes": [*log.axes, "demand" if log.held else "torque"],
            "period": log.period,
            "rows": [len(log.position), *log.starts, *log.begins],
            "position": log.position[[1, -1]].ravel(),
            "torque": log.torque[[1, -1]].ravel(),
            "notes": log.notes,
            "longest": [len(log.longest.position), *log.longest.notes[len(log.notes) :]],
        }

    return answer()


def instants():
    """Bounds of instants that tables cannot show well: neither time nor period, and gaps beside rounded stamps."""
    whole = np.ones(200, bool)
    even = RATE * np.arange(200)
    late = np.where(np.arange(200) < 90, even, even + 0.49e-3)
    later = np.where(np.arange(200) < 90, even, even + 0.51e-3)
    torn = whole.copy()
    torn[[30, 31, 60, 95, 130, 160]] = False
    answers = [
        refusal(lambda: instants_of(whole, None, None)),
        instants_of(torn, None, RATE),
        instants_of(torn, even, None),
        refusal(lambda: instants_of(whole, late, None)),
        instants_of(whole, later, None),
        instants_of(whole, np.round(later, 3), RATE),
        refusal(lambda: instants_of(whole[:99], even[:99], None)),
        refusal(lambda: instants_of(whole & (np.arange(200) % 19 > 0), even, None)),
        instants_of(whole & (np.arange(200) % 21 > 0), even, None),
    ]
    return [str(answer) for answer in answers]


def rows_answer():
    texts = ("3:", ":7", "3:7", ":", "0:7", "7", "a:b", "-1:3", " 4 : 9 ")
    return {text: refusal(lambda text=text: list(Rows.parse(text))) for text in texts}


def part(log, rows, first=0):
    chosen = slice(first, first + rows)
    return replace(log, position=log.position[chosen], torque=log.torque[chosen])


def known_log(seed, law, rows=4000, **given):
    return part(random_log(seed, law, slip="", period=given.pop("period", RATE), noise=2e-3, **given).log, rows)


def with_gap(log):
    """The log without 40 rows in its middle."""
    middle = len(log.position) // 2
    chosen = np.r_[0:middle, middle + 40 : len(log.position)]
    return replace(
        log,
        position=log.position[chosen],
        torque=log.torque[chosen],
        starts=(0, middle),
        begins=(0.0, (middle + 40) * log.period),
    )


# of three axes, and the last one as its motor's torque
FITS = {
    "stribeck": lambda: known_log(1, "stribeck"),
    "load, with a gap": lambda: with_gap(known_log(5, "load", 3400)),
    "asymmetric, as a torque": lambda: replace(known_log(4, "asymmetric", 3000), held=False),
    "every other row": lambda: known_log(2, "lugre", 2000, period=2e-3),
}


def fit_answer(name):
    found = identify(MACHINE, FITS[name]())
    rows = {
        value.name: [
            value.value,
            0.5 * (value.high - value.low),
            value.nominal,
            value.unit,
            value.reason or value.identified,
        ]
        for value in found.values
    }
    return {
        "values": digits(rows, 5),
        "notes": found.notes,
        "unidentified": found.unidentified,
        "adopted": [sorted(names) for names in found.adopted],
    }


def spoiled_answers():
    """What is said of logs whose errors lie at the bounds of the checks."""
    log = known_log(1, "coulomb", 3000)
    peak = MACHINE.axes[1].peak_torque
    largest = float(np.abs(log.torque).max())
    still = log.position.copy()
    still[1000:1200] = still[1000]
    jump = log.position.copy()
    jump[1500:] += 0.4
    changes = {
        "torque beyond the peak": {"torque": log.torque * (1.201 * peak / largest)},
        "torque in ozf·in": {"torque": log.torque * 141.6},
        "torque in lbf·in": {"torque": log.torque * 8.851},
        "torque in N·cm": {"torque": log.torque * 100},
        "position in turns": {"position": log.position / 10},
        "position in degrees of the motor": {"position": log.position * 36},
        "position in counts": {"position": log.position * 1000},
        "time in ms": {"period": 1.0},
        "torque backwards": {"torque": -log.torque},
        "no torque": {"torque": np.zeros_like(log.torque)},
        "one way": {"position": np.cumsum(np.abs(np.diff(log.position, axis=0, prepend=0.0)), axis=0) / 50},
        "few counts": {"position": np.round(log.position / 200) * 0.001},
        "one speed": {"position": 20 * np.abs(((np.arange(3000) * RATE)[:, None] % 0.4) - 0.2)},
        "standing": {"position": still},
        "a jump": {"position": jump},
        "early": {"torque": np.roll(log.torque, -30)},
        "of noise": {"torque": np.random.default_rng(3).standard_normal((3000, 1)) * 0.1},
        "swapped": {"position": log.torque, "torque": log.position},
        "short": {"position": log.position[:499], "torque": log.torque[:499]},
    }
    return {name: refused_by(lambda values=values: fitted(log, values)) for name, values in changes.items()}


def fitted(log, values):
    return identify(MACHINE, replace(log, **values))


def refused_by(answer):
    found = refusal(answer)
    return found if isinstance(found, str) else "is fitted"


def slips():
    """Confusions that are named for factors of an inertia, of slides and of turning axes."""
    factors = (1e-6, 1e-3, 0.03, 0.07, 0.1, 0.2, 0.7, 5.0, 8.9, 20.0, 33.0, 100.0, 141.0, 645.0, 1e3, 1e6, 1e12)
    axes = {"x": MACHINE.axes[0], "r": TURNING.axes[3]}
    answers = {
        f"{name}, {factor:g}": [
            ", ".join(torque_slips(axis, factor)),
            ", ".join(position_slips(axis, factor)),
            inertia_hint(axis, factor),
        ]
        for name, axis in axes.items()
        for factor in factors
    }
    return {name: [text for text in texts if text] for name, texts in answers.items()}


def plan_answer(name, controller):
    def answer():
        text, suffix = excitation(Machine(name), controller)
        lines = text.splitlines()
        return {"lines": [*lines[:16], *lines[-4:]], "count": len(lines), "suffix": suffix}

    return refusal(answer)


def strokes_answer():
    moves = strokes(MACHINE)
    return [len(moves), *([move.distance, move.speed, move.acceleration] for move in moves[:14])]


WEIGHTS = "pressure [kPa],time [s],mass [mg]\n100,60,33.2\n200,30,52.5\n300,20,68.3\n400,15,84.1\n500,10,80.2\n"
DISPENSERS = {
    "pressures": (WEIGHTS, {"density": 1.2, "needle": (0.41, 12.7)}),
    "pressures without a needle": (WEIGHTS, {"density": 1.2}),
    "no density": (WEIGHTS, {}),
    "a density of 0": (WEIGHTS, {"density": 0.0}),
    "a pump": ("pump speed [rpm],time [s],mass [mg]\n10,20,160\n20,20,322\n40,20,640\n80,20,1284\n", {"density": 1.2}),
    "a pump of one speed": ("pump speed [rpm],time [s],mass [mg]\n10,20,160\n10,20,161\n10,20,160\n", {"density": 1.2}),
    "a piston": ("plunger speed [mm/s],time [s],mass [g]\n1,10,1.21\n2,10,2.39\n4,5,2.42\n", {"density": 1.2}),
    "a jet": ("drops,mass [mg]\n100,48.1\n200,96.3\n400,192.2\n800,384.9\n", {"density": 1.2}),
    "two kinds": ("pump speed [rpm],drops,time [s],mass [mg]\n1,100,2,3\n", {"density": 1.2}),
    "two densities": ("time [s],mass [mg],density [g/cm3]\n1,2,1.2\n2,4,1.3\n", {}),
    "no unit": ("time,mass [mg]\n1,2\n", {"density": 1.2}),
    "an empty row": ("time [s],mass [mg],pressure [kPa]\n1,2,100\n,,\n2,4,\n", {"density": 1.2}),
    "nothing": ("time [s],mass [mg]\n,\n", {"density": 1.2}),
    "no measurement": ("speed [mm/s],gap [mm]\n1,2\n", {}),
    "no mass": ("time [s],pressure [kPa]\n1,100\n", {}),
    "falling mass": (WEIGHTS.replace("84.1", "8.4"), {"density": 1.2, "needle": (0.41, 12.7)}),
    "a negative mass": (WEIGHTS.replace("84.1", "-84.1"), {"density": 1.2, "needle": (0.41, 12.7)}),
    "bar as kPa": (WEIGHTS.replace("kPa", "bar"), {"density": 1.2, "needle": (0.41, 12.7)}),
    "an empty pan": (
        "pressure [kPa],time [s],mass [mg]\n100,60,133.2\n200,30,152.5\n300,20,168.3\n400,15,184.1\n500,10,180.2\n",
        {"density": 1.2, "needle": (0.41, 12.7)},
    ),
}


def dispenser_answer(text, given):
    def answer():
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "table.csv"
            file.write_text(text, encoding="utf-8")
            try:
                measured = read_measurements([file], **given)
                found = identify_dispenser(measured)
            except InputError as error:
                return str(error).replace(f"{folder}/", "")
        values = {
            value.name: [value.value, *(end for end in (value.low, value.high) if math.isfinite(end)), value.unit]
            for value in found.values
        }
        return {
            "values": digits(values),
            "reasons": {value.name: value.reason for value in found.values if value.reason},
            "notes": found.notes,
            "tables": tables_text(found).splitlines(),
        }

    return answer()


def needles():
    texts = ("0.41x12.7", "22Gx12.7", "21g × 6 mm", "0.41", "0x12.7", "99Gx3", "ax3", "0.4x-1")
    return {text: refusal(lambda text=text: list(needle_of(text))) for text in texts}


PLANS = (*(("xy", each) for each in CONTROLLERS), ("xyzr", "linuxcnc"), ("stage", "trio"), ("xy", "a"))
CASES = {f"log, {name}": lambda given=given: read(*given) for name, given in LOGS.items()}
CASES |= {f"fit, {name}": lambda name=name: fit_answer(name) for name in FITS}
CASES |= {f"dispenser, {name}": lambda given=given: dispenser_answer(*given) for name, given in DISPENSERS.items()}
CASES |= {
    f"plan of {name} for {controller}": lambda name=name, controller=controller: plan_answer(name, controller)
    for name, controller in PLANS
}
CASES |= {
    "instants": instants,
    "rows": rows_answer,
    "spoiled": spoiled_answers,
    "slips": slips,
    "strokes": strokes_answer,
    "needles": needles,
}
