"""Values of MC-Basic: numbers, strings, points, elements and arrays; and what the operators do with them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from gantrysim.controllers.basic import operators
from gantrysim.controllers.basic.operators import ARITHMETIC, COMPARISONS, Function
from gantrysim.controllers.softmc.commands import SoftMCError

STRING_LENGTH = 256  # string
MOST_ITEMS = 100_000  # of an array
_LARGEST_WHOLE = 2.0**53  # whole number that a double holds exactly


@dataclass(frozen=True)
class Point:
    """A joint, {..}, or a location, #{..}.

    Attributes:
        values: coordinates [mm, mm, mm, deg].
    """

    values: tuple[float, ...]

    def __str__(self) -> str:
        return "{" + " , ".join(map(text_of, self.values)) + "}"


@dataclass(eq=False)
class Element:
    """An axis, a group, or the system.

    Attributes:
        name: as the program first writes it.
        kind: "axis", "group" or "system".
        properties: values by canonical names, in lower case.
        axes: names of a group's axes.
    """

    name: str
    kind: str
    properties: dict[str, Any] = field(default_factory=dict)
    axes: tuple[str, ...] = ()


Value = float | str | Point | Element | list[Any]


@dataclass
class Variable:
    """A variable or an array.

    Attributes:
        name: as declared.
        kind: "long", "double", "string", "point" or "element".
        value: of that kind, or nested lists.
        fixed: whether it is a constant.
    """

    name: str
    kind: str
    value: Any
    fixed: bool = False

    def assign(self, value: Value, indices: Sequence[Value] = ()) -> None:
        """Assign to the variable, or to an item of the array.

        Raises:
            SoftMCError: a constant, an index out of bounds, or a value of another kind.
        """
        if self.fixed:
            raise SoftMCError(f"{self.name} is a constant: must not be assigned")
        if not indices:
            if isinstance(self.value, list):
                raise SoftMCError(f"{self.name} is an array: must have an index")
            self.value = converted_value(self.name, self.kind, value)
            return
        holder, last = self._holder(indices)
        if isinstance(holder[last], list):
            raise SoftMCError(f"{self.name} has more dimensions than {len(indices)}")
        holder[last] = converted_value(self.name, self.kind, value)

    def item(self, indices: Sequence[Value]) -> Value:
        """Return an item of the array."""
        holder, last = self._holder(indices)
        return holder[last]

    def _holder(self, indices: Sequence[Value]) -> tuple[list[Any], int]:
        holder = self.value
        last = -1
        for depth, index in enumerate(indices):
            holder = holder[last] if depth else holder
            if not isinstance(holder, list):
                raise SoftMCError(f"{self.name} has {depth} dimensions: {len(indices)} are used")
            last = int(number(f"index of {self.name}", index)) - 1
            if not 0 <= last < len(holder):
                raise SoftMCError(f"index of {self.name} = {last + 1}: must be 1 to {len(holder)}")
        return holder, last


def array(dimensions: Sequence[Value], value: Value | None) -> Any:
    """Return nested lists, the first index outermost; `value` itself without dimensions.

    Raises:
        SoftMCError: a dimension below 1, or too many items.
    """
    sizes = [int(number("dimension", size)) for size in dimensions]
    if any(size < 1 for size in sizes) or math.prod(sizes) > MOST_ITEMS:
        raise SoftMCError(f"dimensions {sizes}: must be at least 1, and at most {MOST_ITEMS} items in all")

    def nested(inner: list[int]) -> Any:
        return [nested(inner[1:]) for _ in range(inner[0])] if inner else value

    return nested(sizes)


def number(name: str, value: Value) -> float:
    """Return a number, or raise SoftMCError."""
    if not isinstance(value, float | int):
        raise SoftMCError(f"{name} = {text_of(value)}: must be a number")
    if not math.isfinite(value):
        raise SoftMCError(f"{name} = {value:g}: must be finite")
    return float(value)


def converted_value(name: str, kind: str, value: Value) -> Value:
    """Return a value as a variable of that kind holds it; a long truncates.

    Raises:
        SoftMCError: a value of another kind.
    """
    if kind in ("long", "double"):
        held = number(name, value)
        return float(math.trunc(held)) if kind == "long" else held
    wanted: dict[str, tuple[type, str]] = {
        "string": (str, "a string"),
        "point": (Point, "a point in braces, as in {0, 0, 5}"),
        "element": (Element, "an axis or a group"),
    }
    type_, words = wanted[kind]
    if not isinstance(value, type_):
        raise SoftMCError(f"{name} = {text_of(value)}: must be {words}")
    return value


def text_of(value: Value) -> str:
    """Return a value as PRINT shows it."""
    if isinstance(value, float | int):
        whole = abs(value) < _LARGEST_WHOLE and value == int(value)
        return str(int(value)) if whole else f"{round(value, 9) + 0.0:.10g}"
    if isinstance(value, Element):
        return value.name
    return f"an array of {len(value)}" if isinstance(value, list) else str(value)


def truth(value: Value) -> bool:
    """Return whether a condition holds."""
    return number("condition", value) != 0


def negative(value: Value) -> Value:
    """Return -value."""
    return operate("*", -1.0, value)


def operate(symbol: str, a: Value, b: Value) -> Value:
    """Return the value of `a symbol b`; points add and subtract, and scale by numbers.

    Raises:
        SoftMCError: operands that do not fit, or a division by zero.
    """
    if isinstance(a, float) and isinstance(b, float):  # first, as most are
        return _number(symbol, a, b)
    if isinstance(a, str) and isinstance(b, str) and symbol == "+":
        if len(a) + len(b) > STRING_LENGTH:
            raise SoftMCError(f"string of {len(a) + len(b)} characters: must be at most {STRING_LENGTH}")
        return a + b
    if isinstance(a, Point) and isinstance(b, Point) and symbol in "+-":
        if len(a.values) != len(b.values):
            raise SoftMCError(f"{a} {symbol} {b}: must be points of one length")
        return Point(tuple(_number(symbol, u, v) for u, v in zip(a.values, b.values, strict=True)))
    if isinstance(a, Point) and isinstance(b, float) and symbol in "*/":
        return Point(tuple(_number(symbol, u, b) for u in a.values))
    if isinstance(a, float) and isinstance(b, Point) and symbol == "*":
        return Point(tuple(_number(symbol, a, v) for v in b.values))
    raise SoftMCError(f"{text_of(a)} {symbol} {text_of(b)}: must be two numbers, or points and numbers that fit")


def _number(symbol: str, a: float, b: float) -> float:
    try:
        value = _NUMBER_OPERATORS[symbol.lower()](a, b)
    except (ZeroDivisionError, OverflowError, ValueError):
        value = math.nan
    if isinstance(value, complex) or not math.isfinite(value):
        raise SoftMCError(f"{text_of(a)} {symbol} {text_of(b)}: has no finite value")
    return value


_NUMBER_OPERATORS: dict[str, Callable[[float, float], float]] = {**ARITHMETIC, "mod": math.fmod}


def compare(symbol: str, a: Value, b: Value) -> float:
    """Return 1 where `a symbol b` holds, else 0.

    Raises:
        SoftMCError: values that are neither two numbers nor two strings, nor two points compared for equality.
    """
    same = (isinstance(a, float) and isinstance(b, float)) or (isinstance(a, str) and isinstance(b, str))
    if not same and not (isinstance(a, Point) and isinstance(b, Point) and symbol in ("=", "<>")):
        raise SoftMCError(
            f"{text_of(a)} {symbol} {text_of(b)}: must be two numbers or two strings, or with = and <> two points"
        )
    return float(COMPARISONS[symbol](a, b))


FUNCTIONS: dict[str, Function] = {
    **{name.lower(): function for name, function in operators.FUNCTIONS.items()},
    "atn": Function(math.atan),
    "int": Function(lambda x: float(math.floor(x))),
    "log": Function(math.log),
    "sqrt": Function(math.sqrt),
}

# of variables by kind; others have no value until they are assigned
INITIAL: dict[str, Value] = {"long": 0.0, "double": 0.0, "string": ""}

CONSTANTS: dict[str, float] = {
    "on": 1.0,
    "off": 0.0,
    "true": 1.0,
    "false": 0.0,
    "pi": math.pi,
    "inposition": 2.0,
    "generatorcompleted": 3.0,
    "gcom": 3.0,
}


def builtin(name: str, arguments: Sequence[Value]) -> float:
    """Return the value of a built-in function; angles are in radians.

    Raises:
        SoftMCError: another number of arguments, or no finite value.
    """
    function = FUNCTIONS[name]
    if len(arguments) != function.arguments:
        raise SoftMCError(f"{name} of {len(arguments)} arguments: must have {function.arguments}")
    numbers = [number(f"argument of {name}", value) for value in arguments]
    try:
        return float(function.value(*numbers))
    except (ValueError, OverflowError):
        raise SoftMCError(f"{name}({', '.join(map(text_of, numbers))}): has no finite value") from None
