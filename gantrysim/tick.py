"""The servo tick as native code, installed as MuJoCo's control callback.

MuJoCo calls the callback once per physics step, on whatever thread steps the simulation. Everything it
needs lies in the simulation's own mjData.userdata, laid out as ROW: parameters, state, and the addresses
of the setpoints and of the log. A simulation whose row does not begin with MAGIC is left alone.
"""

from __future__ import annotations

import ctypes
import inspect
import sys
import threading
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any

import mujoco
import numba
import numpy as np
from numba import types
from numba.extending import intrinsic

from gantrysim import native
from gantrysim.controllers import servo
from gantrysim.controllers.servo import PlainLaw, Tick
from gantrysim.errors import InputError

__all__ = ["ADDRESSES", "FAULTS", "GAINS", "MAX_AXES", "ROW", "installed", "installed_law", "log_width", "magic"]

MAX_AXES = 6

# How far an axis may pass its travel before the limit switch trips, and by how much its speed limit.
OVERTRAVEL = 0.1  # [mm or deg]
OVERSPEED = 1.2

# An unstable loop need not run away: the torque limit can hold it in a limit cycle, whose error looks harmless.
# So many swings of the demand from one limit to the other, each within this time of the last, are no motion's.
OSCILLATION_SWINGS = 20
OSCILLATION_TIME = 0.1  # [s]

FAULTS = ("none", "following error", "travel", "overspeed", "diverged", "oscillation")
_FOLLOWING_ERROR, _TRAVEL, _OVERSPEED, _DIVERGED, _OSCILLATION = range(1, 6)

GAINS = ("kp", "ki", "kd", "velocity_ff", "acceleration_ff", "output_velocity")

_WHOLE = [
    "magic",
    "axes",
    "ticks",  # setpoints in all
    "substeps",  # physics steps per servo period
    "delay",  # physics steps from the sample to the output
    "steps",  # physics steps begun
    "tick",  # servo ticks begun
    "setpoints",  # address of (ticks, axes) positions
    "log",  # address of (ticks, log_width) numbers
    "ctrl_at",  # byte offsets of mjData's fields
    "act_at",
    "length_at",
    "velocity_at",
    "site_at",
    "body_at",
    "matrix_at",
    "nozzle",  # site
    "work",  # body
    "fault",  # index into FAULTS
    "fault_axis",
    "fault_tick",
]
_AXIS_WHOLE = ["control", "output", "current"]  # indices of ctrl, of actuator_length, and of act or -1
_AXIS_PARAMETERS = [
    "scale",  # axis travel per radian of the motor
    "resolution",
    *GAINS,
    "torque_limit",
    "following_error_limit",
    "low",
    "high",
    "speed_limit",
]
_AXIS_STATE = [
    "commanded",
    "measured",
    "error",
    "error_change",
    "error_sum",
    "demand_velocity",
    "demand_acceleration",
    "measured_velocity",
    "torque",
    "pending",
    "held",
    "clamp_side",  # where the demand was last clamped, -1 or 1
    "clamp_tick",
    "swings",
]
ROW = np.dtype(
    [(name, np.int64) for name in _WHOLE]
    + [("period", np.float64), ("fault_value", np.float64), ("fault_limit", np.float64)]
    + [(name, np.int64, (MAX_AXES,)) for name in _AXIS_WHOLE]
    + [(name, np.float64, (MAX_AXES,)) for name in _AXIS_PARAMETERS + _AXIS_STATE]
)


def log_width(axes: int) -> int:
    """Numbers per tick in the log: encoder, nozzle (3), torque demand, motor current, motor speed."""
    return 3 + 4 * axes


_OFFSETS = native.offsets()  # verified at import: an error here is better than a wrong address later

# the row's byte offsets of mjData's fields
ADDRESSES = {
    "ctrl_at": _OFFSETS.data_ctrl,
    "act_at": _OFFSETS.data_act,
    "length_at": _OFFSETS.data_actuator_length,
    "velocity_at": _OFFSETS.data_actuator_velocity,
    "site_at": _OFFSETS.data_site_xpos,
    "body_at": _OFFSETS.data_xpos,
    "matrix_at": _OFFSETS.data_xmat,
}


@cache
def magic() -> int:
    """Return a number that stands for layout and code, so that no cached code outlives a change of either."""
    source = inspect.getsource(sys.modules[__name__]) + inspect.getsource(servo)
    return zlib.crc32(source.encode())


@intrinsic
def _integers(context: Any, address: Any) -> Any:
    return _typed_pointer(types.int64)


@intrinsic
def _floats(context: Any, address: Any) -> Any:
    return _typed_pointer(types.float64)


@intrinsic
def _rows(context: Any, address: Any) -> Any:
    return _typed_pointer(numba.from_dtype(ROW))


