"""Laws of the ladder as stages of the servo tick, and torques that are sent with the setpoints."""

# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

import numba
from numba import types

from gantrysim.base.arrays import Floats
from gantrysim.base.jit import jit
from gantrysim.engine.native.parts import part, with_parts
from gantrysim.engine.native.pointers import gains_of, log_of, pointer, row_at
from gantrysim.engine.native.stages import compiled_stage
from gantrysim.machine.row import LAW, Log
from gantrysim.servo import notch
from gantrysim.servo.laws.law import BaseLaw

_LAW = numba.from_dtype(LAW)
_FLOAT = types.float64
_filtered = part(notch.filtered_output)


@jit
def take(row, axis, torque, integral):
    """Take the torque of a base law and its integral after this tick, the torque through the axis' notch."""
    row.torque[axis], row.notch_first[axis], row.notch_second[axis] = _filtered(
        torque, row.notch[axis], row.notch_first[axis], row.notch_second[axis]
    )
    row.next_integral[axis] = integral


@cache
def base_stage(law: BaseLaw) -> int:
    """Return the address of a base law as a stage."""
    return compiled_stage(with_parts(_tick_all_axes, tick=law.tick))


def tick(row, axis, gains):
    """Stand for the function of a base law."""
    raise NotImplementedError


def _tick_all_axes(address, argument):
    row = row_at(address)
    for axis in range(row.axes):
        torque, integral = tick(row, axis, gains_of(row, axis))
        take(row, axis, torque, integral)


@cache
def law_stage(function: Any) -> int:
    """Return the address of a law's function of row and laws as a stage; its argument is the address of the laws."""
    return compiled_stage(with_parts(_act_on_laws, act=function))


def act(row, laws):
    """Stand for the function of a law."""
    raise NotImplementedError


def _act_on_laws(address, argument):
    row = row_at(address)
    act(row, numba.carray(pointer(argument, _LAW), (row.axes,)))


@cache
def feed_stage() -> int:
    """Return the address of the stage that adds torques sent with the setpoints; its argument is their address."""

    def stage(address, argument):
        row = row_at(address)
        torque = numba.carray(pointer(argument, _FLOAT), (row.ticks, row.axes))
        add_fed_torque(row, FedTape(log_of(row), torque))

    return compiled_stage(stage)


class FedTape(NamedTuple):
    """The log, and torques sent with the setpoints, (n, axes) [N·m]."""

    log: Log
    torque: Floats


@jit
def add_fed_torque(row, tape):
    """Add the torques that are sent with the setpoint of this tick."""
    setpoint = tape.log.tick[row.tick - row.first].setpoint
    for axis in range(row.axes):
        row.feedforward[axis] += tape.torque[setpoint, axis]
