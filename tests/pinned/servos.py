"""Derived servos, their margins, and what bounds them, on machines and drives of every kind."""

from pathlib import Path

import numpy as np

from gantrysim import Machine
from gantrysim.job.job import Job
from gantrysim.machine.sizing import Sizing

SETTINGS = {
    "defaults": {},
    "no integral": {"integral_time": float("inf")},
    "slow": {"period": 0.004, "delay": 0.001},
    "fast": {"period": 0.00025, "damping": 0.7},
    "late feedback": {"feedback_delay": 2},
    "load": {"feedback": "load"},
    "velocity": {"mode": "velocity"},
    "velocity, given": {"mode": "velocity", "velocity_bandwidth": 40.0, "drive_period": 0.0005},
    "position": {"mode": "position"},
    "current loop": {"current_bandwidth": 300.0},
    "no notch": {"notch_frequency": 0.0},
    "notch": {"notch_frequency": 120.0, "notch_depth": 0.2, "notch_width": 0.5},
    "frequency": {"frequency": 12.0},
    "too high a frequency": {"frequency": 45.0},
    "gains": {"kp": 0.02, "ki": 0.3, "kd": 0.0004, "velocity_ff": 0.0, "acceleration_ff": 0.0},
    "damped output": {"output_velocity": -0.0002},
    "no feed-forward": {"feedforward": 0.0},
    "pd": {"law": "pd"},
    "p-pi": {"law": "p-pi"},
    "friction, observer": {"law": ["pid", "friction", "observer"], "observer_bandwidth": 30.0},
    "contour, preview": {"law": ["pid", "contour", "preview"]},
    "zv": {"law": ["pid", "zv"]},
    "zvd": {"law": ["pid", "zvd"], "shaper_frequency": 20.0},
    "learning": {"law": ["pid", "learning"]},
}
MACHINES = ("xy", "xyz", "xyzr", "stage", "delta")
EXAMPLES = Path(__file__).parent.parent.parent / "examples" / "machines"
TABLES = ("belt-gantry", "cantilever", "corexy", "stepper", "tandem")
ON_OTHERS = ("defaults",)


def pinnable(axis):
    """The numbers and words of an axis, without its motion and what is coupled to it."""
    return {name: value for name, value in vars(axis).items() if isinstance(value, int | float | str | bool)}


def without_zeros(values):
    return {name: value for name, value in values._asdict().items() if value}


def margins_text(margins):
    if margins is None:
        return None
    return [[str(each), [each.phase, each.delay, each.sensitivity, each.gain, each.gain_lower]] for each in margins]


def servo_answer(machine, settings):
    job = Job.of_content(
        {
            "name": "loop",
            "machine": machine,
            "program": {"controller": "linuxcnc.Program", "text": "G21\nF600\nG1 X1\nM2\n"}
            if machine != "stage"
            else {"controller": "stage.OutlineTrace", "width": 20.0, "height": 12.0, "corner_radius": 3.0},
            "servo": settings,
            "dispenser": {"area": 0.8},
        },
        "job loop",
    )
    servo = job.built_servo
    return {
        "modes": list(servo.modes),
        "gains": [without_zeros(gains) for gains in servo.gains],
        "drives": [without_zeros(drive) for drive in servo.drives],
        "margins": margins_text(job.margins),
        "reason": job.servo_reason,
        "notes": [note for note in job.notes if note.startswith(("servo", "machine"))],
    }


def machine_answer(source):
    machine = Machine(source)
    sizing = Sizing.of(machine, 1e-3, None)
    return {
        "axes": [list(pinnable(axis).values()) for axis in machine.axes],
        "home": machine.tip(np.zeros((1, len(machine.axes)))),
        "sizing": [[value for key, value in vars(axis).items() if key != "axis"] for axis in sizing.axes],
        "locked": sizing.locked,
        "free": sizing.free,
        "findings": list(sizing.findings),
    }


CASES = {f"xy, {name}": lambda settings=settings: servo_answer("xy", settings) for name, settings in SETTINGS.items()}
CASES |= {
    f"{machine}, {name}": lambda machine=machine, name=name: servo_answer(machine, SETTINGS[name])
    for machine in ("xyz", "stage", "delta")
    for name in ON_OTHERS
}
CASES |= {f"machine {name}": lambda name=name: machine_answer(name) for name in MACHINES}
CASES |= {f"machine {name}": lambda name=name: machine_answer(EXAMPLES / f"{name}.toml") for name in TABLES}
