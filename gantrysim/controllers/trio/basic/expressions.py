"""Expressions: every one becomes a function of the process that evaluates it."""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from difflib import get_close_matches
from functools import partial
from typing import TypeVar

from gantrysim.base.errors import InputError
from gantrysim.controllers.trio.basic import words
from gantrysim.controllers.trio.basic.axis import Axis
from gantrysim.controllers.trio.basic.commands import COMMANDS
from gantrysim.controllers.trio.basic.process import MOST_OUTPUTS, TABLE_SIZE, VR_SIZE, Process, State, index

DEEPEST = 60  # nesting of an expression

Evaluate = Callable[[Process], float]


@dataclass(frozen=True)
class Expression:
    """An expression.

    Attributes:
        value: evaluates it.
        depth: of its nesting.
    """

    value: Evaluate
    depth: int = 1


@dataclass(frozen=True)
class Reference:
    """A word with what belongs to it: a variable, a parameter, a function or a command.

    Attributes:
        name: in capitals.
        arguments: None without brackets.
        axis: of AXIS(), None without.
        line: of the text.
        spelled: as in the text.
    """

    name: str
    arguments: tuple[Expression, ...] | None
    axis: Expression | None
    line: int
    spelled: str

    def count(self, least: int, most: int) -> tuple[Expression, ...]:
        """Return the arguments, or raise InputError where their number is out of bounds."""
        given = self.arguments or ()
        if not least <= len(given) <= most:
            wanted = str(least) if least == most else f"{least} to {most}"
            raise InputError(f"{self.name} with {len(given)} values: must have {wanted}")
        return given

    def plain(self, arguments: int, axis: bool = False) -> tuple[Expression, ...]:
        """Return the arguments of a word that takes so many, and AXIS() if `axis`."""
        if self.axis is not None and not axis:
            raise InputError(f"{self.name} AXIS(): {self.name} does not belong to an axis")
        return self.count(arguments, arguments)


def _true(test: Callable[[float, float], bool]) -> Callable[[float, float], float]:
    return lambda a, b: -1.0 if test(a, b) else 0.0


def _bits(operation: Callable[[int, int], int]) -> Callable[[float, float], float]:
    return lambda a, b: float(operation(int(a), int(b)))


def _remainder(a: float, b: float) -> float:
    return a - b * int(a / b)


def _power(a: float, b: float) -> float:
    result: float | complex = a**b
    if isinstance(result, complex):
        raise InputError("root of a negative number")
    return result


# operators with their rank: the higher binds the tighter
_BETWEEN: dict[str, tuple[int, Callable[[float, float], float]]] = {
    "OR": (1, _bits(operator.or_)),
    "XOR": (1, _bits(operator.xor)),
    "AND": (2, _bits(operator.and_)),
    "=": (4, _true(operator.eq)),
    "<>": (4, _true(operator.ne)),
    "<": (4, _true(operator.lt)),
    ">": (4, _true(operator.gt)),
    "<=": (4, _true(operator.le)),
    ">=": (4, _true(operator.ge)),
    "+": (5, operator.add),
    "-": (5, operator.sub),
    "*": (6, operator.mul),
    "/": (6, operator.truediv),
    "MOD": (6, _remainder),
    "^": (8, _power),
}
_BEFORE: dict[str, tuple[int, Callable[[float], float]]] = {
    "NOT": (3, lambda a: float(~int(a))),
    "+": (7, operator.pos),
    "-": (7, operator.neg),
}
_Sign = TypeVar("_Sign", bound=str)


def joined(
    parts: Iterable[Expression | _Sign], at: Callable[[_Sign, Callable[[], Expression]], Expression]
) -> Expression:
    """Return operands joined by the operators before and between them, by Dijkstra's shunting yard.

    Operators of one rank are taken from the left, powers from the right.

    Args:
        parts: operands and signs of operators, in their order.
        at: calls what applies an operator, given its sign.
    """
    operands: list[Expression] = []
    waiting: list[tuple[int, _Sign, int, Callable[..., float]]] = []  # rank, sign, operands and what it does

    def apply(least: int) -> None:
        while waiting and waiting[-1][0] >= least:
            _, sign, count, operation = waiting.pop()
            operands[-count:] = [at(sign, partial(_operation, operation, *operands[-count:]))]

    before = True  # whether an operator that comes next stands before its operand
    for part in parts:
        if isinstance(part, Expression):
            operands.append(part)
        elif before:
            rank, change = _BEFORE[part.upper()]
            waiting.append((rank, part, 1, change))
        else:
            rank, operation = _BETWEEN[part.upper()]
            apply(rank + (part == "^"))
            waiting.append((rank, part, 2, operation))
        before = not isinstance(part, Expression)
    apply(0)
    return operands[0]


