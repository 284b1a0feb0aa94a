"""Calls of subs and functions, and what a name that means nothing is answered with."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from gantrysim.controllers.softmc.basic import properties
from gantrysim.controllers.softmc.basic.task import Expression, Frame, Routine
from gantrysim.controllers.softmc.basic.values import Value, Variable, converted
from gantrysim.controllers.softmc.commands import SoftMCError


def called(routine: Routine, arguments: Sequence[Expression], names: Sequence[str | None], frame: Frame) -> Value:
    """Return the value of a function, 0 of a sub.

    Variables pass by reference, unless the parameter is BYVAL.

    Raises:
        SoftMCError: another number of arguments, an argument of another kind, or calls too deep.
    """
    task = frame.task
    if len(arguments) != len(routine.parameters):
        raise SoftMCError(f"{routine.name} of {len(arguments)} arguments: must have {len(routine.parameters)}")
    if task.depth >= task.deepest:
        raise SoftMCError(f"{routine.name}: calls are nested more than {task.deepest} deep")
    local: dict[str, Variable] = {}
    for (parameter, by_value, kind), argument, name in zip(routine.parameters, arguments, names, strict=True):
        variable = frame.find(name.lower()) if name is not None and not by_value else None
        if variable is not None and not variable.fixed and (isinstance(variable.value, list) or variable.kind == kind):
            local[parameter.lower()] = variable
        else:
            held = argument(frame)
            value = held if isinstance(held, list) else converted(parameter, kind, held)
            local[parameter.lower()] = Variable(parameter, kind, value)
    if routine.kind is not None:
        initial: Any = 0.0 if routine.kind in ("long", "double") else "" if routine.kind == "string" else None
        local[routine.name.lower()] = Variable(routine.name, routine.kind, initial)
    task.depth += 1
    line = task.line
    task.run(routine.block, Frame(task, local))
    task.depth -= 1
    task.line = line
    if routine.kind is None:
        return 0.0
    result = local[routine.name.lower()].value
    if result is None:
        raise SoftMCError(f"{routine.name} returns nothing: must be assigned a value")
    return result


def executed(arguments: Sequence[Value], frame: Frame) -> float:
    """Return 0 after a text has run as statements."""
    if len(arguments) != 1 or not isinstance(arguments[0], str):
        raise SoftMCError("VesExecute: must have one string")
    if frame.task.depth >= frame.task.deepest:
        raise SoftMCError(f"VesExecute: calls are nested more than {frame.task.deepest} deep")
    frame.task.depth += 1
    frame.task.run(frame.task.interpret(arguments[0], frame.task.line), frame)
    frame.task.depth -= 1
    return 0.0


def unknown_name(name: str, frame: Frame) -> SoftMCError:
    """Return the error for a name that means nothing."""
    known = {*frame.local, *frame.task.shared, *frame.task.routines, *properties.NAMES}
    return SoftMCError(f"unknown name {name!r}{properties.hint(name.lower(), known)}")
