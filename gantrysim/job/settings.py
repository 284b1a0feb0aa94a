"""The tables [servo] and [simulation] of a job file."""

from __future__ import annotations

import inspect
import math
from collections.abc import Mapping
from typing import Any, Literal, get_type_hints

from pydantic import BaseModel, ConfigDict, Field, create_model, model_validator

from gantrysim.glue.dispenser.dispenser import DEMANDS
from gantrysim.job.programs import described_fields
from gantrysim.servo.gains import Parameter
from gantrysim.servo.laws import ADDITIONS, BASES
from gantrysim.servo.request import DERIVED_VALUES
from gantrysim.servo.servo import Servo

# Defaults of jobs and program files: one table for the values that nobody gave.

INTEGRAL_TIME = 0.03  # kp / ki of the servo, as in the built-in jobs [s]
MACHINE = "xy"

# built-in machines of Cartesian axes, the smallest first: a program file runs on the first that has what it moves
MACHINES = {
    "xy": ("x", "y"),
    "xyz": ("x", "y", "z"),
    "xyzr": ("x", "y", "z", "r"),
}
TURNING_MACHINE = "stage"  # for programs that give positions of the axes of a machine that turns its work

# keys of [dispenser] that state the amount of glue; without one, it follows from needle and path speed
GLUE = tuple(DEMANDS)
FILAMENT = 1.75  # diameter where nobody states one: that of most printers [mm]


def smallest_machine(axes: tuple[str, ...]) -> str:
    """Return the smallest built-in machine with these axes; `MACHINE` where none has them, which then names them."""
    for name, machine_axes in MACHINES.items():
        if set(axes) <= set(machine_axes):
            return name
    return MACHINE


STRICT: ConfigDict = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=True)

_Feedback = Literal["motor", "load", "none"]
_Mode = Literal["torque", "velocity", "position", "stepper"]

PerAxis = float | list[float] | None


def _setting(default: Any, description: str) -> Any:
    return Field(default=default, description=description)


# types of a job file where a keyword of `Servo.derive` takes more: functions, and sequences of any kind
_TYPES: dict[str, Any] = {
    "feedback": _Feedback | list[_Feedback],
    "mode": _Mode | list[_Mode] | None,
    "law": str | list[str],
}
_POSITION_GAINS = ("kp", "ki", "kd", "velocity_gain")  # beside which an integral term of another loop has no place
_DEFAULTS = {"integral_time": INTEGRAL_TIME}  # of a job, where `Servo.derive` alone has another
_NAMES_OF_LAWS = (
    f'law, or a list as in ["pid", "friction"]: first one of {", ".join(BASES)} or your own as "mine.py:pd", then any '
    f"of {', '.join(ADDITIONS)}"
)


def _keywords() -> dict[str, Any]:
    """Return type, default and meaning of the keywords of `Servo.derive`, from its signature and docstring."""
    hints = get_type_hints(Servo.derive)
    meanings = described_fields(Servo.derive) | {"law": _NAMES_OF_LAWS}
    parameters = inspect.signature(Servo.derive).parameters.values()
    return {
        parameter.name: (
            _TYPES.get(parameter.name, hints[parameter.name]),
            _setting(_DEFAULTS.get(parameter.name, parameter.default), meanings[parameter.name].removesuffix(".")),
        )
        for parameter in parameters
        if parameter.default is not inspect.Parameter.empty
    }


def _given_type(parameter: Parameter) -> Any:
    """Return type, default and meaning of a parameter of each axis that is derived unless it is given."""
    unit = "mm or deg" if parameter.unit == "u" else parameter.unit.replace("u", "mm")
    return PerAxis, _setting(None, f"{parameter.meaning} [{unit}]" if unit else parameter.meaning)


_FIELDS = {**_keywords(), **{parameter.name: _given_type(parameter) for parameter in DERIVED_VALUES}}
_ServoSettings: Any = create_model("_ServoSettings", __config__=STRICT, **_FIELDS)


class ServoSettings(_ServoSettings):  # type: ignore[misc]
    """Arguments of `Servo.derive`; one that is given, as a number or a list of one per axis, is not derived.

    With loop gains of the user's own, the integral term is the user's too: there is none unless it is given.
    """

    @model_validator(mode="before")
    @classmethod
    def _leave_given_gains_alone(cls, values: Any) -> Any:
        # ki would follow from a derived kp, which is not the one that is given
        if isinstance(values, dict) and "integral_time" not in values and has_loop_gains(values):
            return {**values, "integral_time": math.inf}
        return values


def has_loop_gains(values: Mapping[str, Any]) -> bool:
    """Return whether a table [servo] gives gains of the loop itself."""
    return any(values.get(name) is not None for name in _POSITION_GAINS)


# gains of the loop and the rules from which they are derived: one set, of which no part fits another
_LOOP = (*_POSITION_GAINS, "output_velocity", "velocity_time", "frequency", "damping", "integral_time")


def laid_over(servo: Mapping[str, Any], further: Mapping[str, Any]) -> dict[str, Any]:
    """Return a table [servo] whose values are replaced by those of another table.

    Where the other gives a gain of the loop, or a rule by which one is derived, none of the first is left.
    """
    gives_loop = any(name in further for name in _LOOP)
    others = {name: value for name, value in servo.items() if not (gives_loop and name in _LOOP)}
    return {**others, **further}


class SimulationSettings(BaseModel):
    """Physics steps, time for which the last position is held, and whether an unstable servo may run."""

    model_config = STRICT

    physics_step: float | None = _setting(None, "longest physics step, by default the machine's own [s]")
    settle: float = _setting(0.25, "time for which the last position is held at the end [s]")
    engine: Literal["mujoco", "loop"] | None = _setting(
        None,
        'what makes the physics steps: "mujoco", or "loop", the compiled loop; by default MuJoCo, and the loop in '
        "searches and studies",
    )
    allow_unstable: bool = _setting(False, "whether to run with a servo that is unstable on the machine")
