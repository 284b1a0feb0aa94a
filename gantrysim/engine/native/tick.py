"""The servo tick: measure, apply the law, clamp, log, put out.

It is called before each physics step. What it reads of the machine, and what it does to it, stands in the servo's row.
What only some runs need hangs on its points as stages, see `gantrysim.engine.native.stages`.
"""

from __future__ import annotations

import numpy as np

from gantrysim.base.jit import jit
from gantrysim.engine.native.functions import part, take
from gantrysim.engine.native.pointers import call, gains_of, tape_of
from gantrysim.engine.native.stages import has_stages, run_stages
from gantrysim.engine.native.supervision import trip, watch_oscillation
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
)
from gantrysim.servo.laws.pid import PID

# of NumPy's type, as numba compiles a function anew for every literal of Python's that it is called with
CURRENT, SETPOINT, MOTOR, ENCODER, FEEDBACK, REPORT, SUPERVISE = map(np.int64, range(7))
ERROR, LAW, FEEDFORWARD, DISTURBANCE, DEMAND, DRIVE, VOLTAGE = map(np.int64, range(7, len(POINTS)))

_pid = part(PID.tick)


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
def sample(row, tape):
    """Measure all axes if a servo tick begins with this step; return whether it does."""
    if row.phase != 0 or row.fault != 0 or row.index >= row.ticks:
        return False
    _read_encoders(row, tape)
    entry = tape.log.tick[row.tick - row.first]
    entry.setpoint = row.index
    _take_errors(row, tape)
    _check_limits(row)
    row.waits = 0
    run_stages(row, tape, SUPERVISE)
    if row.waits == 0:
        row.index += 1
    for i in range(3):
        entry.nozzle[i] = row.nozzle[i]
    return True


@jit
def _read_encoders(row, tape):
    """Take the setpoint of this tick, and read the encoders."""
    n = row.axes
    for a in range(n):
        row.setpoint[a] = tape.setpoints[row.index, a]
        row.motor[a] = row.angle[a] * row.scale[a]
    # before the current is logged
    run_stages(row, tape, CURRENT)
    run_stages(row, tape, SETPOINT)
    run_stages(row, tape, MOTOR)
    for a in range(n):
        row.seen[a] = row.motor[a]
    run_stages(row, tape, ENCODER)
    for a in range(n):
        count = row.resolution[a]
        if count != 0.0:
            row.seen[a] = count * np.floor(row.seen[a] / count + 0.5)
    run_stages(row, tape, FEEDBACK)
    run_stages(row, tape, REPORT)


@jit
def _take_errors(row, tape):
    """Set the following errors and their changes, and log what was measured."""
    for a in range(row.axes):
        commanded = row.setpoint[a]
        measured = row.seen[a]
        error = commanded - measured
        if row.tick == 0:  # before, it moved at the speeds of the start, which are mostly zero
            row.commanded[a] = commanded - row.period * row.demand_velocity[a]
            row.measured[a] = measured - row.period * row.measured_velocity[a]
            row.error[a] = error - row.period * row.error_change[a]
        demand_velocity = (commanded - row.commanded[a]) / row.period
        row.demand_acceleration[a] = (demand_velocity - row.demand_velocity[a]) / row.period
        row.demand_velocity[a] = demand_velocity
        row.measured_velocity[a] = (measured - row.measured[a]) / row.period
        row.error_change[a] = (error - row.error[a]) / row.period
        row.commanded[a] = commanded
        row.measured[a] = measured
        row.error[a] = error
        entry = tape.log.axis[row.tick - row.first, a]
        entry.encoder = measured
        entry.motor = row.motor[a]
        entry.motor_speed = row.motor_speed[a]


@jit
def _check_limits(row):
    """Trip where an axis is beyond a limit, or its state is no number or one that MuJoCo has warned of."""
    lost = row.lost != 0
    for a in range(row.axes):
        position = row.angle[a] * row.scale[a]
        speed = row.motor_speed[a] * row.scale[a]
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
def apply_law(row, tape):
    """Set the torque demands of all axes, before they are clamped."""
    n = row.axes
    for a in range(n):
        # a law of the user's that raises sets none
        row.torque[a] = np.nan
        row.next_integral[a] = row.integral[a]
        row.feedforward[a] = 0.0
        row.law_error[a] = row.error[a]
        row.law_change[a] = row.error_change[a]
    run_stages(row, tape, ERROR)
    if has_stages(row, LAW):
        run_stages(row, tape, LAW)
    else:
        for a in range(n):
            torque, integral = _pid(row, a, gains_of(row, a))
            take(row, a, torque, integral)
    if has_stages(row, FEEDFORWARD) or has_stages(row, DISTURBANCE):
        run_stages(row, tape, FEEDFORWARD)
        run_stages(row, tape, DISTURBANCE)
        for a in range(n):
            row.torque[a] += row.feedforward[a]
    for a in range(n):
        # anti-windup: the integral is frozen while the output is clamped on the side to which the error drives it
        if abs(row.torque[a]) <= row.torque_limit[a] or row.torque[a] * row.law_error[a] < 0.0:
            row.integral[a] = row.next_integral[a]
    run_stages(row, tape, DEMAND)


@jit
def command(row, tape):
    """Clamp, schedule and log the torques of the law."""
    n = row.axes
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
        entry = tape.log.axis[row.tick - row.first, a]
        entry.demand = torque
        entry.current = row.winding_current[a]
    if row.fault != 0:
        for a in range(n):
            row.pending[a] = 0.0
            row.held[a] = 0.0
    row.tick += 1


@jit
def _watch_stops(row):
    """Note where a joint is at a stop that the model lacks: from this step on the motion is wrong."""
    for a in range(row.axes):
        place = row.joint_place[a]
        if place - row.stop_low[a] < 0.0 or row.stop_high[a] - place < 0.0:
            row.stops = MISSED


@jit
def output(row, tape):
    """Set the controls, with torque demands that are due at this step."""
    due = row.phase == row.delay
    # a fault takes the torque away at once; what limits the voltage begins from the servo's demand at every step
    if due or row.phase == 0 or has_stages(row, VOLTAGE):
        for a in range(row.axes):
            if due:
                row.held[a] = row.pending[a]
            row.control_torque[a] = row.held[a] * row.drive_gain[a]
    if row.stages != 0:
        for a in range(row.axes):
            row.applied[a] = 0.0
        run_stages(row, tape, DRIVE)
        run_stages(row, tape, CURRENT)
        run_stages(row, tape, VOLTAGE)
    if row.stops == NOT_IN_MODEL:
        _watch_stops(row)
    row.steps += 1
    row.phase += 1
    if row.phase == row.substeps:
        row.phase = 0
    if row.steps == row.observer_step:
        call(row.observer, row.address, row.observer_argument)


@jit
def step(row):
    """Do what the servo has to do before a physics step."""
    # before the call, which most steps then save
    if row.phase == 0:
        tape = tape_of(row)
        if sample(row, tape):
            apply_law(row, tape)
            command(row, tape)
    # stages, which need it, find it by themselves
    output(row, None)
