"""The start of a run: the machine's position, and the servo's row with its parameters, before it is armed."""

from __future__ import annotations

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.machine.layout import offsets
from gantrysim.machine.machine import Machine
from gantrysim.machine.row import OFFSETS, OVERSPEED, ROW, ROW_NUMBERS
from gantrysim.machine.stops import stops_of
from gantrysim.machine.timing import delay_steps
from gantrysim.record.setpoints import Setpoints, periods
from gantrysim.servo.servo import Servo


def start_of(
    machine: Machine, servo: Servo, setpoints: Setpoints, position: Floats, substeps: int
) -> tuple[Floats, Floats]:
    """Return qpos at rest at the first setpoint, (nq,), and the servo's row as numbers, (ROW_NUMBERS,).

    Args:
        machine: the machine.
        servo: the servo.
        setpoints: the setpoints.
        position: the same for all the machine's axes, kept alive by the caller, (n, axes) [mm or deg].
        substeps: physics steps per servo period.
    """
    numbers = np.zeros(ROW_NUMBERS)
    row = numbers.view(ROW)[0]
    row["ticks"] = len(position)
    row["setpoints"] = position.ctypes.data
    row["substeps"] = substeps
    row["delay"] = delay_steps(servo.delay, servo.period, substeps)
    _fill(machine, servo, row)
    _supervise(machine, setpoints, row)
    return machine.to_qpos(position[0]), numbers


def _fill(machine: Machine, servo: Servo, row: np.void) -> None:
    """Write the servo, its axes and where MuJoCo has them."""
    for name, field in OFFSETS.items():
        row[name] = offsets()[field]
    row["axes"] = servo.axes
    row["nozzle"] = machine.nozzle
    row["work"] = machine.work
    row["period"] = servo.period
    row["resolution"][: servo.axes] = [drive.resolution for drive in servo.drives]
    row["following_error_limit"][: servo.axes] = servo.following_error_limit
    row["gains"][: servo.axes] = servo.gains
    row["notch"][: servo.axes] = servo.filters
    # a demand beyond what the drive can give is clamped by the drive itself
    peak = np.array([axis.peak_torque for axis in machine.plain_axes]) / machine.drive_gain
    row["torque_limit"][: servo.axes] = np.minimum([drive.torque_limit for drive in servo.drives], peak)
    for a, (axis, mode) in enumerate(zip(machine.plain_axes, servo.modes, strict=True)):
        if mode != "torque":  # the drives limit torques themselves
            row["torque_limit"][a] = axis.speed_limit if mode == "velocity" else np.inf
    row["drive_gain"][: servo.axes] = machine.drive_gain
    for name, values in zip(("joint", "stop_low", "stop_high"), stops_of(machine.layout), strict=True):
        row[name][: servo.axes] = values
    for a, (axis, address) in enumerate(zip(machine.plain_axes, machine.addresses, strict=True)):
        for name in ("control", "output", "current"):
            row[name][a] = getattr(address, name)
        row["scale"][a] = axis.scale
        row["speed_limit"][a] = axis.speed_limit
        row["low"][a], row["high"][a] = axis.travel


def _supervise(machine: Machine, setpoints: Setpoints, row: np.void) -> None:
    """Write the limits of the supervision."""
    supervision = setpoints.supervision
    gates = setpoints.gates
    row["position_error"] = supervision.position_error
    row["position_error_delay"] = supervision.position_error_delay
    row["gates"] = gates.ctypes.data
    row["gate_count"] = gates.size
    row["settle_error"] = supervision.settle_error
    row["settle_ticks"] = periods(supervision.settle_time, setpoints.period)
    row["timeout_ticks"] = periods(supervision.settle_timeout, setpoints.period)
    for a, axis in enumerate(machine.plain_axes):
        row["linear"][a] = axis.unit == "mm"
        if axis.unit == "mm":
            row["speed_limit"][a] = min(axis.speed_limit, supervision.velocity_limit / OVERSPEED)
