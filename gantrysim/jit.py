"""Compilation by numba, with numbers that behave as NumPy's (a division by zero gives inf)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numba

_Function = TypeVar("_Function", bound=Callable[..., Any])


def jit(function: _Function) -> _Function:
    """Compile a function and cache the result on disk."""
    return numba.njit(cache=True, error_model="numpy")(function)


def inner_jit(function: _Function) -> _Function:
    """Compile a function that only compiled functions call; it becomes a part of them, also in their cache."""
    return numba.njit(error_model="numpy")(function)
