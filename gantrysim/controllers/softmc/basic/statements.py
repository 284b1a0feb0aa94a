"""Assignments, calls, printing and the element in focus, a function each: `cmd_print` is PRINT."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from lark import Token

from gantrysim.base.errors import unknown_text
from gantrysim.controllers.basic.code import ForLoop
from gantrysim.controllers.basic.statements import Statements
from gantrysim.controllers.softmc.basic import properties
from gantrysim.controllers.softmc.basic.execution import Action, Expression, Routine, RoutineFrame
from gantrysim.controllers.softmc.basic.expressions import (
    Arguments,
    call,
    element,
    expression,
    indexed_item,
    listed_arguments,
    port,
    several,
    unknown_name,
)
from gantrysim.controllers.softmc.basic.tree import (
    BlockHandler,
    CommandHandler,
    Node,
    TreeAssembler,
    child,
    optional,
    trees,
    word,
)
from gantrysim.controllers.softmc.basic.values import (
    INITIAL,
    Element,
    Value,
    Variable,
    compare,
    converted_value,
    number,
    truth,
)
from gantrysim.controllers.softmc.commands import SoftMCError

# Declarations of variables, groups, subs and functions.

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
                value = converted_value(name, kind, initial(scope))
            items: Any = execution.array([size(scope) for size in dimensions], value)
            variables = scope.shared if is_shared else scope.variables
            variables[name.lower()] = Variable(name, kind, items, is_constant)

    return act


# Conditions and loops, a function each: `cmd_while_loop` is WHILE.
#
# What ends a block, or an ELSEIF, is a part of the statement that begins the block: it costs nothing.

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


@command('target "=" expr')
def cmd_assign(tree: Node) -> Action:
    """target = value."""
    target = child(tree, 0)
    store = _STORES.get(str(target.data))
    value = expression(child(tree, 1))
    if store is None:
        raise SoftMCError("a single coordinate: cannot be assigned; assign the whole point")
    return store(target, value)


def _to_name(target: Node, value: Expression) -> Action:
    name = word(target)
    key = word(target).lower()

    def act(scope: RoutineFrame) -> None:
        variable = scope.find(key)
        if variable is not None:
            variable.assign(value(scope))
        elif properties.is_property(key):
            execution = scope.execution
            focus = execution.elements.focus()
            execution.assign(focus, name, value(scope))
        else:
            raise unknown_name(name, scope)

    return act


def _to_item(target: Node, value: Expression) -> Action:
    name, indices = indexed_item(target)

    def act(scope: RoutineFrame) -> None:
        variable = scope.find(name.lower())
        if variable is None:
            raise unknown_name(name, scope)
        variable.assign(value(scope), [index(scope) for index in indices])

    return act


def _to_member(target: Node, value: Expression) -> Action:
    owner = element(child(target, 0))
    name = word(target, 1)

    def act(scope: RoutineFrame) -> None:
        named = owner(scope)
        scope.execution.assign(named, name, value(scope))

    return act


def _to_port(target: Node, value: Expression) -> Action:
    which = port(target)
    return lambda scope: scope.execution.switch(which, number(f"sys.dout.{which}", value(scope)))


_STORES: dict[str, Callable[[Node, Expression], Action]] = {
    "target": _to_name,
    "item": _to_item,
    "member": _to_member,
    "port": _to_port,
}


@command('_CALL NAME ["(" [exprs] ")"]')
def cmd_call_sub(tree: Node) -> Action:
    """CALL sub[(argument, ...)]."""
    name = word(tree)
    listed = listed_arguments(tree)
    arguments = Arguments([expression(argument) for argument in listed], listed)

    def act(scope: RoutineFrame) -> None:
        routines = scope.execution.routines
        routine = routines.get(name.lower())
        if routine is None:
            raise SoftMCError(unknown_text("sub", name, [known.name for known in routines.values()]))
        call(routine, arguments, scope)

    return act


@command('(_PRINT | "?") [expr (("," | ";") expr)* ["," | ";"]]')
def cmd_print(tree: Node) -> Action:
    """PRINT value, ..."""
    parts = [expression(part) for part in trees(tree)]
    return lambda scope: scope.execution.show([part(scope) for part in parts])


@command("_ATTACH [target]")
def cmd_attach(tree: Node) -> Action:
    """ATTACH [element]: has no effect, as no other task runs."""
    return _checking(tree)


@command("_DETACH [target]")
def cmd_detach(tree: Node) -> Action:
    """DETACH [element]: has no effect."""
    return _checking(tree)


@command("_CONFIGGROUP [target]")
def cmd_configgroup(tree: Node) -> Action:
    """CONFIGGROUP [group]: has no effect."""
    return _checking(tree)


def _checking(tree: Node) -> Action:
    """Return what only checks that the named element is one."""
    named = _named_element(tree)

    def act(scope: RoutineFrame) -> None:
        if named is not None:
            named(scope)

    return act


@command("_WITH target")
def cmd_with_element(tree: Node) -> Action:
    """WITH element: properties without an element are those of this one."""
    named = element(child(tree, 0))

    def act(scope: RoutineFrame) -> None:
        scope.execution.elements.default = named(scope)

    return act


@command("_END_WITH")
def cmd_end_with(tree: Node) -> Action:
    """END WITH."""

    def act(scope: RoutineFrame) -> None:
        scope.execution.elements.default = None

    return act


def _named_element(tree: Node) -> Callable[[RoutineFrame], Element] | None:
    named = trees(tree)
    return element(named[0]) if named else None
