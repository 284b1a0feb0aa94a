"""The registry of motion controllers, by the names in job files."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from functools import cache
from typing import Any, get_args, get_type_hints

from pydantic import ConfigDict
from pydantic.dataclasses import dataclass as validated

from gantrysim.controllers import cad, fanuc, softmc, stage, trio
from gantrysim.controllers.controller import Controller
from gantrysim.errors import unknown

PROGRAMS: dict[str, type[Controller]] = {
    "trio.MoveSpiral": trio.MoveSpiral,
    "fanuc.Program": fanuc.Program,
    "softmc.Program": softmc.Program,
    "stage.OutlineTrace": stage.OutlineTrace,
    "cad.Drawing": cad.Drawing,
}

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
    return _validated[name](**values)


def keys(name: str) -> list[str]:
    """Return the dotted names of a program's arguments, including nested ones; none of an unknown program."""
    return list(dotted(PROGRAMS[name])) if name in PROGRAMS else []


@cache
def dotted(table: type[Any], prefix: str = "") -> tuple[str, ...]:
    """Return the dotted names of a dataclass' fields, including nested ones."""
    hints, names = get_type_hints(table), []
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
