"""Declarations of variables, groups, subs and functions."""

from __future__ import annotations

from typing import Any

from lark import Token

from gantrysim.controllers.basic.statements import Statements
from gantrysim.controllers.softmc.basic.execution import Action, Routine, RoutineFrame
from gantrysim.controllers.softmc.basic.expressions import expression, several
from gantrysim.controllers.softmc.basic.tree import Node, child, optional, trees, word
from gantrysim.controllers.softmc.basic.tree_assembler import CommandHandler
from gantrysim.controllers.softmc.basic.values import INITIAL, Value, Variable, converted
from gantrysim.controllers.softmc.commands import SoftMCError

command: Statements[CommandHandler] = Statements()

_KINDS = {"long": "long", "double": "double", "string": "string", "joint": "point", "location": "point"}


def routine(tree: Node) -> Routine:
    """Return a sub or a function, without its code."""
    declared = optional(tree, 1)
    parameters = []
    for parameter in [] if declared is None else trees(declared):
        by_value, name, _, _ = parameter.children
        parameters.append((str(name), by_value is not None, _kind(child(parameter, 3))))
    kind = _kind(child(tree, 2)) if tree.data == "function" else None
    return Routine(word(tree), parameters, kind)


def _kind(tree: Node) -> str:
    words = [str(part).lower() for part in tree.children if part is not None]
    return next((kind for name, kind in _KINDS.items() if name in words[:1]), "element")


@command('(_DIM | COMMON) [SHARED] [CONST] declared ("," declared)* _AS [CONST] type ["=" expr]')
def cmd_dim(tree: Node) -> Action:
    """DIM and COMMON: variables, constants, arrays and groups."""
    words = {str(part).lower() for part in tree.children if isinstance(part, Token)}
    declared = [part for part in trees(tree) if part.data == "declared"]
    type_ = next(part for part in trees(tree) if part.data == "type")
    last = optional(tree, -1)
    initial = expression(last) if last is not None and last is not type_ else None
    kind = _kind(type_)
    words_of_type = [str(part) for part in type_.children if part is not None]
    is_shared = bool(words & {"shared", "common"})
    is_constant = "const" in words
    is_group = words_of_type[0].lower() == "group"
    if is_group and any(name.lower() != "axnm" for name in words_of_type[1::2]):
        raise SoftMCError("group: must be followed by Axnm = axis")
    axes = tuple(axis.lower() for axis in words_of_type[2::2])
    sizes = [(word(part), [size for sub in trees(part) for size in several(sub)]) for part in declared]

    def act(scope: RoutineFrame) -> None:
        execution = scope.execution
        for name, dimensions in sizes:
            value: Value | None = INITIAL.get(kind)
            if is_group:
                value = execution.elements.declared_group(name, axes)
            if initial is not None:
                value = converted(name, kind, initial(scope))
            items: Any = execution.array([size(scope) for size in dimensions], value)
            variables = scope.shared if is_shared else scope.variables
            variables[name.lower()] = Variable(name, kind, items, is_constant)

    return act
