"""Memory at an address as an array or a record, in code that numba compiles.

An intrinsic makes a typed pointer of an integer (LLVM's `inttoptr`), and `numba.carray` an array of the pointer. The
array is a view of the memory. Nothing is checked: the address must be right.
"""

# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators

from __future__ import annotations

from typing import Any

import numba
from llvmlite import ir
from numba import RequireLiteralValue, types
from numba.extending import intrinsic

from gantrysim.base.jit import jit
from gantrysim.machine.row import FAULT, LAW, LOG_AXIS, LOG_TICK, ROW, STAGE
from gantrysim.servo.gains import GAIN_NAMES, Gains

_MANY_NUMBERS = 2**31  # nothing is checked against it
_GAINS = len(GAIN_NAMES)
_TICK_SIZE = LOG_TICK.itemsize
_AXIS_SIZE = LOG_AXIS.itemsize


@intrinsic
def integers(context: Any, address: Any) -> Any:
    """Return the pointer to 64-bit integers at an address."""
    return typed_pointer(types.int64)


@intrinsic
def whole(context: Any, address: Any) -> Any:
    """Return the pointer to 32-bit integers at an address."""
    return typed_pointer(types.int32)


@intrinsic
def octets(context: Any, address: Any) -> Any:
    """Return the pointer to bytes at an address."""
    return typed_pointer(types.uint8)


@intrinsic
def floats(context: Any, address: Any) -> Any:
    """Return the pointer to doubles at an address."""
    return typed_pointer(types.float64)


@intrinsic
def _rows(context: Any, address: Any) -> Any:
    return typed_pointer(numba.from_dtype(ROW))


@intrinsic
def _tick_entries(context: Any, address: Any) -> Any:
    return typed_pointer(numba.from_dtype(LOG_TICK))


@intrinsic
def _axis_entries(context: Any, address: Any) -> Any:
    return typed_pointer(numba.from_dtype(LOG_AXIS))


@intrinsic
def _stage_entries(context: Any, address: Any) -> Any:
    return typed_pointer(numba.from_dtype(STAGE))


@intrinsic
def _fault_entries(context: Any, address: Any) -> Any:
    return typed_pointer(numba.from_dtype(FAULT))


@intrinsic
def _law_entries(context: Any, address: Any) -> Any:
    return typed_pointer(numba.from_dtype(LAW))


@intrinsic
def call(context: Any, address: Any, data: Any, userdata: Any, argument: Any) -> Any:
    """Call the C function at an address with three integers."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        word = ir.IntType(64)
        function = ir.FunctionType(ir.VoidType(), [word, word, word])
        builder.call(builder.inttoptr(args[0], function.as_pointer()), args[1:])
        return context.get_dummy_value()

    return types.void(types.int64, types.int64, types.int64, types.int64), codegen


@intrinsic
def leading(context: Any, array: Any, count: Any) -> Any:
    """Return the first numbers of a contiguous array as a tuple, as many as a constant tells.

    For numba's `to_fixed_tuple` a function is compiled that fills the tuple in a loop.
    """
    if not isinstance(count, types.IntegerLiteral):
        raise RequireLiteralValue("count")
    size = count.literal_value

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        data = context.make_array(array)(context, builder, args[0]).data
        places = [ir.Constant(ir.IntType(64), k) for k in range(size)]
        numbers = [builder.load(builder.gep(data, [place])) for place in places]
        return context.make_tuple(builder, signature.return_type, numbers)

    return types.UniTuple(array.dtype, size)(array, count), codegen


def typed_pointer(target: types.Type) -> Any:
    """Return what an intrinsic needs to make a pointer to a type of numba's: its signature, and its code."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.inttoptr(args[0], context.get_value_type(signature.return_type))

    return types.CPointer(target)(types.int64), codegen


@jit
def field(struct, offset):
    """Return the 64-bit integer at an offset of a struct."""
    return numba.carray(integers(struct + offset), (1,))[0]


@jit
def vector(struct, offset):
    """Return the doubles to which the pointer at an offset of a struct points, however many they are."""
    return numba.carray(floats(field(struct, offset)), (_MANY_NUMBERS,))


@jit
def row_at(address):
    """Return the row at an address, a view."""
    return numba.carray(_rows(address), (1,))[0]


@jit
def logs_at(address, axis_address, ticks, axes):
    """Return the log at two addresses, views: of the machine, (ticks,), and of the axes, (ticks, axes)."""
    return (
        numba.carray(_tick_entries(address), (ticks,)),
        numba.carray(_axis_entries(axis_address), (ticks, axes)),
    )


@jit
def tick_log(row, tick):
    """Return a tick's entry in the log of the machine, a view."""
    return numba.carray(_tick_entries(row.log + _TICK_SIZE * tick), (1,))[0]


@jit
def axis_log(row, tick):
    """Return a tick's entries in the log of the axes, a view, (axes,)."""
    return numba.carray(_axis_entries(row.axis_log + _AXIS_SIZE * row.axes * tick), (row.axes,))


@jit
def stages_of(row):
    """Return the stages of the tick, a view."""
    return numba.carray(_stage_entries(row.stages), (row.stage_until[-1],))


@jit
def fault_at(address):
    """Return the deliberate fault at an address, a view."""
    return numba.carray(_fault_entries(address), (1,))[0]


@jit
def laws_at(address, axes):
    """Return the laws at an address, a view, (axes,)."""
    return numba.carray(_law_entries(address), (axes,))


@jit
def gains_of(row, axis):
    """Return the gains of an axis, a copy."""
    return Gains(*leading(row.gains[axis], _GAINS))
