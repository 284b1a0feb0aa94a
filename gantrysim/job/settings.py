"""The tables [servo] and [simulation] of a job file."""

from __future__ import annotations

import math
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, create_model

from gantrysim.servo.drive_settings import DRIVE_PERIOD
from gantrysim.servo.laws import ADDITIONS, BASES
from gantrysim.servo.laws.selection import Laws
from gantrysim.servo.parameter import Parameter
from gantrysim.servo.servo_values import DERIVED, FOLLOWING_ERROR_LIMIT

STRICT = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=True)

_Feedback = Literal["motor", "load", "none"]
_Mode = Literal["torque", "velocity", "position", "stepper"]

PerAxis = float | list[float] | None


def _setting(default: Any, description: str) -> Any:
    return Field(default=default, description=description)


class _Derivation(BaseModel):
    model_config = STRICT

    period: float = _setting(1e-3, "servo period [s]")
    frequency: float | None = _setting(
        None, "natural frequency of the loop, by default what the lags leave room for [Hz]"
    )
    damping: float = _setting(1.0, "damping ratio of the loop")
    feedforward: float = _setting(1.0, "share of the computed velocity and acceleration feed-forward")
    integral_time: float = _setting(math.inf, "kp / ki; inf for no integral term [s]")
    following_error_limit: float = _setting(FOLLOWING_ERROR_LIMIT, "error at which the drives are disabled [mm or deg]")
    delay: float = _setting(0.0, "from the encoder's sample to the torque demand [s]")
    feedback: _Feedback | list[_Feedback] = _setting(
        "motor", "where the encoders are: on the motor or on the load, or none"
    )
    mode: _Mode | list[_Mode] | None = _setting(None, "command mode of the drives, by default that of their motors")
    drive_period: float | None = _setting(None, f"of the loops in the drives, by default {DRIVE_PERIOD:g} [s]")
    velocity_bandwidth: float | None = _setting(
        None, "of velocity loops in the drives, by default the highest that keeps the margins [Hz]"
    )
    feedback_delay: int = _setting(0, "from the encoder's sample to the servo, in servo periods")
    encoder_seed: int = _setting(0, "of the encoders' noise")
    law: str | list[str] = _setting(
        "pid", f"names of its laws: one of {', '.join(BASES)}, and any of {', '.join(ADDITIONS)}"
    )
    learning_repeats: int = _setting(Laws.learning_repeats, "number of runs from which the law learning learns")


def _per_axis(parameter: Parameter) -> Any:
    unit = "mm or deg" if parameter.unit == "u" else parameter.unit.replace("u", "mm")
    return PerAxis, _setting(None, f"{parameter.meaning} [{unit}]" if unit else parameter.meaning)


_PER_AXIS: dict[str, Any] = {parameter.name: _per_axis(parameter) for parameter in DERIVED}


class ServoSettings(create_model("_ServoSettings", __base__=_Derivation, **_PER_AXIS)):  # type: ignore[misc]
    """Arguments of `Servo.derive`; one that is given, as a number or a list of one per axis, is not derived."""


class SimulationSettings(BaseModel):
    """Longest physics step, time for which the last position is held, and whether an unstable servo may run."""

    model_config = STRICT

    physics_step: float | None = _setting(None, "longest physics step, by default the machine's own [s]")
    settle: float = _setting(0.25, "time for which the last position is held [s]")
    allow_unstable: bool = _setting(False, "whether to run with a servo that is unstable on the machine")
