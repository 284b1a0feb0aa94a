"""Operators and functions of macro languages, and the tables from which a dialect chooses its own.

The operators bind, from the strongest: `**`; `* / MOD`; `+ -`; `EQ NE GT GE LT LE`; `AND OR XOR`. Angles are in
degrees.
"""

from __future__ import annotations

import math
import operator
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

from gantrysim.base.errors import InputError

Function = Callable[[float], float]

SHORT_WORD = 2  # letters of a word that stand for it, in a dialect that shortens words
_SAME = 1e-6  # difference of numbers that compare as equal


class BinaryOperator(NamedTuple):
    """An operator between two values: one of a greater strength is applied first."""

    strength: int
    function: Callable[[float, float], float]


def _quotient(a: float, b: float) -> float:
    if b == 0:
        raise InputError(f"{a:g} / 0: the divisor must not be 0")
    return a / b


def _modulo(a: float, b: float) -> float:
    """Remainder that is never negative, unlike fmod's, which has the sign of a."""
    if b == 0:
        raise InputError(f"{a:g} MOD 0: the divisor must not be 0")
    # products of large numbers overflow to infinity
    if not (math.isfinite(a) and math.isfinite(b)):
        raise InputError(f"{a:g} MOD {b:g}: has no finite value")
    remainder = math.fmod(a, b)
    return remainder + (abs(b) if remainder < 0 else 0.0)


def _power(a: float, b: float) -> float:
    try:
        return math.pow(a, b)
    except (ValueError, OverflowError):
        raise InputError(f"{a:g} ** {b:g}: has no finite value") from None


OPERATORS: dict[str, BinaryOperator] = {
    "**": BinaryOperator(5, _power),
    "*": BinaryOperator(4, operator.mul),
    "/": BinaryOperator(4, _quotient),
    "MOD": BinaryOperator(4, _modulo),
    "+": BinaryOperator(3, operator.add),
    "-": BinaryOperator(3, operator.sub),
    "EQ": BinaryOperator(2, lambda a, b: float(abs(a - b) < _SAME)),
    "NE": BinaryOperator(2, lambda a, b: float(abs(a - b) >= _SAME)),
    "GT": BinaryOperator(2, lambda a, b: float(a > b)),
    "GE": BinaryOperator(2, lambda a, b: float(a >= b)),
    "LT": BinaryOperator(2, lambda a, b: float(a < b)),
    "LE": BinaryOperator(2, lambda a, b: float(a <= b)),
    "AND": BinaryOperator(1, lambda a, b: float(a != 0 and b != 0)),
    "OR": BinaryOperator(1, lambda a, b: float(a != 0 or b != 0)),
    "XOR": BinaryOperator(1, lambda a, b: float((a != 0) != (b != 0))),
}


def _of_degrees(function: Function) -> Function:
    return lambda degrees: function(math.radians(degrees))


def _in_degrees(function: Function) -> Function:
    return lambda ratio: math.degrees(function(ratio))


def _rounded_number(x: float) -> float:
    """The nearest whole number, half of one away from zero; Python's `round` goes to the even one."""
    return float(math.floor(x + 0.5) if x >= 0 else math.ceil(x - 0.5))


def rounded_down(x: float) -> float:
    """Return the next whole number below."""
    return float(math.floor(x))


def rounded_up(x: float) -> float:
    """Return the next whole number above."""
    return float(math.ceil(x))


def rounded_to_zero(x: float) -> float:
    """Return the next whole number towards zero."""
    return float(math.trunc(x))


def rounded_from_zero(x: float) -> float:
    """Return the next whole number away from zero."""
    return math.copysign(math.ceil(abs(x)), x)


# those that all dialects share; FIX and FUP round differently in each
FUNCTIONS: dict[str, Function] = {
    "ABS": abs,
    "ACOS": _in_degrees(math.acos),
    "ASIN": _in_degrees(math.asin),
    "COS": _of_degrees(math.cos),
    "EXP": math.exp,
    "LN": math.log,
    "ROUND": _rounded_number,
    "SIN": _of_degrees(math.sin),
    "SQRT": math.sqrt,
    "TAN": _of_degrees(math.tan),
}


@dataclass(frozen=True)
class Grammar:
    """The words of a dialect's expressions.

    Attributes:
        operators: between two values, by their spelling.
        functions: of one value in brackets, by their spelling.
        arc_tangent: name of the function of a ratio, NAME[y]/[x] or NAME[y] [deg].
        existence: name of the function that is 1 for a parameter that was set, else 0.
        shortened: whether the first two letters of a word stand for it, as RO for ROUND.
    """

    operators: Mapping[str, BinaryOperator]
    functions: Mapping[str, Function]
    arc_tangent: str = "ATAN"
    existence: str = "EXISTS"
    shortened: bool = False

    @cached_property
    def operators_by_spelling(self) -> dict[str, BinaryOperator]:
        """The operators by all their spellings."""
        return {spelled: self.operators[name] for spelled, name in self._spellings(self.operators).items()}

    @cached_property
    def operator_pattern(self) -> re.Pattern[str]:
        """Regular expression of an operator."""
        return _any_of(self.operators_by_spelling)

    @cached_property
    def function_names(self) -> dict[str, str]:
        """The names of the functions by all their spellings."""
        return self._spellings((*self.functions, self.arc_tangent, self.existence))

    @cached_property
    def function_pattern(self) -> re.Pattern[str]:
        """Regular expression of a function's name."""
        return _any_of(self.function_names)

    def _spellings(self, names: Iterable[str]) -> dict[str, str]:
        spellings = {name: name for name in names}
        if self.shortened:
            for name in names:
                spellings.setdefault(name[:SHORT_WORD] if name.isalpha() else name, name)
        return spellings

    def function_value(self, name: str, x: float) -> float:
        """Return the value of a function.

        Raises:
            InputError: it has no finite value there.
        """
        try:
            return self.functions[name](x)
        except (ValueError, OverflowError):
            raise InputError(f"{name}[{x:g}]: has no finite value") from None


def _any_of(names: Iterable[str]) -> re.Pattern[str]:
    # the longest first: a pattern takes the first alternative that fits, and "*" begins "**"
    return re.compile("|".join(re.escape(name) for name in sorted(names, key=len, reverse=True)))
