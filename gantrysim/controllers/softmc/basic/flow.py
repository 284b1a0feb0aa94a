"""Conditions and loops, a function each: `cmd_while_loop` is WHILE.

What ends a block, or an ELSEIF, is a part of the statement that begins the block: it costs nothing.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from gantrysim.controllers.basic.code import ForLoop
from gantrysim.controllers.basic.statements import Statements
from gantrysim.controllers.softmc.basic.calls import unknown_name
from gantrysim.controllers.softmc.basic.execution import Expression, RoutineFrame
from gantrysim.controllers.softmc.basic.expressions import expression
from gantrysim.controllers.softmc.basic.tree import Node, child, optional, trees, word
from gantrysim.controllers.softmc.basic.tree_assembler import BlockHandler, TreeAssembler
from gantrysim.controllers.softmc.basic.values import Value, compare, number, truth
from gantrysim.controllers.softmc.commands import SoftMCError

block: Statements[BlockHandler] = Statements()


def condition(tree: Node) -> Callable[[RoutineFrame], bool]:
    """Return the function that tells whether a condition holds."""
    value = expression(tree)
    return lambda scope: truth(value(scope))


@block("_IF expr _THEN _NL block elseif* [_ELSE _NL block] _END _IF _NL")
def cmd_if_block(assembler: TreeAssembler, tree: Node, line: int) -> None:
    """IF condition THEN, with blocks."""
    assembler.begin_if(line, condition(child(tree, 0)))
    assembler.add_all(child(tree, 1))
    for branch in trees(tree)[2:]:
        if branch.data == "elseif":
            assembler.begin_elseif(line, condition(child(branch, 0)), None)
            assembler.add_all(child(branch, 1))
        else:
            assembler.begin_else(line)
            assembler.add_all(branch)
    assembler.end_if()


@block("_IF expr _THEN simple [_ELSE simple] _NL")
def cmd_if_line(assembler: TreeAssembler, tree: Node, line: int) -> None:
    """IF condition THEN command, in a line; the command is a part of the statement."""
    assembler.begin_if(line, condition(child(tree, 0)))
    assembler.add(child(tree, 1), None)
    otherwise = optional(tree, 2)
    if otherwise is not None:
        assembler.begin_else(line)
        assembler.add(otherwise, None)
    assembler.end_if()


@block("_WHILE expr _NL block _END _WHILE _NL")
def cmd_while_loop(assembler: TreeAssembler, tree: Node, line: int) -> None:
    """WHILE condition."""
    goes_on = condition(child(tree, 0))
    assembler.begin_while(line, goes_on)
    assembler.add_all(child(tree, 1))
    assembler.test_again(line, goes_on)


@block("_DO _NL block _LOOP _WHILE expr _NL")
def cmd_do_while(assembler: TreeAssembler, tree: Node, line: int) -> None:
    """DO, LOOP WHILE condition."""
    _begin_do(assembler, tree, line)
    goes_on = condition(child(tree, 1))
    assembler.end_repeat(line, lambda scope: not goes_on(scope))


@block("_DO _NL block _LOOP _UNTIL expr _NL")
def cmd_do_until(assembler: TreeAssembler, tree: Node, line: int) -> None:
    """DO, LOOP UNTIL condition."""
    _begin_do(assembler, tree, line)
    assembler.end_repeat(line, condition(child(tree, 1)))


def _begin_do(assembler: TreeAssembler, tree: Node, line: int) -> None:
    assembler.emit(line, lambda scope: None)
    assembler.begin_repeat(line)
    assembler.add_all(child(tree, 0))


@block('_FOR NAME "=" expr _TO expr [_STEP expr] _NL block _NEXT [NAME] _NL')
def cmd_for_loop(assembler: TreeAssembler, tree: Node, line: int) -> None:
    """FOR variable = first TO last [STEP step]."""
    name = word(tree)
    first = expression(child(tree, 1))
    last = expression(child(tree, 2))
    step = optional(tree, 3)
    start = _start(name, first, last, None if step is None else expression(step))
    assembler.begin_for(line, name, start)
    assembler.add_all(child(tree, 4))
    closing = tree.children[5]
    if closing is not None and str(closing).lower() != name.lower():
        raise SoftMCError(f"next {closing}: must be next {name}")
    assembler.end_for(line, assembler.close("next", "FOR"))


def _start(
    name: str, first: Expression, last: Expression, step: Expression | None
) -> Callable[[RoutineFrame], ForLoop]:
    key = name.lower()

    def start(scope: RoutineFrame) -> ForLoop:
        variable = scope.find(key)
        if variable is None:
            raise unknown_name(name, scope)
        end = number("end", last(scope))
        stride = 1.0 if step is None else number("step", step(scope))
        if not stride:
            raise SoftMCError("step = 0: must not be 0")
        variable.assign(first(scope))
        return ForLoop(lambda: number(name, variable.value), variable.assign, end, stride)

    return start


@block("_SELECT _CASE expr _NL case* [_CASE _ELSE _NL block] _END _SELECT _NL")
def cmd_select(assembler: TreeAssembler, tree: Node, line: int) -> None:
    """SELECT CASE value: the first case that holds."""
    value = expression(child(tree, 0))
    cases: list[list[Callable[[Value, RoutineFrame], bool]]] = []  # choices of each

    def add_branch(part: Node) -> None:
        if part.data == "block":  # CASE ELSE
            assembler.add_all(part)
            return
        *choices, block_of_case = trees(part)
        cases.append([_choice(choice) for choice in choices])
        assembler.add_all(block_of_case)

    def index_of_case(scope: RoutineFrame) -> int:
        selected = value(scope)
        for k, choices in enumerate(cases):
            if any(holds(selected, scope) for holds in choices):
                return k
        return len(cases)

    assembler.select(line, index_of_case, [partial(add_branch, part) for part in trees(tree)[1:]])


def _choice(tree: Node) -> Callable[[Value, RoutineFrame], bool]:
    """Return whether a choice of a case holds for a value."""
    if tree.data == "span":
        low = expression(child(tree, 0))
        high = expression(child(tree, 1))
        return lambda value, scope: bool(compare(">=", value, low(scope)) and compare("<=", value, high(scope)))
    if tree.data == "test":
        symbol = word(tree)
        bound = expression(child(tree, 1))
        return lambda value, scope: bool(compare(symbol, value, bound(scope)))
    same = expression(child(tree, 0))
    return lambda value, scope: bool(compare("=", value, same(scope)))
