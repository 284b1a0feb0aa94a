"""The drives of a run that are no plain ones, as the servo tick needs them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.errors import InputError
from gantrysim.machine.axis import PER_SI, Axis
from gantrysim.machine.machine import Machine
from gantrysim.native.row import DRIVE, POSITION, STEPPER, VELOCITY
from gantrysim.servo.servo import Servo

_PRESLIDING = 5e-6  # of a transmission's friction at a slide [m]
_PRESLIDING_TURN = 3e-3  # of a rotary axis, at the motor [rad]
# longest step of a stepper's circuit [s]: a bridge needs about 10 us from one microstep's current to the next, and of a
# step four times as long the mean torque was 8 % too high
_CIRCUIT = 4e-6


def drive_entries(machine: Machine, servo: Servo, step: float) -> NDArray[np.void] | None:
    """Return the drives of a servo at their start, (axes,) of `DRIVE`; None where all are plain ones.

    Args:
        machine: the machine.
        servo: its servo.
        step: physics step [s].

    Raises:
        InputError: feedback from the load of an axis that has none, a current loop of a motor without inductance, or
            mode "stepper" of a motor that is none.
    """
    if servo.plain and all(axis.efficiency == 1 for axis in machine.plain_axes):
        return None
    entries = np.zeros(servo.axes, DRIVE)
    model = machine.physics
    for a, (axis, address) in enumerate(zip(machine.plain_axes, machine.addresses, strict=True)):
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
        if axis.efficiency < 1:
            dof = int(model.jnt_dofadr[model.actuator_trnid[a, 0]])
            entry["loss"], entry["dof"], entry["damping"] = 1 / axis.efficiency - 1, dof, model.dof_damping[dof]
            entry["spring"] = model.jnt_dofadr[address.load] if address.load >= 0 else -1
            entry["presliding"] = (
                _PRESLIDING if axis.unit == "mm" else _PRESLIDING_TURN / float(model.actuator_gear[a, 0])
            )
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
        if servo.mode[a] == "stepper":
            _step(entry, axis, servo, a, float(machine.drive_gain[a]), step)
        elif servo.mode[a] != "torque":
            _close(entry, axis, servo, a, float(machine.drive_gain[a]), step)
    return entries


def _close(entry: np.void, axis: Axis, servo: Servo, a: int, gain: float, step: float) -> None:
    """Fill in the entry of a drive that closes a loop itself."""
    entry["mode"] = VELOCITY if servo.mode[a] == "velocity" else POSITION
    entry["every"], entry["period"] = round(servo.drive_period / step), servo.drive_period
    entry["limit"] = min(servo.torque_limit[a], axis.peak_torque / gain)
    entry["gain"] = servo.velocity_gain[a]
    entry["rate"] = 1 / servo.velocity_time[a] if servo.velocity_time[a] else 0.0
    if axis.phases is not None and axis.lag > 0:
        entry["reactance"] = axis.phases.pole_pairs * axis.phases.inductance
        entry["constant"], entry["resistance"] = axis.motor_constant, axis.resistance
        entry["bus"] = axis.bus_voltage


def _step(entry: np.void, axis: Axis, servo: Servo, a: int, gain: float, step: float) -> None:
    """Fill in the entry of a stepper in open loop, whose motor constant is the nominal one times the gain."""
    motor = axis.phases
    if motor is None or not motor.microsteps:
        raise InputError(
            f"servo mode of axis {axis.name} = 'stepper': its motor is no stepper with microsteps; use 'torque', or a "
            "table of the machine with a motor of kind 'stepper'"
        )
    steps = 2 * math.ceil(0.5 * step / _CIRCUIT)  # even, as the record has the currents at the middle
    inductance = motor.inductance if axis.lag > 0 else 0.0
    entry["mode"], entry["counts"], entry["circuit"] = STEPPER, servo.feedback[a] == "none", steps
    entry["poles"] = motor.pole_pairs / axis.scale
    entry["microstep"] = axis.electrical_period / (4 * motor.microsteps)
    entry["amplitude"] = min(servo.torque_limit[a], axis.peak_torque) / axis.motor_constant
    entry["constant"], entry["resistance"], entry["bus"] = gain * axis.motor_constant, axis.resistance, axis.bus_voltage
    entry["left"] = math.exp(-axis.resistance * step / steps / inductance) if inductance else 0.0
