"""The servo tick, compiled as MuJoCo's control callback: measure, apply the law, clamp, log, put out.

MuJoCo calls it once per physics step, on the thread that steps the simulation; see `gantrysim.native`.
"""

from __future__ import annotations

import inspect
import sys
import zlib
from functools import cache
from typing import Any, NamedTuple, cast

import numba
import numpy as np
from numba import types
from numba.np.unsafe.ndarray import to_fixed_tuple

from gantrysim.base.jit import cached, inner_jit
from gantrysim.native import drives, injection, laws, pointers, supervision
from gantrysim.native import row as row_layout
from gantrysim.native.drives import delayed, follow_demands, read
from gantrysim.native.injection import interrupt, limit_voltage, received, reported, turned
from gantrysim.native.laws import LAWS, apply_laws
from gantrysim.native.layout import WARNING_NUMBER, WARNING_SIZE, offsets
from gantrysim.native.pointers import axis_log, field, floats, gains_of, row_at, tick_log, vector, whole
from gantrysim.native.row import (
    DIVERGED,
    FOLLOWING_ERROR,
    LARGEST_TORQUE,
    OVERSPEED,
    OVERSPEEDING,
    OVERTRAVEL,
    ROW_NUMBERS,
    TRAVEL,
    WARNINGS,
)
from gantrysim.native.supervision import trip, waits, watch_oscillation, watch_position_error
from gantrysim.servo import gains, law, notch


@cache
def magic() -> int:
    """Return a number of the layout and code, so that numba's cached code is not used after a change of either."""
    source = "".join(
        inspect.getsource(module)
        for module in (
            sys.modules[__name__],
            pointers,
            supervision,
            drives,
            injection,
            laws,
            row_layout,
            gains,
            law,
            notch,
            *LAWS,
        )
    )
    return zlib.crc32(source.encode())


_law = inner_jit(law.law)
_filtered = inner_jit(notch.filtered)
_COEFFICIENTS = len(notch.Coefficients._fields)