def _typed_pointer(target: types.Type) -> Any:
    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.inttoptr(args[0], context.get_value_type(signature.return_type))

    return types.CPointer(target)(types.int64), codegen


_jit = numba.njit(error_model="numpy")
_law = _jit(servo.law)


@_jit
def _field(struct, offset):
    return numba.carray(_integers(struct + offset), (1,))[0]


@_jit
def _vector(struct, offset, size):
    return numba.carray(_floats(_field(struct, offset)), (size,))


@_jit
def _row(address):
    return numba.carray(_rows(address), (1,))[0]


@_jit
def _trip(row, fault, axis, value, limit):
    if row.fault == 0:
        row.fault = fault
        row.fault_axis = axis
        row.fault_tick = row.tick
        row.fault_value = value
        row.fault_limit = limit


@numba.njit(cache=True, error_model="numpy")
def _sample(data, userdata):
    """Measure all axes if a servo tick begins with this step; say whether it does."""
    row = _row(userdata)
    if row.fault != 0 or row.tick >= row.ticks or row.steps % row.substeps != 0:
        return False
    n = row.axes
    width = 3 + 4 * n
    setpoint = numba.carray(_floats(row.setpoints + 8 * n * row.tick), (n,))
    log = numba.carray(_floats(row.log + 8 * width * row.tick), (width,))
    length = _vector(data, row.length_at, row.output[:n].max() + 1)
    velocity = _vector(data, row.velocity_at, row.output[:n].max() + 1)
    for a in range(n):
        position = length[row.output[a]] * row.scale[a]
        speed = velocity[row.output[a]] * row.scale[a]
        count = row.resolution[a]
        measured = position if count == 0.0 else count * np.floor(position / count + 0.5)
        commanded = setpoint[a]
        error = commanded - measured
        if row.tick == 0:
            row.commanded[a], row.measured[a], row.error[a] = commanded, measured, error
        demand_velocity = (commanded - row.commanded[a]) / row.period
        row.demand_acceleration[a] = (demand_velocity - row.demand_velocity[a]) / row.period
        row.demand_velocity[a] = demand_velocity
        row.measured_velocity[a] = (measured - row.measured[a]) / row.period
        row.error_change[a] = (error - row.error[a]) / row.period
        row.commanded[a], row.measured[a], row.error[a] = commanded, measured, error
        log[a] = measured
        log[3 + 3 * n + a] = velocity[row.output[a]]
        if not (np.isfinite(position) and np.isfinite(speed)):
            _trip(row, _DIVERGED, a, position, np.inf)
        elif abs(error) > row.following_error_limit[a]:
            _trip(row, _FOLLOWING_ERROR, a, error, row.following_error_limit[a])
        elif abs(speed) > OVERSPEED * row.speed_limit[a]:
            _trip(row, _OVERSPEED, a, speed, OVERSPEED * row.speed_limit[a])
        elif position < row.low[a] - OVERTRAVEL:
            _trip(row, _TRAVEL, a, position, row.low[a] - OVERTRAVEL)
        elif position > row.high[a] + OVERTRAVEL:
            _trip(row, _TRAVEL, a, position, row.high[a] + OVERTRAVEL)
    tip = _vector(data, row.site_at, 3 * (row.nozzle + 1))[3 * row.nozzle :]
    origin = _vector(data, row.body_at, 3 * (row.work + 1))[3 * row.work :]
    frame = _vector(data, row.matrix_at, 9 * (row.work + 1))[9 * row.work :]
    for i in range(3):
        log[n + i] = 1e3 * (
            frame[i] * (tip[0] - origin[0]) + frame[3 + i] * (tip[1] - origin[1]) + frame[6 + i] * (tip[2] - origin[2])
        )
    return True


@_jit
def _apply_law(row):
    for a in range(row.axes):
        error_sum = row.error_sum[a] + row.error[a] * row.period
        torque = _law(
            row.error[a],
            error_sum,
            row.error_change[a],
            row.demand_velocity[a],
            row.demand_acceleration[a],
            row.measured_velocity[a],
            row.kp[a],
            row.ki[a],
            row.kd[a],
            row.velocity_ff[a],
            row.acceleration_ff[a],
            row.output_velocity[a],
        )
        row.torque[a] = torque
        # anti-windup: the sum stands still while the clamp holds the side the error drives towards
        if abs(torque) <= row.torque_limit[a] or torque * row.error[a] < 0.0:
            row.error_sum[a] = error_sum


