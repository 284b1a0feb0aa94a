"""Parts of the servo tick, compiled out of the plain Python functions of laws and faults.

Tests can call these functions, and other rooms read them. What they call is compiled with them.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from inspect import getclosurevars
from types import FunctionType
from typing import Any

from gantrysim.base.jit import jit


@cache
def part(function: Callable[..., Any]) -> Any:
    """Return a plain function compiled, with the plain functions that it calls, for calls from compiled functions."""
    called = getclosurevars(function).globals
    return jit(with_parts(function, **{name: call for name, call in called.items() if isinstance(call, FunctionType)}))


def with_parts(function: Any, **parts: Any) -> Any:
    """Return a copy of a function that calls others, compiled, in place of some of its globals.

    Copies of one function that call different others have different names, by which numba's cache keeps them apart: a
    closure would have another key there in every process.

    Args:
        function: with names for them among its globals.
        parts: plain functions, by the names of the globals.
    """
    if not parts:
        return function
    names = {**function.__globals__, **{name: part(called) for name, called in parts.items()}}
    copy = FunctionType(function.__code__, names, function.__name__, function.__defaults__, function.__closure__)
    copy.__qualname__ = ".".join([function.__qualname__, *map(_full_name, parts.values())])
    if any("<" in _full_name(called) for called in parts.values()):
        raise ValueError(f"{copy.__qualname__}: functions compiled in place of others must have a name of their own")
    return copy


def _full_name(function: Any) -> str:
    return f"{function.__module__}.{function.__qualname__}"
