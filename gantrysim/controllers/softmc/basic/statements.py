"""Assignments, calls, printing and the element in focus, a function each: `cmd_print` is PRINT."""

from __future__ import annotations

from collections.abc import Callable

from gantrysim.base.errors import unknown_text
from gantrysim.controllers.basic.statements import Statements
from gantrysim.controllers.softmc.basic import properties
from gantrysim.controllers.softmc.basic.calls import Arguments, call, listed_arguments, unknown_name
from gantrysim.controllers.softmc.basic.execution import Action, Expression, RoutineFrame
from gantrysim.controllers.softmc.basic.expressions import element, expression, indexed, port
from gantrysim.controllers.softmc.basic.tree import Node, child, trees, word
from gantrysim.controllers.softmc.basic.tree_assembler import CommandHandler
from gantrysim.controllers.softmc.basic.values import Element, number
from gantrysim.controllers.softmc.commands import SoftMCError

command: Statements[CommandHandler] = Statements()


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
    name, indices = indexed(target)

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
