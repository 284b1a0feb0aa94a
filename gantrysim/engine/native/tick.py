"""The servo tick, compiled as MuJoCo's control callback: measure, apply the law, clamp, log, put out.

MuJoCo calls it once per physics step, on the thread that steps the simulation; see `gantrysim.engine.native`. What only
some runs need hangs on its points as stages, see `gantrysim.engine.native.stages`.
"""

from __future__ import annotations

import numba
import numpy as np

from gantrysim.base.jit import jit
from gantrysim.engine.native.laws import take
from gantrysim.engine.native.parts import part
from gantrysim.engine.native.pointers import axis_log, call, field, floats, gains_of, row_at, tick_log, vector, whole
from gantrysim.engine.native.stages import has_stages, run_stages
from gantrysim.engine.native.supervision import trip, watch_oscillation
from gantrysim.machine.layout import WARNING_NUMBER, WARNING_SIZE
from gantrysim.machine.row import (
    DIVERGED,
    FOLLOWING_ERROR,
    LARGEST_TORQUE,
    MISSED,
    NOT_IN_MODEL,
    OVERSPEED,
    OVERSPEEDING,
    OVERTRAVEL,
    POINTS,
    TRAVEL,
    WARNINGS,
)
from gantrysim.servo.laws.pid import PID

# of NumPy's type, as numba compiles a function anew for every literal of Python's that it is called with
CURRENT, SETPOINT, MOTOR, ENCODER, FEEDBACK, REPORT, SUPERVISE = map(np.int64, range(7))
ERROR, LAW, FEEDFORWARD, DISTURBANCE, DEMAND, DRIVE, VOLTAGE = map(np.int64, range(7, len(POINTS)))

_pid = part(PID.tick)


