"""The registry of motion controllers, by the names in job files, and controllers of the user's own."""

from __future__ import annotations

import inspect
import math
import re
import sys
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from functools import cache
from importlib import import_module
from typing import Any, get_args, get_type_hints

import tomli_w
from pydantic import ConfigDict, ValidationError
from pydantic.dataclasses import dataclass as validated
from pydantic.errors import PydanticUserError

from gantrysim.base.errors import GantryError, InputError, text_of, unknown
from gantrysim.base.user_code import is_code, named_object
from gantrysim.controllers.controller import Controller
from gantrysim.paths.kinds import KINDS
from gantrysim.paths.path import Path
from gantrysim.record.setpoints import Setpoints

_METHODS = tuple(name for name in vars(Controller) if name in Controller.__abstractmethods__)
_RESERVED = ("controller", "file")  # keys of every table [program]
_BASE = "gantrysim.controllers.controller.Controller"


# A program that runs a circle, for a job that tests a machine whatever its controller is.


def circle_program(radius: float, speed: float, acceleration: float, angle: float) -> dict[str, Any]:
    """Return a program that runs along a circle about the zero of the axes x and y, from the positive x axis on.

    softMC's CIRCLE takes any angle in one command, so that nothing stops the motion between two turns.

    Args:
        radius: of the circle [mm].
        speed: along it [mm/s].
        acceleration: along it at start and end [mm/s²].
        angle: of the motion, counter-clockwise positive [deg].
    """
    return {
        "controller": "softmc.Program",
        "program": f"Circle G1 Angle={angle:.10g} CircleCenter={{0, 0}}",
        "start": [radius, 0.0],
        "group": {"velocity": speed, "acceleration": acceleration},
    }


class Programs(Mapping[str, type[Controller]]):
    """The built-in controllers by their names, each imported at its first use: together they take as long as a run.

    Args:
        places: module of each, and its class.
    """

    def __init__(self, places: Mapping[str, tuple[str, str]]) -> None:
        self._places = dict(places)
        self._imported: dict[str, type[Controller]] = {}

    def __getitem__(self, name: str) -> type[Controller]:
        if name not in self._imported:
            module, kind = self._places[name]
            self._imported[name] = getattr(import_module(f"gantrysim.{module}"), kind)
        return self._imported[name]

    def __contains__(self, name: object) -> bool:
        return name in self._places

    def __iter__(self) -> Iterator[str]:
        return iter(self._places)

    def __len__(self) -> int:
        return len(self._places)


PROGRAMS = Programs(
    {
        "trio.MoveSpiral": ("controllers.trio", "MoveSpiral"),
        "trio.Basic": ("controllers.trio", "Basic"),
        "fanuc.Program": ("controllers.fanuc", "Program"),
        "softmc.Program": ("controllers.softmc", "Program"),
        "softmc.Basic": ("controllers.softmc", "Basic"),
        "stage.OutlineTrace": ("controllers.stage", "OutlineTrace"),
        "linuxcnc.Program": ("controllers.gcode.linuxcnc", "Program"),
        "slicer.Program": ("controllers.gcode.slicer", "Program"),
        "cad.Drawing": ("controllers.drawings", "Drawing"),
    }
)

_MAGNITUDES = 1e-100, 1e12  # of numbers; smaller ones than 1e-12 are rounding
# tuples, as a union would be made anew at every use
_NUMBERS = (int, float)
_LISTS = (list, tuple)
_NO_TABLES = (str, *_NUMBERS, *_LISTS)  # whether anything else is a mapping takes longer to find out
_STRICT = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=True)


def program_class(name: str) -> type[Controller]:
    """Return the class of a controller: a built-in one, or the user's own, whose code runs.

    Raises:
        InputError: an unknown controller, or a class that is none.
    """
    if is_code(name):
        return user_controller(name)
    if name not in PROGRAMS:
        raise unknown("controller", name, PROGRAMS)
    return PROGRAMS[name]


def build(name: str, values: Mapping[str, Any]) -> Controller:
    """Return a controller with its program.

    Raises:
        InputError: an unknown controller, or a program that it refuses.
        pydantic.ValidationError: a missing or unknown argument, or one of the wrong type.
    """
    program = program_class(name)
    reject_booleans(program, values)
    _reject_extremes("", values)
    return _build_users(name, program, values) if is_code(name) else _validated_program(program)(**values)


