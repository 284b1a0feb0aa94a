"""The registry of motion controllers, by the names in job files."""

from __future__ import annotations

import inspect
import math
import re
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from functools import cache
from typing import Any, get_args, get_type_hints

from pydantic import ConfigDict
from pydantic.dataclasses import dataclass as validated

from gantrysim.base.errors import InputError, unknown
from gantrysim.controllers import fanuc, softmc, stage, trio
from gantrysim.controllers.controller import Controller
from gantrysim.controllers.gcode import linuxcnc, slicer
from gantrysim.drawings import Drawing

PROGRAMS: dict[str, type[Controller]] = {
    "trio.MoveSpiral": trio.MoveSpiral,
    "trio.Basic": trio.Basic,
    "fanuc.Program": fanuc.Program,
    "softmc.Program": softmc.Program,
    "softmc.Basic": softmc.Basic,
    "stage.OutlineTrace": stage.OutlineTrace,
    "linuxcnc.Program": linuxcnc.Program,
    "slicer.Program": slicer.Program,
    "cad.Drawing": Drawing,
}

_MAGNITUDES = 1e-100, 1e12  # of numbers; smaller ones than 1e-12 are rounding
_STRICT = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=True)
_validated: dict[str, Callable[..., Any]] = {
    name: validated(config=_STRICT)(program) for name, program in PROGRAMS.items()
}


def build(name: str, values: Mapping[str, Any]) -> Controller:
    """Return a controller with its program.

    Raises:
        InputError: an unknown controller, or a program that it refuses.
        pydantic.ValidationError: a missing or unknown argument, or one of the wrong type.
    """
    if name not in PROGRAMS:
        raise unknown("controller", name, PROGRAMS)
    reject_booleans(PROGRAMS[name], values)
    _reject_extremes("", values)
    return _validated[name](**values)


def reject_booleans(kind: type[Any], values: Mapping[str, Any], prefix: str = "") -> None:
    """Raise InputError for true or false where a number belongs, which pydantic would take as 1 or 0.

    Args:
        kind: dataclass, or other class with annotations, of the values.
        values: by name.
        prefix: of the names in the message.
    """
    hints = _hints(kind)  # type: ignore[arg-type]  # mypy takes a type for not hashable
    for name, value in values.items():
        hint = hints.get(name)
        kinds = {hint, *get_args(hint)}
        items = value if isinstance(value, list | tuple) else [value]
        if any(isinstance(item, bool) for item in items) and hint and bool not in kinds and Any not in kinds:
            raise InputError(f"{prefix}{name} = {str(value).lower()}: true and false are no numbers")
        nested = next((one for one in kinds if isinstance(one, type) and is_dataclass(one)), None)
        if isinstance(value, Mapping) and nested is not None:
            reject_booleans(nested, value, f"{prefix}{name}.")


@cache
def _hints(kind: type[Any]) -> dict[str, Any]:
    return get_type_hints(kind)  # slow


def _reject_extremes(name: str, value: object) -> None:
    """Raise InputError for a number, in a value or in its parts, that no machine has and arithmetic may not survive."""
    if isinstance(value, Mapping):
        for key, part in value.items():
            _reject_extremes(f"{name}.{key}" if name else str(key), part)
    elif isinstance(value, list | tuple):
        for part in value:
            _reject_extremes(name, part)
    elif isinstance(value, int | float) and value and not isinstance(value, bool):
        least, most = _MAGNITUDES
        if not (least <= abs(value) <= most or abs(value) == math.inf or value != value):
            shown = f"{value:g}" if isinstance(value, float) else f"an integer of {len(str(value))} digits"
            raise InputError(f"{name} = {shown}: must be 0 or from {least:g} to {most:g} in magnitude")


def suffixes() -> tuple[str, ...]:
    """Return the suffixes of the program files that controllers read."""
    return tuple(sorted({suffix for program in PROGRAMS.values() for suffix in program.suffixes}))


def reader(suffix: str, controller: str | None = None) -> str:
    """Return the name of the controller that reads a program file.

    Args:
        suffix: of the file, with its dot.
        controller: its name or the part before the dot, in any case; by default that of the suffix.

    Raises:
        InputError: a suffix that no controller has, or an unknown controller.
    """
    reading = {
        name: program
        for name, program in PROGRAMS.items()
        if program.text_argument in getattr(program, "__dataclass_fields__", ())
    }
    if controller is None:
        fitting = [name for name, program in reading.items() if suffix.lower() in program.suffixes]
        if not fitting:
            raise unknown("kind of program file", suffix, suffixes())
        return fitting[0]
    wanted = controller.lower()
    fitting = [name for name in reading if wanted in (name.lower(), name.lower().split(".")[0])]
    fitting.sort(key=lambda name: suffix.lower() not in reading[name].suffixes)
    if not fitting:
        raise unknown("controller of a program file", controller, reading)
    return fitting[0]


def keys(name: str) -> list[str]:
    """Return the dotted names of a program's arguments, including nested ones; none of an unknown program."""
    return list(dotted(PROGRAMS[name])) if name in PROGRAMS else []


@cache
def dotted(table: type[Any], prefix: str = "") -> tuple[str, ...]:
    """Return the dotted names of a dataclass' fields, including nested ones."""
    hints = get_type_hints(table)
    names = []
    for field in fields(table):
        names.append(prefix + field.name)
        for part in (hints[field.name], *get_args(hints[field.name])):
            if is_dataclass(part) and isinstance(part, type):
                names += dotted(part, f"{prefix}{field.name}.")
    return tuple(names)


def described(kind: type[Any]) -> dict[str, str]:
    """Return the description of every field in a dataclass' docstring."""
    listed = re.split(r"\n(?:Args|Attributes):\n", inspect.getdoc(kind) or "")[-1].split("\n\n")[0]
    entries = re.split(r"\n {4}(?=\w+: )", "\n" + listed)[1:]
    return {name: " ".join(text.split()) for name, text in (entry.split(": ", 1) for entry in entries)}
