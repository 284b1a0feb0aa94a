"""The servo of a machine from a table [servo] alone, without a job."""

from __future__ import annotations

from pathlib import Path

from gantrysim.base.errors import InputError, expanded_path
from gantrysim.job.code import absolute_value, named_code, refusal
from gantrysim.job.loading import servo_table
from gantrysim.job.plan import check_servo_file
from gantrysim.job.settings import ServoSettings
from gantrysim.machine.machine import Machine
from gantrysim.servo.servo import Servo


def servo_of_file(file: Path | None, machine: Machine, period: float, *, allow_code: bool = False) -> Servo:
    """Return the servo of a TOML file's table [servo], derived for a machine as in a job.

    Args:
        file: the file; None for the defaults of a job.
        machine: whose axes it moves.
        period: servo period where the file gives none [s].
        allow_code: whether a law of the file's own may run where the file lies outside of the working folder.

    Raises:
        InputError: no such file or table, a value out of its bounds, or code that may not run.
    """
    if file is None:
        return Servo.derive(machine.axes, **{**dict(ServoSettings()), "period": period})
    table = servo_table(file)
    code = named_code({"servo": table})
    reason = "" if allow_code else refusal(code, expanded_path(file))
    if reason:
        raise InputError(f"servo {file} {reason}")
    if "law" in table:
        table["law"] = absolute_value("servo.law", table["law"], expanded_path(file).parent)
    settings = ServoSettings(**{"period": period, **table})
    check_servo_file(file, settings, machine)
    return Servo.derive(machine.axes, **dict(settings))
