"""Deliberate faults as stages of the servo tick."""

# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators

from __future__ import annotations

from functools import cache
from typing import Any

from gantrysim.engine.native.parts import with_parts
from gantrysim.engine.native.pointers import fault_at, row_at, vector
from gantrysim.engine.native.stages import compiled_stage

# points whose quantity is MuJoCo's: it is taken into the row for the fault, and put back
CURRENT = "current"
VOLTAGE = "voltage"


@cache
def fault_stage(point: str, function: Any) -> int:
    """Return the address of a fault's function of row and entry as a stage; its argument is the entry's address."""
    stage = {CURRENT: _act_on_current, VOLTAGE: _act_on_voltage}.get(point, _act)
    return compiled_stage(with_parts(stage, act=function))


def act(row, fault):
    """Stand for the function of a fault."""
    raise NotImplementedError


def _act(data, userdata, argument):
    act(row_at(userdata), fault_at(argument))


def _act_on_current(data, userdata, argument):
    row = row_at(userdata)
    fault = fault_at(argument)
    axis = fault.axis
    if row.current[axis] >= 0:
        currents = vector(data, row.act_at)
        row.winding_current[axis] = currents[row.current[axis]]
        act(row, fault)
        currents[row.current[axis]] = row.winding_current[axis]


def _act_on_voltage(data, userdata, argument):
    row = row_at(userdata)
    fault = fault_at(argument)
    axis = fault.axis
    ctrl = vector(data, row.ctrl_at)
    row.motor_speed[axis] = vector(data, row.actuator_velocity_at)[row.output[axis]]
    row.control_torque[axis] = ctrl[row.control[axis]]
    act(row, fault)
    ctrl[row.control[axis]] = row.control_torque[axis]
