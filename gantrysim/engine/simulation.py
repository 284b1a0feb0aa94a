"""A run before and while it is stepped: checks of the input, the servo's row of userdata, the record."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from gantrysim.arrays import Floats
from gantrysim.controllers.law import GAIN_NAMES
from gantrysim.controllers.servo import Servo
from gantrysim.controllers.setpoints import MAX_TICKS, Setpoints, Supervision, ticks
from gantrysim.engine.recording import record
from gantrysim.errors import GantryError, InputError
from gantrysim.machine.dispenser import Dispenser
from gantrysim.machine.kinematics import UnreachableError
from gantrysim.machine.machine import Machine
from gantrysim.machine.timing import delay_steps, substeps_of
from gantrysim.native.row import (
    FAULTS,
    OFFSETS,
    OVERSPEED,
    POSITION_ERROR,
    POSITION_ERROR_AT_REST,
    ROW,
    ROW_NUMBERS,
    SETTLING,
    Log,
)
from gantrysim.native.tick import magic
from gantrysim.run import Fault, Run


_ROUNDING, _NEAR = 1e-9, 1e-3  # of positions [mm]


@dataclass(frozen=True, eq=False)
class Simulation:
    """The checked input of a run, and the log that it fills; whoever steps the physics owns the state.

    Attributes:
        machine: the machine.
        servo: the servo.
        setpoints: the setpoints.
        dispenser: of the glue.
        position: the setpoints for all the machine's axes, (n, axes) [mm or deg].
        substeps: physics steps per servo period.
        model: the machine's, with the physics step; not to be changed.
        log: entries written by the servo.
    """

    machine: Machine
    servo: Servo
    setpoints: Setpoints
    dispenser: Dispenser
    position: Floats
    substeps: int
    model: mujoco.MjModel
    log: Log

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
        if machine.kinematics.followers:
            _check_supervision(machine, setpoints.supervision)
        if servo.axes != len(machine.axes):
            raise InputError(f"servo has {servo.axes} axes: machine {machine.name} has {len(machine.axes)}")
        if abs(servo.period - setpoints.period) > 1e-12:
            raise InputError(
                f"setpoints' period = {setpoints.period:g} s: must be the servo period, {servo.period:g} s"
            )
        substeps = substeps_of(machine, servo.period, physics_step)
        delay_steps(servo.delay, servo.period, substeps)
        log = Log.of(_most_ticks(setpoints), servo.axes)
        model = machine.stepping(servo.period / substeps)
        return cls(machine, servo, setpoints, dispenser, position, substeps, model, log)

    def start(self, qpos: Floats, userdata: Floats) -> Started:
        """Write the start, at rest at the first setpoint, into a fresh state's qpos and userdata; arm the servo."""
        qpos[:] = self.machine.to_qpos(self.position[0])
        userdata[:ROW_NUMBERS] = 0.0
        row = userdata[:ROW_NUMBERS].view(ROW)[0]
        self._fill(row)
        self._supervise(row)
        row["magic"] = magic()  # the last, for it arms the servo
        return Started(self, row)

    def _fill(self, row: np.void) -> None:
        machine, servo = self.machine, self.servo
        for name, value in OFFSETS.items():
            row[name] = value
        row["axes"], row["ticks"], row["substeps"] = servo.axes, len(self.position), self.substeps
        row["delay"] = delay_steps(servo.delay, servo.period, self.substeps)
        row["setpoints"] = self.position.ctypes.data
        row["log"], row["axis_log"] = self.log.tick.ctypes.data, self.log.axis.ctypes.data
        row["nozzle"], row["work"], row["period"] = machine.nozzle, machine.work, servo.period
        row["resolution"][: servo.axes] = servo.resolution
        row["following_error_limit"][: servo.axes] = servo.following_error_limit
        for k, name in enumerate(GAIN_NAMES):
            row["gains"][: servo.axes, k] = getattr(servo, name)
        row["notch"][: servo.axes] = servo.filters
        # a demand beyond what the drive can give is clamped by the drive itself
        peak = np.array([axis.peak_torque for axis in machine.axes]) / machine.drive_gain
        row["torque_limit"][: servo.axes] = np.minimum(servo.torque_limit, peak)
        row["drive_gain"][: servo.axes] = machine.drive_gain
        for a, (axis, address) in enumerate(zip(machine.axes, machine.addresses, strict=True)):
            for name in ("control", "output", "current"):
                row[name][a] = getattr(address, name)
            row["scale"][a], row["speed_limit"][a] = axis.scale, axis.speed_limit
            row["low"][a], row["high"][a] = axis.travel

    def _supervise(self, row: np.void) -> None:
        """Write the limits of the supervision."""
        supervision, gates = self.setpoints.supervision, self.setpoints.gates
        row["position_error"] = supervision.position_error
        row["position_error_delay"] = supervision.position_error_delay
        row["gates"], row["gate_count"], row["settle_error"] = gates.ctypes.data, gates.size, supervision.settle_error
        row["settle_ticks"] = ticks(supervision.settle_time, self.setpoints.period)
        row["timeout_ticks"] = ticks(supervision.settle_timeout, self.setpoints.period)
        for a, axis in enumerate(self.machine.axes):
            row["linear"][a] = axis.unit == "mm"
            if axis.unit == "mm":
                row["speed_limit"][a] = min(axis.speed_limit, supervision.velocity_limit / OVERSPEED)


