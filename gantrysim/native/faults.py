"""Deliberate faults as stages of the servo tick."""

# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators

from __future__ import annotations

from functools import cache
from typing import Any

from gantrysim.native.compiling import part
from gantrysim.native.pointers import fault_at, row_at, vector
from gantrysim.native.stages import compiled_stage

# points whose quantity is MuJoCo's: it is taken into the row for the fault, and put back
CURRENT = "current"
VOLTAGE = "voltage"


@cache
def fault_stage(point: str, function: Any) -> int:
    """Return the address of a fault's function of row and entry as a stage; its argument is the entry's address."""
    act = part(function)

    def stage(data, userdata, argument):
        act(row_at(userdata), fault_at(argument))

    def current_stage(data, userdata, argument):
        row = row_at(userdata)
        fault = fault_at(argument)
        axis = fault.axis
        if row.current[axis] >= 0:
            currents = vector(data, row.act_at)
            row.winding_current[axis] = currents[row.current[axis]]
            act(row, fault)
            currents[row.current[axis]] = row.winding_current[axis]

    def voltage_stage(data, userdata, argument):
        row = row_at(userdata)
        fault = fault_at(argument)
        axis = fault.axis
        ctrl = vector(data, row.ctrl_at)
        row.motor_speed[axis] = vector(data, row.actuator_velocity_at)[row.output[axis]]
        row.control_torque[axis] = ctrl[row.control[axis]]
        act(row, fault)
        ctrl[row.control[axis]] = row.control_torque[axis]

    return compiled_stage({CURRENT: current_stage, VOLTAGE: voltage_stage}.get(point, stage))
