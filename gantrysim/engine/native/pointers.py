"""Memory at an address as an array or a record, in code that numba compiles.

The intrinsic `pointer` makes a typed pointer of an integer (LLVM's `inttoptr`), and `numba.carray` an array of the
pointer. The array is a view of the memory. Nothing is checked: the address must be right.
"""

# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators

from __future__ import annotations

from typing import Any

import numba
from llvmlite import ir
from numba import RequireLiteralValue, types
from numba.extending import intrinsic

from gantrysim.base.jit import jit
from gantrysim.machine.row import LOG_AXIS, LOG_TICK, ROW, STAGE, Log, Tape
from gantrysim.servo.gains import GAIN_NAMES, Gains

_UNCHECKED_LENGTH = 2**31  # nothing is checked against it
_GAINS = len(GAIN_NAMES)
_INTEGER = types.int64
_FLOAT = types.float64
_OCTET = types.uint8
_ROW = numba.from_dtype(ROW)
_TICK = numba.from_dtype(LOG_TICK)
_AXIS = numba.from_dtype(LOG_AXIS)
_STAGE = numba.from_dtype(STAGE)


@intrinsic
def pointer(context: Any, address: Any, kind: Any) -> Any:
    """Return the pointer to numbers or records at an address, whose type of numba's is a global of the caller."""
    target = kind.instance_type

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.inttoptr(args[0], context.get_value_type(signature.return_type))

    return types.CPointer(target)(types.int64, kind), codegen


@intrinsic
def call(context: Any, address: Any, row: Any, argument: Any) -> Any:
    """Call the C function at an address with two integers."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        word = ir.IntType(64)
        function = ir.FunctionType(ir.VoidType(), [word, word])
        builder.call(builder.inttoptr(args[0], function.as_pointer()), args[1:])
        return context.get_dummy_value()

    return types.void(types.int64, types.int64, types.int64), codegen


@intrinsic
def take_turn(context: Any, address: Any) -> Any:
    """Return the integer at an address, which becomes 1 more: of several threads each gets another one."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        word = ir.IntType(64)
        return builder.atomic_rmw(
            "add", builder.inttoptr(args[0], word.as_pointer()), ir.Constant(word, 1), "monotonic"
        )

    return types.int64(types.int64), codegen


@intrinsic
def leading(context: Any, array: Any, count: Any) -> Any:
    """Return the first numbers of a contiguous array as a tuple, as many as a constant tells."""
    if not isinstance(count, types.IntegerLiteral):
        raise RequireLiteralValue("count")
    size = count.literal_value

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        data = context.make_array(array)(context, builder, args[0]).data
        places = [ir.Constant(ir.IntType(64), k) for k in range(size)]
        numbers = [builder.load(builder.gep(data, [place])) for place in places]
        return context.make_tuple(builder, signature.return_type, numbers)

    return types.UniTuple(array.dtype, size)(array, count), codegen


@jit
def integer_at(address):
    """Return the 64-bit integer at an address."""
    return numba.carray(pointer(address, _INTEGER), (1,))[0]


@jit
def floats_at(address):
    """Return the doubles at an address, however many they are."""
    return numba.carray(pointer(address, _FLOAT), (_UNCHECKED_LENGTH,))


@jit
def octets_at(address):
    """Return the bytes at an address, however many they are."""
    return numba.carray(pointer(address, _OCTET), (_UNCHECKED_LENGTH,))


@jit
def rows_at(address, count, columns):
    """Return the doubles at an address as rows, (count, columns)."""
    return numba.carray(pointer(address, _FLOAT), (count, columns))


@jit
def row_at(address):
    """Return the row at an address, a view."""
    return numba.carray(pointer(address, _ROW), (1,))[0]


@jit
def log_of(row):
    """Return the log that a row names, a view, by tick."""
    return Log(
        numba.carray(pointer(row.log, _TICK), (_UNCHECKED_LENGTH,)),
        numba.carray(pointer(row.axis_log, _AXIS), (_UNCHECKED_LENGTH, row.axes)),
    )


@jit
def tape_of(row):
    """Return the setpoints, the gates and the log that a row names, views."""
    return Tape(
        numba.carray(pointer(row.setpoints, _FLOAT), (row.ticks, row.axes)),
        numba.carray(pointer(row.gates, _INTEGER), (row.gate_count,)),
        log_of(row),
    )


@jit
def stages_of(row):
    """Return the stages of the tick, a view."""
    return numba.carray(pointer(row.stages, _STAGE), (row.stage_until[-1],))


@jit
def gains_of(row, axis):
    """Return the gains of an axis, a copy."""
    return Gains(*leading(row.gains[axis], _GAINS))