@dataclass(frozen=True, eq=False)
class Started:
    """A simulation in a state of MuJoCo's.

    Attributes:
        simulation: the simulation, kept alive as the row holds addresses of its arrays.
        row: the servo's row of the state's userdata, a live view, see `gantrysim.native.row`.
    """

    simulation: Simulation
    row: np.void

    @property
    def steps(self) -> int:
        """Number of physics steps begun."""
        return int(self.row["steps"])

    @property
    def ticks(self) -> int:
        """Number of servo ticks begun."""
        return int(self.row["tick"])

    @property
    def sent(self) -> int:
        """Number of setpoints sent."""
        return int(self.row["index"])

    @property
    def done(self) -> bool:
        """Whether the last setpoint is sent, or a fault has ended the run."""
        return self.sent >= len(self.simulation.position) or bool(self.row["fault"])

    @property
    def steps_left(self) -> int:
        """Number of physics steps to the first one of the last tick, if the stream waits at no further gate."""
        last = self.ticks - self.sent + len(self.simulation.position) - 1
        return last * self.simulation.substeps + 1 - self.steps

    @property
    def fault(self) -> Fault | None:
        """The fault, if there is one."""
        row, simulation = self.row, self.simulation
        code = int(row["fault"])
        if not code:
            return None
        kind, axis = FAULTS[code], simulation.machine.axes[row["fault_axis"]]
        value, limit = float(row["fault_value"]), float(row["fault_limit"])
        unit = {"overspeed": f"{axis.unit}/s", "oscillation": "swings"}.get(kind, axis.unit)
        if kind == "diverged" and np.isfinite(limit):
            unit = "N·m"  # of the demand; else it is the following error, which has no limit
        reaction = {
            POSITION_ERROR: "the motion stops",
            POSITION_ERROR_AT_REST: "the drives are disabled",
            SETTLING: f"not settled after {simulation.setpoints.supervision.settle_timeout:g} s",
        }.get(code, "")
        time = float(row["fault_tick"] * simulation.servo.period)
        return Fault(kind, axis.name, time, value, limit, unit, reaction)

    def record(self, *, partial: bool = False) -> Run:
        """Return the record so far, of at least one tick.

        Args:
            partial: whether the run may be unfinished.

        Raises:
            GantryError: a run that is neither at its end nor stopped by a fault.
        """
        simulation, fault, kept = self.simulation, self.fault, self.ticks
        if not partial and not self.done:
            raise GantryError(
                f"the servo of machine {simulation.machine.name} ran for {kept} of {len(simulation.position)} ticks: "
                "MuJoCo did not call it"
            )
        if fault is not None:
            nozzle, encoder = simulation.log.tick["nozzle"][kept - 1], simulation.log.axis["encoder"][kept - 1]
            if not (np.isfinite(nozzle).all() and np.isfinite(encoder).all()):
                kept -= 1  # the tick at which it diverged has no position to record
        log, position = simulation.log.until(kept), simulation.position
        return record(simulation.machine, simulation.setpoints, position, log, simulation.dispenser, fault)


