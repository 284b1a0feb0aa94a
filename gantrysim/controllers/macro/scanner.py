"""Expressions in brackets, parameters and numbers, compiled to functions of the parameters."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from typing import Protocol

from gantrysim.base.errors import InputError
from gantrysim.controllers.macro.grammar import BinaryOperator, Grammar


class Store(Protocol):
    """The parameters that an expression reads."""

    def numbered(self, number: float) -> float: ...
    def named(self, name: str) -> float: ...
    def exists(self, key: float | str) -> bool: ...


Value = Callable[[Store], float]
Target = Value | str  # a parameter: its number or its name

# Both limits keep Python's stack from overflowing: a level of brackets, and an operator, are a call each.
_DEEPEST = 60  # nesting of brackets
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
            if self.take("/"):
                raise InputError(f"{name}[y]/: must be followed by [x]")
            return lambda parameters: math.degrees(math.atan(ordinate(parameters)))
        abscissa = self._close_bracket()
        return lambda parameters: math.degrees(math.atan2(ordinate(parameters), abscissa(parameters)))

    def expression(self) -> Value:
        """Read an expression that stands without brackets."""
        return self._expression(0)

    def _close_bracket(self) -> Value:
        value = self._expression(0)
        if not self.take("]"):
            raise InputError(f"{self.quoted_rest}: must be an operator or ]")
        return value

    def _expression(self, weakest: int) -> Value:
        """Read operands and the operators between them that are stronger than the weakest, from left to right."""
        self._enter()
        value = self.value("[")
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
        if self._depth > _DEEPEST:
            raise InputError(f"expression nested deeper than {_DEEPEST} levels")


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
