"""Expressions in brackets, parameters and numbers, compiled to functions of the parameters.

Their operators and functions come from tables, of which a dialect chooses its own. The operators bind, from the
strongest: `**`; `* / MOD`; `+ -`; `EQ NE GT GE LT LE`; `AND OR XOR`. Angles are in degrees.
"""

from __future__ import annotations

import math
import operator
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Protocol

from gantrysim.base.errors import InputError

Function = Callable[[float], float]

SHORT_WORD = 2  # letters of a word that stand for it, in a dialect that shortens words
_EQUAL_NUMBERS = 1e-6  # difference of numbers that compare as equal


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
    "EQ": BinaryOperator(2, lambda a, b: float(abs(a - b) < _EQUAL_NUMBERS)),
    "NE": BinaryOperator(2, lambda a, b: float(abs(a - b) >= _EQUAL_NUMBERS)),
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
        arc_tangent: name of the function of a ratio, NAME[y]/[x] [deg].
        one_tangent: whether NAME[y] alone is that of y.
        existence: name of the function that is 1 for a parameter that was set, else 0.
        shortened: whether the first two letters of a word stand for it, as RO for ROUND.
    """

    operators: Mapping[str, BinaryOperator]
    functions: Mapping[str, Function]
    arc_tangent: str = "ATAN"
    one_tangent: bool = False
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


class Store(Protocol):
    """The parameters that an expression reads."""

    def numbered(self, number: float) -> float: ...
    def named(self, name: str) -> float: ...
    def exists(self, key: float | str) -> bool: ...


Value = Callable[[Store], float]
Target = Value | str  # a parameter: its number or its name

# Both limits keep Python's stack from overflowing: a level of brackets, and an operator, are a call each.
_NESTED_BRACKETS = 60  # nesting of brackets
_MOST_OPERATORS = 200  # operators in a line
_NUMBER = re.compile(r"[0-9]+\.?[0-9]*|\.[0-9]+")
_NAME = re.compile(r"<([^<>]*)>")
_SHOWN = 12  # characters of the text in a message


class Scanner:
    """Reads values from a line without spaces, in capitals.

    Args:
        text: of the line.
        grammar: the words of expressions.

    Attributes:
        position: index of the character that follows what was read.
    """

    def __init__(self, text: str, grammar: Grammar) -> None:
        self.text = text
        self.position = 0
        self._grammar = grammar
        self._depth = 0
        self._operators = 0

    @property
    def remaining(self) -> str:
        """The text that was not read yet."""
        return self.text[self.position :]

    @property
    def quoted_rest(self) -> str:
        """The start of the text that was not read yet, quoted for a message."""
        return repr(self.remaining[:_SHOWN])

    def take(self, literal: str) -> bool:
        """Move past a literal if it follows."""
        if self.text.startswith(literal, self.position):
            self.position += len(literal)
            return True
        return False

    def match(self, pattern: re.Pattern[str]) -> re.Match[str] | None:
        """Move past a pattern if it follows, and return its match."""
        match = pattern.match(self.text, self.position)
        if match:
            self.position = match.end()
        return match

    def value(self, owner: str) -> Value:
        """Read a number, a parameter, a function or an expression in brackets, with an optional sign.

        Args:
            owner: the letter or word that the value belongs to, for the error.
        """
        self._enter()
        try:
            return self._value(owner)
        finally:
            self._depth -= 1

    def _value(self, owner: str) -> Value:
        if self.take("-"):
            inner = self.value(owner)
            return lambda parameters: -inner(parameters)
        if self.take("+"):
            return self.value(owner)
        number = self.match(_NUMBER)
        if number:
            return _constant(number[0])
        if self.take("["):
            return self._close_bracket()
        if self.take("#"):
            return _parameter(self.target())
        function = self.match(self._grammar.function_pattern)
        if function:
            return self._function_call(self._grammar.function_names[function[0]])
        raise InputError(f"{owner}{self.quoted_rest}: must be followed by a number, a parameter or an expression")

    def target(self) -> Target:
        """Read a parameter's name or number, after its #."""
        name = self.match(_NAME)
        return name[1].lower() if name else self.value("#")

    def _function_call(self, name: str) -> Value:
        if not self.take("["):
            raise InputError(f"{name}: must be followed by [")
        if name == self._grammar.existence:
            return self._existence(name)
        argument = self._close_bracket()
        if name == self._grammar.arc_tangent:
            return self._arc_tangent(name, argument)
        grammar = self._grammar
        return lambda parameters: grammar.function_value(name, argument(parameters))

    def _existence(self, name: str) -> Value:
        if not self.take("#"):
            raise InputError(f"{name}: must be followed by a parameter in brackets")
        target = self.target()
        if not self.take("]"):
            raise InputError(f"{name}: must end with ]")
        if isinstance(target, str):
            key = target
            return lambda parameters: float(parameters.exists(key))
        number = target
        return lambda parameters: float(parameters.exists(number(parameters)))

    def _arc_tangent(self, name: str, ordinate: Value) -> Value:
        if not self.take("/["):
            if self.take("/") or not self._grammar.one_tangent:
                raise InputError(f"{name}[y]: must be followed by /[x]")
            return lambda parameters: math.degrees(math.atan(ordinate(parameters)))
        abscissa = self._close_bracket()
        return lambda parameters: math.degrees(math.atan2(ordinate(parameters), abscissa(parameters)))

    def expression(self, owner: str) -> Value:
        """Read an expression that stands without brackets, behind what it belongs to."""
        return self._expression(0, owner)

    def _close_bracket(self) -> Value:
        value = self._expression(0)
        if not self.take("]"):
            raise InputError(f"{self.quoted_rest}: must be an operator or ]")
        return value

    def _expression(self, weakest: int, owner: str = "[") -> Value:
        """Read operands and the operators between them that are stronger than the weakest, from left to right."""
        self._enter()
        value = self.value(owner)
        while True:
            start = self.position
            match = self.match(self._grammar.operator_pattern)
            if not match:
                break
            operator = self._grammar.operators_by_spelling[match[0]]
            if operator.strength <= weakest:
                # it belongs to the expression around this one
                self.position = start
                break
            self._operators += 1
            if self._operators > _MOST_OPERATORS:
                raise InputError(f"expression of more than {_MOST_OPERATORS} operators")
            value = _combined_value(operator, value, self._expression(operator.strength))
        self._depth -= 1
        return value

    def _enter(self) -> None:
        self._depth += 1
        if self._depth > _NESTED_BRACKETS:
            raise InputError(f"expression nested deeper than {_NESTED_BRACKETS} levels")


def _constant(digits: str) -> Value:
    number = float(digits)
    if not math.isfinite(number):
        raise InputError(f"{digits[:20]}...: must be finite")
    return lambda parameters: number


def _parameter(target: Target) -> Value:
    if isinstance(target, str):
        name = target
        return lambda parameters: parameters.named(name)
    number = target
    return lambda parameters: parameters.numbered(number(parameters))


def _combined_value(operator: BinaryOperator, first: Value, second: Value) -> Value:
    function = operator.function
    return lambda parameters: function(first(parameters), second(parameters))
