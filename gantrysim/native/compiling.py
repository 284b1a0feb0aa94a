"""Compiles the parts of the servo tick out of plain Python functions, each under a key of its own in numba's cache.

The functions of a law or a fault are plain Python, which tests can call and other rooms can read. What they call is
compiled with them. A part is compiled where a run first needs it, and stays in numba's cache on disk.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from types import FunctionType
from typing import Any

from numba.core.ccallback import CFunc

from gantrysim.base import pipeline
from gantrysim.base.caches import Cached
from gantrysim.base.fingerprint import outer_values
from gantrysim.base.jit import inner_jit

_OPTIONS = {"error_model": "numpy"}


@cache
def part(function: Callable[..., Any]) -> Any:
    """Return a plain function compiled, with the plain functions that it calls, as a part of compiled functions."""
    helpers = {name: part(value) for name, value in outer_values(function) if isinstance(value, FunctionType)}
    if not helpers:
        return inner_jit(function)
    names = {**function.__globals__, **helpers}
    copy = FunctionType(function.__code__, names, function.__name__, function.__defaults__, function.__closure__)
    return inner_jit(copy)


def c_function(function: Callable[..., Any], result: Any, *arguments: Any) -> CFunc:
    """Return a function as a C function, from numba's cache on disk if nothing that is compiled into it has changed.

    Args:
        function: with compiled functions among its globals or in its closure, as `part` returns them.
        result: numba's type of its result.
        arguments: numba's types of its arguments.
    """
    compiled = CFunc(function, (arguments, result), {}, _OPTIONS, pipeline.WHOLE)
    compiled._cache = Cached(function, _OPTIONS)
    compiled.compile()
    return compiled
