"""Drives in the servo tick that are no plain ones: what their encoders report, current loop, stepper."""

# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators

from __future__ import annotations

import numpy as np

from gantrysim.jit import inner_jit
from gantrysim.native.pointers import axis_log, drives_of, vector
from gantrysim.native.row import STEPPER

_STEP, _FIRST, _SECOND = np.uint64(0x9E3779B97F4A7C15), np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
_UNIT = 2.0**-53


@inner_jit
def read(data, row, axis, motor, position):
    """Return the position that an encoder reads before it is counted.

    The position x is the motor's, or that of the joint and of the load on its spring. The encoder adds
    e1 sin(2 pi x / p) + e2 sin(4 pi x / p), with the signal period p, and white noise.
    """
    drive = drives_of(row)[axis]
    if drive.counts:
        return _stepped(_field(row, drive, 0.0), drive)
    seen = motor
    if drive.load >= 0:
        seen = position + (vector(data, row.qpos_at)[drive.load] - drive.load_zero) * drive.per_si
    angle = seen * drive.signal
    seen += drive.once * np.sin(angle) + drive.twice * np.sin(2.0 * angle)
    if drive.noise > 0.0:
        seen += drive.noise * normal(drive.seed, row.tick)
    return seen


@inner_jit
def delayed(row, axis, measured):
    """Return what the encoder reported some ticks ago, at the start what it reported first."""
    drive = drives_of(row)[axis]
    slots = drive.delay + 1
    if row.tick == 0:
        drive.history[:] = measured
    drive.history[row.tick % slots] = measured
    return drive.history[(row.tick + 1) % slots]


@inner_jit
def follow_demands(data, row):
    """Set the controls of one physics step so that the torques follow the demands held.

    A control u that is held for a step takes the torque T of a winding to T + (1 - exp(-h R / L)) (u - T). With
    u = T + lead (T* - T) it comes as much nearer to the demand T* as a lag of the current loop's bandwidth f does,
    1 - exp(-2 pi f h). MuJoCo limits the voltage of u to the bus.
    """
    ctrl, currents = vector(data, row.ctrl_at), vector(data, row.act_at)
    drives = drives_of(row)
    for a in range(row.axes):
        drive, demand = drives[a], row.held[a] * row.drive_gain[a]
        if drive.mode == STEPPER:
            turn_field(data, row, a, drive)
        elif drive.lead == 0.0:
            ctrl[row.control[a]] = demand
        else:
            torque = drive.constant * currents[row.current[a]]
            ctrl[row.control[a]] = torque + drive.lead * (demand - torque)


@inner_jit
def turn_field(data, row, axis, drive):
    """Give a stepper in open loop its torque of this physics step, and drive its phases to the field's next angle.

    With the electrical angle p x of the rotor the phases have the torque and the back-EMF of

        T = K (i_b cos p x - i_a sin p x),    e_a = -K w sin p x,    e_b = K w cos p x

    The driver wants the currents I cos p f and I sin p f of the field's angle f, counted in microsteps. Each of its two
    bridges sets the voltage, within the bus, at which L di/dt = v - R i - e takes the current there in one step of the
    circuit. At rest the torque is K I sin p (f - x).
    """
    at = row.output[axis]
    angle = vector(data, row.actuator_length_at)[at] * row.scale[axis]
    speed = vector(data, row.actuator_velocity_at)[at]
    if row.phase == row.delay % row.substeps:
        drive.start, drive.target = drive.target, row.commanded[axis]
        if row.delay == row.substeps:
            drive.target, drive.next = drive.next, row.commanded[axis]
    amplitude = 0.0 if row.fault != 0 else drive.amplitude
    if drive.logged == 0:
        field = drive.poles * _stepped(drive.start, drive)
        drive.phases[0], drive.phases[1] = amplitude * np.cos(field), amplitude * np.sin(field)
    first, second = drive.phases[0], drive.phases[1]
    theta = drive.poles * angle
    current = second * np.cos(theta) - first * np.sin(theta)
    if row.current[axis] >= 0:
        vector(data, row.act_at)[row.current[axis]] = current
    vector(data, row.ctrl_at)[row.control[axis]] = drive.constant * current
    if row.tick > drive.logged:
        drive.logged = row.tick
        entry = axis_log(row, row.tick - 1)[axis]
        entry.current, entry.demand = current, drive.volts
    turn = drive.poles * speed * row.scale[axis] * row.period / row.substeps
    gain, back, largest = drive.resistance / (1.0 - drive.left), drive.constant * speed, 0.0
    for k in range(drive.circuit):
        field = drive.poles * _stepped(_field(row, drive, (k + 1) / drive.circuit), drive)
        middle = theta + turn * (k + 0.5) / drive.circuit
        away, along = -back * np.sin(middle), back * np.cos(middle)
        a = gain * (amplitude * np.cos(field) - drive.left * first) + away
        b = gain * (amplitude * np.sin(field) - drive.left * second) + along
        a, b = min(max(a, -drive.bus), drive.bus), min(max(b, -drive.bus), drive.bus)
        first = drive.left * first + (a - away) / gain
        second = drive.left * second + (b - along) / gain
        largest = max(largest, abs(a), abs(b))
    drive.phases[0], drive.phases[1], drive.volts = first, second, largest


@inner_jit
def _field(row, drive, share):
    """Return where the field is at a share of a physics step, on its way from the last setpoint to this one [u]."""
    begun = (row.phase - row.delay) % row.substeps + share
    if begun == 0.0:  # about to start from there
        return drive.target
    return drive.start + (drive.target - drive.start) * begun / row.substeps


@inner_jit
def _stepped(field, drive):
    return drive.microstep * np.floor(field / drive.microstep + 0.5)


@inner_jit
def normal(seed, tick):
    """Return a number of the standard normal distribution, by Box and Muller, that depends on seed and tick alone."""
    first = _mixed(seed + np.uint64(2 * tick) * _STEP)
    second = _mixed(seed + np.uint64(2 * tick + 1) * _STEP)
    radius = np.sqrt(-2.0 * np.log((np.float64(first >> np.uint64(11)) + 0.5) * _UNIT))
    return radius * np.cos(2.0 * np.pi * np.float64(second >> np.uint64(11)) * _UNIT)


@inner_jit
def _mixed(number):
    """Return 64 bits that look random (the finaliser of SplitMix64, Steele, Lea and Flood 2014)."""
    number = (number ^ (number >> np.uint64(30))) * _FIRST
    number = (number ^ (number >> np.uint64(27))) * _SECOND
    return number ^ (number >> np.uint64(31))
