"""The record of a simulation, from the log of its servo."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gantrysim.arrays import Floats, dot
from gantrysim.controllers.setpoints import Setpoints
from gantrysim.machine.dispenser import Dispenser
from gantrysim.machine.machine import Machine
from gantrysim.native.row import Log
from gantrysim.run import Fault, Run


def record(
    machine: Machine,
    setpoints: Setpoints,
    position: Floats,
    log: Log,
    dispenser: Dispenser,
    fault: Fault | None,
) -> Run:
    """Return the record of a simulation.

    Args:
        machine: the machine of the run.
        setpoints: its setpoints.
        position: the same for all the machine's axes, (setpoints, axes) [mm or deg].
        log: the servo's.
        dispenser: its dispenser.
        fault: why the run ended early, or None.
    """

    def column(name: str) -> Floats:
        """A logged value, (axes, n): contiguous columns are several times as fast to work on as rows."""
        return np.ascontiguousarray(log.axis[name].T)

    encoder, motor, motor_speed, demand, current = map(column, ("encoder", "motor", "motor_speed", "demand", "current"))
    constant = np.array([[axis.motor_constant] for axis in machine.axes])
    resistance = np.array([[axis.resistance] for axis in machine.axes])
    bus = np.array([[axis.bus_voltage] for axis in machine.axes])
    peak = np.array([[axis.peak_torque] for axis in machine.axes])
    torque = machine.drive_gain[:, None] * demand  # about to be delivered
    # the drive's law: terminal voltage for the demanded torque, back-EMF compensated, within the bus
    voltage = np.clip(resistance / constant * torque + constant * motor_speed, -bus, bus)
    current = np.where(np.isnan(current), (voltage - constant * motor_speed) / resistance, current)
    torque = np.clip(np.where(np.isnan(constant), torque, constant * current), -peak, peak)
    return Run(
        **_sent(machine, setpoints, position, log.tick["setpoint"], dispenser),
        encoder=encoder.T,
        encoder_tip=machine.tip(encoder.T),
        motor=motor.T,
        motor_tip=machine.tip(motor.T),
        nozzle=log.tick["nozzle"],
        demand=demand.T,
        torque=torque.T,
        current=current.T,
        voltage=voltage.T,
        fault=fault,
    )


def perfect_record(machine: Machine, setpoints: Setpoints, position: Floats, dispenser: Dispenser) -> Run:
    """Return the record of a machine without tracking error, and without torque; arguments as in `record`."""
    sent = _sent(machine, setpoints, position, np.arange(len(position)), dispenser)
    tip, none = sent["commanded_tip"], np.zeros_like(position)
    return Run(
        **sent,
        encoder=position,
        encoder_tip=tip,
        motor=position,
        motor_tip=tip,
        nozzle=tip,
        demand=none,
        torque=none,
        current=none,
        voltage=none,
    )


def _sent(
    machine: Machine, setpoints: Setpoints, position: Floats, sent: NDArray[np.integer], dispenser: Dispenser
) -> dict[str, Any]:
    """Return the part of a record that follows from the setpoints, given the index of the one at each tick, (n,)."""
    commanded, dispense = position[sent], setpoints.dispense[sent]
    tip, period = machine.tip(commanded), setpoints.period
    steps = np.diff(tip, axis=0, append=tip[-1:])
    speed = np.sqrt(dot(steps, steps)) / period
    return {
        "machine": machine.name,
        "axes": machine.axis_names,
        "units": tuple(axis.unit for axis in machine.axes),
        "requested": setpoints.requested,
        "period": period,
        "time": np.arange(sent.size, dtype=np.float64) * period,
        "commanded": commanded,
        "commanded_tip": tip,
        "flow": dispenser.flows(dispense, speed, period),
        "flow_demand": dispenser.flow_demand(dispense, speed),
        "dispense": dispense,
        "gap": machine.gap,
        **_needle(machine, dispenser),
    }


def _needle(machine: Machine, dispenser: Dispenser) -> dict[str, float]:
    """Return the size of the dispenser's needle, or else of the machine's; empty where neither has one."""
    needle = dispenser.needle
    size = machine.needle if needle is None else (needle.face, needle.length)
    return {} if size is None else {"face": size[0], "needle_length": size[1]}
