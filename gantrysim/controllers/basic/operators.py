"""Operators by rank, and the reading of flat expressions with them."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple, TypeVar

# What operators and functions of all dialects do with numbers.

ARITHMETIC: dict[str, Callable[[Any, Any], Any]] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": operator.truediv,
    "^": operator.pow,
}
COMPARISONS: dict[str, Callable[[Any, Any], bool]] = {
    "=": operator.eq,
    "<>": operator.ne,
    "<": operator.lt,
    ">": operator.gt,
    "<=": operator.le,
    ">=": operator.ge,
}


def sign(x: float) -> float:
    """Return 1, 0 or -1."""
    return float((x > 0) - (x < 0))


class Function(NamedTuple):
    """A function of numbers.

    Attributes:
        value: its value; angles are in radians.
        arguments: number of them.
    """

    value: Callable[..., float]
    arguments: int = 1


# Functions under the names that dialects share; a dialect adds those that it names, or defines, in its own way.
FUNCTIONS = {
    "ABS": Function(abs),
    "ACOS": Function(math.acos),
    "ASIN": Function(math.asin),
    "ATAN2": Function(math.atan2, 2),
    "COS": Function(math.cos),
    "EXP": Function(math.exp),
    "SGN": Function(sign),
    "SIN": Function(math.sin),
    "TAN": Function(math.tan),
}


def number_of(digits: str, hexadecimal_prefix: str) -> float:
    """Return the number that a text states, in hexadecimal digits after a prefix, else in decimal ones."""
    if digits.startswith(hexadecimal_prefix):
        return float(int(digits.removeprefix(hexadecimal_prefix), 16))
    return float(digits)


Evaluate = Callable[[Any], Any]  # from the frame in which an expression is evaluated to its value
Join = Callable[..., Evaluate]  # from the sign as the text has it, and the operands' evaluations


@dataclass(frozen=True)
class RankedOperator:
    """An operator of a dialect.

    Attributes:
        rank: the higher binds the tighter.
        join: returns the evaluation of the result, given the sign and the operands' evaluations.
        from_right: whether operators of this rank are taken from the right, as powers are.
    """

    rank: int
    join: Join
    from_right: bool = False


def of_values(function: Callable[..., Any]) -> Join:
    """Return what joins operands by a function of their values, all of which are evaluated."""

    def join(sign: str, first: Evaluate, second: Evaluate | None = None) -> Evaluate:
        if second is None:
            return lambda frame: function(first(frame))
        return lambda frame: function(first(frame), second(frame))

    return join


def of_sign_and_values(function: Callable[..., Any]) -> Join:
    """Return what joins operands by a function of the operator's sign and their values."""
    return lambda sign, *operands: of_values(partial(function, sign))(sign, *operands)


_Operand = TypeVar("_Operand")
Apply = Callable[[str, RankedOperator, list[_Operand]], _Operand]


@dataclass(frozen=True)
class Operators:
    """All operators of a dialect.

    Attributes:
        before: those that stand before their operand, by sign in capitals.
        between: those that stand between two operands.
    """

    before: Mapping[str, RankedOperator]
    between: Mapping[str, RankedOperator]

    def read(self, parts: Iterable[_Operand | str], apply: Apply[_Operand]) -> _Operand:
        """Return the operand that a flat expression stands for, by Dijkstra's shunting yard.

        A grammar with a rule per rank takes a step per rank for every number; a flat one leaves the ranks to this.

        Args:
            parts: operands and signs in their order; a sign is a text, an operand is not.
            apply: returns the operand that an operator makes, given its sign, itself and its operands.
        """
        operands: list[_Operand] = []
        # with the number of its operands
        waiting: list[tuple[str, RankedOperator, int]] = []

        def reduce(least_rank: int) -> None:
            while waiting and waiting[-1][1].rank >= least_rank:
                sign, operator, count = waiting.pop()
                operands[-count:] = [apply(sign, operator, operands[-count:])]

        expects_operand = True
        for part in parts:
            if not isinstance(part, str):
                operands.append(part)
                expects_operand = False
            elif expects_operand:
                waiting.append((part, self.before[part.upper()], 1))
            else:
                operator = self.between[part.upper()]
                reduce(operator.rank + operator.from_right)
                waiting.append((part, operator, 2))
                expects_operand = True
        reduce(0)
        return operands[0]
