"""Expressions in brackets, parameters and numbers, compiled to functions of the parameters.

The operators bind, from the strongest: `**`; `* / MOD`; `+ -`; `EQ NE GT GE LT LE`; `AND OR XOR`. Angles are in
degrees.
"""

from __future__ import annotations

import math
import operator
import re
from collections.abc import Callable
from typing import Protocol

from gantrysim.base.errors import InputError


class Store(Protocol):
    """The parameters that an expression reads."""

    def numbered(self, number: float) -> float: ...
    def named(self, name: str) -> float: ...
    def exists(self, key: float | str) -> bool: ...


Value = Callable[[Store], float]
Target = Value | str  # a parameter: its number or its name

_DEEPEST = 60  # nesting of brackets
_MOST = 200  # operators in a line
_NUMBER = re.compile(r"[0-9]+\.?[0-9]*|\.[0-9]+")
_NAME = re.compile(r"<([^<>]*)>")
_SAME = 1e-6  # difference of numbers that compare as equal


def _divided(a: float, b: float) -> float:
    if b == 0:
        raise InputError(f"{a:g} / 0: the divisor must not be 0")
    return a / b


def _modulo(a: float, b: float) -> float:
    if b == 0:
        raise InputError(f"{a:g} MOD 0: the divisor must not be 0")
    return math.fmod(a, b) + (abs(b) if math.fmod(a, b) < 0 else 0.0)


def _power(a: float, b: float) -> float:
    try:
        return math.pow(a, b)
    except (ValueError, OverflowError):
        raise InputError(f"{a:g} ** {b:g}: has no finite value") from None


_BINARY: dict[str, tuple[int, Callable[[float, float], float]]] = {
    "**": (5, _power),
    "*": (4, operator.mul),
    "/": (4, _divided),
    "MOD": (4, _modulo),
    "+": (3, operator.add),
    "-": (3, operator.sub),
    "EQ": (2, lambda a, b: float(abs(a - b) < _SAME)),
    "NE": (2, lambda a, b: float(abs(a - b) >= _SAME)),
    "GT": (2, lambda a, b: float(a > b)),
    "GE": (2, lambda a, b: float(a >= b)),
    "LT": (2, lambda a, b: float(a < b)),
    "LE": (2, lambda a, b: float(a <= b)),
    "AND": (1, lambda a, b: float(a != 0 and b != 0)),
    "OR": (1, lambda a, b: float(a != 0 or b != 0)),
    "XOR": (1, lambda a, b: float((a != 0) != (b != 0))),
}
_OPERATOR = re.compile("|".join(re.escape(name) for name in sorted(_BINARY, key=len, reverse=True)))


def _turned(function: Callable[[float], float]) -> Callable[[float], float]:
    return lambda degrees: function(math.radians(degrees))


_UNARY: dict[str, Callable[[float], float]] = {
    "ABS": abs,
    "ACOS": lambda x: math.degrees(math.acos(x)),
    "ASIN": lambda x: math.degrees(math.asin(x)),
    "COS": _turned(math.cos),
    "EXP": math.exp,
    "FIX": lambda x: float(math.floor(x)),
    "FUP": lambda x: float(math.ceil(x)),
    "LN": math.log,
    "ROUND": lambda x: float(math.floor(x + 0.5) if x >= 0 else math.ceil(x - 0.5)),
    "SIN": _turned(math.sin),
    "SQRT": math.sqrt,
    "TAN": _turned(math.tan),
}
_FUNCTION = re.compile("|".join(sorted((*_UNARY, "ATAN", "EXISTS"), key=len, reverse=True)))


def _safe(name: str, function: Callable[[float], float]) -> Callable[[float], float]:
    def call(x: float) -> float:
        try:
            return function(x)
        except (ValueError, OverflowError):
            raise InputError(f"{name}[{x:g}]: has no finite value") from None

    return call


_TRUNCATING: dict[str, Callable[[float], float]] = {
    "FIX": lambda x: float(math.trunc(x)),
    "FUP": lambda x: math.copysign(math.ceil(abs(x)), x),
}
_SAFE = {name: _safe(name, function) for name, function in _UNARY.items()}


