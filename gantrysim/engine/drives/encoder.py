"""Encoders: where they sit, what they report, their noise, and the delay of the feedback."""

# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.errors import InputError
from gantrysim.base.jit import jit
from gantrysim.engine.drives.field import field_at, stepped_place
from gantrysim.engine.drives.part import DrivenAxis, DrivePart
from gantrysim.machine.axis import PER_SI
from gantrysim.servo.request import MAX_FEEDBACK_DELAY
from gantrysim.servo.servo import Servo

_SEED_STEP = np.uint64(0x9E3779B97F4A7C15)
_FIRST_MULTIPLIER = np.uint64(0xBF58476D1CE4E5B9)
_SECOND = np.uint64(0x94D049BB133111EB)
_UNIT = 2.0**-53


def _encoder(driven: DrivenAxis) -> dict[str, Any]:
    """Return the encoder of an axis: its place and its errors."""
    axis = driven.axis
    drive = driven.drive
    entry: dict[str, Any] = {
        "load": -1,
        "counts": drive.mode == "stepper" and drive.feedback == "none",
        "noise": drive.encoder_noise,
        "seed": _seed(driven) if drive.encoder_noise else 0,
        "once": drive.interpolation_error,
        "twice": drive.interpolation_error_twice,
        "signal": 2 * math.pi / drive.signal_period if drive.signal_period else 0.0,
    }
    if drive.feedback == "load":
        if driven.load < 0:
            raise InputError(
                f"servo feedback of axis {axis.name} = 'load': machine {driven.machine.name} has no single spring "
                "between this axis and its load; use 'motor'"
            )
        place = driven.model.jnt_qposadr[driven.load]
        entry |= {"load": place, "load_zero": driven.model.qpos0[place], "per_si": PER_SI[axis.unit]}
    return entry


def _seed(driven: DrivenAxis) -> np.uint64:
    """Return the seed of an encoder's noise."""
    seeds = np.random.SeedSequence([driven.servo.encoder_seed, driven.number])
    return np.uint64(seeds.generate_state(1, np.uint64)[0])


def _report(row, tape, axis, drive):
    """Set what the encoder of an axis reads at this tick, or the microsteps that are counted in its place."""
    if drive.encoder.counts:
        # a new target is about to be taken where it is 0
        begun = (row.phase - row.delay) % row.substeps
        row.seen[axis] = stepped_place(field_at(row, drive.field, 0.0) if begun else drive.field.target, drive.stepper)
    else:
        row.seen[axis] = read(row, axis, drive.encoder, row.tick)


@jit
def read(row, axis, encoder, sample):
    """Return the position that the encoder of an axis reads at a numbered sample before it is counted.

    The position x is the motor's, or that of the joint and of the load on its spring. The encoder adds
    e1 sin(2 pi x / p) + e2 sin(4 pi x / p), with the signal period p, and white noise.
    """
    seen = row.motor[axis]
    if encoder.load >= 0:
        joint = row.angle[axis] * row.scale[axis]
        seen = joint + (row.load_place[axis] - encoder.load_zero) * encoder.per_si
    angle = seen * encoder.signal
    seen += encoder.once * np.sin(angle) + encoder.twice * np.sin(2.0 * angle)
    if encoder.noise > 0.0:
        seen += encoder.noise * normal(encoder.seed, sample)
    return seen


def _delay(row, tape, axis, drive):
    """Set what the encoder of an axis reported some ticks ago, at the start what it reported first."""
    feedback = drive.feedback
    slots = feedback.delay + 1
    if row.tick == 0:
        feedback.history[:] = row.seen[axis]
    feedback.history[row.tick % slots] = row.seen[axis]
    row.seen[axis] = feedback.history[(row.tick + 1) % slots]


@jit
def normal(seed, tick):
    """Return a number of the standard normal distribution, by Box and Muller, that depends on seed and tick alone."""
    first = _mixed_bits(seed + np.uint64(2 * tick) * _SEED_STEP)
    second = _mixed_bits(seed + np.uint64(2 * tick + 1) * _SEED_STEP)
    radius = np.sqrt(-2.0 * np.log((np.float64(first >> np.uint64(11)) + 0.5) * _UNIT))
    return radius * np.cos(2.0 * np.pi * np.float64(second >> np.uint64(11)) * _UNIT)


@jit
def _mixed_bits(number):
    """Return 64 bits that look random (the finaliser of SplitMix64, Steele, Lea and Flood 2014)."""
    number = (number ^ (number >> np.uint64(30))) * _FIRST_MULTIPLIER
    number = (number ^ (number >> np.uint64(27))) * _SECOND
    return number ^ (number >> np.uint64(31))


def _is_no_plain_one(servo: Servo, entries: NDArray[np.void]) -> bool:
    return not all(drive.ideal_encoder and drive.feedback == "motor" for drive in servo.drives)


ENCODER = DrivePart(
    "encoder",
    [
        ("load", np.int64),  # of the load's joint in qpos, -1 where the encoder is on the motor
        ("load_zero", np.float64),  # where the load is not displaced [SI]
        ("per_si", np.float64),  # mm per metre or deg per radian
        ("counts", np.int64),  # 1 where the microsteps of a stepper are counted in place of an encoder
        ("noise", np.float64),  # rms [u]
        ("seed", np.uint64),
        ("once", np.float64),  # amplitude of the interpolation error, once per signal period [u]
        ("twice", np.float64),  # and twice
        ("signal", np.float64),  # radians of the signal per u
    ],
    _encoder,
    (("encoder", _report),),
    _is_no_plain_one,
)

FEEDBACK = DrivePart(
    "feedback",
    [
        ("delay", np.int64),  # servo ticks from the encoder to the servo
        ("history", np.float64, (MAX_FEEDBACK_DELAY + 1,)),  # of the encoder [u]
    ],
    lambda driven: {"delay": driven.servo.feedback_delay},
    (("feedback", _delay),),
    lambda servo, entries: servo.feedback_delay > 0,
)
