"""A controller of the user's own: a class in a module or in a file, named in a job as its controller."""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from typing import Any, get_type_hints

import tomli_w

from gantrysim.base.errors import InputError, text_of
from gantrysim.base.user_code import named_object
from gantrysim.controllers.controller import Controller
from gantrysim.paths.kinds import KINDS
from gantrysim.paths.path import Path
from gantrysim.record.setpoints import Setpoints

_METHODS = tuple(name for name in vars(Controller) if name in Controller.__abstractmethods__)
_RESERVED = ("controller", "file")  # keys of every table [program]
_BASE = "gantrysim.controllers.controller.Controller"


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
