"""Expressions of MC-Basic as functions of a frame."""

from __future__ import annotations

from lark import Tree

from gantrysim.base.errors import unknown_text
from gantrysim.controllers.softmc.basic import properties
from gantrysim.controllers.softmc.basic.calls import called, executed, unknown_name
from gantrysim.controllers.softmc.basic.syntax import Node
from gantrysim.controllers.softmc.basic.task import Expression, Frame
from gantrysim.controllers.softmc.basic.values import (
    CONSTANTS,
    FUNCTIONS,
    Element,
    Point,
    Value,
    builtin,
    compare,
    negative,
    number,
    operate,
    text_of,
)
from gantrysim.controllers.softmc.commands import SoftMCError

_MOST_COORDINATES = 10


def expression(tree: Node) -> Expression:
    """Return the function that evaluates an expression."""
    return _MAKERS[str(tree.data)](tree)


def several(tree: Node | None) -> list[Expression]:
    """Return the functions of a list of expressions."""
    return [] if tree is None else [expression(child) for child in trees(tree)]


def trees(tree: Node) -> list[Node]:
    """Return the children that are trees."""
    return [child for child in tree.children if isinstance(child, Tree)]


def word(tree: Node, k: int = 0) -> str:
    """Return a child that is a token."""
    return str(tree.children[k])


def child(tree: Node, k: int) -> Node:
    """Return a child that is a tree."""
    found = tree.children[k]
    assert isinstance(found, Tree)
    return found


def truth(value: Value) -> bool:
    """Return whether a condition holds."""
    return number("condition", value) != 0


def name_of(tree: Node) -> str | None:
    """Return the name that a tree is, or None."""
    return word(tree) if tree.data in ("name", "target") else None


def indexed(tree: Node) -> tuple[str, list[Expression]]:
    """Return the name and the indices of an item of an array.

    Raises:
        SoftMCError: what has an index is no name.
    """
    indices: list[Expression] = []
    while tree.data == "item":
        indices = several(child(tree, 1)) + indices
        tree = child(tree, 0)
    name = name_of(tree)
    if name is None:
        raise SoftMCError("an index in [ ]: must follow the name of an array")
    return name, indices


def element(tree: Node) -> Expression:
    """Return the function that finds the axis or group of a tree."""
    name = name_of(tree)
    if name is None:
        inner = expression(tree)

        def evaluated(frame: Frame) -> Value:
            value = inner(frame)
            if not isinstance(value, Element):
                raise SoftMCError(f"{text_of(value)}: must be an axis or a group")
            return value

        return evaluated

    def named(frame: Frame) -> Value:
        found = frame.task.element(name, frame)
        if found is None:
            raise SoftMCError(f"{name}: must be an axis or a group; {_group_words(frame)}")
        return found

    return named


def _group_words(frame: Frame) -> str:
    moved = frame.task.moved
    return "none is declared" if moved is None else f"the group is {moved.name}"


def _number(tree: Node) -> Expression:
    text = word(tree).lower()
    value = float(int(text, 16)) if text.startswith("0x") else float(text)
    return lambda frame: value


def _string(tree: Node) -> Expression:
    value = word(tree)[1:-1]
    return lambda frame: value


def _name(tree: Node) -> Expression:
    name = word(tree)
    key = word(tree).lower()

    def value(frame: Frame) -> Value:
        variable = frame.find(key)
        if variable is not None:
            if variable.value is None:
                raise SoftMCError(f"{name} has no value yet: must be assigned first")
            return variable.value
        if key in CONSTANTS:
            return CONSTANTS[key]
        routine = frame.task.routines.get(key)
        if routine is not None and routine.kind is not None:
            return called(routine, [], [], frame)
        if properties.is_property(key):
            return frame.task.read(frame.task.focus(), key)
        if key in frame.task.elements:
            return frame.task.elements[key]
        if key[0] in "aj" and key[1:].isdigit() and (found := frame.task.element(key, frame)) is not None:
            return found
        raise unknown_name(name, frame)

    return value


def _call(tree: Node) -> Expression:
    name = word(tree)
    key = word(tree).lower()
    given = tree.children[1]
    listed = trees(given) if isinstance(given, Tree) else []
    arguments = [expression(one) for one in listed]
    names = [name_of(one) for one in listed]

    def value(frame: Frame) -> Value:
        routine = frame.task.routines.get(key)
        if routine is not None:
            if routine.kind is None:
                raise SoftMCError(f"{routine.name} is a sub: must be called by CALL")
            return called(routine, arguments, names, frame)
        if key in FUNCTIONS:
            return builtin(key, [argument(frame) for argument in arguments])
        if key == "vesexecute":
            return executed([argument(frame) for argument in arguments], frame)
        raise SoftMCError(f"{unknown_text('function', name, FUNCTIONS)}, and those of the program")

    return value


