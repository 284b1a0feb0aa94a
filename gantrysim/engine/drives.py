"""The drives of a run that are no plain ones, as the servo tick needs them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from gantrysim.controllers.servo import Servo
from gantrysim.errors import InputError
from gantrysim.machine.axis import PER_SI
from gantrysim.machine.machine import Machine
from gantrysim.native.row import DRIVE


def drive_entries(machine: Machine, servo: Servo, step: float) -> NDArray[np.void] | None:
    """Return the drives of a servo at their start, (axes,) of `DRIVE`; None where all are plain ones.

    Args:
        machine: the machine.
        servo: its servo.
        step: physics step [s].

    Raises:
        InputError: feedback from the load of an axis that has none, or a current loop of a motor without inductance.
    """
    if servo.plain:
        return None
    entries, model = np.zeros(servo.axes, DRIVE), machine.physics
    for a, (axis, address) in enumerate(zip(machine.axes, machine.addresses, strict=True)):
        entry = entries[a]
        entry["load"] = -1
        if servo.feedback[a] == "load":
            if address.load < 0:
                raise InputError(
                    f"servo feedback of axis {axis.name} = 'load': machine {machine.name} has no one spring by which "
                    "this axis carries its load; use 'motor'"
                )
            entry["load"] = place = model.jnt_qposadr[address.load]
            entry["load_zero"], entry["per_si"] = model.qpos0[place], PER_SI[axis.unit]
        entry["noise"], entry["delay"] = servo.encoder_noise[a], servo.feedback_delay
        entry["seed"] = np.random.SeedSequence([servo.encoder_seed, a]).generate_state(1, np.uint64)[0]
        entry["once"], entry["twice"] = servo.interpolation_error[a], servo.interpolation_error_twice[a]
        if servo.signal_period[a]:
            entry["signal"] = 2 * math.pi / servo.signal_period[a]
        if bandwidth := servo.current_bandwidth[a]:
            if not axis.lag > 0:
                raise InputError(
                    f"current_bandwidth of axis {axis.name} = {bandwidth:g} Hz: its motor has no inductance, so that "
                    "its torque follows at once; use 0"
                )
            entry["lead"] = math.expm1(-2 * math.pi * bandwidth * step) / math.expm1(-step / axis.lag)
            entry["constant"] = axis.motor_constant
    return entries