def checked_dispenser(dispenser: Dispenser | None, setpoints: Setpoints) -> Dispenser:
    """Return the dispenser, or one that lays nothing, checked against the setpoints."""
    checked = Dispenser() if dispenser is None else dispenser
    checked.check(setpoints)
    return checked


def _check_supervision(machine: Machine, supervision: Supervision) -> None:
    """Raise InputError for a limit on the linear axes of a machine whose axes are no coordinates of the nozzle."""
    for name, unit in (("position_error", "mm"), ("velocity_limit", "mm/s")):
        value = getattr(supervision, name)
        if value < np.inf:
            axes = ", ".join(f"{axis.name} [{axis.unit}]" for axis in machine.axes)
            raise InputError(
                f"{name} = {value:g} {unit}: must be inf on machine {machine.name}, whose axes {axes} are not those "
                "of its nozzle; limit the servo's following error instead"
            )


def program_positions(machine: Machine, setpoints: Setpoints) -> Floats:
    """Return the setpoints in all coordinates of the machine's kinematics, (n, coordinates) [mm or deg].

    A coordinate that the program does not move is where it is with all axes at zero.

    Raises:
        InputError: an unknown coordinate, or one that the program does not move but that its path has elsewhere.
    """
    names = machine.kinematics.names
    for name in setpoints.axes:
        if name not in names:
            raise InputError(f"the program moves axis {name!r}: machine {machine.name} has {', '.join(names)}")
    begin = dict(zip("xyz", setpoints.requested.position(0.0)[0].tolist(), strict=True))
    for name, home in zip(names, machine.home.tolist(), strict=True):
        still = name in begin and name not in setpoints.axes and abs(home) > _ROUNDING
        if still and abs(begin[name] - home) > _NEAR:
            raise InputError(
                f"the program does not move {name} and its path begins at {name} = {begin[name]:g} mm: on machine "
                f"{machine.name} it must move {name}, which is {home:g} mm with all axes at zero"
            )
    position = np.tile(machine.home, (len(setpoints.position), 1))
    position[:, [names.index(name) for name in setpoints.axes]] = setpoints.position
    return position


def axis_positions(machine: Machine, setpoints: Setpoints) -> Floats:
    """Return contiguous positions of all the machine's axes, checked against travel and speed, (n, axes).

    Setpoints that name axes which are no coordinates give the positions of the axes themselves.

    Raises:
        InputError: an unknown axis, a position out of travel or reach, or a speed above the limit.
    """
    kinematics = machine.kinematics
    if set(setpoints.axes) <= set(machine.axis_names) and not set(setpoints.axes) <= set(kinematics.names):
        position = np.zeros((len(setpoints.position), len(machine.axes)))
        position[:, [machine.axis_names.index(name) for name in setpoints.axes]] = setpoints.position
    else:
        program = program_positions(machine, setpoints)
        try:
            position = np.ascontiguousarray(kinematics.inverse(program))
        except UnreachableError as error:
            raise InputError(
                f"{error}, at t = {error.row * setpoints.period:.4g} s, on machine {machine.name}"
            ) from None
    speed = np.abs(np.diff(position, axis=0)) / setpoints.period

    def where(k: int) -> str:
        place = f" ({kinematics.described(kinematics.forward(position[k : k + 1])[0])})" if kinematics.followers else ""
        return f"at t = {k * setpoints.period:.4g} s{place}"

    for a, axis in enumerate(machine.axes):
        low, high = axis.travel
        for k in (int(position[:, a].argmin()), int(position[:, a].argmax())):
            if not low <= position[k, a] <= high:
                raise InputError(
                    f"{axis.name} = {position[k, a]:.4g} {axis.unit} {where(k)}: "
                    f"must lie in the travel {low:g} to {high:g} {axis.unit} of machine {machine.name}"
                )
        k = int(speed[:, a].argmax())
        if speed[k, a] > axis.speed_limit * (1 + 1e-9):
            raise InputError(
                f"speed of {axis.name} = {speed[k, a]:.6g} {axis.unit}/s {where(k)}: "
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
