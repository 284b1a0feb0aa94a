"""A run before it is stepped: its checked input, and the log that it fills."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import mujoco
import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError
from gantrysim.base.memory import check_ticks
from gantrysim.controllers.controller import Controller
from gantrysim.engine.arguments import check_argument, sent_setpoints
from gantrysim.engine.drives import drive_entries
from gantrysim.engine.injection import NONE, Change, Injection, faulted_models, injection
from gantrysim.engine.laws import law_entries
from gantrysim.engine.linear import Linear
from gantrysim.engine.perturbed_linear import linear_of
from gantrysim.engine.positions import axis_positions, axis_torques, check_supervision
from gantrysim.engine.recording import LogBook
from gantrysim.faults import InjectedFault, check_faults
from gantrysim.glue.dispenser.dispenser import Dispenser
from gantrysim.machine.machine import Machine
from gantrysim.machine.motors import BRISTLE_STIFFNESS, MOTOR_CONSTANT, STRIBECK, activation_slots, driven_joints
from gantrysim.machine.row import OVERSPEED, ROW, ROW_NUMBERS, Log
from gantrysim.machine.timing import delay_steps, substeps_of
from gantrysim.machine.travel import has_no_constraints_but_stops, stops_of
from gantrysim.record.setpoints import Setpoints, periods
from gantrysim.servo.inverse import Inverse
from gantrysim.servo.servo import Servo

# The start of a run: the machine's position, and the servo's row with its parameters, before it is armed.


_VELOCITY_TIME = 1e-3  # time over which a velocity is a difference of positions [s]


@dataclass(frozen=True, eq=False)
class Start:
    """State of the axes at the first setpoint of a run that does not begin at rest there.

    Attributes:
        position: of the motors, (axes,) [mm or deg].
        velocity: of the motors, (axes,) [mm/s or deg/s].
        commanded_velocity: of the setpoints, (axes,) [mm/s or deg/s].
        torque: of the motors, (axes,) [N·m].
    """

    position: Floats
    velocity: Floats
    commanded_velocity: Floats
    torque: Floats

    def write(self, machine: Machine, data: mujoco.MjData) -> None:
        """Write velocities, and the activations of the motors, into a state at the first setpoint.

        Bristles are bent as in steady motion; those of an axis at rest are not, as what bent them is not known.
        """
        data.qvel[:] = self._qvel(machine)
        model = machine.physics
        for a, axis in enumerate(machine.plain_axes):
            bristle, current = activation_slots(model, a)
            speed = self.velocity[a] / axis.scale
            if bristle >= 0:
                _, _, _, coulomb, static, stribeck = model.actuator_biasprm[a, : STRIBECK + 1]
                friction = coulomb + (static - coulomb) * np.exp(-((speed / stribeck) ** 2))
                data.act[bristle] = np.sign(speed) * friction / model.actuator_dynprm[a, BRISTLE_STIFFNESS]
            if current >= 0:
                data.act[current] = self.torque[a] / model.actuator_gainprm[a, MOTOR_CONSTANT]

    def _qvel(self, machine: Machine) -> Floats:
        """Return MuJoCo's qvel for the velocities, (nv,)."""
        ahead, behind = (
            machine.to_qpos(self.position + time * self.velocity) for time in (_VELOCITY_TIME, -_VELOCITY_TIME)
        )
        return (ahead - behind) / (2 * _VELOCITY_TIME)


