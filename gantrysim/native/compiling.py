"""Compiles the parts of the servo tick out of plain Python functions, each under a key of its own in numba's cache.

The functions of a law or a fault are plain Python, which tests can call and other rooms can read. What they call is
compiled with them. A part is compiled where a run first needs it, and stays in numba's cache on disk.
"""

from __future__ import annotations

import dis
import hashlib
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import cache
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np
from numba.core.caching import FunctionCache
from numba.core.ccallback import CFunc
from numba.core.dispatcher import Dispatcher
from numba.extending import _Intrinsic

from gantrysim.base import pipeline
from gantrysim.base.jit import inner_jit

_OUTSIDE = ("numba", "numpy", "llvmlite", "math", "builtins", "typing")  # numba's cache has a key of its versions


@cache
def part(function: Callable[..., Any]) -> Any:
    """Return a plain function compiled, with the plain functions that it calls, as a part of compiled functions."""
    helpers = {name: part(value) for name, value in _outer_values(function) if isinstance(value, FunctionType)}
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
    compiled = CFunc(function, (arguments, result), {}, {"error_model": "numpy"}, pipeline.WHOLE)
    with suppress(RuntimeError):  # there is no folder in which a cache can be written
        compiled._cache = _KeyedCache(function)
    compiled.compile()
    return compiled


class _KeyedCache(FunctionCache):  # type: ignore[misc]
    """Numba's cache of a function, keyed by `fingerprint`.

    Numba itself looks at the date of the function's own file, not at those of the functions that it calls, and pickles
    a closure, in which a compiled function gets another number in every process.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        self._fingerprint = fingerprint(function)
        super().__init__(function)

    def _index_key(self, sig: Any, codegen: Any) -> Any:
        return sig, codegen.magic_tuple(), self._fingerprint


@cache
def fingerprint(function: Callable[..., Any]) -> str:
    """Return a hash of all that is compiled into a function: its code, its constants, and those of what it calls.

    Raises:
        TypeError: it uses a value of a kind that the hash does not cover.
    """
    digest = hashlib.sha256()
    for text in _ingredients(_plain(function), set()):
        digest.update(text.encode())
        digest.update(b"\0")
    return digest.hexdigest()


def _plain(function: Any) -> Any:
    """Return the plain function that one is compiled of."""
    return getattr(function, "py_func", function)


def _ingredients(function: Any, seen: set[Any]) -> Iterator[str]:
    code = function.__code__
    if code in seen:  # it is in the hash, or calls itself
        return
    seen.add(code)
    yield from _code(code)
    yield repr(function.__defaults__)
    for name, value in _outer_values(function):
        yield name
        if isinstance(value, Dispatcher):
            yield from _ingredients(value.py_func, seen)
        elif isinstance(value, FunctionType) and not _outside(value):
            yield from _ingredients(value, seen)
        elif isinstance(value, _Intrinsic) and not _outside(value._defn):
            yield from _ingredients(value._defn, seen)
        else:
            yield _constant(name, value)


def _code(code: CodeType) -> Iterator[str]:
    yield code.co_code.hex()
    yield repr(code.co_names)
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _code(constant)
        else:
            yield repr(constant)


def _outer_values(function: Any) -> Iterator[tuple[str, Any]]:
    """Yield name and value of the globals and the closure's variables that a function uses."""
    code = function.__code__
    for name, cell in zip(code.co_freevars, function.__closure__ or (), strict=True):
        yield name, cell.cell_contents
    for name in sorted(_names(code)):
        if name in function.__globals__:
            yield name, function.__globals__[name]


def _names(code: CodeType) -> set[str]:
    names = {instruction.argval for instruction in dis.get_instructions(code) if instruction.opname == "LOAD_GLOBAL"}
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            names |= _names(constant)
    return names


def _constant(name: str, value: Any) -> str:
    """Return a text of a constant's value."""
    if value is None or isinstance(value, bool | int | float | str | np.generic):
        return repr(value)
    if isinstance(value, tuple):
        return repr(tuple(_constant(name, item) for item in value))
    if isinstance(value, np.dtype):
        return repr(value.descr)
    if isinstance(value, ModuleType):
        return value.__name__
    if isinstance(value, type) and hasattr(value, "_fields"):  # a NamedTuple
        return f"{value.__qualname__}{value._fields}"
    if _outside(value):
        return repr(type(value))
    raise TypeError(f"{name} = {value!r}: a part of the servo tick must use constants of Python or NumPy alone")


def _outside(value: Any) -> bool:
    """Return whether a value comes from a package whose version is in numba's own key."""
    module = getattr(value, "__module__", None) or type(value).__module__
    return module.partition(".")[0] in _OUTSIDE
