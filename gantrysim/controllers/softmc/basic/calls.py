"""Calls of subs and functions, and the error for a name that means nothing."""

from __future__ import annotations

from collections.abc import Sequence

from gantrysim.controllers.softmc.basic import properties
from gantrysim.controllers.softmc.basic.execution import Expression, Routine, RoutineFrame
from gantrysim.controllers.softmc.basic.tree import Node, name_of, trees
from gantrysim.controllers.softmc.basic.values import INITIAL, Value, Variable, converted
from gantrysim.controllers.softmc.commands import SoftMCError


class Arguments:
    """The arguments of a call.

    Attributes:
        values: their evaluations.
        names: of those that are nothing but a name, which pass by reference.
    """

    def __init__(self, values: Sequence[Expression], listed: Sequence[Node]) -> None:
        self.values = values
        self.names = [name_of(tree) for tree in listed]


NO_ARGUMENTS = Arguments((), ())


def call(routine: Routine, arguments: Arguments, scope: RoutineFrame) -> Value:
    """Return the value of a function, 0 of a sub.

    Variables pass by reference, unless the parameter is BYVAL.

    Raises:
        SoftMCError: another number of arguments, an argument of another kind, or calls too deep.
    """
    execution = scope.execution
    if len(arguments.values) != len(routine.parameters):
        raise SoftMCError(f"{routine.name} of {len(arguments.values)} arguments: must have {len(routine.parameters)}")
    execution.check_depth(routine.name)
    variables = _passed(routine, arguments, scope)
    if routine.kind is not None:
        # the function's name is the variable that holds its value
        variables[routine.name.lower()] = Variable(routine.name, routine.kind, INITIAL.get(routine.kind))
    execution.call(routine.code, variables)
    if routine.kind is None:
        return 0.0
    result: Value | None = variables[routine.name.lower()].value
    if result is None:
        raise SoftMCError(f"{routine.name} returns nothing: must be assigned a value")
    return result


def _passed(routine: Routine, arguments: Arguments, scope: RoutineFrame) -> dict[str, Variable]:
    """Return the parameters as variables of the routine."""
    variables: dict[str, Variable] = {}
    for (parameter, by_value, kind), argument, name in zip(
        routine.parameters, arguments.values, arguments.names, strict=True
    ):
        # an expression, a constant, or a variable of another kind cannot be assigned to by the routine
        variable = scope.find(name.lower()) if name is not None and not by_value else None
        if variable is not None and not variable.fixed and (isinstance(variable.value, list) or variable.kind == kind):
            variables[parameter.lower()] = variable
        else:
            value = argument(scope)
            held = value if isinstance(value, list) else converted(parameter, kind, value)
            variables[parameter.lower()] = Variable(parameter, kind, held)
    return variables


def execute_text(arguments: Sequence[Value], scope: RoutineFrame) -> float:
    """Return 0 after a text has run as statements of the scope."""
    if len(arguments) != 1 or not isinstance(arguments[0], str):
        raise SoftMCError("VesExecute: must have one string")
    execution = scope.execution
    execution.check_depth("VesExecute")
    execution.call(execution.interpret(arguments[0], execution.clock.line), scope.variables)
    return 0.0


def listed_arguments(tree: Node) -> list[Node]:
    """Return the trees of the arguments in brackets, which may be missing."""
    exprs = tree.children[1]
    return [] if exprs is None or isinstance(exprs, str) else trees(exprs)


def unknown_name(name: str, scope: RoutineFrame) -> SoftMCError:
    """Return the error for a name that means nothing."""
    known = {*scope.variables, *scope.shared, *scope.execution.routines, *properties.NAMES}
    return SoftMCError(f"unknown name {name!r}{properties.hint(name.lower(), known)}")