def start_of(simulation: Simulation) -> tuple[Floats, Floats]:
    """Return qpos at the first setpoint, (nq,), and the servo's row as numbers, (ROW_NUMBERS,)."""
    machine = simulation.machine
    servo = simulation.servo
    position = simulation.position
    if simulation.prepared is None:
        numbers = np.zeros(ROW_NUMBERS)
        row = numbers.view(ROW)[0]
        row["substeps"] = simulation.substeps
        row["delay"] = delay_steps(servo.delay, servo.period, simulation.substeps)
        _fill(machine, servo, row)
    else:
        numbers = simulation.prepared.copy()
        row = numbers.view(ROW)[0]
    row["ticks"] = len(position)
    row["setpoints"] = position.ctypes.data
    _limit(machine, servo, row)
    _supervise(machine, simulation.setpoints, row)
    begin = simulation.begin
    if begin is None:
        return machine.to_qpos(position[0]), numbers
    row["demand_velocity"][: servo.axes] = begin.commanded_velocity
    row["measured_velocity"][: servo.axes] = begin.velocity
    row["held"][: servo.axes] = row["pending"][: servo.axes] = begin.torque / machine.drive_gain
    row["error_change"][: servo.axes] = begin.commanded_velocity - begin.velocity
    return machine.to_qpos(begin.position), numbers


def _fill(machine: Machine, servo: Servo, row: np.void) -> None:
    """Write the servo, its axes and where MuJoCo has them, which perturbations of the machine do not change."""
    row["axes"] = servo.axes
    row["nozzle_site"] = machine.nozzle
    row["work_body"] = machine.work
    row["period"] = servo.period
    row["resolution"][: servo.axes] = [drive.resolution for drive in servo.drives]
    row["following_error_limit"][: servo.axes] = servo.following_error_limit
    row["gains"][: servo.axes] = servo.gains
    row["notch"][: servo.axes] = servo.filters
    for name, values in zip(("joint_at", "stop_low", "stop_high"), stops_of(machine.layout), strict=True):
        row[name][: servo.axes] = values
    joints = driven_joints(machine.layout)
    row["dof_at"][: servo.axes] = machine.layout.jnt_dofadr[joints]
    for a, (axis, address) in enumerate(zip(machine.plain_axes, machine.addresses, strict=True)):
        for name in ("control", "output", "current"):
            row[f"{name}_at"][a] = getattr(address, name)
        row["load_at"][a] = machine.layout.jnt_qposadr[address.load] if address.load >= 0 else -1
        row["load_dof_at"][a] = machine.layout.jnt_dofadr[address.load] if address.load >= 0 else -1
        row["scale"][a] = axis.scale
        row["low"][a], row["high"][a] = axis.travel


def _limit(machine: Machine, servo: Servo, row: np.void) -> None:
    """Write the limits of the drives and their gain."""
    axes = servo.axes
    # a demand beyond what the drive can give is clamped by the drive itself
    peak = np.array([axis.peak_torque for axis in machine.plain_axes]) / machine.drive_gain
    row["torque_limit"][:axes] = np.minimum([drive.torque_limit for drive in servo.drives], peak)
    for a, (axis, mode) in enumerate(zip(machine.plain_axes, servo.modes, strict=True)):
        # the drives limit torques themselves
        if mode != "torque":
            row["torque_limit"][a] = axis.speed_limit if mode == "velocity" else np.inf
        row["speed_limit"][a] = axis.speed_limit
    row["drive_gain"][:axes] = machine.drive_gain


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


