"""The record of a simulation, from the log of its servo."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gantrysim.arrays import Floats, read_only
from gantrysim.controllers.setpoints import Setpoints
from gantrysim.engine.injection import faulted_flow, stretches
from gantrysim.faults import InjectedFault
from gantrysim.jit import jit
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
    faults: tuple[InjectedFault, ...] = (),
) -> Run:
    """Return the record of a simulation.

    Args:
        machine: the machine of the run.
        setpoints: its setpoints.
        position: the same for all the machine's axes, (setpoints, axes) [mm or deg].
        log: the servo's.
        dispenser: its dispenser.
        fault: why the run ended early, or None.
        faults: its faults on purpose.
    """
    drives = np.array(
        [
            (gain, axis.motor_constant, axis.resistance, axis.bus_voltage, axis.peak_torque)
            for gain, axis in zip(machine.drive_gain, machine.axes, strict=True)
        ]
    )
    columns = np.empty((6, len(drives), len(log.axis)))
    for first, after, own in stretches(faults, machine.axis_names, setpoints.period, len(log.axis), drives):
        _fill(columns[:, :, first:after], log.axis[first:after], own)
    encoder, motor, demand, torque, current, voltage = columns
    measured = {
        "encoder": encoder.T,
        "encoder_tip": machine.tip(encoder.T),
        "motor": motor.T,
        "motor_tip": machine.tip(motor.T),
        "nozzle": log.tick["nozzle"].copy(),
        "demand": demand.T,
        "torque": torque.T,
        "current": current.T,
        "voltage": voltage.T,
    }
    sent = _sent(machine, setpoints, position, log.tick["setpoint"], dispenser)
    kept: dict[str, Any] = {name: read_only(array) for name, array in measured.items()}
    if faults:
        valve = dispenser.open_share(sent["dispense"], setpoints.period)
        sent["flow"] = read_only(faulted_flow(faults, sent["flow"], valve, setpoints.period))
    return Run(**sent, **kept, fault=fault, injected=faults)


@jit
def _fill(columns: Floats, log: NDArray[np.void], drives: Floats) -> None:
    """Fill in encoder, motor, demand, torque, current and voltage, (6, axes, n).

    Columns are several times as fast to work on as rows. The voltage is by the drive's law: terminal voltage for the
    demanded torque, back-EMF compensated, within the bus.

    Args:
        columns: to be filled in.
        log: of the axes, (n, axes) of `LOG_AXIS`.
        drives: gain, motor constant, resistance, bus voltage and peak torque of each axis, (axes, 5).
    """
    n, axes = log.shape
    for a in range(axes):
        gain, constant, resistance, bus, peak = drives[a]
        for k in range(n):
            entry = log[k, a]
            wanted = gain * entry.demand  # about to be delivered
            back = constant * entry.motor_speed
            volts = min(max(resistance / constant * wanted + back, -bus), bus)
            amperes = (volts - back) / resistance if np.isnan(entry.current) else entry.current
            delivered = wanted if np.isnan(constant) else constant * amperes
            torque = min(max(delivered, -peak), peak)
            for row, value in enumerate((entry.encoder, entry.motor, entry.demand, torque, amperes, volts)):
                columns[row, a, k] = value


@jit
def _speeds(tip: Floats, period: float) -> Floats:
    """Return the mean speed over the period after each tick, 0 after the last, (n,) [mm/s].

    Args:
        tip: commanded nozzle, (n, 3) [mm].
        period: servo period [s].
    """
    speeds = np.zeros(len(tip))
    for k in range(len(tip) - 1):
        x, y, z = tip[k + 1, 0] - tip[k, 0], tip[k + 1, 1] - tip[k, 1], tip[k + 1, 2] - tip[k, 2]
        speeds[k] = np.sqrt(x * x + y * y + z * z) / period
    return speeds


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
    if sent[-1] == sent.size - 1:  # one at a tick: the run waited nowhere
        commanded, dispense = position[: sent.size], setpoints.dispense[: sent.size]
    else:
        commanded, dispense = position[sent], setpoints.dispense[sent]
    tip, period = machine.tip(commanded), setpoints.period
    speed = _speeds(tip, period)
    columns = {
        "time": np.arange(sent.size, dtype=np.float64) * period,
        "commanded": commanded,
        "commanded_tip": tip,
        "flow": dispenser.flows(dispense, speed, period),
        "flow_demand": dispenser.flow_demand(dispense, speed),
        "dispense": dispense,
    }
    return {
        "machine": machine.name,
        "axes": machine.axis_names,
        "units": tuple(axis.unit for axis in machine.axes),
        "requested": setpoints.requested,
        "period": period,
        **{name: read_only(array) for name, array in columns.items()},
        "gap": machine.gap,
        **_needle(machine, dispenser),
    }


def _needle(machine: Machine, dispenser: Dispenser) -> dict[str, float]:
    """Return the size of the dispenser's needle, or else of the machine's; empty where neither has one."""
    needle = dispenser.needle
    size = machine.needle if needle is None else (needle.face, needle.length)
    return {} if size is None else {"face": size[0], "needle_length": size[1]}
