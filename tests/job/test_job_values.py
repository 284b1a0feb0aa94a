"""Every value of the built-in jobs, and the lengths of their paths in closed form."""

import math
import tomllib
from importlib.resources import files

import pytest
from scipy.integrate import quad

from gantrysim import Job
from gantrysim.job.loading import builtin_jobs

VALUES = {
    "an225-3d": {
        "machine": "xyz",
        "program.controller": "trio.MoveSpiral",
        "program.diameter": 120.0,
        "program.turns": 4,
        "program.thickness": 10.0,
        "program.speed": 100.0,
        "program.loop_period": 0.1,
        "program.height": 40.0,
        "program.mhelical_mode": 1,
        "program.acceleration": 1000.0,
        "program.wait_resolution": 0.001,
        "program.ratio_bits": 16,
        "servo.period": 0.001,
        "servo.integral_time": 0.03,
        "dispenser.flow": 200.0,
        "dispenser.dead_time": 0.008,
        "dispenser.opening": 0.02,
        "dispenser.closing": 0.03,
    },
    "an225": {
        "machine": "xy",
        "program.controller": "trio.MoveSpiral",
        "program.diameter": 120.0,
        "program.turns": 4,
        "program.thickness": 10.0,
        "program.speed": 100.0,
        "program.loop_period": 0.1,
        "program.acceleration": 1000.0,
        "program.wait_resolution": 0.001,
        "program.ratio_bits": 16,
        "servo.period": 0.001,
        "servo.integral_time": 0.03,
        "dispenser.flow": 200.0,
        "dispenser.dead_time": 0.008,
        "dispenser.opening": 0.02,
        "dispenser.closing": 0.03,
    },
    "delta-arc": {
        "machine": "delta",
        "program.controller": "softmc.Program",
        "program.start": [100.0, 0.0, 426.0, 0.0],
        "program.group.velocity": 150.0,
        "program.group.acceleration": 3000.0,
        "program.group.profile": "sine",
        "program.group.vrot": 720.0,
        "servo.period": 0.001,
        "servo.integral_time": 0.03,
        "dispenser.area": 2.5,
        "dispenser.dead_time": 0.005,
        "dispenser.opening": 0.02,
        "dispenser.closing": 0.02,
        "dispenser.start_lead": 0.02,
        "dispenser.stop_lead": 0.02,
    },
    "fanuc-conical": {
        "machine": "xyzr",
        "program.controller": "fanuc.Program",
        "program.start": [0.0, 100.0, 0.0],
        "program.acceleration": 2000.0,
        "program.blend_time": 0.02,
        "servo.period": 0.001,
        "servo.integral_time": 0.03,
        "dispenser.area": 2.5,
        "dispenser.dead_time": 0.005,
        "dispenser.opening": 0.02,
        "dispenser.closing": 0.02,
        "dispenser.stop_lead": 0.02,
        "dispenser.advance": 0.02,
        "dispenser.limit": 600.0,
    },
    "fanuc-spiral": {
        "machine": "xy",
        "program.controller": "fanuc.Program",
        "program.start": [0.0, 0.0, 0.0],
        "program.acceleration": 2000.0,
        "program.clamp.radius": 40.0,
        "program.clamp.feed": 4500.0,
        "program.clamp.floor": 1200.0,
        "servo.period": 0.001,
        "servo.integral_time": 0.03,
        "dispenser.flow": 300.0,
        "dispenser.metering": "time-pressure",
        "dispenser.dead_time": 0.012,
        "dispenser.opening": 0.04,
        "dispenser.closing": 0.05,
        "dispenser.start_lead": 0.05,
        "dispenser.stop_lead": 0.045,
        "dispenser.needle.bore": 1.2,
        "dispenser.needle.length": 25.0,
        "dispenser.needle.consistency": 40.0,
        "dispenser.needle.index": 0.6,
    },
    "linuxcnc-flanges": {
        "machine": "xyz",
        "program.controller": "linuxcnc.Program",
        "program.dispense.by": "codes",
        "program.dispense.on": ["M62"],
        "program.dispense.off": ["M63"],
        "servo.integral_time": 0.03,
        "dispenser.flow": 40.0,
        "dispenser.dead_time": 0.004,
        "dispenser.opening": 0.01,
        "dispenser.closing": 0.01,
    },
    "slicer-square": {
        "machine": "xyz",
        "program.controller": "slicer.Program",
        "servo.integral_time": 0.03,
        "dispenser.area": 1.5,
        "dispenser.dead_time": 0.004,
        "dispenser.opening": 0.01,
        "dispenser.closing": 0.01,
    },
    "softmc-arc": {
        "machine": "xy",
        "program.controller": "softmc.Program",
        "program.start": [0.0, 0.0],
        "program.group.velocity": 150.0,
        "program.group.acceleration": 3000.0,
        "program.group.profile": "sine",
        "program.record.points": 1000,
        "program.record.gap": 4,
        "program.record.what": ["PCMD", "PFB", "PE"],
        "servo.period": 0.001,
        "servo.integral_time": 0.03,
        "dispenser.area": 2.5,
        "dispenser.dead_time": 0.005,
        "dispenser.opening": 0.02,
        "dispenser.closing": 0.02,
        "dispenser.start_lead": 0.02,
        "dispenser.stop_lead": 0.02,
    },
    "softmc-basic": {
        "machine": "xy",
        "program.controller": "softmc.Basic",
        "servo.period": 0.001,
        "servo.integral_time": 0.03,
        "dispenser.flow": 240.0,
        "dispenser.dead_time": 0.005,
        "dispenser.opening": 0.02,
        "dispenser.closing": 0.02,
    },
    "softmc-helical": {
        "machine": "xyzr",
        "program.controller": "softmc.Program",
        "program.start": [25.0, 0.0, 0.0, 0.0],
        "program.group.velocity": 200.0,
        "program.group.acceleration": 3000.0,
        "program.group.jerk": 100000.0,
        "program.group.profile": "trapezoidal acceleration",
        "program.group.settle_error": 0.05,
        "program.group.settle_time": 0.005,
        "servo.period": 0.001,
        "servo.integral_time": 0.03,
        "dispenser.flow": 400.0,
        "dispenser.dead_time": 0.008,
        "dispenser.opening": 0.02,
        "dispenser.closing": 0.03,
    },
    "stage-outline": {
        "machine": "stage",
        "program.controller": "stage.OutlineTrace",
        "program.width": 100.0,
        "program.height": 60.0,
        "program.corner_radius": 10.0,
        "program.speed": 50.0,
        "program.needle": [-200.0, 0.0],
        "program.sigma": -1,
        "program.velocity": [360.0, 1000.0, 1000.0],
        "program.acceleration": [2000.0, 2000.0, 2000.0],
        "program.travel_x": [-220.0, 220.0],
        "program.travel_y": [-220.0, 220.0],
        "program.blend": 10.0,
        "servo.period": 0.001,
        "servo.integral_time": 0.03,
        "dispenser.area": 0.8,
        "dispenser.dead_time": 0.005,
        "dispenser.opening": 0.02,
        "dispenser.closing": 0.02,
    },
    "svg-gasket": {
        "machine": "xyz",
        "program.controller": "cad.Drawing",
        "program.speed": 60.0,
        "program.travel_speed": 150.0,
        "program.lift": 4.0,
        "program.placement.x": -60.0,
        "program.placement.y": -40.0,
        "servo.period": 0.001,
        "servo.integral_time": 0.03,
        "dispenser.area": 0.8,
        "dispenser.dead_time": 0.005,
        "dispenser.opening": 0.02,
        "dispenser.closing": 0.02,
        "dispenser.start_lead": 0.02,
        "dispenser.stop_lead": 0.02,
    },
    "trio-basic": {
        "machine": "xy",
        "program.controller": "trio.Basic",
        "servo.period": 0.001,
        "servo.integral_time": 0.03,
        "dispenser.area": 2.5,
        "dispenser.dead_time": 0.005,
        "dispenser.opening": 0.02,
        "dispenser.closing": 0.02,
        "dispenser.start_lead": 0.02,
        "dispenser.stop_lead": 0.02,
    },
}


