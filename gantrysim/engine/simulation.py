"""One run, checked and ready to be stepped: the servo's row is armed here, and the record taken from its log."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from gantrysim.arrays import Floats
from gantrysim.controllers.servo import Servo
from gantrysim.controllers.setpoints import MAX_TICKS, Setpoints, ticks
from gantrysim.engine.recording import fault_of, record
from gantrysim.errors import GantryError, InputError
from gantrysim.machine.dispenser import Dispenser
from gantrysim.machine.machine import Machine
from gantrysim.machine.timing import delay_steps, substeps_of
from gantrysim.native.row import ADDRESSES, GAINS, OVERSPEED, ROW, ROW_NUMBERS, log_width
from gantrysim.native.tick import magic
from gantrysim.run import Fault, Run

Row = np.ndarray[tuple[int], np.dtype[np.void]]  # one servo's, of userdata


@dataclass(frozen=True, eq=False)
class Simulation:
    """A machine, its servo and its setpoints, with what a run of them needs; whoever steps the physics owns the state.

    Attributes:
        machine: the machine.
        servo: the servo.
        setpoints: the setpoints.
        dispenser: of the glue.
        position: the setpoints for all the machine's axes, (n, axes) [mm or deg].
        substeps: physics steps per servo period.
        model: of the machine, with the physics step; to be left unchanged.
        log: what the servo writes, a row per tick, see `log_width`.
    """

    machine: Machine
    servo: Servo
    setpoints: Setpoints
    dispenser: Dispenser
    position: Floats
    substeps: int
    model: mujoco.MjModel
    log: Floats

    @classmethod
    def of(
        cls,
        machine: Machine,
        servo: Servo,
        setpoints: Setpoints,
        *,
        physics_step: float | None = None,
        dispenser: Dispenser | None = None,
    ) -> Simulation:
        """Return the simulation; arguments and errors as of `gantrysim.simulate`."""
        dispenser = checked_dispenser(dispenser, setpoints)
        position = axis_positions(machine, setpoints)
        if servo.axes != len(machine.axes):
            raise InputError(f"servo has {servo.axes} axes: machine {machine.name} has {len(machine.axes)}")
        if abs(servo.period - setpoints.period) > 1e-12:
            raise InputError(
                f"setpoints' period = {setpoints.period:g} s: must be the servo period, {servo.period:g} s"
            )
        substeps = substeps_of(machine, servo.period, physics_step)
        delay_steps(servo.delay, servo.period, substeps)
        log = np.empty((_most_ticks(setpoints), log_width(servo.axes)))
        model = machine.stepping(servo.period / substeps)
        return cls(machine, servo, setpoints, dispenser, position, substeps, model, log)

    def start(self, qpos: Floats, userdata: Floats) -> Row:
        """Write the start into a fresh state, at rest at the first setpoint, and return the servo's row of it.

        Args:
            qpos: of the state, to be written, (nq,).
            userdata: of the state, to be written, (nuserdata,).
        """
        qpos[:] = self.machine.to_qpos(self.position[0])
        row: Row = userdata[:ROW_NUMBERS].view(ROW)
        self._fill(row)
        self._supervise(row)
        row["magic"] = magic()  # the last, for it arms the servo
        return row

    def done(self, row: Row) -> bool:
        """Return whether the last setpoint is sent, or a fault has ended the run."""
        return bool(row[0]["index"] >= len(self.position) or row[0]["fault"])

    def steps_left(self, row: Row) -> int:
        """Return the number of physics steps to the last tick's first, if the stream waits at no further gate."""
        ticks_left = int(row[0]["tick"] - row[0]["index"]) + len(self.position) - 1
        return ticks_left * self.substeps + 1 - int(row[0]["steps"])

    def fault(self, row: Row) -> Fault | None:
        """Return the fault, if there is one."""
        return fault_of(self.machine, self.servo, row[0], self.setpoints.supervision.settle_timeout)

    def record(self, row: Row, *, partial: bool = False) -> Run:
        """Return the record of what has been run.

        Args:
            row: of the servo, after at least one tick.
            partial: whether a run may be recorded that is not at its end.

        Raises:
            GantryError: a run that is neither at its end nor stopped by a fault.
        """
        fault, kept = self.fault(row), int(row[0]["tick"])
        if not partial and not self.done(row):
            raise GantryError(
                f"the servo of machine {self.machine.name} ran for {kept} of {len(self.position)} ticks: "
                "MuJoCo did not call it"
            )
        if fault is not None and not np.isfinite(self.log[kept - 1, : self.servo.axes + 3]).all():
            kept -= 1  # the tick that saw the divergence has no position to record
        return record(self.machine, self.setpoints, self.position, self.log[:kept], self.dispenser, fault)

    def _fill(self, row: Row) -> None:
        machine, servo = self.machine, self.servo
        row[:] = np.zeros(1, ROW)
        for name, value in ADDRESSES.items():
            row[name] = value
        row["axes"], row["ticks"], row["substeps"] = servo.axes, len(self.position), self.substeps
        row["delay"] = delay_steps(servo.delay, servo.period, self.substeps)
        row["setpoints"], row["log"] = self.position.ctypes.data, self.log.ctypes.data
        row["nozzle"], row["work"], row["period"] = machine.nozzle, machine.work, servo.period
        for name in ("resolution", "following_error_limit", *GAINS):
            row[name][0, : servo.axes] = getattr(servo, name)
        # a demand beyond what the drive can give is clamped by the drive itself
        peak = np.array([axis.peak_torque for axis in machine.axes]) / machine.drive_gain
        row["torque_limit"][0, : servo.axes] = np.minimum(servo.torque_limit, peak)
        row["drive_gain"][0, : servo.axes] = machine.drive_gain
        for a, (axis, address) in enumerate(zip(machine.axes, machine.addresses, strict=True)):
            row["control"][0, a], row["output"][0, a], row["current"][0, a] = (
                address.control,
                address.output,
                address.current,
            )
            row["scale"][0, a], row["speed_limit"][0, a] = axis.scale, axis.speed_limit
            row["low"][0, a], row["high"][0, a] = axis.travel

    def _supervise(self, row: Row) -> None:
        """Write what the controller watches besides its servo."""
        supervision, gates = self.setpoints.supervision, self.setpoints.gates
        row["supervised"] = supervision.position_error < np.inf or gates.size > 0
        row["position_error"] = supervision.position_error
        row["position_error_delay"] = supervision.position_error_delay
        row["gates"], row["gate_count"], row["settle_error"] = gates.ctypes.data, gates.size, supervision.settle_error
        row["settle_ticks"] = ticks(supervision.settle_time, self.setpoints.period)
        row["timeout_ticks"] = ticks(supervision.settle_timeout, self.setpoints.period)
        for a, axis in enumerate(self.machine.axes):
            row["linear"][0, a] = axis.unit == "mm"
            if axis.unit == "mm":
                row["speed_limit"][0, a] = min(axis.speed_limit, supervision.velocity_limit / OVERSPEED)


