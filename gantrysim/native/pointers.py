"""Access to memory by its address, for code that numba compiles.

Numba knows arrays, not addresses. An intrinsic turns an integer into a pointer of a given type (LLVM's `inttoptr`,
which costs nothing), and `numba.carray` turns the pointer into an array that shares the memory. No check of any kind
is made: an address must be right.
"""

# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators

from __future__ import annotations

from typing import Any

import numba
from numba import types
from numba.extending import intrinsic

from gantrysim.native.row import LOG, ROW

jit = numba.njit(error_model="numpy")

_LOG_SIZE = LOG.itemsize


@intrinsic
def integers(context: Any, address: Any) -> Any:
    """Return the pointer to 64-bit integers at an address."""
    return _typed_pointer(types.int64)


@intrinsic
def whole(context: Any, address: Any) -> Any:
    """Return the pointer to 32-bit integers at an address."""
    return _typed_pointer(types.int32)


@intrinsic
def floats(context: Any, address: Any) -> Any:
    """Return the pointer to doubles at an address."""
    return _typed_pointer(types.float64)


@intrinsic
def _rows(context: Any, address: Any) -> Any:
    return _typed_pointer(numba.from_dtype(ROW))


@intrinsic
def _entries(context: Any, address: Any) -> Any:
    return _typed_pointer(numba.from_dtype(LOG))


def _typed_pointer(target: types.Type) -> Any:
    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.inttoptr(args[0], context.get_value_type(signature.return_type))

    return types.CPointer(target)(types.int64), codegen


@jit
def field(struct, offset):
    """Return the 64-bit integer at an offset of a struct."""
    return numba.carray(integers(struct + offset), (1,))[0]


@jit
def vector(struct, offset, size):
    """Return the doubles to which the pointer at an offset of a struct points."""
    return numba.carray(floats(field(struct, offset)), (size,))


@jit
def row_at(address):
    """Return the row at an address; a view, so that what is written to it is written there."""
    return numba.carray(_rows(address), (1,))[0]


@jit
def log_at(row, tick):
    """Return the entry of a tick in the log; a view."""
    return numba.carray(_entries(row.log + _LOG_SIZE * tick), (1,))[0]