def settings(table, before=""):
    """The settings of a job file by their full keys, without the texts of programs."""
    for key, value in table.items():
        if isinstance(value, dict):
            yield from settings(value, f"{before}{key}.")
        elif key not in ("text", "name") and not (isinstance(value, str) and "\n" in value):
            yield f"{before}{key}", value


@pytest.mark.parametrize("name", builtin_jobs())
def test_a_job_has_the_values_that_its_pages_and_pictures_are_made_with(name):
    text = (files("gantrysim.jobs") / f"{name}.toml").read_text(encoding="utf-8")
    table = tomllib.loads(text)
    assert table["name"] == name
    assert dict(settings(table)) == VALUES[name]


def coil(first, last, turns, rise=0.0):
    """Length of a spiral whose radius changes evenly with its angle."""
    angle = 2 * math.pi * turns
    out, up = (last - first) / angle, rise / angle
    return quad(lambda turned: math.hypot(first + out * turned, out, up), 0, angle)[0]


def frame(width, height, radius):
    """Perimeter of a rectangle with rounded corners."""
    return 2 * (width + height - 4 * radius) + 2 * math.pi * radius


LENGTHS = {  # of the requested path [mm]
    "delta-arc": math.pi * 100,
    "fanuc-conical": coil(100, 37.5, 2.5, 62.5) + 60 + 7.5,
    "fanuc-spiral": 100 + coil(100, 30, 3.5) + 30,
    "slicer-square": 4 * 40 + 4 * 32 + math.sqrt(2) * (2 * 24 + 20 + 4 + 4 + 12) + 24,
    "softmc-arc": 100 + math.pi * 100 + 15 + math.pi * 85 + 85,
    "softmc-basic": 6 * 2 * math.pi * 30,
    "softmc-helical": sum(math.hypot(math.pi * (25 + 12.5 * k), 5) for k in range(8)),
    "stage-outline": frame(100, 60, 10),
    "trio-basic": 20 + frame(110, 80, 20) + math.hypot(7, 14) + frame(82, 52, 13) + math.hypot(27, 14),
}
GLUE = {  # of it with glue, where the rest is dry [mm]
    "linuxcnc-flanges": 2 * (2 * (50 + 30) - 10 + 2.5 * math.pi),
    "svg-gasket": 2 * 2 * math.pi * 6 + 2 * math.pi * 22 + 200 + math.pi * (10 + 30),
}
TICK = 0.5  # way of a servo tick or two, and what blending cuts off corners [mm]


@pytest.mark.parametrize("name", LENGTHS)
def test_the_path_of_a_job_has_the_length_of_its_program(name):
    assert Job.load(name).controller.requested.length == pytest.approx(LENGTHS[name], rel=1e-9)


@pytest.mark.parametrize("name", GLUE)
def test_glue_is_laid_along_what_is_to_be_glued(name):
    assert Job.load(name).plan().glue == pytest.approx(GLUE[name], abs=TICK)
