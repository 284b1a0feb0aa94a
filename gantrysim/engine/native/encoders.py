"""Encoders in the servo tick: what they report, their noise, and the delay of the feedback."""

# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators

from __future__ import annotations

from functools import cache

import numpy as np

from gantrysim.base.jit import jit
from gantrysim.engine.native.pointers import drives_at, row_at, vector
from gantrysim.engine.native.stages import compiled_stage
from gantrysim.engine.native.stepping_field import field_at, stepped

_STEP = np.uint64(0x9E3779B97F4A7C15)
_FIRST = np.uint64(0xBF58476D1CE4E5B9)
_SECOND = np.uint64(0x94D049BB133111EB)
_UNIT = 2.0**-53


@cache
def encoder_stage() -> int:
    """Return the address of the stage that reads the encoders; its argument is the address of the drives."""

    def stage(data, userdata, argument):
        row = row_at(userdata)
        drives = drives_at(argument, row.axes)
        for axis in range(row.axes):
            drive = drives[axis]
            if drive.counts:
                begun = (row.phase - row.delay) % row.substeps  # a new target is about to be taken where it is 0
                row.seen[axis] = stepped(field_at(row, drive, 0.0) if begun else drive.target, drive)
            else:
                row.seen[axis] = read(data, row, axis, drive, row.tick)

    return compiled_stage(stage)


@cache
def delay_stage() -> int:
    """Return the address of the stage that delays the feedback; its argument is the address of the drives."""

    def stage(data, userdata, argument):
        row = row_at(userdata)
        drives = drives_at(argument, row.axes)
        for axis in range(row.axes):
            row.seen[axis] = _delayed(row, drives[axis], row.seen[axis])

    return compiled_stage(stage)


@jit
def read(data, row, axis, drive, sample):
    """Return the position that the encoder of an axis reads at a numbered sample before it is counted.

    The position x is the motor's, or that of the joint and of the load on its spring. The encoder adds
    e1 sin(2 pi x / p) + e2 sin(4 pi x / p), with the signal period p, and white noise.
    """
    seen = row.motor[axis]
    if drive.load >= 0:
        joint = vector(data, row.actuator_length_at)[row.output[axis]] * row.scale[axis]
        seen = joint + (vector(data, row.qpos_at)[drive.load] - drive.load_zero) * drive.per_si
    angle = seen * drive.signal
    seen += drive.once * np.sin(angle) + drive.twice * np.sin(2.0 * angle)
    if drive.noise > 0.0:
        seen += drive.noise * normal(drive.seed, sample)
    return seen


@jit
def _delayed(row, drive, measured):
    """Return what the encoder reported some ticks ago, at the start what it reported first."""
    slots = drive.delay + 1
    if row.tick == 0:
        drive.history[:] = measured
    drive.history[row.tick % slots] = measured
    return drive.history[(row.tick + 1) % slots]


@jit
def normal(seed, tick):
    """Return a number of the standard normal distribution, by Box and Muller, that depends on seed and tick alone."""
    first = _mixed(seed + np.uint64(2 * tick) * _STEP)
    second = _mixed(seed + np.uint64(2 * tick + 1) * _STEP)
    radius = np.sqrt(-2.0 * np.log((np.float64(first >> np.uint64(11)) + 0.5) * _UNIT))
    return radius * np.cos(2.0 * np.pi * np.float64(second >> np.uint64(11)) * _UNIT)


@jit
def _mixed(number):
    """Return 64 bits that look random (the finaliser of SplitMix64, Steele, Lea and Flood 2014)."""
    number = (number ^ (number >> np.uint64(30))) * _FIRST
    number = (number ^ (number >> np.uint64(27))) * _SECOND
    return number ^ (number >> np.uint64(31))
