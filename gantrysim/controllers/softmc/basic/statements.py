"""Statements of MC-Basic as functions of a frame."""

from __future__ import annotations

from collections.abc import Callable

from lark import Tree

from gantrysim.base.errors import InputError, unknown_text
from gantrysim.controllers.softmc.basic import declarations, motion, properties
from gantrysim.controllers.softmc.basic.calls import called, unknown_name
from gantrysim.controllers.softmc.basic.expressions import (
    child,
    element,
    expression,
    indexed,
    name_of,
    port,
    trees,
    truth,
    word,
)
from gantrysim.controllers.softmc.basic.syntax import Node, parse
from gantrysim.controllers.softmc.basic.task import Block, Expression, Frame, Statement
from gantrysim.controllers.softmc.basic.values import Element, Value, compare, number
from gantrysim.controllers.softmc.commands import SoftMCError


class LocatedError(SoftMCError):
    """An error with its line."""


def block(tree: Node) -> Block:
    """Return the statements of a block with their lines."""
    return [(line_of(one), statement(one)) for one in trees(tree)]


def interpreted(text: str, line: int) -> Block:
    """Return the statements of a text within the program's line."""
    return [(line, statement(one)) for one in trees(parse(text.strip()))]


def statement(tree: Node) -> Statement:
    """Return the function that runs a statement.

    Raises:
        SoftMCError: words that do not fit, with their line.
    """
    make = _MAKERS.get(str(tree.data))
    if make is None:
        raise LocatedError(f"line {line_of(tree)}: a {tree.data} must stand outside of others")
    try:
        return make(tree)
    except LocatedError:
        raise
    except RecursionError:
        raise LocatedError(f"line {line_of(tree)}: must be less deeply nested") from None
    except InputError as error:
        raise LocatedError(f"line {line_of(tree)}: {error}") from None


def line_of(tree: Node) -> int:
    """Return the line of a tree."""
    return int(tree.meta.line)


def _assign(tree: Node) -> Statement:
    target = child(tree, 0)
    value = expression(child(tree, 1))
    if target.data == "target":
        name = word(target)
        key = word(target).lower()

        def to_name(frame: Frame) -> None:
            variable = frame.find(key)
            if variable is not None:
                variable.assign(value(frame))
            elif properties.is_property(key):
                frame.task.assign(frame.task.focus(), name, value(frame))
            else:
                raise unknown_name(name, frame)

        return to_name
    if target.data == "item":
        name, indices = indexed(target)

        def to_item(frame: Frame) -> None:
            variable = frame.find(name.lower())
            if variable is None:
                raise unknown_name(name, frame)
            variable.assign(value(frame), [index(frame) for index in indices])

        return to_item
    if target.data == "member":
        of = element(child(target, 0))
        name = word(target, 1)

        def to_member(frame: Frame) -> None:
            found = of(frame)
            assert isinstance(found, Element)
            frame.task.assign(found, name, value(frame))

        return to_member
    if target.data == "port":
        which = port(target)
        return lambda frame: frame.task.switch(which, number(f"sys.dout.{which}", value(frame)))
    raise SoftMCError("a single coordinate: cannot be assigned; assign the whole point")


def _call_sub(tree: Node) -> Statement:
    name = word(tree)
    given = tree.children[1]
    listed = trees(given) if isinstance(given, Tree) else []
    arguments = [expression(one) for one in listed]
    names = [name_of(one) for one in listed]

    def do(frame: Frame) -> None:
        found = frame.task.routines.get(name.lower())
        if found is None:
            known = [one.name for one in frame.task.routines.values()]
            raise SoftMCError(unknown_text("sub", name, known))
        called(found, arguments, names, frame)

    return do


def _print(tree: Node) -> Statement:
    parts = [expression(one) for one in trees(tree)]
    return lambda frame: frame.task.show([part(frame) for part in parts])


def _if_block(tree: Node) -> Statement:
    cases: list[tuple[Expression, Block]] = [(expression(child(tree, 0)), block(child(tree, 1)))]
    cases += [(expression(child(one, 0)), block(child(one, 1))) for one in trees(tree) if one.data == "elseif"]
    last = tree.children[-1]
    otherwise = block(last) if isinstance(last, Tree) and len(trees(tree)) > len(cases) + 1 else []

    def do(frame: Frame) -> None:
        chosen = next((inner for condition, inner in cases if truth(condition(frame))), otherwise)
        frame.task.run(chosen, frame)

    return do


