"""The servo tick as C functions: MuJoCo's control callback, and the parts for a law in plain Python."""

# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numba import types

from gantrysim.base.jit import c_function, source_hash
from gantrysim.engine.native.pointers import row_at
from gantrysim.engine.native.tick import command, output, sample, step
from gantrysim.machine.layout import offsets
from gantrysim.machine.row import ROW_NUMBERS


@cache
def magic() -> int:
    """Return a number of the package's text, the row's layout included, by which the callback knows a servo's row."""
    return int(source_hash()[:15], 16)


@cache
def callback() -> Any:
    """Return the tick as a C function (mjModel, mjData), compiled or from numba's cache."""
    # of NumPy's type, as numba compiles functions anew for literals of Python's
    nuserdata_at = np.int64(offsets()["nuserdata"])
    userdata_at = np.int64(offsets()["userdata"])
    row_size = np.int64(ROW_NUMBERS)
    key = np.int64(magic())

    def tick(model, data):
        step(model, data, nuserdata_at, userdata_at, row_size, key)

    return c_function(tick, types.void(types.int64, types.int64)).ctypes


@cache
def clock() -> Any:
    """Return a C function for MuJoCo's timers that takes no time to tell: it is always 0."""

    def always_zero():
        return 0.0

    return c_function(always_zero, types.float64()).ctypes


@cache
def parts() -> tuple[Any, Any, Any]:
    """Return the tick before, after and without its law for one in plain Python, functions of (mjData, userdata).

    The first returns whether a tick begins with this physics step, the second takes the law's torques, and the third
    sets the controls of every step.
    """
    key = np.int64(magic())

    def before_law(data, userdata):
        return row_at(userdata).magic == key and sample(data, userdata)

    def after_law(data, userdata):
        if row_at(userdata).magic == key:
            command(data, userdata)

    def every_step(data, userdata):
        if row_at(userdata).magic == key:
            output(data, userdata)

    ends = types.void(types.int64, types.int64)
    return (
        c_function(before_law, types.boolean(types.int64, types.int64)).ctypes,
        c_function(after_law, ends).ctypes,
        c_function(every_step, ends).ctypes,
    )
