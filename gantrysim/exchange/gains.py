"""Servo gains to and from the parameters of motion controllers.

Drives that take positions or steps have no gains: their settings are scale and limits.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from gantrysim.base.errors import InputError, unknown
from gantrysim.exchange.cascade import Fanuc, SoftMC
from gantrysim.exchange.dialect import AxisServo, Dialect
from gantrysim.exchange.linuxcnc import LinuxCNC, LinuxCNCIni
from gantrysim.exchange.trio import Trio
from gantrysim.machine.axis import Axis
from gantrysim.servo.gains import GAIN_NAMES
from gantrysim.servo.laws import LAW_PARAMETERS, PD, PID
from gantrysim.servo.laws.selection import words
from gantrysim.servo.servo import Servo

POSITION_MODES = ("position", "stepper")

_FULL_STEPS = 4  # per electrical period
_HEADROOM = 1.25  # of the step generator above the planner, so that it can catch up

# Values of a servo that a controller's parameters cannot express.
#
# Every value of `Servo.values` is in one of three groups. A value in none of them counts as acting: every dialect that
# does not carry a newly added gain refuses it.

# Set in the controller, the drive or the encoder beside the gains: listed in the file and in notes, where not carried.
BESIDE_GAINS = {
    "period": "servo period [s]",
    "torque_limit": "torque limit of the drive [N·m]",
    "resolution": "encoder count [u]",
    "following_error_limit": "following error limit [u]",
    "feedback": "place of the encoder",
    "delay": "delay from sample to output [s]",
    "feedback_delay": "delay from the encoder [servo periods]",
    "current_bandwidth": "bandwidth of the drive's current loop [Hz]",
    "encoder_noise": "noise of the simulated encoder [u]",
    "interpolation_error": "error of the simulated encoder per signal period [u]",
    "interpolation_error_twice": "error of the simulated encoder, twice per signal period [u]",
    "signal_period": "signal period of the encoder [u]",
    "encoder_seed": "seed of the simulated encoder's noise",
    "mode": "command mode of the drive",
    "velocity_gain": "gain of the velocity loop in the drive [N·m·s/u]",
    "velocity_time": "integral time of the velocity loop in the drive [s]",
    "drive_period": "period of the velocity loop in the drive [s]",
}
_ORDINARY_COMMANDS = ("motor", "torque")  # words that need no setting
_OF_VELOCITY_DRIVES = ("velocity_gain", "velocity_time", "drive_period")
# Without effect but through another field, which is refused.
THROUGH = {
    "notch_width": "notch_frequency",
    "notch_depth": "notch_frequency",
    "learning_repeats": "law",
    "motions": "law",
    **{parameter.name: "law" for parameter in LAW_PARAMETERS},
}
# The laws pd and pid are the gains themselves.
_PLAIN_LAWS = ((PID.name,), (PD.name,))
_REMEDIES = {"law": "servo.law='\"pid\"'"}


def unsaid(dialect: Dialect, axes: Sequence[AxisServo], servo: Servo) -> dict[str, str]:
    """Return acting settings for which a dialect has no parameter, by the key of the servo, with their values."""
    lost: dict[str, str] = {}
    for name, values in servo.values().items():
        if name in BESIDE_GAINS or name in THROUGH:
            continue
        if name == "law":
            if servo.laws.names not in _PLAIN_LAWS:
                lost[name] = f"law = {words(servo.laws.names)}"
            continue
        acting = [
            f"{axis.name} {value:g}"
            for axis, value in zip(axes, values, strict=True)
            if value and name not in dialect.carried_fields(axis.mode)
        ]
        if acting:
            lost[name] = f"{name} ({', '.join(acting)})"
    return lost


def settings_beside_gains(dialect: Dialect, servo: Servo) -> list[str]:
    """Return the settings beside the gains that a dialect does not carry, in lines."""
    lines = []
    for name, meaning in BESIDE_GAINS.items():
        value = servo.values()[name]
        values = value if isinstance(value, tuple) else (value,)
        if all(name in dialect.carried_fields(mode) for mode in servo.modes):
            continue
        if not any(value and value not in _ORDINARY_COMMANDS for value in values):
            continue
        if name in _OF_VELOCITY_DRIVES and "velocity" not in servo.modes:
            continue
        shown = ", ".join(value if isinstance(value, str) else f"{value:g}" for value in values)
        lines.append(f"not among these parameters, set it separately: {name} = {shown}, {meaning}")
    return lines


def remedy(field: str) -> str:
    """Return the setting of a job that removes a field's effect."""
    return _REMEDIES.get(field, f"servo.{field}=0")


DIALECTS: dict[str, Dialect] = {entry.name: entry for entry in (Trio(), LinuxCNC(), LinuxCNCIni(), SoftMC(), Fanuc())}


_UNSTABLE_DAMPING = 2.0  # D T / J
_LARGEST_FORWARD = 0.5  # share of the torque limit that friction takes at the speed limit


def dialect(name: str) -> Dialect:
    """Return a dialect by its name.

    Raises:
        InputError: there is none of this name.
    """
    if name not in DIALECTS:
        raise unknown("controller", name, DIALECTS)
    return DIALECTS[name]


