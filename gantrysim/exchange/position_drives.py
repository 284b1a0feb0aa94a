"""Drives that take positions or steps, in a controller's parameters: scale and limits, as there are no gains."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

from gantrysim.base.errors import InputError
from gantrysim.machine.axis import Axis
from gantrysim.servo.servo import Servo

POSITION_MODES = ("position", "stepper")

_FULL_STEPS = 4  # per electrical period
_HEADROOM = 1.25  # of the step generator above the planner, so that it can catch up


class _Drive(NamedTuple):
    """Drive of an axis: steps per travel [1/u], speed limit [u/s], following error limit [u]."""

    axis: Axis
    takes: str
    steps: float
    following_error: float


def position_text(name: str, axes: Sequence[Axis], servo: Servo) -> tuple[str, list[str]]:
    """Return the settings of a controller whose drives all take positions or steps, and notes.

    Args:
        name: of the controller's dialect.
        axes: of the machine.
        servo: with one value per axis.

    Raises:
        InputError: a controller without parameters for them, or an axis whose steps are not known.
    """
    if name not in _WRITERS:
        raise InputError(
            f"{name} has no parameters for drives in mode {', '.join(map(repr, servo.modes))}: they close their loops "
            f"themselves, and the controller has no gains for them; export scale and limits to {', '.join(_WRITERS)}"
        )
    drives = [_drive(axis, servo, a) for a, axis in enumerate(axes)]
    note = "no gains: the drives take positions or steps and close their loops themselves; these are scale and limits"
    return "\n".join(_WRITERS[name](drives, servo.period, note)) + "\n", [note]


def _drive(axis: Axis, servo: Servo, number: int) -> _Drive:
    """Return the drive of an axis."""
    limit = servo.following_error_limit[number]
    if servo.modes[number] == "stepper":
        if axis.phases is None or not axis.electrical_period:
            raise InputError(f"axis {axis.name}: its stepper's pole pairs are not known, and so its steps are not")
        steps = _FULL_STEPS * axis.phases.microsteps / axis.electrical_period
        return _Drive(axis, "steps", steps, limit)
    resolution = servo.drives[number].resolution
    if not resolution:
        raise InputError(f"resolution of axis {axis.name} = 0: must be greater than 0, as a position is sent in counts")
    return _Drive(axis, "positions", 1 / resolution, limit)


def _linuxcnc(drives: Sequence[_Drive], period: float, note: str) -> list[str]:
    """Return the lines of an INI file of LinuxCNC."""
    lines = [f"# {note}", "[EMCMOT]", f"SERVO_PERIOD = {round(1e9 * period)}", "", "[TRAJ]"]
    lines += [f"COORDINATES = {' '.join(drive.axis.name.upper() for drive in drives)}", "LINEAR_UNITS = mm"]
    for number, drive in enumerate(drives):
        axis = drive.axis
        lines += ["", f"[JOINT_{number}]", f"# axis {axis.name} [{axis.unit}], its drive takes {drive.takes}"]
        lines += [f"TYPE = {'LINEAR' if axis.unit == 'mm' else 'ANGULAR'}", f"SCALE = {drive.steps!r}"]
        if math.isfinite(axis.speed_limit):
            lines.append(f"MAX_VELOCITY = {axis.speed_limit!r}")
            if drive.takes == "steps":
                lines.append(f"STEPGEN_MAXVEL = {_HEADROOM * axis.speed_limit!r}")
        lines.append(f"FERROR = {drive.following_error!r}")
    return lines


def _trio(drives: Sequence[_Drive], period: float, note: str) -> list[str]:
    """Return the lines of a program in Motion BASIC."""
    lines = [f"' {note}", f"' SERVO_PERIOD={1e6 * period:g} [us], set once and active after a restart"]
    for number, drive in enumerate(drives):
        axis = drive.axis
        lines += [f"BASE({number}) ' axis {axis.name} [{axis.unit}], its drive takes {drive.takes}"]
        lines += [f"UNITS={drive.steps!r}", f"FE_LIMIT={drive.following_error!r}"]
        if math.isfinite(axis.speed_limit):
            lines.append(f"' SPEED at most {axis.speed_limit:.6g}")
    return lines


_WRITERS: dict[str, Callable[[Sequence[_Drive], float, str], list[str]]] = {"linuxcnc-ini": _linuxcnc, "trio": _trio}
