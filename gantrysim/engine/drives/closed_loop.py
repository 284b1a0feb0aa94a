"""Loops that a drive closes itself: of the velocity that the servo demands, or the servo's own law on the position."""

# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators

from __future__ import annotations

from typing import Any

import numpy as np

from gantrysim.base.jit import jit
from gantrysim.engine.drives.current_loop import follow_demand
from gantrysim.engine.drives.encoder import read
from gantrysim.engine.drives.field import field_at, turn_target
from gantrysim.engine.drives.part import POSITION, VELOCITY, DrivenAxis, DrivePart
from gantrysim.engine.native.functions import part
from gantrysim.engine.native.pointers import gains_of
from gantrysim.engine.native.stages import run_stages
from gantrysim.engine.native.supervision import watch_oscillation
from gantrysim.machine.row import POINTS
from gantrysim.servo import notch
from gantrysim.servo.drive_settings import LOOPS
from gantrysim.servo.laws import pid

_torque_demand = part(pid.torque_demand)
_filtered = part(notch.filtered_output)
MOTOR = np.int64(POINTS.index("motor"))
REPORT = np.int64(POINTS.index("report"))
_DRIVE = 2**40  # added to the number of a sample that the drive takes itself, for its noise


def _loop(driven: DrivenAxis) -> dict[str, Any]:
    """Return the loop of a drive that closes it itself; its motor has the torque of one with the gain."""
    axis = driven.axis
    drive = driven.drive
    if drive.mode not in LOOPS:
        return {}
    entry = {
        "every": round(driven.servo.drive_period / driven.step),
        "period": driven.servo.drive_period,
        "limit": min(drive.torque_limit, axis.peak_torque / driven.gain),
        "gain": drive.velocity_gain,
        "rate": 1 / drive.velocity_time if drive.velocity_time else 0.0,
    }
    if axis.phases is not None and axis.lag > 0:
        entry["reactance"] = axis.phases.pole_pairs * axis.phases.inductance
        entry["constant"] = axis.motor_constant
        entry["resistance"] = axis.resistance
        entry["bus"] = axis.bus_voltage
    return entry


def _follow_loop(row, tape, axis, drive):
    """Set the control of a drive in velocity or position mode."""
    if drive.mode == VELOCITY or drive.mode == POSITION:
        follow_demand(row, axis, drive.current, _closed_loop(row, tape, axis, drive))


@jit
def _closed_loop(row, tape, axis, drive):
    """Return the torque demand of a drive that closes a loop itself, sampled in steps of its own period.

    In velocity mode, with the velocity v as a difference of the motor's positions and the servo's demand w,

        out = K (w - v + sum(w - v) t / Ti)

    In position mode it is the servo's own law and notch at the drive's period. The setpoint goes in a straight line
    from the last to this one, one servo period late.
    """
    loop = drive.loop
    field = drive.field
    if drive.mode == POSITION:
        turn_target(row, axis, field, drive.logged > 0)
    if row.phase % loop.every == 0:
        row.motor[axis] = row.angle[axis] * row.scale[axis]
        run_stages(row, tape, MOTOR)
        row.seen[axis] = row.motor[axis]
        if drive.mode == POSITION or drive.encoder.load < 0:
            row.seen[axis] = read(row, axis, drive.encoder, _DRIVE + row.steps)
        if row.resolution[axis] > 0.0:
            row.seen[axis] = row.resolution[axis] * np.floor(row.seen[axis] / row.resolution[axis] + 0.5)
        run_stages(row, tape, REPORT)
        seen = row.seen[axis]
        if drive.mode == VELOCITY:
            if drive.logged == 0:
                loop.before = seen
            error = row.held[axis] - (seen - loop.before) / loop.period
            loop.before = seen
            total = loop.total + error * loop.period
            torque = loop.gain * (error + loop.rate * total)
        else:
            error = field_at(row, field, 0.0) - seen
            if drive.logged == 0:
                loop.before = error
                loop.position = seen
            total = loop.total + error * loop.period
            torque = _torque_demand(
                error,
                total,
                (error - loop.before) / loop.period,
                (field.target - field.start) / row.period,
                row.demand_acceleration[axis],
                (seen - loop.position) / loop.period,
                gains_of(row, axis),
            )
            torque, loop.first, loop.second = _filtered(torque, row.notch[axis], loop.first, loop.second)
            loop.before = error
            loop.position = seen
        limit = loop.limit
        if loop.reactance > 0.0:
            limit = min(limit, _left_by_reactance(loop, row.motor_speed[axis], np.sign(torque)))
        loop.torque = min(max(torque, -limit), limit)
        if abs(torque) <= limit or torque * error < 0.0:  # anti-windup
            loop.total = total
        if abs(torque) > limit and limit > 0.0 and row.fault == 0:
            watch_oscillation(row, axis, np.sign(torque))
    if row.fault != 0:
        loop.torque = 0.0
    if row.tick > drive.logged:
        drive.logged = row.tick
        tape.log.axis[row.tick - 1 - row.first, axis].demand = loop.torque
    return loop.torque


@jit
def _left_by_reactance(loop, speed, side):
    """Return the largest torque to one side that bus, resistance and reactance leave at a speed, in the torque's axis.

    (R i + K w)^2 + (X i)^2 = V^2 with X = p w L, where K w is positive if the motor drives.
    """
    back = loop.constant * speed * side
    reactance = loop.reactance * speed
    square = loop.resistance**2 + reactance**2
    half = loop.resistance * back
    under = half**2 - square * (back**2 - loop.bus**2)
    if under < 0.0:
        return 0.0
    return loop.constant * max((np.sqrt(under) - half) / square, 0.0)


LOOP = DrivePart(
    "loop",
    [
        ("every", np.int64),  # physics steps between its samples
        ("period", np.float64),  # of them [s]
        ("limit", np.float64),  # largest torque demand [N·m]
        ("gain", np.float64),  # of the velocity loop [N·m·s/u]
        ("rate", np.float64),  # its integral action [1/s]
        ("before", np.float64),  # position [u], or in position mode following error, at the last sample
        ("position", np.float64),  # in position mode at the last sample [u]
        ("total", np.float64),  # of the error times the period
        ("torque", np.float64),  # demand held [N·m]
        ("first", np.float64),  # states of the notch in position mode
        ("second", np.float64),
        ("reactance", np.float64),  # of a motor with poles per speed, else 0 [ohm·s]
        ("constant", np.float64),  # of such a motor [N·m/A]
        ("resistance", np.float64),  # [ohm]
        ("bus", np.float64),  # [V]
    ],
    _loop,
    (("drive", _follow_loop),),
    lambda servo, entries: bool(LOOPS & set(servo.modes)),
)
