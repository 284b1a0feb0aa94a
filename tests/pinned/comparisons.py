"""What is said of traces with known faults beside a run: of clock, place, scale, speed, axes, gaps."""

import math
import tempfile
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from pinned.runs import digits
from scipy.interpolate import CubicSpline

from gantrysim import InputError, Machine
from gantrysim.compare.alignment import (
    Alignment,
    Motion,
    Timing,
    alignment_words,
    estimate_rows,
    timing_of,
)
from gantrysim.compare.comparison import Comparison
from gantrysim.compare.equal_times import apart_shifts, check_duration, places, turned_points
from gantrysim.compare.estimates import Estimate
from gantrysim.compare.measured import Assignment, Trace
from gantrysim.compare.over_time import frictionless_run
from gantrysim.compare.page import headline, share_text
from gantrysim.compare.vertices import Vertices, noise_of, starts, vertices
from gantrysim.tables.reading import read_table

from support.compared import circle_job

PART = "G21 G17 G90\nF3000\nG0 X4 Y0\nM62 P0\nG1 X20\nG1 Y10\nG3 X10 Y20 I-10 J0\nG1 X2\nM63 P0\nG0 X0\nM2\n"
NOISE = 1e-3  # of every trace [mm]; without, what is left is rounding
LATE = 0.37  # of every trace [s]
RATE = 500.0  # of the samples [Hz]
BOTH = ("time", "offset", "rotation")
MACHINE = Machine("xy")


@cache
def part_job():
    return circle_job(text=PART)


@cache
def part_run():
    return part_job().run()


@cache
def contrast():
    job = part_job()
    return frictionless_run(part_run(), job.built_machine, job.built_servo)


def positions_of(link, at, seed):
    run = part_run()
    values = CubicSpline(run.time, getattr(run, link), axis=0)(np.clip(at, 0.0, run.time[-1]))
    return values + NOISE * np.random.default_rng(seed).standard_normal(values.shape)


def trace(
    links=("nozzle",),
    *,
    begin=0.0,
    end=1.0,
    rate=RATE,
    clock=0.0,
    speed=1.0,
    offset=0.0,
    turn=0.0,
    scale=1.0,
    order=None,
    lost=(),
    shake=0.0,
    flat=False,
    torque=0.0,
    late=LATE,
):
    """A trace of the run with faults.

    Args:
        links: that are measured.
        begin: share of the run's duration at which it begins.
        end: the same of its end.
        rate: of the samples [Hz].
        clock: rate of the trace's clock less 1.
        speed: of the trace, over that of the run.
        offset: of every link [mm].
        turn: of the nozzle about z [deg].
        scale: of the axes.
        order: of the first two axes, with signs as (axis, axis, sign, sign).
        lost: samples without a row.
        shake: amplitude of a vibration of the nozzle at 60 Hz [mm].
        flat: whether z is not measured.
        torque: error of the demand, which is measured where it is not zero [N·m].
        late: time of the trace less that of the run [s].
    """
    run = part_run()
    at = np.arange(begin * run.time[-1] + 1.1e-4, end * run.time[-1], speed / rate)
    at = np.delete(at, list(lost))
    time = (1 + clock) * at / speed + late
    found = {}
    for seed, link in enumerate(links):
        values = positions_of(link, at, seed)
        values = values * scale
        if link == "nozzle":
            values = turned_points(values, math.radians(turn))
            values[:, :2] += shake * np.sin(2 * np.pi * 60.0 * at)[:, None]
            if flat:
                values[:, 2] = np.nan
        if order is not None:
            first, second, *signs = order
            values[:, :2] = values[:, [first, second]] * signs
        found[link] = values + offset
    nozzle = found.pop("nozzle", None)
    tick = np.searchsorted(run.time, at, side="right") - 1
    torques = {"demand": run.demand[tick] + torque * np.cos(9.0 * at)[:, None]} if torque else {}
    return Trace(time, found, nozzle, (), torques)


def refusal(answer):
    try:
        return answer()
    except InputError as error:
        return str(error)


