"""Numbers of settings: few digits, and factors as text."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

_DIGITS = 4


def rounded_number(value: float) -> float:
    """Return a number of at most four significant digits, as people type it."""
    return float(f"{value:.{_DIGITS}g}")


def factor_text(factor: float) -> str:
    """Return a factor as text, such as "× 0.5"."""
    return f"× {factor:g}"


def milliseconds(seconds: float) -> str:
    """Return a time as text, such as "25 ms"."""
    return f"{1e3 * seconds:.4g} ms"


def value_of(arguments: Mapping[str, Any], dotted: str) -> Any:
    """Return the argument with a dotted name, None where there is none."""
    value: Any = arguments
    for part in dotted.split("."):
        if not isinstance(value, Mapping) or part not in value:
            return None
        value = value[part]
    return value


def scaled_numbers(value: Any, factor: float) -> Any:
    """Return a number, or the numbers of a list, times a factor; None for anything else."""
    if isinstance(value, list | tuple):
        items = [scaled_numbers(item, factor) for item in value]
        return None if None in items else items
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    return rounded_number(float(value) * factor)
