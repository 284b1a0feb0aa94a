"""Runs of random programs with corners: polylines, arcs, rests and reversals, on three controllers.

The machine has no dry friction and a fine encoder, so that its figures do not scatter with the last bit of a step.
"""

import itertools
import re
import shutil
import tempfile
from functools import cache
from pathlib import Path

import numpy as np

import gantrysim
from gantrysim import Machine, Servo, simulate
from gantrysim.controllers import fanuc, softmc
from gantrysim.controllers.gcode import linuxcnc

CORNERED_SEEDS = (11, 18, 42, 51)  # of programs whose links were many times too large at their corners
MODELS = Path(gantrysim.__file__).parent / "models"
PERIOD = 1e-3


@cache
def smooth_machine():
    """The built-in machine xy without dry friction, and with an encoder of a nanometre."""
    folder = Path(tempfile.mkdtemp()) / "models"
    shutil.copytree(MODELS, folder, ignore=shutil.ignore_patterns("__pycache__"))
    parts = folder / "parts" / "dispenser.xml"
    parts.write_text(re.sub(r' lugre="[^"]*"', "", parts.read_text()))
    model = folder / "xy.xml"
    model.write_text(model.read_text().replace('user="10000"', 'user="10000000"'))
    machine = Machine(model)
    shutil.rmtree(folder.parent)
    return machine


def random_points(rng):
    """Corners of a polyline, many of them reversals or right angles."""
    points = [np.zeros(2)]
    heading = rng.uniform(0, 2 * np.pi)
    for _ in range(rng.integers(3, 8)):
        turns = [rng.uniform(-np.pi, np.pi), np.pi * rng.choice([-1, 1]) * rng.uniform(0.9, 1), np.pi, np.pi / 2]
        heading += rng.choice(turns)
        point = points[-1] + rng.uniform(1, 25) * np.array([np.cos(heading), np.sin(heading)])
        if np.abs(point).max() < 60:
            points.append(point)
    return points


def softmc_program(rng, points, speed, acceleration):
    lines = []
    for start, end in itertools.pairwise(points):
        if rng.random() < 0.25:
            across = np.array([start[1] - end[1], end[0] - start[0]])
            middle = 0.5 * (start + end) + 0.3 * rng.choice([-1, 1]) * across
            lines.append(
                f"Circle G1 CirclePoint={{{middle[0]:.6f},{middle[1]:.6f}}} TargetPoint={{{end[0]:.6f},{end[1]:.6f}}}"
            )
        else:
            lines.append(f"Move G1 {{{end[0]:.6f},{end[1]:.6f}}}")
    group = softmc.Group(velocity=speed, acceleration=acceleration)
    return softmc.Program(program="\n".join(lines), group=group)


def gcode_lines(rng, points, speed):
    yield "G21 G17 G90 G94"
    yield f"F{60 * speed:.0f}"
    for start, end in itertools.pairwise(points):
        if rng.random() < 0.25:
            radius = 0.6 * np.linalg.norm(end - start)
            yield f"G{rng.integers(2, 4)} X{end[0]:.4f} Y{end[1]:.4f} R{radius:.4f}"
        else:
            yield f"G1 X{end[0]:.4f} Y{end[1]:.4f}"
        if rng.random() < 0.2:
            yield "G4 P0.05"


def cornered_run(seed, physics_step=None):
    """The record of a random program with corners."""
    rng = np.random.default_rng(seed)
    points = random_points(rng)
    speed = rng.uniform(20, 150)
    acceleration = float(rng.choice([1000, 3000, 8000]))
    controller = rng.choice(["softmc", "linuxcnc", "fanuc"])
    if controller == "softmc":
        program = softmc_program(rng, points, speed, acceleration)
    elif controller == "linuxcnc":
        blend = rng.choice(["G64 P0.05", "G64 P0.3", "G61"])
        program = linuxcnc.Program(text="\n".join([blend, *gcode_lines(rng, points, speed), "M2"]))
    else:
        text = "\n".join([*gcode_lines(rng, points, speed), "M02"])
        program = fanuc.Program(text, acceleration=acceleration)
    machine = smooth_machine()
    integral = {"integral_time": 0.03} if rng.random() < 0.6 else {}
    servo = Servo.derive(machine.axes, PERIOD, **integral)
    step = {} if physics_step is None else {"physics_step": physics_step}
    return simulate(machine, servo, program.setpoints(PERIOD), **step)