def compared(given, what=("path", "offset", "rotation"), friction=False):
    def answer():
        run = part_run()
        comparison = Comparison.of(given, run, MACHINE, what, contrast() if friction else None)
        alignment = comparison.alignment
        timing = alignment.timing
        summary = comparison.summary()
        left = summary["unexplained"].values()
        return {
            "words": alignment_words(alignment, run),
            "rows": [" ".join(map(cell, row)) for row in estimate_rows(alignment, run)],
            "notes": list(comparison.notes),
            "headline": headline(comparison),
            "timing": None if timing is None else [timing.kind, timing.speed, timing.duration, timing.middle],
            "left": [list(sizes.values()) for sizes in left],
            "without friction": digits(summary["explained_without_friction"]),
            "over time": [" ".join(map(cell, row.values())) for row in summary["over_time"]],
            "noise": [comparison.is_all_noise, *(row.is_noise for row in comparison.over_time)],
            "peaks": [[peak.frequency, peak.rms] for peak in comparison.peaks],
        }

    return refusal(answer)


def cell(value):
    return f"{value:.3g}" if isinstance(value, float) else str(value)


ALL = ("commanded", "encoder", "nozzle")
TRACES = {
    "as it is": {},
    "every link": {"links": ALL, "offset": 2.0, "torque": 4e-3},
    "the encoder": {"links": ("encoder",), "offset": np.array([5.0, -3.0])},
    "the command of a part": {"links": ("commanded",), "end": 0.4},
    "an offset in y": {"offset": np.array([0.0, 0.02, 0.0])},
    "a small turn": {"turn": 0.3, "offset": np.array([1.0, 2.0, 0.0])},
    "a large turn": {"turn": 25.0, "offset": np.array([-40.0, 2.0, 0.0])},
    "flat": {"flat": True, "turn": -0.4},
    "a fast clock": {"clock": 9e-4},
    "a slow clock": {"clock": -1.6e-3},
    "no clock": {"clock": 2.2e-3},
    "slower": {"speed": 0.8},
    "faster, the encoder": {"links": ("encoder",), "speed": 1.25},
    "x too long": {"scale": np.array([1.003, 1.0, 1.0])},
    "y too short": {"links": ("encoder",), "scale": np.array([1.0, 0.995])},
    "a scale of 1.019": {"scale": np.array([1.019, 1.0, 1.0])},
    "a scale of 1.021": {"scale": np.array([1.021, 1.0, 1.0])},
    "twice as wide": {"links": ("encoder",), "scale": 2.04},
    "swapped, y mirrored": {"order": (1, 0, 1, -1)},
    "the second half": {"begin": 0.45},
    "a few samples": {"begin": 0.3, "end": 0.4, "rate": 400.0},
    "gaps": {"lost": (50, 51, 52, 200)},
    "a vibration": {"links": ("encoder", "nozzle"), "shake": 5e-3},
}
TIMED = (
    "as it is",
    "every link",
    "an offset in y",
    "a large turn",
    "a fast clock",
    "a slow clock",
    "y too short",
    "the second half",
)
MIRRORED = {
    "x mirrored": {"order": (0, 1, -1, 1)},
    "y mirrored": {"order": (0, 1, 1, -1)},
    "both mirrored": {"order": (0, 1, -1, -1)},
    "swapped": {"order": (1, 0, 1, 1)},
    "swapped and both mirrored": {"order": (1, 0, -1, -1)},
    "the encoder swapped": {"links": ("encoder",), "order": (1, 0, 1, 1)},
    "the encoder's y mirrored": {"links": ("encoder",), "order": (0, 1, 1, -1)},
    "another path": {"links": ("encoder",), "scale": np.array([0.3, 1.0]), "order": (0, 1, 1, 1)},
}


def motion(to_trace, speed=50.0, feed=True, noise=1e-6):
    """Samples of a run that speeds up, goes steadily and slows down, with the trace's time of each instant."""
    instants = np.linspace(0.0, 4.0, 801)
    course = speed * np.clip(np.minimum(instants, 4.0 - instants), 0.0, 1.0)
    time = to_trace(instants) + noise * np.random.default_rng(1).standard_normal(instants.size)
    dispense = (instants > 1.0) & (instants < 3.0) & feed
    return Motion(time, instants, course, np.gradient(course, instants), course < 1e-6, dispense)


