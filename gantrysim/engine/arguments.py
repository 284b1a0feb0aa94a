"""The arguments of a run by type: what is refused in one line that says what to write."""

from __future__ import annotations

import os
from numbers import Real
from types import NoneType
from typing import Any

from gantrysim.base.errors import InputError, short_text, wrong_type
from gantrysim.controllers.controller import Controller
from gantrysim.faults import InjectedFault
from gantrysim.glue.dispenser.dispenser import Dispenser
from gantrysim.machine.machine import Machine
from gantrysim.paths.path import Path
from gantrysim.record.setpoints import Setpoints
from gantrysim.servo.servo import Servo

_KINDS: dict[str, tuple[tuple[type, ...], str]] = {
    "machine": ((Machine,), "a Machine"),
    "servo": ((Servo,), "a Servo"),
    "setpoints": ((Setpoints, Controller), "Setpoints or a controller with its program"),
    "physics_step": ((Real, NoneType), "a number or None"),
    "dispenser": ((Dispenser, NoneType), "a Dispenser or None"),
    "faults": ((list, tuple), "a list of faults"),
}


def check_argument(name: str, value: Any, place: str = "", alternative: str = "") -> None:
    """Check the type of an argument of a run.

    Args:
        name: of the argument.
        value: given.
        place: of the value in a list, as "[2]".
        alternative: what else it may be, in words.

    Raises:
        InputError: another type, with what to write instead where that is known.
    """
    kinds, words = _KINDS[name]
    if isinstance(value, kinds) and not isinstance(value, bool):
        return
    if name == "setpoints" and _is_program(value):
        return
    raise wrong_type(f"{name}{place}", value, f"{words}{alternative}", _advice(name, value))


def sent_setpoints(setpoints: Setpoints | Controller, period: float) -> Setpoints:
    """Return setpoints, those of a controller at a servo period [s].

    Raises:
        InputError: the method `setpoints` of a class of the user's own returns something else.
    """
    if isinstance(setpoints, Setpoints):
        return setpoints
    positions: Any = setpoints.setpoints(period)
    if not isinstance(positions, Setpoints):
        raise InputError(
            f"{type(setpoints).__name__}.setpoints returned {type(positions).__name__}: must return gantrysim.Setpoints"
        )
    return positions


def _is_program(value: Any) -> bool:
    """Return whether a value stands for its setpoints, as a controller does; a class of controllers does not."""
    return callable(getattr(type(value), "setpoints", None))


def _advice(name: str, value: Any) -> str:
    """Return what to write for a value of a wrong type; nothing where that is not known."""
    text = isinstance(value, str | os.PathLike)
    if name == "machine" and text:
        return f"write gantrysim.Machine({short_text(os.fspath(value))})"
    if name == "servo":
        return "write gantrysim.Servo.derive(machine.axes)"
    if name == "setpoints":
        return _advice_on_setpoints(value, text)
    if name == "dispenser" and isinstance(value, Real) and not isinstance(value, bool):
        return f"write gantrysim.Dispenser(flow={value}) for a flow in mm³/s"
    if name == "faults" and isinstance(value, InjectedFault):
        return "write faults=[fault]"
    return ""


def _advice_on_setpoints(value: Any, text: bool) -> str:
    if text:
        return f"a job or program file is run by gantrysim.Job.load({short_text(os.fspath(value))}).run()"
    if isinstance(value, type) and issubclass(value, Controller):
        return f"write {value.__name__}(...) with its arguments"
    if isinstance(value, Path):
        return "a path has no speed: write Setpoints.along(path, speed, servo.period)"
    if callable(getattr(value, "run", None)):  # a job
        return f"a {type(value).__name__} has a machine and a servo of its own: write .run() behind it"
    return ""