def _point(tree: Node) -> Expression:
    parts = several(child(tree, 0))
    if len(parts) > _MOST_COORDINATES:
        raise SoftMCError(f"a point of {len(parts)} numbers: must have at most {_MOST_COORDINATES}")
    return lambda frame: Point(tuple(number("coordinate", part(frame)) for part in parts))


def _item(tree: Node) -> Expression:
    name, indices = indexed(tree)
    key = name.lower()

    def value(frame: Frame) -> Value:
        variable = frame.find(key)
        if variable is None:
            raise unknown_name(name, frame)
        found = variable.item([index(frame) for index in indices])
        if found is None:
            raise SoftMCError(f"{name} has no value at that index: must be assigned first")
        return found

    return value


def _component(tree: Node) -> Expression:
    of = expression(child(tree, 0))
    which = expression(_only(child(tree, 1)))

    def value(frame: Frame) -> Value:
        point = of(frame)
        k = number("coordinate's number", which(frame))
        if not isinstance(point, Point) or not 1 <= k <= len(point.values):
            raise SoftMCError(f"{text_of(point)}{{{k:g}}}: must be a coordinate of a point")
        return point.values[int(k) - 1]

    return value


def _only(tree: Node) -> Node:
    """Return the only index within braces."""
    if tree.data != "sums":
        return tree
    if len(tree.children) != 1:
        raise SoftMCError("a coordinate's number in { }: must be one number")
    return child(tree, 0)


def _member(tree: Node) -> Expression:
    of = element(child(tree, 0))
    name = word(tree, 1)

    def value(frame: Frame) -> Value:
        found = of(frame)
        assert isinstance(found, Element)
        return frame.task.read(found, name)

    return value


def port(tree: Node) -> int:
    """Return the number of a digital output, `sys.dout.1`.

    Raises:
        SoftMCError: something else before the number.
    """
    of = child(tree, 0)
    digits = word(tree, 1)[1:]
    is_output = of.data == "member" and word(of, 1).lower() == "dout"
    if not is_output or (name_of(child(of, 0)) or "").lower() not in ("sys", "system"):
        raise SoftMCError(f".{digits}: must follow sys.dout")
    return int(digits[:9])


def _port(tree: Node) -> Expression:
    which = port(tree)
    return lambda frame: frame.task.outputs.get(which, 0.0)


def _binary(tree: Node) -> Expression:
    a = expression(child(tree, 0))
    symbol = word(tree, 1)
    b = expression(child(tree, 2))
    return lambda frame: operate(symbol, a(frame), b(frame))


def _negative(tree: Node) -> Expression:
    of = expression(child(tree, -1))
    return lambda frame: negative(of(frame))


def _compare(tree: Node) -> Expression:
    a = expression(child(tree, 0))
    symbol = word(tree, 1)
    b = expression(child(tree, 2))
    return lambda frame: compare(symbol, a(frame), b(frame))


def _equal(tree: Node) -> Expression:
    a = expression(child(tree, 0))
    b = expression(child(tree, 1))
    return lambda frame: compare("=", a(frame), b(frame))


def _not(tree: Node) -> Expression:
    of = expression(child(tree, 0))
    return lambda frame: float(not truth(of(frame)))


def _logic(tree: Node) -> Expression:
    a = expression(child(tree, 0))
    symbol = word(tree, 1).lower()
    b = expression(child(tree, 2))
    if symbol == "and":
        return lambda frame: float(truth(a(frame)) and truth(b(frame)))
    if symbol == "or":
        return lambda frame: float(truth(a(frame)) or truth(b(frame)))
    return lambda frame: float(truth(a(frame)) != truth(b(frame)))


_MAKERS = {
    "number": _number,
    "string": _string,
    "name": _name,
    "target": _name,
    "call": _call,
    "joint": _point,
    "location": _point,
    "item": _item,
    "component": _component,
    "member": _member,
    "port": _port,
    "binary": _binary,
    "negative": _negative,
    "compare": _compare,
    "equal": _equal,
    "not_": _not,
    "logic": _logic,
}
