"""Loops that a drive closes itself: of the velocity that the servo demands, or the servo's own law on the position."""

# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators

from __future__ import annotations

from functools import cache

import numpy as np

from gantrysim.base.jit import jit
from gantrysim.engine.native.drives import follow_demand
from gantrysim.engine.native.encoders import read
from gantrysim.engine.native.parts import part
from gantrysim.engine.native.pointers import axis_log, drives_at, gains_of, leading, row_at, vector
from gantrysim.engine.native.stages import compiled_stage, run_stages
from gantrysim.engine.native.stepping_field import field_at, turn_target
from gantrysim.engine.native.supervision import watch_oscillation
from gantrysim.machine.row import POINTS, POSITION, VELOCITY
from gantrysim.servo import notch
from gantrysim.servo.laws import pid

_torque_demand = part(pid.torque_demand)
_filtered = part(notch.filtered)
_COEFFICIENTS = len(notch.Coefficients._fields)
MOTOR = np.int64(POINTS.index("motor"))
REPORT = np.int64(POINTS.index("report"))
_DRIVE = 2**40  # added to the number of a sample that the drive takes itself, for its noise


@cache
def loop_stage() -> int:
    """Return the address of the stage of drives in velocity or position mode."""

    def stage(data, userdata, argument):
        row = row_at(userdata)
        drives = drives_at(argument, row.axes)
        for axis in range(row.axes):
            drive = drives[axis]
            if drive.mode == VELOCITY or drive.mode == POSITION:
                torque = closed_loop(data, row, userdata, axis, drive)
                follow_demand(data, row, axis, drive, torque)

    return compiled_stage(stage)


@jit
def closed_loop(data, row, userdata, axis, drive):
    """Return the torque demand of a drive that closes a loop itself, sampled in steps of its own period.

    In velocity mode, with the velocity v as a difference of the motor's positions and the servo's demand w,

        out = K (w - v + sum(w - v) t / Ti)

    In position mode it is the servo's own law and notch at the drive's period. The setpoint goes in a straight line
    from the last to this one, one servo period late.
    """
    if drive.mode == POSITION:
        turn_target(row, axis, drive)
    if row.phase % drive.every == 0:
        position = vector(data, row.actuator_length_at)[row.output[axis]] * row.scale[axis]
        speed = vector(data, row.actuator_velocity_at)[row.output[axis]]
        row.motor[axis] = position
        run_stages(data, row, userdata, MOTOR)
        row.seen[axis] = row.motor[axis]
        if drive.mode == POSITION or drive.load < 0:
            row.seen[axis] = read(data, row, axis, drive, _DRIVE + row.steps)
        if row.resolution[axis] > 0.0:
            row.seen[axis] = row.resolution[axis] * np.floor(row.seen[axis] / row.resolution[axis] + 0.5)
        run_stages(data, row, userdata, REPORT)
        seen = row.seen[axis]
        if drive.mode == VELOCITY:
            if drive.logged == 0:
                drive.before = seen
            error = row.held[axis] - (seen - drive.before) / drive.period
            drive.before = seen
            total = drive.sum + error * drive.period
            torque = drive.gain * (error + drive.rate * total)
        else:
            error = field_at(row, drive, 0.0) - seen
            if drive.logged == 0:
                drive.before = error
                drive.position = seen
            total = drive.sum + error * drive.period
            torque = _torque_demand(
                error,
                total,
                (error - drive.before) / drive.period,
                (drive.target - drive.start) / row.period,
                row.demand_acceleration[axis],
                (seen - drive.position) / drive.period,
                gains_of(row, axis),
            )
            torque, drive.first, drive.second = _filtered(
                torque, leading(row.notch[axis], _COEFFICIENTS), drive.first, drive.second
            )
            drive.before = error
            drive.position = seen
        limit = drive.limit
        if drive.reactance > 0.0:
            limit = min(limit, _left_by_reactance(drive, speed, np.sign(torque)))
        drive.torque = min(max(torque, -limit), limit)
        if abs(torque) <= limit or torque * error < 0.0:  # anti-windup
            drive.sum = total
        if abs(torque) > limit and limit > 0.0 and row.fault == 0:
            watch_oscillation(row, axis, np.sign(torque))
    if row.fault != 0:
        drive.torque = 0.0
    if row.tick > drive.logged:
        drive.logged = row.tick
        axis_log(row, row.tick - 1)[axis].demand = drive.torque
    return drive.torque


@jit
def _left_by_reactance(drive, speed, side):
    """Return the largest torque to one side that bus, resistance and reactance leave at a speed, in the torque's axis.

    (R i + K w)^2 + (X i)^2 = V^2 with X = p w L, where K w is positive if the motor drives.
    """
    back = drive.constant * speed * side
    reactance = drive.reactance * speed
    square = drive.resistance**2 + reactance**2
    half = drive.resistance * back
    under = half**2 - square * (back**2 - drive.bus**2)
    if under < 0.0:
        return 0.0
    return drive.constant * max((np.sqrt(under) - half) / square, 0.0)
