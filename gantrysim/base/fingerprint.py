"""A hash of all that is compiled into a function, the key under which a cache on disk keeps it.

Numba's own key is the text of the function's file. That is too much, as a comment in it makes a cache worthless, and
too little: what the function calls is compiled into it as well, and a change there goes unnoticed.
"""

from __future__ import annotations

import dis
import hashlib
from collections.abc import Callable, Iterator
from functools import cache
from types import CodeType, FunctionType, ModuleType
from typing import Any, NamedTuple

import numpy as np
from numba.core.dispatcher import Dispatcher
from numba.core.types import Type
from numba.extending import _Intrinsic

_OUTSIDE = ("numba", "numpy", "llvmlite", "math", "builtins", "typing")  # numba's cache has a key of its versions
_EXTENDED = dis.opmap["EXTENDED_ARG"]
_GLOBAL = dis.opmap["LOAD_GLOBAL"]


@cache
def fingerprint(function: Callable[..., Any]) -> str:
    """Return a hash of all that is compiled into a function: its code, its constants, and those of what it calls.

    It is the same in every process and does not change with comments, docstrings, or other parts of the same file.

    Raises:
        TypeError: it uses a value of a kind that the hash does not cover.
    """
    digest = hashlib.sha256()
    for text in _texts(_plain(function), {}):
        digest.update(text.encode())
        digest.update(b"\0")
    return digest.hexdigest()


@cache
def code_hash(function: Callable[..., Any]) -> str:
    """Return a hash of a function's own code, without that of what it calls and without the values in its closure."""
    plain = _plain(function)
    return hashlib.sha256("\0".join(_code(plain.__code__, plain.__doc__)).encode()).hexdigest()


class _Ingredients(NamedTuple):
    """What is compiled into a function: texts of its own code and constants, and the functions that it uses."""

    texts: tuple[str, ...]
    functions: tuple[FunctionType, ...]


def _plain(function: Any) -> Any:
    """Return the plain function that one is compiled of."""
    return getattr(function, "py_func", function)


def _texts(function: Any, seen: dict[Any, int]) -> Iterator[str]:
    """Yield the texts of a function and of those that it uses, each once."""
    if function in seen:
        yield str(seen[function])
        return
    seen[function] = len(seen)
    ingredients = _ingredients(function)
    yield from ingredients.texts
    for used in ingredients.functions:
        yield from _texts(used, seen)


@cache
def _ingredients(function: Any) -> _Ingredients:
    defaults = (function.__defaults__, tuple(sorted((function.__kwdefaults__ or {}).items())))
    texts = [*_code(function.__code__, function.__doc__), _constant(function.__name__, defaults)]
    functions = []
    for name, value in outer_values(function):
        texts.append(name)
        if isinstance(value, Dispatcher):
            texts.append(repr(sorted(value.targetoptions.items())))
            functions.append(value.py_func)
        elif isinstance(value, _Intrinsic) and not _outside(value._defn):
            functions.append(value._defn)
        elif isinstance(value, FunctionType) and not _outside(value):
            functions.append(value)
        else:
            texts.append(_constant(name, value))
    return _Ingredients(tuple(texts), tuple(functions))


def _code(code: CodeType, docstring: str | None = None) -> Iterator[str]:
    yield code.co_code.hex()
    yield code.co_exceptiontable.hex()
    yield repr((code.co_argcount, code.co_kwonlyargcount, code.co_flags, code.co_names, code.co_varnames))
    for number, constant in enumerate(code.co_consts):
        if isinstance(constant, CodeType):
            yield from _code(constant)
        elif number > 0 or docstring is None or constant != docstring:
            yield _constant(code.co_name, constant)


def outer_values(function: Any) -> Iterator[tuple[str, Any]]:
    """Yield name and value of the globals and the closure's variables that a function uses."""
    code = function.__code__
    for name, cell in zip(code.co_freevars, function.__closure__ or (), strict=True):
        yield name, cell.cell_contents
    for name in sorted(_names(code)):
        if name in function.__globals__:
            yield name, function.__globals__[name]


def _names(code: CodeType) -> set[str]:
    """Return the names of the globals that a function's code loads, and those of the functions within it."""
    names = {code.co_names[number] for number in _loaded(code.co_code)}
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            names |= _names(constant)
    return names


def _loaded(code: bytes) -> Iterator[int]:
    """Yield the numbers of the names that instructions load from the globals; `dis` itself takes 20 times as long."""
    argument = 0
    for operation, low in zip(code[::2], code[1::2], strict=True):
        argument = argument << 8 | low
        if operation == _EXTENDED:
            continue
        if operation == _GLOBAL:
            yield argument >> 1  # the lowest bit is a flag
        argument = 0


def _constant(name: str, value: Any) -> str:
    """Return a text of a constant's value."""
    if value is None or value is Ellipsis or isinstance(value, bool | int | float | complex | str | bytes | np.generic):
        return repr(value)
    if isinstance(value, tuple):
        return repr(tuple(_constant(name, item) for item in value))
    if isinstance(value, frozenset):
        return repr(sorted(_constant(name, item) for item in value))
    if isinstance(value, np.ndarray) and not value.dtype.hasobject:
        return f"{value.dtype.descr} {value.shape} {hashlib.sha256(value.tobytes()).hexdigest()}"
    if isinstance(value, np.dtype):
        return repr(value.descr)
    if isinstance(value, Type):  # of numba, named by what it holds
        return str(value)
    if isinstance(value, type) and hasattr(value, "_fields"):  # a NamedTuple
        return f"{value.__qualname__}{value._fields}"
    if isinstance(value, ModuleType) and _outside(value):
        return value.__name__
    if _outside(value):
        return f"{type(value).__qualname__} {getattr(value, '__qualname__', getattr(value, '__name__', ''))}"
    raise TypeError(f"{name} = {value!r}: compiled code must use constants of Python or NumPy, and functions by name")


def _outside(value: Any) -> bool:
    """Return whether a value comes from a package whose version is in numba's own key."""
    if isinstance(value, ModuleType):
        module = value.__name__
    elif isinstance(value, FunctionType):  # its type is of Python's own
        module = value.__globals__.get("__name__", "")
    else:
        module = getattr(value, "__module__", None) or type(value).__module__
    return module.partition(".")[0] in _OUTSIDE