@numba.njit(cache=True, error_model="numpy")
def _command(data, userdata):
    """Clamp and schedule the torques that the law has put into the row, and log them."""
    row = _row(userdata)
    n = row.axes
    log = numba.carray(_floats(row.log + 8 * (3 + 4 * n) * row.tick), (3 + 4 * n,))
    currents = _vector(data, row.act_at, row.current[:n].max() + 1)
    for a in range(n):
        limit = row.torque_limit[a]
        torque = min(max(row.torque[a], -limit), limit)
        if torque != row.torque[a]:
            _watch_oscillation(row, a, np.sign(torque))
        if row.delay == row.substeps:
            row.held[a] = row.pending[a]
        row.pending[a] = torque
        log[n + 3 + a] = torque
        log[2 * n + 3 + a] = currents[row.current[a]] if row.current[a] >= 0 else np.nan
    if row.fault != 0:
        row.pending[:n] = 0.0
        row.held[:n] = 0.0
    row.tick += 1


@_jit
def _watch_oscillation(row, axis, side):
    since = (row.tick - row.clamp_tick[axis]) * row.period
    if since > OSCILLATION_TIME:
        row.swings[axis] = 0.0
    elif side != row.clamp_side[axis]:
        row.swings[axis] += 1.0
    row.clamp_side[axis] = side
    row.clamp_tick[axis] = row.tick
    if row.swings[axis] >= OSCILLATION_SWINGS:
        _trip(row, _OSCILLATION, axis, row.swings[axis], OSCILLATION_SWINGS)


@numba.njit(cache=True, error_model="numpy")
def _output(data, userdata):
    """Put out the torque demands that are due at this step."""
    row = _row(userdata)
    n = row.axes
    due = row.steps % row.substeps == row.delay
    ctrl = _vector(data, row.ctrl_at, row.control[:n].max() + 1)
    for a in range(n):
        if due:
            row.held[a] = row.pending[a]
        ctrl[row.control[a]] = row.held[a]
    row.steps += 1


@_jit
def _step(model, data, nuserdata_at, userdata_at, row_size, key):
    if _field(model, nuserdata_at) < row_size:
        return
    userdata = _field(data, userdata_at)
    row = _row(userdata)
    if row.magic != key:
        return
    if _sample(data, userdata):
        _apply_law(row)
        _command(data, userdata)
    _output(data, userdata)


@cache
def _compiled() -> Any:
    """Return the tick as a C function, compiled or from numba's cache.

    The numbers of the closure belong to the cache's key: another layout is other code.
    """
    nuserdata_at, userdata_at = _OFFSETS.model_nuserdata, _OFFSETS.data_userdata
    row_size, key = ROW.itemsize // 8, magic()

    @numba.cfunc(types.void(types.int64, types.int64), cache=True, error_model="numpy")
    def callback(model, data):
        _step(model, data, nuserdata_at, userdata_at, row_size, key)

    return callback.ctypes


_turn = threading.Lock()  # held while any callback of ours is installed
_count_lock = threading.Lock()
_count = 0
_previous: Any = None


@contextmanager
def installed() -> Iterator[None]:
    """Have the compiled tick installed; several threads may at once, and what was there before comes back."""
    global _count, _previous
    with _count_lock:
        if _count == 0:
            callback = _compiled()
            _turn.acquire()
            _previous = mujoco.get_mjcb_control()
            mujoco.set_mjcb_control(callback)
        _count += 1
    try:
        yield
    finally:
        with _count_lock:
            _count -= 1
            if _count == 0:
                mujoco.set_mjcb_control(_previous)
                _turn.release()


@contextmanager
def installed_law(data: mujoco.MjData, law: PlainLaw) -> Iterator[None]:
    """Have a law in plain Python installed for one simulation, alone; it raises here what the law raised."""
    own, userdata, row = data._address, data.userdata.ctypes.data, data.userdata[: ROW.itemsize // 8].view(ROW)[0]
    n = int(row["axes"])
    raised: list[BaseException] = []

    @ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)
    def callback(_model: int, address: int) -> None:
        if address != own or raised:
            return
        try:
            if _sample(own, userdata):
                torque = np.asarray(law(_tick(row, n)), float)
                if torque.shape != (n,) or not np.isfinite(torque).all():
                    raise InputError(f"law returned {torque.tolist()}: must be {n} finite torques, one per axis [N·m]")
                row["torque"][:n] = torque
                _command(own, userdata)
            _output(own, userdata)
        except BaseException as error:  # must not unwind through MuJoCo's C frames
            raised.append(error)
            data.ctrl[:] = 0

    with _turn:
        previous = mujoco.get_mjcb_control()
        mujoco.set_mjcb_control(callback)
        try:
            yield
        finally:
            mujoco.set_mjcb_control(previous)
    if raised:
        raise raised[0]


def _tick(row: Any, n: int) -> Tick:
    names = ("commanded", "measured", "demand_velocity", "demand_acceleration", "measured_velocity")
    return Tick(float(row["tick"] * row["period"]), *(row[name][:n].copy() for name in names))