@jit
def _has_warned(address):
    """Return whether MuJoCo has warned of anything."""
    statistics = numba.carray(whole(address), (2 * WARNINGS,))
    # loops, here and below, as numba takes seconds to compile NumPy's reductions and assignments to slices
    for warning in range(WARNINGS):  # noqa: SIM110 - numba knows no generators
        if statistics[(warning * WARNING_SIZE + WARNING_NUMBER) // 4] > 0:
            return True
    return False


@jit
def _furthest(row):
    """Return the axis with the largest following error, or the first whose error is not finite."""
    worst = 0
    for a in range(row.axes):
        if not np.isfinite(row.error[a]):
            return a
        if abs(row.error[a]) > abs(row.error[worst]):
            worst = a
    return worst


@jit
def sample(data, userdata):
    """Measure all axes if a servo tick begins with this step; return whether it does."""
    row = row_at(userdata)
    if row.phase != 0 or row.fault != 0 or row.index >= row.ticks:
        return False
    _read_encoders(data, row, userdata)
    tick_log(row, row.tick).setpoint = row.index
    _take_errors(data, row)
    _check_limits(data, row)
    row.waits = 0
    run_stages(data, row, userdata, SUPERVISE)
    if row.waits == 0:
        row.index += 1
    _log_nozzle(data, row)
    return True


@jit
def _read_encoders(data, row, userdata):
    """Take the setpoint of this tick, and read the encoders."""
    n = row.axes
    setpoint = numba.carray(floats(row.setpoints + 8 * n * row.index), (n,))
    length = vector(data, row.actuator_length_at)
    for a in range(n):
        row.setpoint[a] = setpoint[a]
        row.motor[a] = length[row.output[a]] * row.scale[a]
    # before the current is logged
    run_stages(data, row, userdata, CURRENT)
    run_stages(data, row, userdata, SETPOINT)
    run_stages(data, row, userdata, MOTOR)
    for a in range(n):
        row.seen[a] = row.motor[a]
    run_stages(data, row, userdata, ENCODER)
    for a in range(n):
        count = row.resolution[a]
        if count != 0.0:
            row.seen[a] = count * np.floor(row.seen[a] / count + 0.5)
    run_stages(data, row, userdata, FEEDBACK)
    run_stages(data, row, userdata, REPORT)


@jit
def _take_errors(data, row):
    """Set the following errors and their changes, and log what was measured."""
    axis = axis_log(row, row.tick)
    velocity = vector(data, row.actuator_velocity_at)
    for a in range(row.axes):
        commanded = row.setpoint[a]
        measured = row.seen[a]
        error = commanded - measured
        if row.tick == 0:  # nothing moved before
            row.commanded[a] = commanded
            row.measured[a] = measured
            row.error[a] = error
        demand_velocity = (commanded - row.commanded[a]) / row.period
        row.demand_acceleration[a] = (demand_velocity - row.demand_velocity[a]) / row.period
        row.demand_velocity[a] = demand_velocity
        row.measured_velocity[a] = (measured - row.measured[a]) / row.period
        row.error_change[a] = (error - row.error[a]) / row.period
        row.commanded[a] = commanded
        row.measured[a] = measured
        row.error[a] = error
        axis[a].encoder = measured
        axis[a].motor = row.motor[a]
        axis[a].motor_speed = velocity[row.output[a]]


@jit
def _check_limits(data, row):
    """Trip where an axis is beyond a limit, or its state is no number or one that MuJoCo has warned of."""
    length = vector(data, row.actuator_length_at)
    velocity = vector(data, row.actuator_velocity_at)
    lost = _has_warned(data + row.warning_at)
    for a in range(row.axes):
        position = length[row.output[a]] * row.scale[a]
        speed = velocity[row.output[a]] * row.scale[a]
        lost = lost or not (np.isfinite(position) and np.isfinite(speed))
        if lost:
            break
        if abs(row.error[a]) > row.following_error_limit[a]:
            trip(row, FOLLOWING_ERROR, a, row.error[a], row.following_error_limit[a])
        elif abs(speed) > OVERSPEED * row.speed_limit[a]:
            trip(row, OVERSPEEDING, a, speed, OVERSPEED * row.speed_limit[a])
        elif position < row.low[a] - OVERTRAVEL:
            trip(row, TRAVEL, a, position, row.low[a] - OVERTRAVEL)
        elif position > row.high[a] + OVERTRAVEL:
            trip(row, TRAVEL, a, position, row.high[a] + OVERTRAVEL)
    if lost:
        worst = _furthest(row)
        trip(row, DIVERGED, worst, row.error[worst], np.inf)


@jit
def _log_nozzle(data, row):
    """Log the nozzle's position in the work frame [mm]."""
    nozzle = tick_log(row, row.tick).nozzle
    tip = vector(data, row.site_xpos_at)
    origin = vector(data, row.xpos_at)
    frame = vector(data, row.xmat_at)
    t = 3 * row.nozzle
    o = 3 * row.work
    f = 9 * row.work
    x = tip[t] - origin[o]
    y = tip[t + 1] - origin[o + 1]
    z = tip[t + 2] - origin[o + 2]
    for i in range(3):
        nozzle[i] = 1e3 * (frame[f + i] * x + frame[f + 3 + i] * y + frame[f + 6 + i] * z)


@jit
def _apply_law(data, row, userdata):
    """Set the torque demands of all axes, before they are clamped."""
    n = row.axes
    for a in range(n):
        # a law of the user's that raises sets none
        row.torque[a] = np.nan
        row.next_integral[a] = row.integral[a]
        row.feedforward[a] = 0.0
        row.law_error[a] = row.error[a]
        row.law_change[a] = row.error_change[a]
    run_stages(data, row, userdata, ERROR)
    if has_stages(row, LAW):
        run_stages(data, row, userdata, LAW)
    else:
        for a in range(n):
            torque, integral = _pid(row, a, gains_of(row, a))
            take(row, a, torque, integral)
    if has_stages(row, FEEDFORWARD) or has_stages(row, DISTURBANCE):
        run_stages(data, row, userdata, FEEDFORWARD)
        run_stages(data, row, userdata, DISTURBANCE)
        for a in range(n):
            row.torque[a] += row.feedforward[a]
    for a in range(n):
        # anti-windup: the integral is frozen while the output is clamped on the side to which the error drives it
        if abs(row.torque[a]) <= row.torque_limit[a] or row.torque[a] * row.law_error[a] < 0.0:
            row.integral[a] = row.next_integral[a]
    run_stages(data, row, userdata, DEMAND)


@jit
def command(data, userdata):
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
        for a in range(n):
            row.pending[a] = 0.0
            row.held[a] = 0.0
    row.tick += 1


@jit
def _watch_stops(data, row):
    """Note where a joint is at a stop that the model lacks: from this step on the motion is wrong."""
    position = vector(data, row.qpos_at)
    for a in range(row.axes):
        place = position[row.joint[a]]
        if place - row.stop_low[a] < 0.0 or row.stop_high[a] - place < 0.0:
            row.stops = MISSED


@jit
def _clear_forces(data, row):
    """Take away the forces that stages have added to qfrc_applied in the step before: MuJoCo keeps them."""
    forces = vector(data, row.qfrc_applied_at)
    for dof in range(row.dofs):
        forces[dof] = 0.0


@jit
def output(data, userdata):
    """Set the controls, with torque demands that are due at this step."""
    row = row_at(userdata)
    due = row.phase == row.delay
    # a fault takes the torque away at once; what limits the voltage begins from the servo's demand at every step
    if due or row.phase == 0 or has_stages(row, VOLTAGE):
        n = row.axes
        ctrl = vector(data, row.ctrl_at)
        for a in range(n):
            if due:
                row.held[a] = row.pending[a]
            ctrl[row.control[a]] = row.held[a] * row.drive_gain[a]
    if row.stages != 0:
        if has_stages(row, DRIVE):
            _clear_forces(data, row)
        run_stages(data, row, userdata, DRIVE)
        run_stages(data, row, userdata, CURRENT)
        run_stages(data, row, userdata, VOLTAGE)
    if row.stops == NOT_IN_MODEL:
        _watch_stops(data, row)
    row.steps += 1
    row.phase += 1
    if row.phase == row.substeps:
        row.phase = 0
    if row.steps == row.observer_step:
        call(row.observer, data, userdata, row.observer_argument)


@jit
def step(model, data, nuserdata_at, userdata_at, row_size, key):
    """Do what the servo has to do before a physics step; nothing to data that bear no servo's row.

    Args:
        model: address of the mjModel.
        data: address of the mjData.
        nuserdata_at: offset of this field in mjModel.
        userdata_at: offset of this pointer in mjData.
        row_size: of a servo's row, in numbers.
        key: with which a servo's row begins.
    """
    if field(model, nuserdata_at) < row_size:
        return
    userdata = field(data, userdata_at)
    row = row_at(userdata)
    if row.magic != key:
        return
    # before the call, which most steps then save
    if row.phase == 0 and sample(data, userdata):
        _apply_law(data, row, userdata)
        command(data, userdata)
    output(data, userdata)