class Scanner:
    """Reads values from a line without spaces, in capitals.

    Args:
        text: of the line.
        at: where to begin.
        truncating: whether FIX and FUP round towards and away from 0, instead of down and up.
    """

    def __init__(self, text: str, at: int = 0, truncating: bool = False) -> None:
        self.text = text
        self.at = at
        self._truncating = truncating
        self._depth = self._operators = 0

    @property
    def rest(self) -> str:
        return self.text[self.at :]

    def take(self, literal: str) -> bool:
        """Move past a literal if it follows."""
        if self.text.startswith(literal, self.at):
            self.at += len(literal)
            return True
        return False

    def value(self, after: str) -> Value:
        """Read a number, a parameter, a function or an expression in brackets, with an optional sign.

        Args:
            after: what it belongs to, for the error.
        """
        self._enter()
        try:
            return self._value(after)
        finally:
            self._depth -= 1

    def _value(self, after: str) -> Value:
        if self.take("-"):
            inner = self.value(after)
            return lambda p: -inner(p)
        if self.take("+"):
            return self.value(after)
        found = _NUMBER.match(self.text, self.at)
        if found:
            self.at = found.end()
            number = float(found[0])
            if not math.isfinite(number):
                raise InputError(f"{found[0][:20]}...: must be finite")
            return lambda p: number
        if self.take("["):
            return self._closed()
        if self.take("#"):
            target = self.target()
            if isinstance(target, str):
                name = target
                return lambda p: p.named(name)
            place = target
            return lambda p: p.numbered(place(p))
        function = _FUNCTION.match(self.text, self.at)
        if function:
            self.at = function.end()
            return self._called(function[0])
        raise InputError(f"{after}{self.rest[:12]!r}: must be followed by a number, a parameter or an expression")

    def target(self) -> Target:
        """Read a parameter's name or number, after its #."""
        name = _NAME.match(self.text, self.at)
        if name:
            self.at = name.end()
            return name[1].lower()
        return self.value("#")

    def _called(self, name: str) -> Value:
        if not self.take("["):
            raise InputError(f"{name}: must be followed by [")
        if name == "EXISTS":
            if not self.take("#"):
                raise InputError("EXISTS: must be followed by a parameter in brackets")
            target = self.target()
            if not self.take("]"):
                raise InputError("EXISTS: must end with ]")
            if isinstance(target, str):
                key = target
                return lambda p: float(p.exists(key))
            place = target
            return lambda p: float(p.exists(place(p)))
        first = self._closed()
        if name == "ATAN":
            if not self.take("/["):
                if self.take("/"):
                    raise InputError("ATAN[y]/: must be followed by [x]")
                return lambda p: math.degrees(math.atan(first(p)))
            second = self._closed()
            return lambda p: math.degrees(math.atan2(first(p), second(p)))
        function = (_TRUNCATING if self._truncating else {}).get(name) or _SAFE[name]
        return lambda p: function(first(p))

    def expression(self) -> Value:
        """Read an expression that stands without brackets."""
        return self._expression(0)

    def _closed(self) -> Value:
        value = self._expression(0)
        if not self.take("]"):
            raise InputError(f"{self.rest[:12]!r}: must be an operator or ]")
        return value

    def _expression(self, least: int) -> Value:
        self._enter()
        left = self.value("[")
        while True:
            found = _OPERATOR.match(self.text, self.at)
            if not found or _BINARY[found[0]][0] <= least:
                break
            strength, function = _BINARY[found[0]]
            self.at = found.end()
            self._operators += 1
            if self._operators > _MOST:
                raise InputError(f"expression of more than {_MOST} operators")
            left = _combined(function, left, self._expression(strength))
        self._depth -= 1
        return left

    def _enter(self) -> None:
        self._depth += 1
        if self._depth > _DEEPEST:
            raise InputError(f"expression nested deeper than {_DEEPEST} levels")


def _combined(function: Callable[[float, float], float], left: Value, right: Value) -> Value:
    return lambda p: function(left(p), right(p))
