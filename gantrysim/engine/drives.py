"""The drives of a run that are no plain ones, as the servo tick needs them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.errors import InputError
from gantrysim.engine.native.drive_loops import loop_stage
from gantrysim.engine.native.drives import torque_stage, transmission_stage
from gantrysim.engine.native.encoders import delay_stage, encoder_stage
from gantrysim.engine.native.stages import Stage
from gantrysim.engine.native.stepper import stepper_stage
from gantrysim.machine.axis import PER_SI, Axis
from gantrysim.machine.machine import Machine
from gantrysim.machine.row import DRIVE, POSITION, STEPPER, VELOCITY
from gantrysim.servo.drive_settings import LOOPS, DriveSettings
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
    for a, axis in enumerate(machine.plain_axes):
        entry = entries[a]
        drive = servo.drives[a]
        _fill_encoder(entry, machine, servo, a)
        if axis.efficiency < 1:
            _fill_transmission(entry, machine, a)
        if drive.current_bandwidth:
            if not axis.lag > 0:
                raise InputError(
                    f"current_bandwidth of axis {axis.name} = {drive.current_bandwidth:g} Hz: its motor has no "
                    "inductance, so its torque follows at once; use 0"
                )
            entry["lead"] = math.expm1(-2 * math.pi * drive.current_bandwidth * step) / math.expm1(-step / axis.lag)
            entry["constant"] = axis.motor_constant
        gain = float(machine.drive_gain[a])
        if drive.mode == "stepper":
            _fill_stepper(entry, axis, drive, gain, step)
        elif drive.mode != "torque":
            _fill_loop(entry, axis, drive, gain)
            entry["every"] = round(servo.drive_period / step)
            entry["period"] = servo.drive_period
    return entries


def drive_stages(servo: Servo, entries: NDArray[np.void] | None) -> list[Stage]:
    """Return the stages of drives that are no plain ones; they hold the address of the entries."""
    if entries is None:
        return []
    address = entries.ctypes.data
    modes = set(servo.modes)
    stages = []
    if not all(drive.ideal_encoder and drive.feedback == "motor" for drive in servo.drives):
        stages.append(Stage("encoder", encoder_stage(), address))
    if servo.feedback_delay:
        stages.append(Stage("feedback", delay_stage(), address))
    if entries["loss"].any():
        stages.append(Stage("drive", transmission_stage(), address))
    if modes & LOOPS:
        stages.append(Stage("drive", loop_stage(), address))
    if "stepper" in modes:
        stages.append(Stage("drive", stepper_stage(), address))
    if "torque" in modes and (len(modes) > 1 or entries["lead"].any()):
        stages.append(Stage("drive", torque_stage(), address))
    return stages


def _fill_encoder(entry: np.void, machine: Machine, servo: Servo, a: int) -> None:
    """Fill in the encoder of an axis: its place, its errors and the delay of its feedback."""
    axis = machine.plain_axes[a]
    drive = servo.drives[a]
    load = machine.addresses[a].load
    entry["load"] = -1
    if drive.feedback == "load":
        if load < 0:
            raise InputError(
                f"servo feedback of axis {axis.name} = 'load': machine {machine.name} has no single spring between "
                "this axis and its load; use 'motor'"
            )
        place = machine.physics.jnt_qposadr[load]
        entry["load"] = place
        entry["load_zero"] = machine.physics.qpos0[place]
        entry["per_si"] = PER_SI[axis.unit]
    entry["noise"] = drive.encoder_noise
    entry["seed"] = np.random.SeedSequence([servo.encoder_seed, a]).generate_state(1, np.uint64)[0]
    entry["once"] = drive.interpolation_error
    entry["twice"] = drive.interpolation_error_twice
    if drive.signal_period:
        entry["signal"] = 2 * math.pi / drive.signal_period
    entry["delay"] = servo.feedback_delay


def _fill_transmission(entry: np.void, machine: Machine, a: int) -> None:
    """Fill in a transmission with losses."""
    axis = machine.plain_axes[a]
    model = machine.physics
    load = machine.addresses[a].load
    dof = int(model.jnt_dofadr[model.actuator_trnid[a, 0]])
    entry["loss"] = 1 / axis.efficiency - 1
    entry["dof"] = dof
    entry["damping"] = model.dof_damping[dof]
    entry["spring"] = model.jnt_dofadr[load] if load >= 0 else -1
    turn = _PRESLIDING_TURN / float(model.actuator_gear[a, 0])
    entry["presliding"] = _PRESLIDING if axis.unit == "mm" else turn


def _fill_loop(entry: np.void, axis: Axis, drive: DriveSettings, gain: float) -> None:
    """Fill in a drive that closes a loop itself; its motor has the torque of one with the gain."""
    entry["mode"] = VELOCITY if drive.mode == "velocity" else POSITION
    entry["limit"] = min(drive.torque_limit, axis.peak_torque / gain)
    entry["gain"] = drive.velocity_gain
    entry["rate"] = 1 / drive.velocity_time if drive.velocity_time else 0.0
    if axis.phases is not None and axis.lag > 0:
        entry["reactance"] = axis.phases.pole_pairs * axis.phases.inductance
        entry["constant"] = axis.motor_constant
        entry["resistance"] = axis.resistance
        entry["bus"] = axis.bus_voltage


def _fill_stepper(entry: np.void, axis: Axis, drive: DriveSettings, gain: float, step: float) -> None:
    """Fill in the drive of a stepper in open loop, whose motor constant is the nominal one times the gain."""
    motor = axis.phases
    if motor is None or not motor.microsteps:
        raise InputError(
            f"servo mode of axis {axis.name} = 'stepper': its motor is not a stepper with microsteps; use 'torque', or "
            "a table of the machine with a motor of kind 'stepper'"
        )
    steps = 2 * math.ceil(0.5 * step / _CIRCUIT)  # even, as the record has the currents at the middle
    inductance = motor.inductance if axis.lag > 0 else 0.0
    entry["mode"] = STEPPER
    entry["counts"] = drive.feedback == "none"
    entry["circuit"] = steps
    entry["poles"] = motor.pole_pairs / axis.scale
    entry["microstep"] = axis.electrical_period / (4 * motor.microsteps)
    entry["amplitude"] = min(drive.torque_limit, axis.peak_torque) / axis.motor_constant
    entry["constant"] = gain * axis.motor_constant
    entry["resistance"] = axis.resistance
    entry["bus"] = axis.bus_voltage
    entry["left"] = math.exp(-axis.resistance * step / steps / inductance) if inductance else 0.0