def _build_users(name: str, program: type[Controller], values: Mapping[str, Any]) -> Controller:
    """Return the user's own controller, or raise InputError for whatever its code raises."""
    try:
        constructor = _validated_program(program)
    except (PydanticUserError, TypeError) as error:  # an annotation that is no type of values
        raise InputError(
            f"controller {name!r}: its fields cannot be keys of a job file: {text_of(error):.300}"
        ) from None
    try:
        controller: Controller = constructor(**values)
    except (GantryError, ValidationError):
        raise
    except (Exception, SystemExit) as error:
        raise InputError(f"controller {name!r}: its constructor raised {text_of(error)}") from None
    check_arguments(name, controller.arguments())
    return controller


@cache
def _validated_program(program: type[Controller]) -> Callable[..., Any]:
    return validated(config=_STRICT)(program)  # slow


def reject_booleans(kind: type[Any], values: Mapping[str, Any], prefix: str = "") -> None:
    """Raise InputError for true or false where a number belongs, which pydantic would take as 1 or 0.

    Args:
        kind: dataclass, or other class with annotations, of the values.
        values: by name.
        prefix: of the names in the message.
    """
    kinds_of = _kinds_by_name(kind)  # type: ignore[arg-type]  # mypy takes a type for not hashable
    for name, value in values.items():
        items = value if isinstance(value, _LISTS) else (value,)
        has_booleans = bool in map(type, items)
        if not has_booleans and isinstance(value, _NO_TABLES):
            continue
        kinds = kinds_of.get(name, ())
        if has_booleans and kinds and bool not in kinds and Any not in kinds:
            raise InputError(f"{prefix}{name} = {str(value).lower()}: true and false are not numbers")
        nested = next((part for part in kinds if isinstance(part, type) and is_dataclass(part)), None)
        if nested is not None and isinstance(value, Mapping):
            reject_booleans(nested, value, f"{prefix}{name}.")


@cache
def _kinds_by_name(kind: type[Any]) -> dict[str, tuple[Any, ...]]:
    """Return the type of every field, and the types that a union consists of."""
    return {name: (hint, *get_args(hint)) for name, hint in get_type_hints(kind).items()}  # slow


def _reject_extremes(name: str, value: object) -> None:
    """Raise InputError for a number, in a value or in its parts, that no machine has and arithmetic may not survive."""
    if isinstance(value, _NUMBERS):
        least, most = _MAGNITUDES
        is_plain = not value or isinstance(value, bool) or least <= abs(value) <= most
        if not (is_plain or abs(value) == math.inf or value != value):
            shown = f"{value:g}" if isinstance(value, float) else f"an integer of {len(str(value))} digits"
            raise InputError(f"{name} = {shown}: must be 0 or from {least:g} to {most:g} in magnitude")
    elif isinstance(value, _LISTS):
        for part in value:
            _reject_extremes(name, part)
    elif not isinstance(value, _NO_TABLES) and isinstance(value, Mapping):
        for key, part in value.items():
            _reject_extremes(f"{name}.{key}" if name else str(key), part)


def suffixes() -> tuple[str, ...]:
    """Return the suffixes of the program files that controllers read."""
    return tuple(sorted({suffix for program in PROGRAMS.values() for suffix in program.suffixes}))


def reader(suffix: str, controller: str | None = None) -> str:
    """Return the name of the controller that reads a program file.

    Args:
        suffix: of the file, with its dot.
        controller: its name or the part before the dot, in any case, or the name of the user's own class; by default
            the controller of the suffix.

    Raises:
        InputError: a suffix that no controller has, an unknown controller, or one that reads no program files.
    """
    if controller is not None and is_code(controller):
        program = program_class(controller)
        if not _reads_files(program):
            raise InputError(f"controller {controller!r}: reads no program files: has no field {program.text_argument}")
        return controller
    reading = {name: program for name, program in PROGRAMS.items() if _reads_files(program)}
    if controller is None:
        fitting = [name for name, program in reading.items() if suffix.lower() in program.suffixes]
        if not fitting:
            raise unknown("kind of program file", suffix, suffixes())
        return fitting[0]
    wanted = controller.lower()
    fitting = [name for name in reading if wanted in (name.lower(), name.lower().split(".")[0])]
    if not fitting:
        raise unknown("controller of a program file", controller, reading)
    return fitting[0]


def _reads_files(program: type[Controller]) -> bool:
    return program.text_argument in getattr(program, "__dataclass_fields__", ())


def keys(table: Mapping[str, Any], *, allow_code: bool) -> list[str]:
    """Return the dotted names of a program's arguments, including nested ones; none of an unknown program.

    Args:
        table: [program] of a job file.
        allow_code: whether the user's own controller may be imported; its keys are those in the table otherwise.

    Raises:
        InputError: the user's own controller cannot be imported.
    """
    name = str(table.get("controller"))
    if is_code(name):
        return list(dotted_names(program_class(name))) if allow_code else list(_keys_in(table))
    return list(dotted_names(PROGRAMS[name])) if name in PROGRAMS else []


