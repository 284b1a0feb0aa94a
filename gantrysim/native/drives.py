"""Drives in the servo tick that are no plain ones: what their encoders report, and the current loop."""

# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators

from __future__ import annotations

import numpy as np

from gantrysim.jit import inner_jit
from gantrysim.native.pointers import drives_of, vector

_STEP, _FIRST, _SECOND = np.uint64(0x9E3779B97F4A7C15), np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
_UNIT = 2.0**-53


@inner_jit
def read(data, row, axis, motor, position):
    """Return the position that an encoder reads before it is counted.

    The position x is the motor's, or that of the joint and of the load on its spring. The encoder adds
    e1 sin(2 pi x / p) + e2 sin(4 pi x / p), with the signal period p, and white noise.
    """
    drive = drives_of(row)[axis]
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
        if drive.lead == 0.0:
            ctrl[row.control[a]] = demand
        else:
            torque = drive.constant * currents[row.current[a]]
            ctrl[row.control[a]] = torque + drive.lead * (demand - torque)


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
