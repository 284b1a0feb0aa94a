"""Supervision by the motion controller besides its servo: position error of the group, settling at gates."""

# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators

from __future__ import annotations

from functools import cache

import numpy as np

from gantrysim.base.jit import jit
from gantrysim.engine.native.pointers import row_at, tape_of
from gantrysim.engine.native.stages import compiled_stage
from gantrysim.machine.row import (
    OSCILLATION,
    OSCILLATION_SWINGS,
    OSCILLATION_TIME,
    POSITION_ERROR,
    POSITION_ERROR_AT_REST,
    SETTLING,
)


@jit
def trip(row, fault, axis, value, limit):
    """Record a fault, unless there is one already."""
    if row.fault == 0:
        row.fault = fault
        row.fault_axis = axis
        row.fault_tick = row.tick
        row.fault_value = value
        row.fault_limit = limit


@jit
def watch_oscillation(row, axis, side):
    """Trip where the demand of an axis, clamped on a side, swings from one limit to the other."""
    since = (row.tick - row.clamp_tick[axis]) * row.period
    if since > OSCILLATION_TIME:
        row.swings[axis] = 0.0
    elif side != row.clamp_side[axis]:
        row.swings[axis] += 1.0
    row.clamp_side[axis] = side
    row.clamp_tick[axis] = row.tick
    if row.swings[axis] >= OSCILLATION_SWINGS:
        trip(row, OSCILLATION, axis, row.swings[axis], OSCILLATION_SWINGS)


@cache
def position_error_stage() -> int:
    """Return the address of the stage that watches the group's position error; it has no argument."""

    def stage(address, argument):
        row = row_at(address)
        watch_position_error(row, tape_of(row))

    return compiled_stage(stage)


@cache
def gate_stage() -> int:
    """Return the address of the stage that holds the stream at gates until the axes have settled; no argument."""

    def stage(address, argument):
        row = row_at(address)
        wait_at_gate(row, tape_of(row))

    return compiled_stage(stage)


@jit
def watch_position_error(row, tape):
    """Trip where the linear axes are too far from the command that was sent `position_error_delay` ticks ago."""
    n = row.axes
    sent = tape.log.tick[max(row.tick - row.position_error_delay, 0) - row.first].setpoint
    moving = False
    worst = 0
    largest = -1.0
    square = 0.0
    for a in range(n):
        moving = moving or row.demand_velocity[a] != 0.0
        error = row.linear[a] * abs(tape.setpoints[sent, a] - row.measured[a])
        square += error * error
        if error > largest:
            worst = a
            largest = error
    distance = np.sqrt(square)
    if distance > row.position_error:
        trip(row, POSITION_ERROR if moving else POSITION_ERROR_AT_REST, worst, distance, row.position_error)


@jit
def wait_at_gate(row, tape):
    """Have the stream wait at the setpoint of this tick where it is a gate, for the axes to settle."""
    if _waits(row, tape):
        row.waits = 1


@jit
def _waits(row, tape):
    """Return whether the stream waits at the setpoint of this tick for the axes to settle."""
    if row.gate >= row.gate_count or tape.gates[row.gate] != row.index:
        return False
    worst = 0
    within = True
    for a in range(row.axes):
        within = within and abs(row.error[a]) <= row.settle_error
        if abs(row.error[a]) > abs(row.error[worst]):
            worst = a
    row.within = row.within + 1 if within else 0
    if row.within > row.settle_ticks:
        row.gate += 1
        row.within = 0
        row.waited = 0
        return False
    if row.waited >= row.timeout_ticks:
        trip(row, SETTLING, worst, row.error[worst], row.settle_error)
    row.waited += 1
    return True
