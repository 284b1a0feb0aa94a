"""Expressions of MC-Basic as functions of a scope; each kind of node is read by the function that is marked with it."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from lark import Tree

from gantrysim.base.errors import unknown_text
from gantrysim.controllers.basic.operators import (
    COMPARISONS,
    Evaluate,
    Operators,
    RankedOperator,
    number_of,
    of_sign_and_values,
    of_values,
)
from gantrysim.controllers.softmc.basic import properties
from gantrysim.controllers.softmc.basic.execution import Expression, Routine, RoutineFrame
from gantrysim.controllers.softmc.basic.tree import Node, child, name_of, trees, word
from gantrysim.controllers.softmc.basic.values import (
    CONSTANTS,
    FUNCTIONS,
    INITIAL,
    Element,
    Point,
    Value,
    Variable,
    builtin,
    compare,
    converted_value,
    negative,
    number,
    operate,
    text_of,
    truth,
)
from gantrysim.controllers.softmc.commands import SoftMCError

# Calls of subs and functions, and the error for a name that means nothing.


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
    variables = _passed_parameters(routine, arguments, scope)
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


def _passed_parameters(routine: Routine, arguments: Arguments, scope: RoutineFrame) -> dict[str, Variable]:
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
            held = value if isinstance(value, list) else converted_value(parameter, kind, value)
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


_MOST_COORDINATES = 10


def _conjunction(sign: str, first: Evaluate, second: Evaluate) -> Evaluate:
    """AND, which does not evaluate its second operand where the first is false."""
    return lambda scope: float(truth(first(scope)) and truth(second(scope)))


def _either(sign: str, first: Evaluate, second: Evaluate) -> Evaluate:
    """OR, which does not evaluate its second operand where the first is true."""
    return lambda scope: float(truth(first(scope)) or truth(second(scope)))


def _one_of_two(sign: str, first: Evaluate, second: Evaluate) -> Evaluate:
    """XOR, which takes its first operand for a condition before it evaluates the second."""
    return lambda scope: float(truth(first(scope)) != truth(second(scope)))


OPERATORS = Operators(
    before={
        "NOT": RankedOperator(3, of_values(lambda value: float(not truth(value)))),
        "-": RankedOperator(7, of_values(negative)),
    },
    between={
        "OR": RankedOperator(1, _either),
        "XOR": RankedOperator(1, _one_of_two),
        "AND": RankedOperator(2, _conjunction),
        **{sign: RankedOperator(4, of_sign_and_values(compare)) for sign in COMPARISONS},
        "+": RankedOperator(5, of_sign_and_values(operate)),
        "-": RankedOperator(5, of_sign_and_values(operate)),
        "*": RankedOperator(6, of_sign_and_values(operate)),
        "/": RankedOperator(6, of_sign_and_values(operate)),
        "MOD": RankedOperator(6, of_sign_and_values(operate)),
        "^": RankedOperator(8, of_sign_and_values(operate), from_right=True),
    },
)

Reader = Callable[[Node], Expression]
_READERS: dict[str, Reader] = {}


def node(*kinds: str) -> Callable[[Reader], Reader]:
    """Return a decorator that enters the reader of nodes of these kinds."""

    def enter(reader: Reader) -> Reader:
        for kind in kinds:
            _READERS[kind] = reader
        return reader

    return enter


def expression(tree: Node) -> Expression:
    """Return the function that evaluates an expression."""
    return _READERS[str(tree.data)](tree)


def several(tree: Node | None) -> list[Expression]:
    """Return the functions of a list of expressions."""
    return [] if tree is None else [expression(part) for part in trees(tree)]


def indexed_item(tree: Node) -> tuple[str, list[Expression]]:
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


def element(tree: Node) -> Callable[[RoutineFrame], Element]:
    """Return the function that finds the axis or group of a tree."""
    name = name_of(tree)
    if name is None:
        inner = expression(tree)

        def evaluated(scope: RoutineFrame) -> Element:
            value = inner(scope)
            if not isinstance(value, Element):
                raise SoftMCError(f"{text_of(value)}: must be an axis or a group")
            return value

        return evaluated

    def named(scope: RoutineFrame) -> Element:
        known = scope.execution.element(name, scope)
        if known is None:
            raise SoftMCError(f"{name}: must be an axis or a group; {_group_words(scope)}")
        return known

    return named


def _group_words(scope: RoutineFrame) -> str:
    group = scope.execution.elements.group
    return "none is declared" if group is None else f"the group is {group.name}"


@node("number")
def _number(tree: Node) -> Expression:
    value = number_of(word(tree).lower(), "0x")
    return lambda scope: value


@node("string")
def _string(tree: Node) -> Expression:
    value = word(tree)[1:-1]
    return lambda scope: value


@node("name", "target")
def _name(tree: Node) -> Expression:
    name = word(tree)
    key = word(tree).lower()
    short = properties.canonical(key)
    is_property = short in properties.NAMES

    def value(scope: RoutineFrame) -> Value:
        variable = scope.find(key)
        if variable is not None:
            if variable.value is None:
                raise SoftMCError(f"{name} has no value yet: must be assigned first")
            held: Value = variable.value
            return held
        if key in CONSTANTS:
            return CONSTANTS[key]
        execution = scope.execution
        routine = execution.routines.get(key)
        if routine is not None and routine.kind is not None:
            return call(routine, NO_ARGUMENTS, scope)
        if is_property:
            return execution.read_known(execution.elements.focus(), short, key)
        return _element_of_name(name, key, scope)

    return value


def _element_of_name(name: str, key: str, scope: RoutineFrame) -> Element:
    """Return the element of a name that means nothing else."""
    execution = scope.execution
    if key in execution.elements.by_name:
        return execution.elements.by_name[key]
    axis = execution.element(key, scope) if key[0] in "aj" and key[1:].isdigit() else None
    if axis is None:
        raise unknown_name(name, scope)
    return axis


@node("call")
def _call(tree: Node) -> Expression:
    name = word(tree)
    key = word(tree).lower()
    listed = listed_arguments(tree)
    arguments = Arguments([expression(argument) for argument in listed], listed)

    def value(scope: RoutineFrame) -> Value:
        routine = scope.execution.routines.get(key)
        if routine is not None:
            if routine.kind is None:
                raise SoftMCError(f"{routine.name} is a sub: must be called by CALL")
            return call(routine, arguments, scope)
        if key in FUNCTIONS:
            return builtin(key, [argument(scope) for argument in arguments.values])
        if key == "vesexecute":
            return execute_text([argument(scope) for argument in arguments.values], scope)
        raise SoftMCError(f"{unknown_text('function', name, FUNCTIONS)}, and those of the program")

    return value


@node("joint", "location")
def _point(tree: Node) -> Expression:
    parts = several(child(tree, 0))
    if len(parts) > _MOST_COORDINATES:
        raise SoftMCError(f"a point of {len(parts)} numbers: must have at most {_MOST_COORDINATES}")
    return lambda scope: Point(tuple(number("coordinate", part(scope)) for part in parts))


@node("item")
def _item(tree: Node) -> Expression:
    name, indices = indexed_item(tree)
    key = name.lower()

    def value(scope: RoutineFrame) -> Value:
        variable = scope.find(key)
        if variable is None:
            raise unknown_name(name, scope)
        item: Value | None = variable.item([index(scope) for index in indices])
        if item is None:
            raise SoftMCError(f"{name} has no value at that index: must be assigned first")
        return item

    return value


@node("component")
def _component(tree: Node) -> Expression:
    whole = expression(child(tree, 0))
    which = expression(_only(child(tree, 1)))

    def value(scope: RoutineFrame) -> Value:
        point = whole(scope)
        k = number("coordinate's number", which(scope))
        if not isinstance(point, Point):
            raise SoftMCError(f"{text_of(point)}{{{k:g}}}: must be a coordinate of a point")
        if not 1 <= k <= len(point.values) or k != int(k):
            raise SoftMCError(f"{text_of(point)}{{{k:g}}}: must be a coordinate of the point, 1 to {len(point.values)}")
        return point.values[int(k) - 1]

    return value


def _only(tree: Node) -> Node:
    """Return the only index within braces."""
    if tree.data != "sums":
        return tree
    if len(tree.children) != 1:
        raise SoftMCError("a coordinate's number in { }: must be one number")
    return child(tree, 0)


@node("member")
def _member(tree: Node) -> Expression:
    owner = element(child(tree, 0))
    name = word(tree, 1)
    return lambda scope: scope.execution.read(owner(scope), name)


def port(tree: Node) -> int:
    """Return the number of a digital output, `sys.dout.1`.

    Raises:
        SoftMCError: something else before the number.
    """
    owner = child(tree, 0)
    digits = word(tree, 1)[1:]
    is_output = owner.data == "member" and word(owner, 1).lower() == "dout"
    if not is_output or (name_of(child(owner, 0)) or "").lower() not in ("sys", "system"):
        raise SoftMCError(f".{digits}: must follow sys.dout")
    return int(digits[:9])


@node("port")
def _port(tree: Node) -> Expression:
    which = port(tree)
    return lambda scope: scope.execution.outputs.get(which, 0.0)


@node("chain")
def _chain(tree: Node) -> Expression:
    """Operands with the operators before and between them."""
    parts = [expression(part) if isinstance(part, Tree) else str(part) for part in tree.children]
    return OPERATORS.read(parts, lambda sign, operator, operands: operator.join(sign, *operands))
