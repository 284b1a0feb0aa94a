"""Native code: how numba compiles a function."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numba

_Function = TypeVar("_Function", bound=Callable[..., Any])


def jit(function: _Function) -> _Function:
    """Compile a function for numbers as NumPy treats them, and keep what is compiled on the disk."""
    return numba.njit(cache=True, error_model="numpy")(function)