def _operation(operation: Callable[..., float], a: Expression, b: Expression | None = None) -> Expression:
    first = a.value
    if b is None:
        return _nested(lambda p: operation(first(p)), a)
    second = b.value
    return _nested(lambda p: operation(first(p), second(p)), a, b)


def constant(value: float) -> Expression:
    """Return a number."""
    return Expression(lambda p: value)


def value_of(ref: Reference, read: dict[str, int]) -> Expression:
    """Return what a word stands for in an expression; variables are entered into `read` with their line."""
    name = ref.name
    if name in words.CONSTANTS:
        ref.plain(0)
        return constant(words.CONSTANTS[name])
    if name in words.FUNCTIONS:
        function: Callable[..., float] = words.FUNCTIONS[name]
        given = ref.plain(words.ARGUMENTS.get(name, 1))
        values = [each.value for each in given]
        return _nested(lambda p: function(*[value(p) for value in values]), *given)
    if name in words.AXIS_VALUES or name in words.IGNORED:
        ref.plain(0, axis=True)
        return _of_axis(ref)
    if name in words.SYSTEM_VALUES:
        ref.plain(0)
        return Expression(words.SYSTEM_VALUES[name])
    if name in _MEMORY:
        at = ref.plain(1)[0]
        cells = _MEMORY[name]
        where = at.value
        return _nested(lambda p: cells(p, where(p)), at)
    if name in COMMANDS or name in words.KEYWORDS:
        raise InputError(f"{name}: is a command, it has no value")
    if ref.arguments is not None or ref.axis is not None:
        raise unknown_word(ref)
    _check_emulated(ref)
    read.setdefault(name, ref.line)
    return Expression(lambda p: p.variables.get(name, 0.0))


def _of_axis(ref: Reference) -> Expression:
    name = ref.name
    get: Callable[[State, Axis], float] = words.AXIS_VALUES.get(name, lambda state, axis: axis.values.get(name, 0.0))
    if ref.axis is None:
        return Expression(lambda p: get(p.state, p.state.motion.axis(p.base[0])))
    number = ref.axis.value
    return _nested(lambda p: get(p.state, p.state.motion.axis(number(p))), ref.axis)


_MEMORY: dict[str, Callable[[Process, float], float]] = {
    "IN": lambda p, at: float(index("IN", at, MOST_OUTPUTS) in p.state.inputs),
    "OP": lambda p, at: float(index("OP", at, MOST_OUTPUTS) in p.state.outputs),
    "READ_OP": lambda p, at: float(index("READ_OP", at, MOST_OUTPUTS) in p.state.outputs),
    "TABLE": lambda p, at: p.state.table.get(index("TABLE", at, TABLE_SIZE), 0.0),
    "VR": lambda p, at: p.state.vr.get(index("VR", at, VR_SIZE), 0.0),
}


def _nested(value: Evaluate, *parts: Expression) -> Expression:
    depth = 1 + max((part.depth for part in parts), default=0)
    if depth > DEEPEST:
        raise InputError(f"expression nested more than {DEEPEST} deep: use a variable for a part of it")
    return Expression(value, depth)


def known_words() -> list[str]:
    """Return all words that programs may use, in their order."""
    tables = (words.CONSTANTS, words.FUNCTIONS, words.AXIS_VALUES, words.IGNORED, words.SYSTEM_VALUES, _MEMORY)
    return sorted({*COMMANDS, *words.KEYWORDS, *(name for table in tables for name in table)})


def _check_emulated(ref: Reference) -> None:
    if ref.name in words.NOT_EMULATED:
        raise InputError(f"{ref.spelled}: a word of the controller that is not emulated")


def unknown_word(ref: Reference) -> InputError:
    """Return the error for a word that is none of the language."""
    _check_emulated(ref)
    near = get_close_matches(ref.name, known_words(), n=1, cutoff=0.6)
    return InputError(f"unknown word {ref.spelled!r}" + (f": did you mean {near[0]}?" if near else ""))
