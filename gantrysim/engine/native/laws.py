"""Laws of the ladder as stages of the servo tick, and torques that are sent with the setpoints."""

# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators

from __future__ import annotations

from functools import cache
from typing import Any

import numba

from gantrysim.base.jit import jit
from gantrysim.engine.native.parts import part, with_parts
from gantrysim.engine.native.pointers import floats_at, gains_of, leading, log_of, pointer, row_at
from gantrysim.engine.native.stages import compiled_stage
from gantrysim.machine.row import LAW
from gantrysim.servo import notch
from gantrysim.servo.laws.law import BaseLaw

_LAW = numba.from_dtype(LAW)
_filtered = part(notch.filtered_output)
_COEFFICIENTS = len(notch.Coefficients._fields)


@jit
def take(row, axis, torque, integral):
    """Take the torque of a base law and its integral after this tick, the torque through the axis' notch."""
    row.torque[axis], row.notch_first[axis], row.notch_second[axis] = _filtered(
        torque, leading(row.notch[axis], _COEFFICIENTS), row.notch_first[axis], row.notch_second[axis]
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
        torque = floats_at(argument)
        first = row.axes * log_of(row).tick[row.tick].setpoint
        for axis in range(row.axes):
            row.feedforward[axis] += torque[first + axis]

    return compiled_stage(stage)
