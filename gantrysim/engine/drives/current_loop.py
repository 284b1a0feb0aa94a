"""Drives that take torques: the current follows its demand as the current loop or the winding lets it."""

# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.errors import InputError
from gantrysim.base.jit import jit
from gantrysim.engine.drives.part import TORQUE, DrivenAxis, DrivePart
from gantrysim.servo.servo import Servo


def _current_loop(driven: DrivenAxis) -> dict[str, Any]:
    """Return the current loop of a drive."""
    axis = driven.axis
    bandwidth = driven.drive.current_bandwidth
    if not bandwidth:
        return {}
    if not axis.lag > 0:
        raise InputError(
            f"current_bandwidth of axis {axis.name} = {bandwidth:g} Hz: its motor has no inductance, so its torque "
            "follows at once; use 0"
        )
    lead = math.expm1(-2 * math.pi * bandwidth * driven.step) / math.expm1(-driven.step / axis.lag)
    return {"lead": lead, "constant": axis.motor_constant}


def _follow_servo(row, tape, axis, drive):
    """Set the control of a drive that takes torques."""
    if drive.mode == TORQUE:
        follow_demand(row, axis, drive.current, row.held[axis])


@jit
def follow_demand(row, axis, current, torque_demand):
    """Set the control of one physics step so that the torque follows a demand: current follows it as a first-order lag.

    A control u that is held for a step takes the torque T of a winding to T + (1 - exp(-h R / L)) (u - T). With
    u = T + lead (T* - T) it comes as much nearer to the demand T* as a lag of the current loop's bandwidth f does,
    1 - exp(-2 pi f h). MuJoCo limits the voltage of u to the bus.
    """
    demand = torque_demand * row.drive_gain[axis]
    if current.lead == 0.0:
        row.control_torque[axis] = demand
    else:
        torque = current.constant * row.winding_current[axis]
        row.control_torque[axis] = torque + current.lead * (demand - torque)


def _is_no_plain_one(servo: Servo, entries: NDArray[np.void]) -> bool:
    return "torque" in servo.modes and (len(set(servo.modes)) > 1 or bool(entries["lead"].any()))


CURRENT = DrivePart(
    "current",
    [
        ("lead", np.float64),  # control beyond the torque, per difference of demand and torque; 0 for no current loop
        ("constant", np.float64),  # of the motor [N·m/A]
    ],
    _current_loop,
    (("drive", _follow_servo),),
    _is_no_plain_one,
)
