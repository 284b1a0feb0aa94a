"""Runs of a circle whose nozzle's error is known in closed form, for comparisons."""

import math
from functools import cache

import numpy as np

from gantrysim import Job
from gantrysim.metrics.analysis import Analysis

RADIUS = 20.0
LEAD = 10.0  # on the circle's tangent, so that no corner is near its start
START = math.hypot(RADIUS, LEAD) + LEAD  # length of the path up to the circle [mm]
TEXT = f"G21 G17 G90\nF3000\nG0 X{RADIUS} Y-{LEAD}\nG0 Y0\nM62 P0\nG3 X{RADIUS} Y0 I-{RADIUS}\nM63 P0\nM2\n"


def circle_job(period=0.001, text=TEXT, machine="xy"):
    return Job(
        name="circle",
        machine=machine,
        program={
            "controller": "linuxcnc.Program",
            "text": text,
            "dispense": {"by": "codes", "on": ["M62"], "off": ["M63"]},
        },
        servo={"period": period},
        dispenser={"flow": 100.0},
    )


@cache
def recorded(period=0.001):
    return circle_job(period).run()


def on_circle(mean, swing, period=0.001):
    """A run whose nozzle is `mean + swing * cos(angle)` left of the circle, the angle that of its foot [mm].

    Left of a circle that runs counter-clockwise is inside.
    """
    run = recorded(period)
    nozzle = run.nozzle.copy()
    ticks = Analysis(run).ticks
    angle = np.arctan2(*run.commanded_tip[ticks, 1::-1].T)
    radius = RADIUS - (mean + swing * np.cos(angle))
    nozzle[ticks, 0] = radius * np.cos(angle)
    nozzle[ticks, 1] = radius * np.sin(angle)
    nozzle[ticks, 2] = run.requested.position(0.0)[0, 2]
    return run.replaced(nozzle=nozzle)
