"""The tuned servo as a file for `gantrysim run --servo`."""

from __future__ import annotations

import json
from collections.abc import Sequence

from gantrysim.job.job import Job
from gantrysim.servo.gains import GAIN_NAMES
from gantrysim.servo.laws import PD, PID
from gantrysim.servo.request import DERIVED
from gantrysim.servo.servo import Servo

TUNED = "tuned.toml"

UNITS = {parameter.name: parameter.unit for parameter in DERIVED}  # u is the axis' own unit


def unit_of(name: str, units: Sequence[str]) -> str:
    """Return the unit of a value of the servo; "u" stands for the unit of the axis where these differ."""
    return UNITS[name].replace("u", units[0]) if len(set(units)) == 1 else UNITS[name]


def servo_toml(job: Job, servo: Servo, comments: Sequence[str]) -> str:
    """Return a servo of a job as TOML: a [servo] table with every value, so that nothing is left to be derived.

    Args:
        job: gives the axes and the limit of the following error.
        servo: to be written.
        comments: lines that stand above the table.
    """
    axes = job.built_machine.axes
    units = [axis.unit for axis in axes]
    values = servo.values()
    law = [
        PID.name if name == PD.name and any(any(values[gain]) for gain in PD.unused_gains) else name
        for name in servo.laws.names
    ]
    lines = [
        *(f"# {comment}" for comment in comments),
        f"# One value per axis: {', '.join(f'{axis.name} [{axis.unit}]' for axis in axes)}.",
        "",
        "[servo]",
        f"period = {servo.period!r}  # [s]",
        f"delay = {servo.delay!r}  # [s]",
        f"feedback = {json.dumps(values['feedback'])}",
        f"mode = {json.dumps(servo.modes)}",
        f"drive_period = {servo.drive_period!r}  # [s]",
        f"feedback_delay = {servo.feedback_delay}  # in servo periods",
        f"encoder_seed = {servo.encoder_seed}",
        f"law = {json.dumps(law)}",
        f"learning_repeats = {servo.laws.learning_repeats}",
        f"following_error_limit = {job.servo.following_error_limit!r}  # [{unit_of('resolution', units)}]",
    ]
    for name in UNITS:
        of_axes = ", ".join(repr(float(value)) for value in values[name])
        unit = unit_of(name, units)
        if name in GAIN_NAMES and set(servo.modes) == {"velocity"}:  # whose output is a speed
            unit = unit.replace("N·m", f"({units[0] if len(set(units)) == 1 else 'u'}/s)")
        lines.append(f"{name} = [{of_axes}]  # [{unit}]")
    return "\n".join(lines) + "\n"
