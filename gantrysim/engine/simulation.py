"""A run before and while it is stepped: checks of the input, the servo's row of userdata, the record."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import mujoco
import numpy as np
from numpy.typing import NDArray

from gantrysim.arrays import Floats
from gantrysim.controllers.feeding import Inverse
from gantrysim.controllers.law import GAIN_NAMES
from gantrysim.controllers.laws.parameters import CONTOUR, PREVIEW
from gantrysim.controllers.laws.user import STATE, resolved
from gantrysim.controllers.servo import Servo
from gantrysim.controllers.setpoints import Setpoints, periods
from gantrysim.controllers.shaping import shaped
from gantrysim.engine.drives import drive_entries
from gantrysim.engine.injection import injected_entries, no_entries, stuck_models
from gantrysim.engine.laws import law_entries
from gantrysim.engine.positions import axis_positions, axis_torques, check_supervision
from gantrysim.engine.recording import LogBook
from gantrysim.errors import GantryError, InputError
from gantrysim.fault import Fault
from gantrysim.faults import InjectedFault, check_faults
from gantrysim.machine.dispenser import Dispenser
from gantrysim.machine.machine import Machine
from gantrysim.machine.timing import delay_steps, substeps_of
from gantrysim.memory import check_ticks
from gantrysim.native.row import (
    FAULTS,
    NEVER,
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
from gantrysim.native.user import CalledLaw
from gantrysim.run import Run

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
        model: the machine's, with the physics step; not to be changed.
        book: of the log that the servo writes.
        faults: faults on purpose.
        injected: those that act in the servo tick, (entries,) of `INJECTED`.
        later: the models with the friction of stuck axes, each with the number of physics steps before it, ascending.
        drives: at their start, (axes,) of `DRIVE`; None where all are plain ones.
        laws: at their start, (axes,) of `LAW`; None where PID does alone.
        torque: sent with the setpoints, (n, axes) [N·m]; None for none.
    """

    machine: Machine
    servo: Servo
    setpoints: Setpoints
    dispenser: Dispenser
    position: Floats
    substeps: int
    model: mujoco.MjModel
    book: LogBook
    faults: tuple[InjectedFault, ...] = ()
    injected: NDArray[np.void] = field(default_factory=no_entries)
    later: tuple[tuple[int, mujoco.MjModel], ...] = ()
    drives: NDArray[np.void] | None = None
    laws: NDArray[np.void] | None = None
    torque: Floats | None = None

    @classmethod
    def of(
        cls,
        machine: Machine,
        servo: Servo,
        setpoints: Setpoints,
        *,
        physics_step: float | None = None,
        dispenser: Dispenser | None = None,
        faults: Sequence[InjectedFault] = (),
    ) -> Simulation:
        """Return the simulation; arguments and errors as of `gantrysim.simulate`."""
        setpoints = shaped(servo, setpoints)
        dispenser = checked_dispenser(dispenser, setpoints)
        position = axis_positions(machine, setpoints)
        if machine.kinematics.followers:
            check_supervision(machine, setpoints.supervision)
            if CONTOUR in servo.law:
                raise InputError(
                    f"law 'contour' on machine {machine.name}: its axes are not coordinates of its nozzle; leave it out"
                )
        if servo.axes != len(machine.axes):
            raise InputError(f"servo has {servo.axes} axes: machine {machine.name} has {len(machine.axes)}")
        if abs(servo.period - setpoints.period) > 1e-12:
            raise InputError(
                f"setpoints' period = {setpoints.period:g} s: must be the servo period, {servo.period:g} s"
            )
        substeps = substeps_of(machine, servo.period, physics_step, servo.inner_period)
        delay_steps(servo.delay, servo.period, substeps)
        _check_ticks(setpoints)
        model = machine.stepping(servo.period / substeps, any(servo.current_bandwidth))
        drives = drive_entries(machine, servo, servo.period / substeps)
        torque = axis_torques(machine, setpoints)
        if PREVIEW in servo.law:
            fed = Inverse(servo).preview(position)
            torque = fed if torque is None else torque + fed
        checked = check_faults(faults, machine.name, machine.axis_names, setpoints.most_ticks * servo.period)
        return cls(
            machine,
            servo,
            setpoints,
            dispenser,
            position,
            substeps,
            model,
            LogBook(
                machine,
                setpoints,
                position,
                dispenser,
                checked,
                drives,
                False if drives is None else drives["load"] >= 0,
            ),
            checked,
            injected_entries(checked, machine, servo),
            stuck_models(checked, machine, model, servo.period, substeps),
            drives,
            law_entries(servo, torque),
            torque,
        )

    def with_torque(self, torque: Floats) -> Simulation:
        """Return the simulation with other torques sent with the setpoints, (n, axes) [N·m]."""
        leads = None if self.drives is None else self.drives["lead"]
        return replace(
            self,
            book=LogBook(self.machine, self.setpoints, self.position, self.dispenser, self.faults, leads),
            laws=law_entries(self.servo, torque),
            torque=torque,
        )

    @property
    def log(self) -> Log:
        """The log in memory."""
        return self.book.log

    def start(self, qpos: Floats, userdata: Floats) -> Started:
        """Write the start, at rest at the first setpoint, into a fresh state's qpos and userdata; arm the servo."""
        qpos[:] = self.machine.to_qpos(self.position[0])
        userdata[:ROW_NUMBERS] = 0.0
        row = userdata[:ROW_NUMBERS].view(ROW)[0]
        self._fill(row)
        self._supervise(row)
        drives = None if self.drives is None else self.drives.copy()
        if drives is not None:
            for name in ("start", "target", "next"):
                drives[name] = self.position[0]
        row["drives"] = 0 if drives is None else drives.ctypes.data
        laws = None if self.laws is None else self.laws.copy()
        row["laws"] = 0 if laws is None else laws.ctypes.data
        own = None
        if laws is not None and self.servo.own_law is not None:
            state = np.zeros(STATE)
            own = CalledLaw(resolved(self.servo.own_law), state)
            laws["user"], laws["state_at"] = own.address, state.ctypes.data
        row["magic"] = magic()  # the last, for it arms the servo
        return Started(self, row, drives, laws, own)

    def _fill(self, row: np.void) -> None:
        machine, servo = self.machine, self.servo
        for name, value in OFFSETS.items():
            row[name] = value
        row["axes"], row["ticks"], row["substeps"] = servo.axes, len(self.position), self.substeps
        row["delay"] = delay_steps(servo.delay, servo.period, self.substeps)
        row["setpoints"] = self.position.ctypes.data
        self.book.begin(row)
        row["nozzle"], row["work"], row["period"] = machine.nozzle, machine.work, servo.period
        row["resolution"][: servo.axes] = servo.resolution
        row["following_error_limit"][: servo.axes] = servo.following_error_limit
        for k, name in enumerate(GAIN_NAMES):
            row["gains"][: servo.axes, k] = getattr(servo, name)
        row["notch"][: servo.axes] = servo.filters
        # a demand beyond what the drive can give is clamped by the drive itself
        peak = np.array([axis.peak_torque for axis in machine.axes]) / machine.drive_gain
        row["torque_limit"][: servo.axes] = np.minimum(servo.torque_limit, peak)
        for a, (axis, mode) in enumerate(zip(machine.axes, servo.mode, strict=True)):
            if mode != "torque":  # the drives limit torques themselves
                row["torque_limit"][a] = axis.speed_limit if mode == "velocity" else np.inf
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
        row["injected"], row["injected_count"] = self.injected.ctypes.data, self.injected.size
        row["gates"], row["gate_count"], row["settle_error"] = gates.ctypes.data, gates.size, supervision.settle_error
        row["settle_ticks"] = periods(supervision.settle_time, self.setpoints.period)
        row["timeout_ticks"] = periods(supervision.settle_timeout, self.setpoints.period)
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
        drives, laws, own: their states, kept alive as the row holds their addresses; own is a user's law.
    """

    simulation: Simulation
    row: np.void
    drives: NDArray[np.void] | None = None
    laws: NDArray[np.void] | None = None
    own: CalledLaw | None = None

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
    def model(self) -> mujoco.MjModel:
        """The model of the next physics step."""
        steps, model = self.steps, self.simulation.model
        for begin, later in self.simulation.later:
            if begin <= steps:
                model = later
        return model

    @property
    def steps_of_model(self) -> int:
        """Number of physics steps until the model changes, large if it does not."""
        steps = self.steps
        return min((begin - steps for begin, _ in self.simulation.later if begin > steps), default=NEVER)

    @property
    def done(self) -> bool:
        """Whether the last setpoint is sent, or a fault has ended the run; what a user's law raised is raised here."""
        if self.own is not None and self.own.raised:
            raise self.own.raised[0]
        return self.sent >= len(self.simulation.position) or bool(self.row["fault"])

    @property
    def steps_left(self) -> int:
        """Number of physics steps to the first one of the last tick, if the stream waits at no further gate."""
        last = self.ticks - self.sent + len(self.simulation.position) - 1
        return last * self.simulation.substeps + 1 - self.steps

    def make_room(self, steps: int) -> None:
        """Make room in the log for the servo ticks of a number of physics steps; errors as of `LogBook.make_room`."""
        ticks = steps // self.simulation.substeps + 2
        if self.row["gate"] >= self.row["gate_count"]:  # no more waits
            ticks = min(ticks, len(self.simulation.position) - self.sent)
        self.simulation.book.make_room(self.row, ticks)

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
        if fault is not None and not simulation.book.finite(kept - 1):
            kept -= 1  # the tick at which it diverged has no position to record
        return simulation.book.record(kept, fault)


def checked_dispenser(dispenser: Dispenser | None, setpoints: Setpoints) -> Dispenser:
    """Return the dispenser, or one that lays nothing, checked against the setpoints."""
    if dispenser is None:
        return _NO_GLUE
    dispenser.check(setpoints)
    return dispenser


def _check_ticks(setpoints: Setpoints) -> None:
    """Check that there is memory for the run, which waits at every gate for at least its settling time."""
    wait, count = setpoints.supervision.settle_time, setpoints.gates.size
    what = f"settle_time = {wait:g} s at each of {count} gates" if count else "the program"
    remedy = "use a shorter settle_time or program" if count else "use a shorter program or a longer period"
    check_ticks(setpoints.run_ticks, what, remedy)