def export_gains(name: str, axes: Sequence[Axis], servo: Servo) -> tuple[str, list[str]]:
    """Return the gains as a text for a controller, and what is to be set in the controller or its drives beside.

    Args:
        name: of the dialect.
        axes: of the machine.
        servo: with one value per axis.

    Raises:
        InputError: a gain, a notch or a law for which the controller has no parameter.
    """
    chosen = dialect(name)
    if set(servo.modes) <= set(POSITION_MODES):
        return position_text(name, axes, servo)
    axis_servos = AxisServo.of(axes, servo)
    if lost := unsaid(chosen, axis_servos, servo):
        others = [other.name for other in DIALECTS.values() if not unsaid(other, axis_servos, servo)]
        instead = f"; or export to {', '.join(others)}" if others else ""
        raise InputError(
            f"{name} has no parameter for {', '.join(lost.values())}: the controller would run a different servo; "
            f"run and export the job without: {' '.join(f'--set {remedy(field)}' for field in lost)}{instead}"
        )
    notes = [warning for axis in axis_servos for warning in chosen.warnings(axis)]
    notes += settings_beside_gains(chosen, servo)
    return chosen.text(axis_servos, notes), notes


def import_gains(name: str, text: str, axes: Sequence[Axis], servo: Servo, label: str = "gains") -> Servo:
    """Return a servo with the gains of a controller's text.

    Args:
        name: of the dialect.
        text: as the controller writes it, or `export_gains`.
        axes: of the machine, in the controller's order.
        servo: gives period, limits, resolution and notches.
        label: names the text in errors.

    Raises:
        InputError: no parameters of the dialect, missing ones for an axis, or a term that the servo's law lacks.
    """
    return read_gains(name, text, axes, servo, label)[0]


def read_gains(
    name: str, text: str, axes: Sequence[Axis], servo: Servo, label: str = "gains"
) -> tuple[Servo, list[str]]:
    """Return the servo of `import_gains`, and notes on parts of the text that are not used."""
    chosen = dialect(name)
    axis_servos = AxisServo.of(axes, servo)
    words_by_axis = chosen.read(text, axis_servos)
    missing = [axis.name for axis, words in zip(axis_servos, words_by_axis, strict=True) if not words]
    if missing:
        names = ", ".join(word.name for word in chosen.words(axis_servos[0]))
        why = _reasons_without(chosen, text, axis_servos, missing)
        listed = ", ".join(missing)
        raise InputError(f"{label}: has none of {names} for axis {listed}, in the parameters of {name}{why}")
    gains = [chosen.gains(words, axis) for words, axis in zip(words_by_axis, axis_servos, strict=True)]
    values: dict[str, Any] = {gain: tuple(axis_gains.get(gain, 0.0) for axis_gains in gains) for gain in GAIN_NAMES}
    # of a dialect with parameters for the loop in the drive
    for name in ("velocity_gain", "velocity_time"):
        given = zip(gains, servo.per_axis(name), strict=True)
        values[name] = tuple(axis_gains.get(name, value) for axis_gains, value in given)
    remarks = [
        remark for words, axis in zip(words_by_axis, axis_servos, strict=True) for remark in chosen.remarks(words, axis)
    ]
    read = servo.with_values(**values)
    # a controller that has no parameter for them has none, where the job's servo does
    unstated = ", ".join(unsaid(chosen, axis_servos, read).values())
    if unstated:
        remarks.append(f"no parameter of {chosen.name} states {unstated}: kept from the job's servo")
    return read, remarks


def reasons_without_gains(name: str, text: str, axes: Sequence[Axis], servo: Servo) -> str:
    """Return why axes have no gains in a text, in words that each follow a semicolon; empty where nothing tells."""
    return _reasons_without(dialect(name), text, AxisServo.of(axes, servo), [axis.name for axis in axes])


def _reasons_without(chosen: Dialect, text: str, axes: Sequence[AxisServo], missing: Sequence[str]) -> str:
    reasons = dict.fromkeys(chosen.reason_without(text, axes, axis) for axis in missing)
    return "".join(f"; {reason}" for reason in reasons if reason)


def has_gains(name: str, text: str, axes: Sequence[Axis], servo: Servo) -> bool:
    """Return whether a text has gains, of any axis."""
    return any(dialect(name).read(text, AxisServo.of(axes, servo)))


def sign_of_velocity_drives(axes: Sequence[Axis], servo: Servo) -> str:
    """Return why gains that were read as those of drives which take torques cannot be such; empty if they can.

    Args:
        axes: of the machine.
        servo: with the gains.
    """
    for axis, gains, drive in zip(axes, servo.gains, servo.drives, strict=True):
        if gains.kp > 0 and gains.kd - gains.output_velocity <= 0:
            return f"the loop of axis {axis.name} has P without D, which would not damp a drive that takes torques"
        # of a held torque on an inertia, against the difference of its positions: the poles have the product a / 2
        damping = (gains.kd - gains.output_velocity) * servo.period / axis.inertia
        if damping >= _UNSTABLE_DAMPING:
            return (
                f"as a torque, D would make the loop of axis {axis.name} unstable: D T / J = {damping:.3g}, must be "
                f"less than {_UNSTABLE_DAMPING:g}, with the servo period T and the inertia J at the motor"
            )
        torque = (gains.velocity_ff + gains.output_velocity) * axis.speed_limit
        if torque > _LARGEST_FORWARD * drive.torque_limit:
            return (
                f"as a torque, the velocity feed-forward of axis {axis.name} would take {torque:.3g} N·m of "
                f"{drive.torque_limit:.3g} N·m at its speed limit"
            )
    return ""


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
