"""Glue of every kind of dispenser, on machines that follow their programs exactly: no servo, no scatter."""

from gantrysim.glue.bead import Bead
from gantrysim.job.job import Job
from gantrysim.job.programs import build
from gantrysim.metrics.analysis import Analysis
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
DOTS = "G21 G90\nF1800\nM5\nG0 X10 Y10\nM3\nG4 P0.1\nM5\nG0 X15\nM3\nG4 P0.15\nM5\nG0 X16.5\nM3\nG4 P0.1\nM5\nG0 X30\nM2\n"
FED = ";FLAVOR:Marlin\nM83\nG1 X10 Y10 F3000\nG1 X30 E0.4 F1800\nG1 E-0.5 F1800\nG1 X40 F6000\nG1 E0.5 F1800\nG1 X60 E0.4 F1800\n"
CONE = {
    "controller": "trio.MoveSpiral",
    "diameter": 30.0,
    "turns": 3,
    "thickness": 3.0,
    "speed": 60.0,
    "loop_period": 0.02,
    "acceleration": 1000.0,
}
NEEDLE = {"bore": 0.84, "length": 12.0, "consistency": 30.0, "index": 0.6}

CASES_OF_GLUE = {
    "area": (STROKES, {"area": 0.8}),
    "fixed flow": (STROKES, {"flow": 20.0}),
    "lag": (STROKES, {"area": 0.8, "dead_time": 0.01, "opening": 0.03, "closing": 0.05}),
    "lag, leads": (STROKES, {"area": 0.8, "dead_time": 0.01, "opening": 0.03, "closing": 0.05, "start_lead": 0.04, "stop_lead": 0.06}),
    "early leads": (STROKES, {"area": 0.8, "start_lead": 0.03, "stop_lead": 0.03}),
    "lag, advance": (STROKES, {"area": 0.8, "opening": 0.03, "closing": 0.03, "advance": 0.03, "limit": 60.0}),
    "closing dead time": (STROKES, {"flow": 24.0, "dead_time": 0.01, "closing_dead_time": 0.04}),
    "limit": (STROKES, {"area": 0.8, "limit": 20.0}),
    "pressure": (STROKES, {"pressure": 200.0, "metering": "time-pressure", "needle": NEEDLE, "opening": 0.02, "closing": 0.04}),
    "time-pressure": (STROKES, {"area": 0.8, "metering": "time-pressure", "needle": NEEDLE, "opening": 0.02, "closing": 0.02}),
    "yield stress": (STROKES, {"flow": 20.0, "metering": "time-pressure", "needle": {**NEEDLE, "yield_stress": 100.0, "bore": "18G"}, "opening": 0.02, "closing": 0.04}),
    "syringe": (STROKES, {"flow": 20.0, "metering": "time-pressure", "needle": NEEDLE, "syringe": {"fill": 0.4, "dead_volume": 10.0}}),
    "pump": (STROKES, {"kind": "volumetric", "area": 0.8, "needle": NEEDLE, "pump": {"displacement": 40.0, "leak": 0.004, "compliance": 0.002}}),
    "pump, motor": (STROKES, {"kind": "volumetric", "area": 0.8, "needle": NEEDLE, "pump": {"displacement": 40.0}, "motor": {"top_speed": 0.5, "top_acceleration": 5.0, "step": 0.005, "reverses": False}}),
    "pump, stall": (STROKES, {"kind": "volumetric", "area": 0.8, "needle": NEEDLE, "pump": {"displacement": 40.0, "torque": 0.0003}}),
    "piston": (STROKES, {"kind": "piston", "area": 0.8, "needle": NEEDLE, "piston": {"plunger": 16.0, "charge": 5.0, "compliance": 0.01, "bulk_modulus": 800.0}}),
    "piston, advance": (STROKES, {"kind": "piston", "area": 0.8, "advance": 0.1, "needle": NEEDLE, "piston": {"plunger": 10.0, "compliance": 0.005}, "motor": {"top_speed": 2.0}}),
    "piston, force": (STROKES, {"kind": "piston", "area": 0.8, "needle": NEEDLE, "piston": {"force": 20.0, "seal_friction": 5.0}}),
    "jet": (STROKES, {"kind": "jet", "area": 0.5, "jet": {"drop": 0.5, "top_rate": 100.0}}),
    "jet, slow": (STROKES, {"kind": "jet", "area": 0.8, "jet": {"drop": 0.1, "top_rate": 100.0}}),
    "dots": (DOTS, {"flow": 20.0, "dead_time": 0.01, "opening": 0.02, "closing": 0.03}),
    "dots of a jet": (DOTS, {"kind": "jet", "flow": 20.0, "jet": {"drop": 0.4, "top_rate": 200.0}}),
    "dots without glue": (DOTS, {"area": 0.8}),
    "fed by E": (FED, {"e_volume": 30.0}),
    "filament": (FED, {"filament": 1.75}),
    "piston by E": (FED, {"kind": "piston", "needle": NEEDLE, "piston": {"plunger": 6.0, "compliance": 0.002}}),
    "hatch": (HATCH, {"area": 0.6}),
    "crossing": (CROSSING, {"area": 1.2}),
    "low needle": (STROKES, {"area": 0.3}),
    "spiral": (CONE, {"flow": 90.0, "dead_time": 0.01}),
    "spiral on a cone": ({**CONE, "height": 6.0}, {"area": 1.5}),
}
# of the bead and the limits, by case
MORE = {
    "hatch": {"bead": {"cell": 0.2}, "tolerance": {"bead_width": 5.0}},
    "early leads": {"tolerance": {"start_length": 0.5, "stop_length": 0.5}},
    "low needle": {"bead": {"gap": 0.2}},
    "spiral": {"tolerance": {"turn_clearance": 0.1}},
}