# times of a trace by those of the run, on both sides of what is still a clock, or the same speed
COURSES = {
    "late": lambda t: t + 0.2,
    "clock": lambda t: 1.0015 * t,
    "clock at its bound": lambda t: 1.00195 * t,
    "beyond a clock": lambda t: 1.00205 * t,
    "slow clock": lambda t: 0.99805 * t,
    "slower than a clock": lambda t: 0.99795 * t,
    "lags a little": lambda t: t + 0.006 * (abs(t - 2.0) < 0.5),
    "lags": lambda t: t + 0.012 * (abs(t - 2.0) < 0.5),
    "half as fast": lambda t: 2.0 * t - 1.0,
    "stops": lambda t: t + 1.0 * (t > 2.0),
}


def timings():
    answers = {name: timing_of(motion(course), 1e-3) for name, course in COURSES.items()}
    answers["dry"] = timing_of(motion(COURSES["half as fast"], feed=False), 1e-3)
    answers["rough"] = timing_of(motion(COURSES["lags"]), 0.08)
    answers["not so rough"] = timing_of(motion(COURSES["lags"]), 0.06)
    answers["few"] = timing_of(Motion(*(values[28:36] for values in motion(COURSES["late"]))), 1e-3)
    answers["fewer"] = timing_of(Motion(*(values[28:35] for values in motion(COURSES["late"]))), 1e-3)
    return {
        name: None if timing is None else [timing, timing.instants(np.array([0.5, 3.0]))]
        for name, timing in answers.items()
    }


def words_of(timing=None, criterion="path", by="nozzle", axes=("x", "c"), **changes):
    given = {
        "shift": -0.25,
        "offsets": {},
        "rotation": 0.0,
        "residual": 1.26e-3,
        "estimates": {},
    } | changes
    alignment = Alignment(by=by, criterion=criterion, instants=np.zeros(0), timing=timing, **given)
    run = SimpleNamespace(axes=axes, units=tuple("deg" if axis == "c" else "mm" for axis in axes))
    return [alignment_words(alignment, run), [list(row) for row in estimate_rows(alignment, run)]]


ESTIMATES = {
    "time": Estimate(-0.25, 1e-4),
    "clock": Estimate(3e-5, 2e-5),
    "axes x": Estimate(0.0123, 0.004),
    "axes c": Estimate(-0.5, math.inf),
    "nozzle z": Estimate(0.2, 0.1),
    "nozzle y": Estimate(-0.2001, 0.1),
    "rotation": Estimate(-0.03, 0.4),
}
SEEN = {"rotation": Estimate(1.0, math.inf), "nozzle x": Estimate(0.0, 1e-9)}


def words():
    fast = Timing("clock", Estimate(-0.25, 1e-9), Estimate(4e-5, 3e-7), 1.0, None, 1.0)
    return {
        "all": words_of(
            Timing("shift", Estimate(-0.25, 1e-4), Estimate(0.0, 1.0), 1.0, None, 1.0), estimates=ESTIMATES
        ),
        "of two units": words_of(by="encoder", criterion="time", noise=1.1e-5),
        "of degrees": words_of(by="encoder", axes=("c",), noise=0.9e-5),
        "a clock": words_of(fast, estimates=SEEN, axes=("x",)),
        "other speeds": words_of(Timing("speed", Estimate(0.0, 0.0), Estimate(0.0, 0.0), 1.0, None, 1.23456)),
    }


def columns_of(text, assignment=""):
    """The links that a log has, their first rows, and notes."""

    def answer():
        given = Assignment.parse(assignment) if assignment else Assignment({})
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "log.csv"
            file.write_text(text, encoding="utf-8")
            found = Trace.of(replace(read_table(file), label="log"), given, part_run())
        measured = {**found.axes, **found.torques} | ({} if found.nozzle is None else {"nozzle": found.nozzle})
        return {
            "notes": list(found.notes),
            "time": [len(found.time), *found.time[:2]],
            **{name: values[:2] for name, values in measured.items()},
        }

    return refusal(answer)


def log_of(head, *columns, rows=9):
    """Text of a log: its head, and rows of straight lines by their slopes."""
    lines = [",".join(f"{slope * row:.6g}" for slope in columns) for row in range(rows)]
    return "\n".join([head, *lines]) + "\n"


