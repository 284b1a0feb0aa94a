"""What operators and functions of all dialects do with numbers."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from typing import Any, NamedTuple

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
