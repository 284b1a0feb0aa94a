"""Declarations of variables, groups, subs and functions."""

from __future__ import annotations

from typing import Any

from lark import Token, Tree

from gantrysim.controllers.softmc.basic.expressions import child, expression, several, trees, word
from gantrysim.controllers.softmc.basic.syntax import Node
from gantrysim.controllers.softmc.basic.task import Frame, Routine, Statement
from gantrysim.controllers.softmc.basic.values import Value, Variable, converted
from gantrysim.controllers.softmc.commands import SoftMCError

_KINDS = {"long": "long", "double": "double", "string": "string", "joint": "point", "location": "point"}
_INITIAL: dict[str, Value] = {"long": 0.0, "double": 0.0, "string": ""}


def routine(tree: Node) -> Routine:
    """Return a sub or a function, without its block."""
    given = tree.children[1]
    parameters = []
    for one in trees(given) if isinstance(given, Tree) else []:
        by_value, name, _, type_ = one.children
        assert isinstance(type_, Tree)
        parameters.append((str(name), by_value is not None, _kind(type_)))
    kind = _kind(child(tree, 2)) if tree.data == "function" else None
    return Routine(word(tree), parameters, kind)


def _kind(tree: Node) -> str:
    names = [str(one).lower() for one in tree.children if one is not None]
    return next((kind for name, kind in _KINDS.items() if name in names[:1]), "element")


def dim(tree: Node) -> Statement:
    """DIM and COMMON: variables, constants, arrays and groups."""
    words = {str(one).lower() for one in tree.children if isinstance(one, Token)}
    declared = [one for one in trees(tree) if one.data == "declared"]
    type_ = next(one for one in trees(tree) if one.data == "type")
    last = tree.children[-1]
    given = expression(last) if isinstance(last, Tree) and last is not type_ else None
    kind = _kind(type_)
    of = [str(one) for one in type_.children if one is not None]
    shared = bool(words & {"shared", "common"})
    fixed = "const" in words
    is_group = of[0].lower() == "group"
    if is_group and any(name.lower() != "axnm" for name in of[1::2]):
        raise SoftMCError("group: must be followed by Axnm = axis")
    sizes = [(word(one), [size for sub in trees(one) for size in several(sub)]) for one in declared]

    def do(frame: Frame) -> None:
        for name, dimensions in sizes:
            value: Value | None = _INITIAL.get(kind)
            if is_group:
                value = frame.task.declared_group(name, tuple(axis.lower() for axis in of[2::2]))
            if given is not None:
                value = converted(name, kind, given(frame))
            held: Any = frame.task.array([size(frame) for size in dimensions], value)
            scope = frame.task.shared if shared else frame.local
            scope[name.lower()] = Variable(name, kind, held, fixed)

    return do