def _keys_in(table: Mapping[str, Any], prefix: str = "") -> Iterator[str]:
    """Yield the dotted names of the values in a table and its nested tables."""
    for key, value in table.items():
        if f"{prefix}{key}" != "controller":
            yield f"{prefix}{key}"
        if isinstance(value, Mapping):
            yield from _keys_in(value, f"{prefix}{key}.")


@cache
def dotted_names(table: type[Any], prefix: str = "") -> tuple[str, ...]:
    """Return the dotted names of a dataclass' fields, including nested ones."""
    hints = get_type_hints(table)
    names = []
    for field in fields(table):
        names.append(prefix + field.name)
        for part in (hints[field.name], *get_args(hints[field.name])):
            if is_dataclass(part) and isinstance(part, type):
                names += dotted_names(part, f"{prefix}{field.name}.")
    return tuple(names)


def described_fields(described_object: object) -> dict[str, str]:
    """Return the description of every field or argument in a docstring; empty ones where Python drops docstrings."""
    if sys.flags.optimize > 1:
        return defaultdict(str)
    listed = re.split(r"\n(?:Args|Attributes):\n", inspect.getdoc(described_object) or "")[-1].split("\n\n")[0]
    entries = re.split(r"\n {4}(?=\w+: )", "\n" + listed)[1:]
    return {name: " ".join(text.split()) for name, text in (entry.split(": ", 1) for entry in entries)}


def user_controller(name: str) -> type[Controller]:
    """Return the class that "module:Class" or "path/to/file.py:Class" names.

    Raises:
        InputError: there is none, its module cannot be imported, or it is no complete `Controller`.
    """
    named, place = named_object("controller", name)
    label = f"controller {name!r}"
    if named is None:
        raise InputError(f"{label}: {place} has no class {name.rpartition(':')[2]!r}")
    if not isinstance(named, type):
        raise InputError(f"{label}: is not a class but a {type(named).__name__}: must be a class, not what it returns")
    missing = [method for method in _METHODS if not hasattr(named, method)]
    if issubclass(named, Controller):
        missing = [method for method in _METHODS if method in named.__abstractmethods__]
    lacks = f"it lacks {', '.join(missing)}" if missing else ""
    if not issubclass(named, Controller):
        raise InputError(f"{label}: must derive from {_BASE}" + (f"; {lacks}" if lacks else ""))
    if lacks:
        raise InputError(f"{label}: is not a complete controller: {lacks}, see {_BASE}")
    _check_fields(label, named)
    return named


def _check_fields(label: str, kind: type[Controller]) -> None:
    """Check that the keys of a table [program] can be the fields of a controller."""
    parameters = getattr(kind, "__dataclass_params__", None)
    if not is_dataclass(kind) or not getattr(parameters, "frozen", False):
        raise InputError(f"{label}: must be a frozen dataclass, @dataclass(frozen=True)")
    try:
        get_type_hints(kind)
    except Exception as error:  # of an annotation that is evaluated only now
        raise InputError(f"{label}: its fields have a type that is none: {text_of(error)}") from None
    reserved = [field.name for field in fields(kind) if field.name in _RESERVED]
    if reserved:
        raise InputError(f"{label}: has a field {reserved[0]}, which is a key of every program: give it another name")


def check_arguments(name: str, arguments: dict[str, Any]) -> None:
    """Raise InputError for arguments of a user's controller that cannot be written to a job file.

    Args:
        name: of the controller.
        arguments: by name.
    """
    for key, value in arguments.items():
        try:
            tomli_w.dumps({key: value})
        except (TypeError, ValueError) as error:
            kinds = "numbers, texts, lists and tables can"
            raise InputError(f"controller {name!r}: {key} cannot stand in a job file: {error}; {kinds}") from None


def checked_setpoints(name: str, setpoints: Setpoints) -> Setpoints:
    """Return the setpoints of a user's controller.

    A record holds the requested path by its kind, so that it can be read without the user's code.

    Args:
        name: of the controller.
        setpoints: what it returned.

    Raises:
        InputError: they are none, or request a path of a kind that is not gantrysim's.
    """
    if not isinstance(setpoints, Setpoints):
        raise InputError(
            f"controller {name!r}: setpoints returned a value of type {type(setpoints).__name__}: must return "
            "gantrysim.record.setpoints.Setpoints"
        )
    path: object = setpoints.requested
    if type(path) not in KINDS.values():
        which = type(path).__name__ if isinstance(path, Path) else f"{type(path).__name__}, no path"
        raise InputError(
            f"controller {name!r}: its requested path is a {which}: must be one of {', '.join(KINDS)} of "
            "gantrysim.paths, so that its record can be read without its code"
        )
    return setpoints