def checked_dispenser(dispenser: Dispenser | None, setpoints: Setpoints) -> Dispenser:
    """Return the dispenser, or one that lays nothing, after a look at whether its start lead can be met."""
    checked = Dispenser() if dispenser is None else dispenser
    checked.check(setpoints)
    return checked


def axis_positions(machine: Machine, setpoints: Setpoints) -> Floats:
    """Return contiguous positions of all the machine's axes, checked against travel and speed, (n, axes).

    Raises:
        InputError: an unknown axis, a position outside the travel, or a speed above the limit.
    """
    names = machine.axis_names
    for name in setpoints.axes:
        if name not in names:
            raise InputError(f"the program moves axis {name!r}: machine {machine.name} has {', '.join(names)}")
    position = np.zeros((len(setpoints.position), len(names)))
    for column, name in enumerate(setpoints.axes):
        position[:, names.index(name)] = setpoints.position[:, column]
    speed = np.abs(np.diff(position, axis=0)) / setpoints.period
    for a, axis in enumerate(machine.axes):
        low, high = axis.travel
        for k in (int(position[:, a].argmin()), int(position[:, a].argmax())):
            if not low <= position[k, a] <= high:
                raise InputError(
                    f"{axis.name} = {position[k, a]:.4g} {axis.unit} at t = {k * setpoints.period:.4g} s: "
                    f"must lie in the travel {low:g} to {high:g} {axis.unit} of machine {machine.name}"
                )
        k = int(speed[:, a].argmax())
        if speed[k, a] > axis.speed_limit * (1 + 1e-9):
            raise InputError(
                f"speed of {axis.name} = {speed[k, a]:.6g} {axis.unit}/s at t = {k * setpoints.period:.4g} s: "
                f"must be at most {axis.speed_limit:.6g} {axis.unit}/s, the limit of machine {machine.name}"
            )
    return position


def _most_ticks(setpoints: Setpoints) -> int:
    """Return the number of servo ticks if the stream waits at every gate as long as it may."""
    most = len(setpoints.position) + setpoints.gates.size * ticks(
        setpoints.supervision.settle_timeout, setpoints.period
    )
    if most > MAX_TICKS:
        raise InputError(
            f"settle_timeout = {setpoints.supervision.settle_timeout:g} s at each of {setpoints.gates.size} gates: "
            f"makes {most:.3g} ticks, at most {MAX_TICKS:g}"
        )
    return most