_NO_GLUE = Dispenser()


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
        stops: whether the model has the stops of the axes; if not, see `gantrysim.machine.travel`.
        book: of the log that the servo writes.
        faults: deliberate faults.
        injection: those that act in the servo tick.
        later: changes of the machine or its model, in their order.
        drives: at their start, (axes,) of `DRIVE`; None where all are plain ones.
        laws: at their start, (axes,) of `LAW`; None where none acts in the tick.
        torque: sent with the setpoints, (n, axes) [N·m]; None for none.
        begin: state of the axes at the first setpoint; None for rest there.
        prepared: the servo's row at the start of another simulation with this servo, on a perturbation of the same
            machine, of which this one's is a copy; None for none.
    """

    machine: Machine
    servo: Servo
    setpoints: Setpoints
    dispenser: Dispenser
    position: Floats
    substeps: int
    stops: bool
    book: LogBook
    faults: tuple[InjectedFault, ...] = ()
    injection: Injection = NONE
    later: tuple[Change, ...] = ()
    drives: NDArray[np.void] | None = None
    laws: NDArray[np.void] | None = None
    torque: Floats | None = None
    begin: Start | None = None
    prepared: Floats | None = None

    @classmethod
    def of(
        cls,
        machine: Machine,
        servo: Servo,
        setpoints: Setpoints | Controller,
        *,
        physics_step: float | None = None,
        dispenser: Dispenser | None = None,
        faults: Sequence[InjectedFault] = (),
    ) -> Simulation:
        """Return the simulation; arguments and errors as of `gantrysim.simulate`."""
        given = {"machine": machine, "servo": servo, "setpoints": setpoints, "dispenser": dispenser, "faults": faults}
        for name, value in given.items():
            check_argument(name, value)
        setpoints, position, torque = _sent_setpoints(machine, servo, sent_setpoints(setpoints, servo.period))
        dispenser = checked_dispenser(dispenser, setpoints)
        if not machine.kinematics.axes_are_coordinates:
            check_supervision(machine, setpoints.supervision)
            for law in servo.laws.added:
                if law.same_nozzle_axes:
                    raise InputError(
                        f"law {law.name!r} on machine {machine.name}: its axes are not coordinates of its nozzle; "
                        "leave it out"
                    )
        _check_servo(servo, machine, setpoints)
        substeps = substeps_of(machine, servo.period, physics_step, servo.inner_period)
        delay_steps(servo.delay, servo.period, substeps)
        _check_ticks(setpoints)
        # a run that is to be taken back where an axis reaches a stop may not act on anything but its own state
        own_state = not faults and servo.laws.user is None
        stops = not (own_state and has_no_constraints_but_stops(machine.layout))
        drives = drive_entries(machine, servo, servo.period / substeps)
        checked = check_faults(faults, machine.name, machine.axis_names, setpoints.most_ticks * servo.period)
        simulation = cls(
            machine,
            servo,
            setpoints,
            dispenser,
            position,
            substeps,
            stops,
            LogBook(machine, setpoints, position, dispenser, checked, drives),
            checked,
            injection(checked, machine, servo),
            drives=drives,
            laws=law_entries(servo),
            torque=torque,
        )
        if not any(fault.in_model for fault in checked):
            return simulation
        return replace(simulation, later=faulted_models(checked, machine, simulation.model, servo.period, substeps))

    def with_program(self, machine: Machine, setpoints: Setpoints, dispenser: Dispenser) -> Simulation:
        """Return the simulation of another program, by the same servo, on another perturbation of the machine.

        It equals one of `of`, which takes several times as long: what does not depend on them is this one's.

        Args:
            machine: of the same MJCF as this one's.
            setpoints: of the same period as this one's, without gates.
            dispenser: of the glue.
        """
        # deliberate faults, and drives that are no plain ones, depend on the machine
        if self.faults or self.drives is not None or not machine.kinematics.axes_are_coordinates:
            physics_step = self.physics_step
            return Simulation.of(
                machine, self.servo, setpoints, physics_step=physics_step, dispenser=dispenser, faults=self.faults
            )
        setpoints, position, torque = _sent_setpoints(machine, self.servo, setpoints)
        dispenser = checked_dispenser(dispenser, setpoints)
        _check_ticks(setpoints)
        return replace(
            self,
            machine=machine,
            setpoints=setpoints,
            dispenser=dispenser,
            position=position,
            book=LogBook(machine, setpoints, position, dispenser),
            torque=torque,
            prepared=self.start[1],
        )

    def with_torque(self, torque: Floats) -> Simulation:
        """Return the simulation with other torques sent with the setpoints, (n, axes) [N·m]."""
        return replace(
            self,
            book=LogBook(self.machine, self.setpoints, self.position, self.dispenser, self.faults, self.drives),
            torque=torque,
        )

    @cached_property
    def start(self) -> tuple[Floats, Floats]:
        """The machine's qpos at the first setpoint, and the servo's row before it is armed."""
        return start_of(self)

    @property
    def physics_step(self) -> float:
        """Length of a physics step [s]."""
        return self.servo.period / self.substeps

    @property
    def _voltage(self) -> bool:
        """Whether the bus voltage is the only limit on a motor's control, see `Machine.stepping`."""
        return any(drive.current_bandwidth for drive in self.servo.drives)

    @property
    def model(self) -> mujoco.MjModel:
        """The machine's model with the physics step, always the same object; not to be changed."""
        return self.machine.stepping(self.physics_step, self._voltage, self.stops)

    @property
    def model_with_stops(self) -> mujoco.MjModel:
        """The machine's model with the physics step and the stops of its axes."""
        return self.machine.stepping(self.physics_step, self._voltage)

    def later_model(self, number: int) -> mujoco.MjModel:
        """Return the model after the change of a number in `later`."""
        change = self.later[number]
        if change.model is not None:
            return change.model
        return change.machine.stepping(self.physics_step, self._voltage)

    @cached_property
    def linear(self) -> tuple[Linear | None, ...]:
        """The machine for the compiled loop, and the later ones; None for one whose step is not linear."""
        machines = (self.machine, *(change.machine for change in self.later))
        return tuple(linear_of(machine, self.physics_step, self._voltage) for machine in machines)

    @cached_property
    def hindrance(self) -> str | None:
        """Why the compiled loop cannot step it, so that MuJoCo does; None where it can."""
        if self.begin is not None:
            return "a run that does not begin at rest is MuJoCo's"
        if self.faults:
            return "a run with deliberate faults is MuJoCo's"
        if self.servo.laws.user is not None:
            return "a run with a law of its user's own is MuJoCo's"
        if self.stops:
            return f"machine {self.machine.name} has constraints besides the stops of its axes"
        if None in self.linear:
            return f"the physics step of machine {self.machine.name} is not linear, as where a joint turns"
        return None

    @property
    def log(self) -> Log:
        """The log in memory."""
        return self.book.log


