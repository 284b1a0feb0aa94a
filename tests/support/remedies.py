"""Small jobs, a tenth of a second to simulate, each with one thing that a lever can change."""

from functools import cache

from gantrysim import Job
from gantrysim.remedy.bench import Bench

LAG = {"dead_time": 0.005, "opening": 0.02, "closing": 0.02}
FLOW = 200.0  # [mm³/s], 2 mm² at 100 mm/s
AREA = 2.0  # [mm²]

# three sides of a rectangle: two corners, where the speed falls
SIDES = """G21 G17 G90 G94 G64 P0.02
G0 X0 Y0
M62 P0
G1 X40 F6000
G1 X40 Y30
G1 X0 Y30
M63 P0
M2
"""
# friction turns round four times
CIRCLE = """G21 G17 G90 G94 G64
G0 X0 Y0
M62 P0
G2 X0 Y0 I15 J0 F6000
M63 P0
M2
"""
LINE = """G21 G17 G90 G94 G64
G1 X-40 F6000
M62 P0
G1 X40
M63 P0
M2
"""
DOTS = """G21 G17 G90 G94 G64
G0 X0 Y0
M62 P0
G1 X20 F6000
M63 P0
G0 X25
M62 P0
G4 P0.1
M63 P0
M2
"""
# two beads, and a dry move back across the first
ACROSS = """G21 G17 G90 G94 G64
M62 P0
G1 X30 F6000
M63 P0
G0 X15 Y10
G0 X15 Y-10
M2
"""
SLICED = """M83
G0 F6000 X-10 Y-10
G1 F1800 X10 Y-10 E0.6
G1 X10 Y10 E0.6
G1 X-10 Y10 E0.6
"""


def content_of(program, machine="xy", **tables):
    return {"name": "small", "machine": machine, "program": program, "simulation": {"settle": 0.1}, **tables}


def lines_job(text, machine="xy", **tables):
    """A job of G-code, by default with a bead of 2 mm² at any speed."""
    program = {
        "controller": "linuxcnc.Program",
        "text": text,
        "dispense": {"by": "codes", "on": ["M62"], "off": ["M63"]},
    }
    return Job.of_content(content_of(program, machine, **{"dispenser": {"area": AREA}, **tables}), "job small")


def sliced_job(**tables):
    program = {"controller": "slicer.Program", "text": SLICED}
    return Job.of_content(content_of(program, "xyz", dispenser={"area": 1.5}, **tables), "job small")


def spiral_job(tables=None, **arguments):
    program = {
        "controller": "trio.MoveSpiral",
        "diameter": 60.0,
        "turns": 1,
        "thickness": 10.0,
        "speed": 150.0,
        "loop_period": 0.1,
        "acceleration": 4000.0,
        "wait_resolution": 0.001,
        **arguments,
    }
    return Job.of_content(content_of(program, dispenser={"area": AREA}, **(tables or {})), "job small")


@cache
def fixed_flow():
    """A fixed flow: blobs in the corners."""
    return lines_job(SIDES, dispenser={"flow": FLOW, **LAG})


@cache
def lagging():
    """A flow in proportion to the speed, which comes late."""
    return lines_job(SIDES, dispenser={"area": AREA, **LAG})


@cache
def rubbing():
    """A circle: the path suffers from friction alone."""
    return lines_job(CIRCLE)


def measured_outcome(job):
    """What the run of a job shows; a job that is refused has an outcome too."""
    return Bench(job, workers=1).measure(job)


@cache
def outcome_of(toml):
    """What the run of a job shows, simulated once in a process."""
    import tomllib

    return measured_outcome(Job.of_content(tomllib.loads(toml), "job small"))


def outcome(job):
    return outcome_of(job.toml())