def program_of(text):
    """The table of a program, by its text."""
    if isinstance(text, dict):
        return text
    return {"controller": "slicer.Program" if text is FED else "linuxcnc.Program", "text": text, "acceleration": 1000.0}


def job_of(name, text, dispenser, **tables):
    program = program_of(text)
    values = {key: value for key, value in program.items() if key != "controller"}
    machine = "xyz" if "z" in build(program["controller"], values).axes else "xy"
    content = {"name": name, "machine": machine, "program": program, "dispenser": dispenser, **tables}
    return Job.of_content(content, f"job {name}")


def rows_of(row):
    """Every check of a row of the verdict, in words and as numbers."""
    checks = [[check.brief, str(check.place), check.state, check.value, check.usage] for check in row.checks]
    return {"state": row.state, "remark": row.remark, "checks": checks, "values": row.values}


def answer(name):
    text, dispenser = CASES_OF_GLUE[name]
    job = job_of(name.replace(",", ""), text, dispenser, **MORE.get(name, {}))
    run = job.follow()
    analysis = Analysis(run)
    bead = Bead(run, job.bead, analysis)
    results = RunResults(job, job.built_machine, Budget(analysis), bead)
    verdict = results.verdict
    flow = run.flow
    every = max(1, len(flow) // 12)
    found = {
        "duration": run.time[-1],
        "flow": flow[::every],
        "demand": run.flow_demand[::every],
        "volume": float(flow.sum() * run.period),
        "demanded": float(run.flow_demand.sum() * run.period),
        "bead": None if results.bead_values is None else results.bead_values,
        "glue": rows_of(verdict["glue"]),
        "stall": verdict.stall,
        "headline": verdict.headline,
        "notes": list(job.notes),
    }
    if bead.width.size:
        some = slice(None, None, max(1, bead.width.size // 12))
        found |= {"width": bead.width[some], "height": bead.map.height.max(), "wet": int((bead.map.height > 0).sum())}
    if results.dots:
        tolerance = limits_with(job, bead)
        verdicts = dot_verdicts(bead, tolerance, places_of(run, lambda _: None))
        found["dots"] = [[dot.dot.volume, dot.dot.diameter] for dot in verdicts]
    return found


CASES = {name: lambda name=name: answer(name) for name in CASES_OF_GLUE}
