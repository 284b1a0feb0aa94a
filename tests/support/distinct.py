"""Values that are all different, so that a number shown in the place of another is noticed."""

import dataclasses
import random
import re
from itertools import count

_seeds = count(1)


def distinct(values, low=1.0, high=10.0):
    """The same values, dataclasses and containers with every float replaced by another one, none of them twice."""
    draw = random.Random(next(_seeds))

    def other(value):
        if dataclasses.is_dataclass(value):
            fields = (field.name for field in dataclasses.fields(value))
            return dataclasses.replace(value, **{name: other(getattr(value, name)) for name in fields})
        if isinstance(value, dict):
            return {key: other(one) for key, one in value.items()}
        if isinstance(value, tuple | list):
            return type(value)(other(one) for one in value)
        return draw.uniform(low, high) if isinstance(value, float) else value

    return other(values)


def numbers(text):
    """The numbers in a text, with the digits that they are written with."""
    return re.findall(r"(?<![\w.])[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?", text.replace("−", "-"))


def same(text, other):
    """Whether two numbers as text are one value, each rounded to the digits it is written with."""

    def half(number):
        digits, _, power = number.partition("e")
        return 0.5 * 10.0 ** (int(power or 0) - len(digits.partition(".")[2]))

    return abs(float(text) - float(other)) <= (half(text) + half(other)) * (1 + 1e-9)


def unaccounted(text, tables, *known):
    """The numbers in a text that are neither in a cell of the tables, as it is shown, nor among known values."""
    cells = [number for table in tables for row in table.cells for cell in row for number in numbers(cell)]
    cells += [repr(float(value)) for value in known]
    return [number for number in numbers(text) if not any(same(number, cell) for cell in cells)]