def _if_line(tree: Node) -> Statement:
    condition = expression(child(tree, 0))
    then = statement(child(tree, 1))
    last = tree.children[2]
    otherwise = statement(last) if isinstance(last, Tree) else None

    def do(frame: Frame) -> None:
        if truth(condition(frame)):
            then(frame)
        elif otherwise is not None:
            otherwise(frame)

    return do


def _while_loop(tree: Node) -> Statement:
    condition = expression(child(tree, 0))
    inner = block(child(tree, 1))
    line = line_of(tree)

    def do(frame: Frame) -> None:
        while truth(condition(frame)):
            frame.task.run(inner, frame)
            frame.task.step(line)

    return do


def _do_loop(tree: Node) -> Statement:
    inner = block(child(tree, 0))
    condition = expression(child(tree, 1))
    line = line_of(tree)
    goes_on = tree.data == "do_while"

    def do(frame: Frame) -> None:
        while True:
            frame.task.run(inner, frame)
            frame.task.step(line)
            if truth(condition(frame)) != goes_on:
                return

    return do


def _for_loop(tree: Node) -> Statement:
    name = word(tree)
    key = word(tree).lower()
    line = line_of(tree)
    first = expression(child(tree, 1))
    last = expression(child(tree, 2))
    step = tree.children[3]
    by = expression(step) if isinstance(step, Tree) else None
    inner = block(child(tree, 4))
    closing = tree.children[5]
    if closing is not None and str(closing).lower() != key:
        raise SoftMCError(f"next {closing}: must be next {name}")

    def do(frame: Frame) -> None:
        variable = frame.find(key)
        if variable is None:
            raise unknown_name(name, frame)
        end = number("end", last(frame))
        stride = 1.0 if by is None else number("step", by(frame))
        if not stride:
            raise SoftMCError("step = 0: must not be 0")
        variable.assign(first(frame))
        while (end - number(name, variable.value)) * stride >= 0:
            frame.task.run(inner, frame)
            frame.task.step(line)
            variable.assign(number(name, variable.value) + stride)

    return do


def _select(tree: Node) -> Statement:
    value = expression(child(tree, 0))
    cases = [
        ([_choice(choice) for choice in trees(one)[:-1]], block(trees(one)[-1]))
        for one in trees(tree)
        if one.data == "case"
    ]
    last = tree.children[-1]
    otherwise = block(last) if isinstance(last, Tree) and last.data == "block" else []

    def do(frame: Frame) -> None:
        held = value(frame)
        chosen = next((inner for tests, inner in cases if any(test(held, frame) for test in tests)), otherwise)
        frame.task.run(chosen, frame)

    return do


def _choice(tree: Node) -> Callable[[Value, Frame], bool]:
    if tree.data == "span":
        low = expression(child(tree, 0))
        high = expression(child(tree, 1))
        return lambda held, frame: bool(compare(">=", held, low(frame)) and compare("<=", held, high(frame)))
    if tree.data == "test":
        symbol = word(tree)
        bound = expression(child(tree, 1))
        return lambda held, frame: bool(compare(symbol, held, bound(frame)))
    same = expression(child(tree, 0))
    return lambda held, frame: bool(compare("=", held, same(frame)))


def _focus(tree: Node) -> Statement:
    given = tree.children[0] if tree.children else None
    of = element(given) if isinstance(given, Tree) else None
    sets = tree.data == "with_element"

    def do(frame: Frame) -> None:
        found = None if of is None else of(frame)
        if sets and isinstance(found, Element):
            frame.task.default = found

    return do


def _end_with(tree: Node) -> Statement:
    def do(frame: Frame) -> None:
        frame.task.default = None

    return do


_MAKERS: dict[str, Callable[[Node], Statement]] = {
    "dim": declarations.dim,
    "assign": _assign,
    "call_sub": _call_sub,
    "print": _print,
    "if_block": _if_block,
    "if_line": _if_line,
    "while_loop": _while_loop,
    "do_while": _do_loop,
    "do_until": _do_loop,
    "for_loop": _for_loop,
    "select": _select,
    "attach": _focus,
    "detach": _focus,
    "configgroup": _focus,
    "with_element": _focus,
    "end_with": _end_with,
    "move": motion.move,
    "circle": motion.circle,
    "delay": motion.delay,
    "sleep": motion.sleep,
    "record": motion.record,
    "recordon": motion.recordon,
    "recordoff": motion.recordoff,
    "recordclose": motion.recordoff,
}