def _check_servo(servo: Servo, machine: Machine, setpoints: Setpoints) -> None:
    """Check that a servo has the machine's axes and the period of the setpoints."""
    if servo.axes != len(machine.plain_axes):
        raise InputError(f"servo has {servo.axes} axes: machine {machine.name} has {len(machine.plain_axes)}")
    if abs(servo.period - setpoints.period) > 1e-12:
        raise InputError(f"setpoints' period = {setpoints.period:g} s: must be the servo period, {servo.period:g} s")


def _sent_setpoints(machine: Machine, servo: Servo, setpoints: Setpoints) -> tuple[Setpoints, Floats, Floats | None]:
    """Return the setpoints as the laws send them, the positions of the axes, and the torques sent with them or None."""
    for law in servo.laws.added:
        setpoints = law.sent(servo.laws.by_name(), setpoints)
    position = axis_positions(machine, setpoints)
    torque = axis_torques(machine, setpoints)
    for law in servo.laws.added:
        fed = law.torque(partial(_inverted_torques, servo), position)
        if fed is not None:
            torque = fed if torque is None else torque + fed
    return setpoints, position, torque


def _inverted_torques(servo: Servo, position: Floats) -> Floats:
    """Return the torques with which the linear machine under its servo follows setpoints, (n, axes) [N·m]."""
    return Inverse(servo).preview(position)


def checked_dispenser(dispenser: Dispenser | None, setpoints: Setpoints) -> Dispenser:
    """Return the dispenser, or one that lays nothing, checked against the setpoints."""
    if dispenser is None:
        return _NO_GLUE
    dispenser.check(setpoints)
    return dispenser


def _check_ticks(setpoints: Setpoints) -> None:
    """Check that there is memory for the run, which waits at every gate for at least its settling time."""
    wait = setpoints.supervision.settle_time
    count = setpoints.gates.size
    what = f"settle_time = {wait:g} s at each of {count} gates" if count else "the program"
    remedy = "use a shorter settle_time or program" if count else "use a shorter program or a longer period"
    check_ticks(setpoints.run_ticks, what, remedy)
