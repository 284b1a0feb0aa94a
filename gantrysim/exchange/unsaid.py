"""Values of a servo that a controller's parameters cannot express.

Every value of `Servo.values` is in one of three groups. A value in none of them counts as acting: every dialect that
does not carry a newly added gain refuses it.
"""

from __future__ import annotations

from collections.abc import Sequence

from gantrysim.exchange.dialect import AxisServo, Dialect
from gantrysim.servo.laws import LAW_PARAMETERS, PD, PID
from gantrysim.servo.laws.selection import words
from gantrysim.servo.servo import Servo

# Set in the controller, the drive or the encoder beside the gains: listed in the file and in notes, where not carried.
BESIDE = {
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
_ORDINARY = ("motor", "torque")  # words that need no setting
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
_PLAIN = ((PID.name,), (PD.name,))
_REMEDIES = {"law": "servo.law='\"pid\"'"}


def unsaid(dialect: Dialect, axes: Sequence[AxisServo], servo: Servo) -> dict[str, str]:
    """Return acting settings for which a dialect has no parameter, by the key of the servo, with their values."""
    lost: dict[str, str] = {}
    for name, values in servo.values().items():
        if name in BESIDE or name in THROUGH:
            continue
        if name == "law":
            if servo.laws.names not in _PLAIN:
                lost[name] = f"law = {words(servo.laws.names)}"
            continue
        acting = [
            f"{axis.name} {value:g}"
            for axis, value in zip(axes, values, strict=True)
            if value and name not in dialect.carried(axis.mode)
        ]
        if acting:
            lost[name] = f"{name} ({', '.join(acting)})"
    return lost


def beside(dialect: Dialect, servo: Servo) -> list[str]:
    """Return the settings beside the gains that a dialect does not carry, in lines."""
    lines = []
    for name, meaning in BESIDE.items():
        value = servo.values()[name]
        values = value if isinstance(value, tuple) else (value,)
        if all(name in dialect.carried(mode) for mode in servo.modes):
            continue
        if not any(value and value not in _ORDINARY for value in values):
            continue
        if name in _OF_VELOCITY_DRIVES and "velocity" not in servo.modes:
            continue
        shown = ", ".join(value if isinstance(value, str) else f"{value:g}" for value in values)
        lines.append(f"not among these parameters, set it separately: {name} = {shown}, {meaning}")
    return lines


def remedy(field: str) -> str:
    """Return the setting of a job that removes a field's effect."""
    return _REMEDIES.get(field, f"servo.{field}=0")