@inner_jit
def _warned(address):
    statistics = numba.carray(whole(address), (2 * WARNINGS,))
    return statistics[WARNING_NUMBER // 4 :: WARNING_SIZE // 4].max() > 0


@inner_jit
def _furthest(row):
    """Return the axis with the largest following error, or the first whose error is not finite."""
    worst = 0
    for a in range(row.axes):
        if not np.isfinite(row.error[a]):
            return a
        if abs(row.error[a]) > abs(row.error[worst]):
            worst = a
    return worst


@inner_jit
def _sample(data, userdata):
    """Measure all axes if a servo tick begins with this step; return whether it does."""
    row = row_at(userdata)
    if row.phase != 0 or row.fault != 0 or row.index >= row.ticks:
        return False
    injected, special = row.injected_count > 0, row.drives != 0
    if injected:
        interrupt(data, row)  # before the current is logged
    n = row.axes
    setpoint = numba.carray(floats(row.setpoints + 8 * n * row.index), (n,))
    log, axis = tick_log(row, row.tick), axis_log(row, row.tick)
    length = vector(data, row.actuator_length_at)
    velocity = vector(data, row.actuator_velocity_at)
    log.setpoint = row.index
    lost = _warned(data + row.warning_at)
    for a in range(n):
        position = length[row.output[a]] * row.scale[a]
        speed = velocity[row.output[a]] * row.scale[a]
        count = row.resolution[a]
        motor, commanded = position, setpoint[a]
        if injected:
            motor, commanded = turned(row, a, position), received(row, a, commanded)
        seen = read(data, row, a, motor, position) if special else motor
        measured = seen if count == 0.0 else count * np.floor(seen / count + 0.5)
        if special:
            measured = delayed(row, a, measured)
        if injected:
            measured = reported(row, a, measured)
        error = commanded - measured
        if row.tick == 0:
            row.commanded[a], row.measured[a], row.error[a] = commanded, measured, error
        demand_velocity = (commanded - row.commanded[a]) / row.period
        row.demand_acceleration[a] = (demand_velocity - row.demand_velocity[a]) / row.period
        row.demand_velocity[a] = demand_velocity
        row.measured_velocity[a] = (measured - row.measured[a]) / row.period
        row.error_change[a] = (error - row.error[a]) / row.period
        row.commanded[a], row.measured[a], row.error[a] = commanded, measured, error
        axis[a].encoder = measured
        axis[a].motor_speed = velocity[row.output[a]]
        axis[a].motor = motor
        lost = lost or not (np.isfinite(position) and np.isfinite(speed))
        if lost:
            continue
        if abs(error) > row.following_error_limit[a]:
            trip(row, FOLLOWING_ERROR, a, error, row.following_error_limit[a])
        elif abs(speed) > OVERSPEED * row.speed_limit[a]:
            trip(row, OVERSPEEDING, a, speed, OVERSPEED * row.speed_limit[a])
        elif position < row.low[a] - OVERTRAVEL:
            trip(row, TRAVEL, a, position, row.low[a] - OVERTRAVEL)
        elif position > row.high[a] + OVERTRAVEL:
            trip(row, TRAVEL, a, position, row.high[a] + OVERTRAVEL)
    if lost:
        worst = _furthest(row)
        trip(row, DIVERGED, worst, row.error[worst], np.inf)
    if row.position_error < np.inf:
        watch_position_error(row)
    if row.gate_count == 0 or not waits(row):
        row.index += 1
    tip = vector(data, row.site_xpos_at)[3 * row.nozzle :]
    origin = vector(data, row.xpos_at)[3 * row.work :]
    frame = vector(data, row.xmat_at)[9 * row.work :]
    for i in range(3):
        log.nozzle[i] = 1e3 * (
            frame[i] * (tip[0] - origin[0]) + frame[3 + i] * (tip[1] - origin[1]) + frame[6 + i] * (tip[2] - origin[2])
        )
    return True


@inner_jit
def _apply_law(row, userdata):
    if row.laws != 0:
        apply_laws(row, userdata)
        return
    for a in range(row.axes):
        error_sum = row.error_sum[a] + row.error[a] * row.period
        torque = _law(
            row.error[a],
            error_sum,
            row.error_change[a],
            row.demand_velocity[a],
            row.demand_acceleration[a],
            row.measured_velocity[a],
            gains_of(row, a),
        )
        torque, row.notch_first[a], row.notch_second[a] = _filtered(
            torque, to_fixed_tuple(row.notch[a], _COEFFICIENTS), row.notch_first[a], row.notch_second[a]
        )
        row.torque[a] = torque
        # anti-windup: the sum is frozen while the output is clamped on the side to which the error drives it
        if abs(torque) <= row.torque_limit[a] or torque * row.error[a] < 0.0:
            row.error_sum[a] = error_sum


@inner_jit
def _command(data, userdata):
    """Clamp, schedule and log the torques of the law."""
    row = row_at(userdata)
    n = row.axes
    axis = axis_log(row, row.tick)
    currents = vector(data, row.act_at)
    for a in range(n):
        limit = row.torque_limit[a]
        torque = min(max(row.torque[a], -limit), limit)
        if not abs(torque) < LARGEST_TORQUE:
            trip(row, DIVERGED, a, torque, LARGEST_TORQUE)
        if torque != row.torque[a]:
            watch_oscillation(row, a, np.sign(torque))
        if row.delay == row.substeps:
            row.held[a] = row.pending[a]
        row.pending[a] = torque
        axis[a].demand = torque
        axis[a].current = currents[row.current[a]] if row.current[a] >= 0 else np.nan
    if row.fault != 0:
        row.pending[:n] = 0.0
        row.held[:n] = 0.0
    row.tick += 1


@inner_jit
def _output(data, userdata):
    """Set the controls, with torque demands that are due at this step."""
    row = row_at(userdata)
    due = row.phase == row.delay
    if due or row.phase == 0:  # a fault takes the torque away at once
        n = row.axes
        ctrl = vector(data, row.ctrl_at)
        for a in range(n):
            if due:
                row.held[a] = row.pending[a]
            ctrl[row.control[a]] = row.held[a] * row.drive_gain[a]
    if row.drives != 0:
        follow_demands(data, row)
    if row.injected_count > 0:
        interrupt(data, row)
        limit_voltage(data, row)
    row.steps += 1
    row.phase += 1
    if row.phase == row.substeps:
        row.phase = 0


@inner_jit
def _step(model, data, nuserdata_at, userdata_at, row_size, key):
    if field(model, nuserdata_at) < row_size:
        return
    userdata = field(data, userdata_at)
    row = row_at(userdata)
    if row.magic != key:
        return
    if _sample(data, userdata):
        _apply_law(row, userdata)
        _command(data, userdata)
    _output(data, userdata)


class Compiled(NamedTuple):
    """The tick as a C function (mjModel, mjData), and its parts for a law in plain Python: (mjData, userdata).

    Attributes:
        clock: a C function for MuJoCo's timers that takes no time to tell: it is always 0.
    """

    callback: Any
    clock: Any
    sample: Any
    command: Any
    output: Any


@cache
def compiled() -> Compiled:
    """Return the tick, compiled or from numba's cache.

    Numba keys its cache by this file's date and the numbers in a function's closure. So every cached function has the
    magic number in its closure, and the functions that it calls are compiled into it.
    """
    nuserdata_at, userdata_at = offsets()["nuserdata"], offsets()["userdata"]
    row_size, key = ROW_NUMBERS, magic()

    @cached(numba.cfunc, types.void(types.int64, types.int64), error_model="numpy")
    def callback(model, data):
        _step(model, data, nuserdata_at, userdata_at, row_size, key)

    @cached(numba.cfunc, types.float64())
    def clock():
        return 0.0

    @cached(numba.njit, types.boolean(types.int64, types.int64), error_model="numpy")
    def sample(data, userdata):
        return row_at(userdata).magic == key and _sample(data, userdata)

    @cached(numba.njit, types.void(types.int64, types.int64), error_model="numpy")
    def command(data, userdata):
        if row_at(userdata).magic == key:
            _command(data, userdata)

    @cached(numba.njit, types.void(types.int64, types.int64), error_model="numpy")
    def output(data, userdata):
        if row_at(userdata).magic == key:
            _output(data, userdata)

    return Compiled(cast(Any, callback).ctypes, cast(Any, clock).ctypes, sample, command, output)