GAP = "t,x,y\n0,0,0\n0.1,1,\n" + "".join(f"{0.1 * k:.1f},{k},{k}\n" for k in range(2, 11))
LOGS = {
    "a nozzle": (log_of("time [s],nozzle x [mm],nozzle y [mm],nozzle z [um]", 0.01, 1, 2, 500),),
    "plain names": (log_of("t,x [cm],y", 0.01, 1, 2),),
    "x alone": (log_of("t,x", 0.01, 1),),
    "z alone": (log_of("t,z", 0.01, 1),),
    "encoders": (log_of("time,encoder x mm,encoder y mm,torque x,demand x [mN*m]", 0.01, 1, 2, 3, 4),),
    "a command of x": (log_of("t,PCMD x,PFB x,PFB y", 0.01, 1, 2, 3),),
    "a command of y": (log_of("t,commanded y,nozzle x,nozzle y", 0.01, 1, 2, 3),),
    "a machine's log": (log_of("t,x position,y position,y torque", 0.01, 0.001, 0.002, 0.1),),
    "named": (log_of("a,b,c", 0.01, 1, 2), "time=a[ms],encoder.x=b*-1,encoder.y=c[um]"),
    "a period": (log_of("b,c", 1, 2), "encoder.x=b,encoder.y=c"),
    "nothing known": (log_of("a,b,c", 0.01, 1, 2),),
    "an unknown quantity": (log_of("a,b,c", 0.01, 1, 2), "time=a,encoder.z=b"),
    "seven rows": (log_of("t,x,y", 0.01, 1, 2, rows=7),),
    "eight rows": (log_of("t,x,y", 0.01, 1, 2, rows=8),),
    "a gap": (GAP,),
    "time that stands": (log_of("t,x,y", 0.01, 1, 2).replace("0.04,", "0.03,"),),
}


def lengths():
    """What is said of traces by their duration, the run's period and length: from 30 ms to a hundred runs."""
    run = part_run()
    bounds = (30 * run.period, 100 * (run.time[-1] - run.time[0]))
    ends = [bound * factor for bound in bounds for factor in (0.999, 1.001)]
    return [refusal(lambda end=end: check_duration(np.array([0.0, end]), run)) for end in ends]


def zigzag(pitch, count):
    return np.column_stack([pitch * np.arange(count), 2.0 * (np.arange(count) % 2), np.zeros(count)])


def chords():
    """Vertices of paths and of parts of them, and where these begin on them."""
    whole = zigzag(3.0, 31)
    made = vertices(whole, 1.3)
    part = vertices(whole[5:20], 1.3)
    turned = Vertices(part.row, turned_points(part.points, 0.7))
    return {
        "rows": made.row[:12],
        "points": made.points[:4],
        "count": [len(made.row), len(part.row)],
        "starts": starts(part, made, False)[:3],
        "turned": starts(turned, made, True)[:2],
        "noise": [noise_of(np.random.default_rng(2).standard_normal((count, 2))) for count in (4, 5, 400)],
        "apart": [apart_shifts([1.0, 1.1, 0.2, 1.25, 0.21], 0.0, 0.2), apart_shifts([], 0.0, 1.0)],
    }


def found_places(**changes):
    given = trace(**changes)
    run = part_run()
    link = given.links[0]
    measured = given.nozzle if link == "nozzle" else given.axes[link]
    return places(given.time, measured, run, getattr(run, link), link == "nozzle")


CASES = {name: lambda changes=changes: compared(trace(**changes)) for name, changes in TRACES.items()}
CASES |= {f"at equal times, {name}": lambda name=name: compared(trace(**TRACES[name]), BOTH) for name in TIMED}
CASES |= {
    f"at equal times, {name}": lambda changes=changes: compared(trace(**changes), BOTH)
    for name, changes in MIRRORED.items()
}
CASES |= {f"log, {name}": lambda given=given: columns_of(*given) for name, given in LOGS.items()}
CASES |= {
    "courses of time": timings,
    "words": words,
    "lengths": lengths,
    "chords": chords,
    "places": lambda: {
        "encoder": found_places(links=("encoder",)),
        "turned": found_places(turn=40.0),
        "another unit": found_places(links=("encoder",), scale=0.01),
        "a part": found_places(links=("encoder",), begin=0.5, end=0.7),
    },
    "shares": lambda: [share_text(share) for share in (1.0, 0.99999, 0.5004, 0.0004, 0.0, -0.0001, -2.5)],
    "without friction": lambda: compared(trace(ALL, torque=4e-3), friction=True),
    "nothing fitted": lambda: compared(trace(("encoder",), late=0.0, offset=0.01), ()),
    "time and path": lambda: compared(trace(), ("time", "path")),
}
