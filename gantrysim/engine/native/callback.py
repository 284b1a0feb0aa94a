"""The servo tick as C functions: MuJoCo's control callback, and the parts for a law in plain Python."""

# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators

from __future__ import annotations

from collections import namedtuple
from functools import cache
from typing import Any

import numba
import numpy as np
from numba import types

from gantrysim.base.jit import c_function, jit, source_hash
from gantrysim.engine.native.pointers import floats_at, integer_at, pointer, row_at, tape_of
from gantrysim.engine.native.stages import has_stages
from gantrysim.engine.native.tick import DRIVE, command, output, sample, step
from gantrysim.machine.layout import WARNING_NUMBER, WARNING_SIZE, offsets
from gantrysim.machine.row import ROW_NUMBERS, WARNINGS

_WHOLE = types.int32

_FIELDS = tuple(offsets())
Offsets: Any = namedtuple("Offsets", _FIELDS)  # type: ignore[misc]


@cache
def magic() -> int:
    """Return a number of the package's text, the row's layout included, by which the callback knows a servo's row."""
    return int(source_hash()[:15], 16)


def _offsets() -> Any:
    # of NumPy's type, as numba compiles functions anew for literals of Python's
    return Offsets(**{name: np.int64(offset) for name, offset in offsets().items()})


@cache
def callback() -> Any:
    """Return the tick as a C function (mjModel, mjData), compiled or from numba's cache."""
    fields = _offsets()
    row_size = np.int64(ROW_NUMBERS)
    key = np.int64(magic())

    def tick(model, data):
        if integer_at(model + fields.nuserdata) < row_size:
            return
        row = row_at(integer_at(data + fields.userdata))
        if row.magic != key:
            return
        read(data, row, fields)
        step(row)
        write(data, row, fields)

    return c_function(tick, types.void(types.int64, types.int64)).ctypes


@jit
def read(data, row, fields):
    """Read the machine's state out of MuJoCo's data into a servo's row.

    Args:
        data: address of the mjData.
        row: the row, in the data's userdata.
        fields: offsets of the data's fields.
    """
    row.address = integer_at(data + fields.userdata)
    length = _array(data, fields.actuator_length)
    velocity = _array(data, fields.actuator_velocity)
    position = _array(data, fields.qpos)
    currents = _array(data, fields.act)
    for a in range(row.axes):
        row.angle[a] = length[row.output_at[a]]
        row.motor_speed[a] = velocity[row.output_at[a]]
        row.winding_current[a] = currents[row.current_at[a]] if row.current_at[a] >= 0 else np.nan
        row.joint_place[a] = position[row.joint_at[a]]
    if row.phase == 0:
        row.lost = _has_warned(data + fields.warning)
        _read_nozzle(data, row, fields)
    if row.stages != 0:
        speed = _array(data, fields.qvel)
        passive = _array(data, fields.qfrc_passive)
        for a in range(row.axes):
            row.joint_speed[a] = speed[row.dof_at[a]]
            row.passive[a] = passive[row.dof_at[a]]
            if row.load_at[a] >= 0:
                row.load_place[a] = position[row.load_at[a]]
                row.load_passive[a] = passive[row.load_dof_at[a]]


@jit
def write(data, row, fields):
    """Write what acts on the machine in the next step from a servo's row into MuJoCo's data; arguments as of `read`."""
    ctrl = _array(data, fields.ctrl)
    for a in range(row.axes):
        ctrl[row.control_at[a]] = row.control_torque[a]
    if row.stages != 0:
        currents = _array(data, fields.act)
        for a in range(row.axes):
            if row.current_at[a] >= 0:
                currents[row.current_at[a]] = row.winding_current[a]
        if has_stages(row, DRIVE):
            applied = _array(data, fields.qfrc_applied)
            for a in range(row.axes):
                applied[row.dof_at[a]] = row.applied[a]


@jit
def _array(data, offset):
    """Return the doubles to which the pointer at an offset of MuJoCo's data points, however many they are."""
    return floats_at(integer_at(data + offset))


@jit
def _has_warned(address):
    """Return whether MuJoCo has warned of anything."""
    statistics = numba.carray(pointer(address, _WHOLE), (2 * WARNINGS,))
    # loops, here and below, as numba takes seconds to compile NumPy's reductions and assignments to slices
    for warning in range(WARNINGS):  # noqa: SIM110 - numba knows no generators
        if statistics[(warning * WARNING_SIZE + WARNING_NUMBER) // 4] > 0:
            return True
    return False


@jit
def _read_nozzle(data, row, fields):
    """Read the nozzle's position in the work frame [mm]."""
    tip = _array(data, fields.site_xpos)
    origin = _array(data, fields.xpos)
    frame = _array(data, fields.xmat)
    t = 3 * row.nozzle_site
    o = 3 * row.work_body
    f = 9 * row.work_body
    x = tip[t] - origin[o]
    y = tip[t + 1] - origin[o + 1]
    z = tip[t + 2] - origin[o + 2]
    for i in range(3):
        row.nozzle[i] = 1e3 * (frame[f + i] * x + frame[f + 3 + i] * y + frame[f + 6 + i] * z)


@cache
def clock() -> Any:
    """Return a C function for MuJoCo's timers that takes no time to tell: it is always 0."""

    def always_zero():
        return 0.0

    return c_function(always_zero, types.float64()).ctypes


@cache
def parts() -> tuple[Any, Any, Any]:
    """Return the tick before, after and without its law for one in plain Python, functions of mjData and of the row.

    The first returns whether a tick begins with this physics step, the second takes the law's torques, and the third
    sets the controls of every step.
    """
    fields = _offsets()
    key = np.int64(magic())

    def before_law(data, address):
        row = row_at(address)
        if row.magic != key:
            return False
        read(data, row, fields)
        return sample(row, tape_of(row))

    def after_law(data, address):
        row = row_at(address)
        if row.magic == key:
            command(row, tape_of(row))

    def every_step(data, address):
        row = row_at(address)
        if row.magic == key:
            output(row, None)
            write(data, row, fields)

    ends = types.void(types.int64, types.int64)
    return (
        c_function(before_law, types.boolean(types.int64, types.int64)).ctypes,
        c_function(after_law, ends).ctypes,
        c_function(every_step, ends).ctypes,
    )
