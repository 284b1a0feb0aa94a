"""The tuned servo as a file for `gantrysim run --servo`."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

from gantrysim.job.job import Job
from gantrysim.job.settings import ServoSettings, laid_over
from gantrysim.servo.gains import GAIN_NAMES
from gantrysim.servo.laws import PD, PID
from gantrysim.servo.request import DERIVED_VALUES
from gantrysim.servo.servo import Servo

TUNED = "tuned.toml"

UNITS = {parameter.name: parameter.unit for parameter in DERIVED_VALUES}  # u is the axis' own unit


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
    units = [axis.unit for axis in job.built_machine.axes]
    values = servo.values()
    lines = [
        f"period = {servo.period!r}  # [s]",
        f"delay = {servo.delay!r}  # [s]",
        f"feedback = {json.dumps(values['feedback'])}",
        f"mode = {json.dumps(servo.modes)}",
        f"drive_period = {servo.drive_period!r}  # [s]",
        f"feedback_delay = {servo.feedback_delay}  # in servo periods",
        f"encoder_seed = {servo.encoder_seed}",
        f"law = {json.dumps(law_of(servo))}",
        f"learning_repeats = {servo.laws.learning_repeats}",
        f"following_error_limit = {job.servo.following_error_limit!r}  # [{unit_of('resolution', units)}]",
        *(f"{name} = {_written_value(servo, name)}  # [{unit_in_modes(servo, name, units)}]" for name in UNITS),
    ]
    return _table(job, comments, lines)


def tuned_toml(job: Job, servo: Servo, gains: Sequence[str], comments: Sequence[str]) -> str:
    """Return the tuned values of a servo as TOML: a [servo] table to be laid over that of the job.

    It has the gains, and what else differs from the servo that the job derives with these: the law, for one, where a
    search from PD has found an integral term.

    Args:
        job: that was tuned.
        servo: the tuned one.
        gains: names of the gains that were searched.
        comments: lines that stand above the table.
    """
    units = [axis.unit for axis in job.built_machine.axes]
    start = job.built_servo
    content = job.servo.model_dump(exclude_unset=True, exclude_none=True)
    table: dict[str, Any] = {name: list(servo.per_axis(name)) for name in gains}
    law = law_of(servo)
    if law != list(start.laws.names):
        table["law"] = law
    derived = job.model_copy(update={"servo": ServoSettings(**laid_over(content, table))}).sharing(job).built_servo
    names = [name for name in UNITS if name in gains or derived.per_axis(name) != servo.per_axis(name)]
    lines = [f"law = {json.dumps(law)}"] if "law" in table else []
    for name in names:
        before = ", ".join(shown_gain(value) for value in start.per_axis(name))
        change = "" if before == ", ".join(shown_gain(value) for value in servo.per_axis(name)) else f", was {before}"
        lines.append(f"{name} = {_written_value(servo, name)}  # [{unit_in_modes(servo, name, units)}]{change}")
    return _table(job, comments, lines)


def law_of(servo: Servo) -> list[Any]:
    """Return the names of a servo's laws; PD with gains that it does not use is PID."""
    values = servo.values()
    return [
        PID.name if name == PD.name and any(any(values[gain]) for gain in PD.unused_gains) else name
        for name in servo.laws.names
    ]


def shown_gain(value: float) -> str:
    """Return a gain with the digits to which a search rounds it."""
    return f"{value:.4g}"


def _written_value(servo: Servo, name: str) -> str:
    return f"[{', '.join(repr(float(value)) for value in servo.per_axis(name))}]"


def unit_in_modes(servo: Servo, name: str, units: Sequence[str]) -> str:
    """Return the unit of a value of the servo as `unit_of`; a gain of velocity drives has a speed for a torque."""
    unit = unit_of(name, units)
    if name in GAIN_NAMES and set(servo.modes) == {"velocity"}:  # whose output is a speed
        return unit.replace("N·m", f"({units[0] if len(set(units)) == 1 else 'u'}/s)")
    return unit


def _table(job: Job, comments: Sequence[str], lines: Sequence[str]) -> str:
    """Return a table [servo] below comments."""
    axes = ", ".join(f"{axis.name} [{axis.unit}]" for axis in job.built_machine.axes)
    head = [*(f"# {comment}" for comment in comments), f"# One value per axis: {axes}."]
    return "\n".join([*head, "", "[servo]", *lines]) + "\n"
