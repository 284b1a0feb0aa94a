"""Glue of every kind of dispenser, on machines that follow their programs exactly: no servo, no scatter."""

import tomllib
from pathlib import Path

from gantrysim.glue.bead import Bead
from gantrysim.job.job import Job
from gantrysim.job.programs import build
from gantrysim.metrics.analysis import Analysis, Range
from gantrysim.metrics.budget import Budget
from gantrysim.results.glue import dot_verdicts
from gantrysim.results.run_results import RunResults
from gantrysim.results.verdict import limits_with, places_of

# two strokes of 30 and 20 mm at 30 mm/s, of which the first turns a corner
STROKES = "G21 G90 G61\nF1800\nG0 X10 Y10\nG1 X30\nG1 Y20\nG0 X10 Y30\nG1 X30\nM2\n"
# lines 1.5 mm apart, as of a filling
HATCH = "G21 G90 G61\nF1800\nG0 X10 Y10\nG1 X30\nG1 Y11.5\nG1 X10\nG1 Y13\nG1 X30\nM2\n"
# over its own bead, and back along it
CROSSING = "G21 G90 G61\nF1800\nG0 X10 Y10\nG1 X30\nG1 Y20\nG1 X20\nG1 Y5\nM2\n"
DOT = "M3\nG4 P{}\nM5\n"
DOTS = "G21 G90\nF1800\nM5\n" + "".join(
    f"G0 X{x} Y10\n{DOT.format(time)}" for x, time in ((10, 0.1), (15, 0.15), (16.5, 0.1))
)
FED = ";FLAVOR:Marlin\nM83\nG1 X10 Y10 F3000\nG1 X30 E0.4 F1800\nG1 E-0.5\nG1 X40 F6000\nG1 E0.5 F1800\nG1 X60 E0.4\n"
CONE = {
    "controller": "trio.MoveSpiral",
    "diameter": 30.0,
    "turns": 3,
    "thickness": 3.0,
    "speed": 60.0,
    "loop_period": 0.02,
    "acceleration": 1000.0,
}

PROGRAMS = {"strokes": STROKES, "hatch": HATCH, "crossing": CROSSING, "dots": DOTS, "fed": FED, "spiral": CONE}
# a program and tables of a job for each case
DISPENSERS = tomllib.loads((Path(__file__).parent / "dispensers.toml").read_text(encoding="utf-8"))


ROUNDING = 1e-6  # of a limit


def program_of(text):
    """The table of a program, by its text."""
    if isinstance(text, dict):
        return text
    return {"controller": "slicer.Program" if text == FED else "linuxcnc.Program", "text": text, "acceleration": 1000.0}


def job_of(name, text, **tables):
    program = program_of(text)
    values = {key: value for key, value in program.items() if key != "controller"}
    machine = "xyz" if "z" in build(program["controller"], values).axes else "xy"
    content = {"name": name, "machine": machine, "program": program, **tables}
    return Job.of_content(content, f"job {name}")


def rows_of(row):
    """Every check of a row of the verdict, in words and as numbers."""
    # where a value is rounding, so are its sign and its place
    checks = [
        [check.brief, str(check.place), check.state, check.value, check.usage]
        if check.usage > ROUNDING
        else [check.name, check.state]
        for check in row.checks
    ]
    return {"state": row.state, "remark": row.remark, "checks": checks}


def spread(values):
    """The values of a bead, of a range its mean, least and largest."""
    found = {name: value for name, value in vars(values).items() if value is not None}
    return {
        name: [value.mean, value.min, value.max] if isinstance(value, Range) else value for name, value in found.items()
    }


def answer(name):
    tables = dict(DISPENSERS[name])
    job = job_of(name.replace(",", ""), PROGRAMS[tables.pop("program")], **tables)
    run = job.follow()
    analysis = Analysis(run)
    bead = Bead(run, job.bead, analysis)
    results = RunResults(job, job.built_machine, Budget(analysis), bead)
    verdict = results.verdict
    flow = run.flow
    every = max(1, len(flow) // 6)
    found = {
        "duration": run.time[-1],
        "flow": flow[::every],
        "volume": float(flow.sum() * run.period),
        "demanded": float(run.flow_demand.sum() * run.period),
        "bead": None if results.bead_values is None else spread(results.bead_values),
        "glue": rows_of(verdict["glue"]),
        "stall": verdict.stall,
        "headline": verdict.headline,
        "notes": list(job.notes),
    }
    if bead.width.size:
        some = slice(None, None, max(1, bead.width.size // 6))
        found |= {"width": bead.width[some], "height": bead.map.height.max(), "wet": int((bead.map.height > 0).sum())}
    if results.dots:
        tolerance = limits_with(job, bead)
        verdicts = dot_verdicts(bead, tolerance, places_of(run, lambda _: None))
        found["dots"] = [[dot.dot.volume, dot.dot.diameter] for dot in verdicts]
    return found


CASES = {name: lambda name=name: answer(name) for name in DISPENSERS}
