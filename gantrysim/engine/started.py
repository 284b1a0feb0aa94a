"""A run while it is stepped: the servo's row of userdata, how far it is, its fault, the record."""

from __future__ import annotations

import math
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import GantryError
from gantrysim.engine.drives import drive_stages
from gantrysim.engine.laws import law_stages
from gantrysim.engine.native.callback import magic
from gantrysim.engine.native.functions import CalledLaw
from gantrysim.engine.native.stages import Body, Stage, arm
from gantrysim.engine.native.supervision import gate_stage, position_error_stage, wait_at_gate, watch_position_error
from gantrysim.engine.simulation import Simulation
from gantrysim.machine.row import (
    FAULTS,
    IN_MODEL,
    NEVER,
    NOT_IN_MODEL,
    POSITION_ERROR,
    POSITION_ERROR_AT_REST,
    ROW,
    ROW_NUMBERS,
    SETTLING,
)
from gantrysim.record.run import Run
from gantrysim.record.run_file import Fault
from gantrysim.servo.laws.user import STATE, resolved_law, without_warnings


@dataclass(frozen=True, eq=False)
class Started:
    """A simulation in a state of MuJoCo's.

    Attributes:
        simulation: the simulation, kept alive as the row holds addresses of its arrays.
        row: the servo's row of the state's userdata, a live view, see `gantrysim.machine.row`.
        drives, laws, user_law: their states, kept alive as the stages hold their addresses.
        stages: of the tick, kept alive as the row holds their address.
        bodies: of the stages, by their points; None for one that a device cannot have.
    """

    simulation: Simulation
    row: np.void
    drives: NDArray[np.void] | None = None
    laws: NDArray[np.void] | None = None
    user_law: CalledLaw | None = None
    stages: NDArray[np.void] | None = None
    bodies: tuple[tuple[str, Body | None], ...] = ()

    @classmethod
    def of(
        cls,
        simulation: Simulation,
        qpos: Floats,
        userdata: Floats,
        drives: NDArray[np.void] | None = None,
        laws: NDArray[np.void] | None = None,
    ) -> Started:
        """Write the start, at the first setpoint, into a fresh state; arm the servo.

        Args:
            simulation: the simulation.
            qpos: of the state.
            userdata: of the state.
            drives: for the state of the drives, (axes,) of `DRIVE`; by default a new array.
            laws: for the state of the laws, (axes,) of `LAW`; by default a new array.
        """
        start, prepared = simulation.start
        qpos[:] = start
        userdata[:ROW_NUMBERS] = prepared
        row = userdata[:ROW_NUMBERS].view(ROW)[0]
        row["stops"] = IN_MODEL if simulation.stops else NOT_IN_MODEL
        simulation.book.begin(row)
        drives = _begun(simulation.drives, drives)
        if drives is not None:
            for name in ("start", "target", "next"):
                drives["field"][name] = simulation.position[0]
        laws = _begun(simulation.laws, laws)
        stages = [
            *simulation.injection.stages(),
            *drive_stages(simulation.servo, drives),
            *_supervision_stages(simulation),
            *law_stages(simulation.servo, laws, simulation.torque),
        ]
        user_law = None
        if simulation.servo.laws.user is not None:
            user_law = CalledLaw(without_warnings(resolved_law(simulation.servo.laws.user)), np.zeros(STATE))
            stages.append(Stage("law", user_law.address, user_law.state.ctypes.data))
        table = arm(row, stages)
        # the last, for it arms the servo
        row["magic"] = magic()
        bodies = tuple((stage.point, stage.body) for stage in stages)
        return cls(simulation, row, drives, laws, user_law, table, bodies)

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
        number = self.number_of_model
        if number:
            return self.simulation.later_model(number - 1)
        return self.simulation.model_with_stops if self.row["stops"] == IN_MODEL else self.simulation.model

    @property
    def number_of_model(self) -> int:
        """Number of the later models that have begun by the next physics step."""
        steps = self.steps
        return sum(change.step <= steps for change in self.simulation.later)

    def stop_at_stops(self) -> None:
        """Step a model with the stops of the axes from now on."""
        self.row["stops"] = IN_MODEL

    @property
    def next_change(self) -> int:
        """The physics step at which the model changes next, large if it does not."""
        steps = self.steps
        return min((change.step for change in self.simulation.later if change.step > steps), default=NEVER)

    @property
    def steps_of_model(self) -> int:
        """Number of physics steps until the model changes, large if it does not."""
        return self.next_change - self.steps

    @property
    def plain(self) -> bool:
        """Whether nothing but MuJoCo and the compiled servo has to act until its model changes or it is done."""
        return self.user_law is None and self.simulation.book.whole

    @property
    def done(self) -> bool:
        """Whether the last setpoint is sent, or a fault has ended the run; what a user's law raised is raised here."""
        if self.user_law is not None and self.user_law.raised:
            raise self.user_law.raised[0]
        return self.sent >= len(self.simulation.position) or bool(self.row["fault"])

    @property
    def steps_left(self) -> int:
        """Number of physics steps to the first one of the last tick, if the stream waits at no further gate."""
        last = self.ticks - self.sent + len(self.simulation.position) - 1
        return last * self.simulation.substeps + 1 - self.steps

    def make_room(self, steps: int) -> None:
        """Make room in the log for the servo ticks of a number of physics steps; errors as of `LogBook.make_room`."""
        if self.simulation.book.whole:
            return
        ticks = steps // self.simulation.substeps + 2
        if self.row["gate"] >= self.row["gate_count"]:  # no more waits
            ticks = min(ticks, len(self.simulation.position) - self.sent)
        self.simulation.book.make_room(self.row, ticks)

    @property
    def fault(self) -> Fault | None:
        """The fault, if there is one."""
        row = self.row
        simulation = self.simulation
        code = row["fault"]
        if not code:
            return None
        kind = FAULTS[code]
        axis = simulation.machine.plain_axes[row["fault_axis"]]
        value = float(row["fault_value"])
        limit = float(row["fault_limit"])
        unit = {"overspeed": f"{axis.unit}/s", "oscillation": "swings"}.get(kind, axis.unit)
        if kind == "diverged" and np.isfinite(limit):
            # of the demand; else it is the following error, which has no limit
            unit = "N·m"
        reaction = {
            POSITION_ERROR: "the motion stops",
            POSITION_ERROR_AT_REST: "the drives are disabled",
            SETTLING: f"not settled after {simulation.setpoints.supervision.settle_timeout:g} s",
        }.get(code, "")
        time = float(row["fault_tick"] * simulation.servo.period)
        return Fault(kind, axis.name, time, value, limit, unit, reaction)

    def record(self, *, partial: bool = False, every: int = 1) -> Run:
        """Return the record so far, of at least one tick.

        Args:
            partial: whether the run may be unfinished.
            every: number of servo ticks for each tick of the record.

        Raises:
            GantryError: a run that is neither at its end nor stopped by a fault.
        """
        simulation = self.simulation
        fault = self.fault
        ticks = self.ticks
        if not partial and not self.done:
            raise GantryError(
                f"the servo of machine {simulation.machine.name} ran for {ticks} of {len(simulation.position)} ticks: "
                "MuJoCo did not call it"
            )
        if fault is not None and not simulation.book.finite(ticks - 1):
            # the tick at which it diverged has no position to record
            ticks -= 1
        return simulation.book.record(ticks, fault, every)


def _begun(start: NDArray[np.void] | None, state: NDArray[np.void] | None) -> NDArray[np.void] | None:
    """Return an array for a state, by default a new one, with what it is at the start; None where there is no state."""
    if start is None:
        return None
    if state is None:
        return start.copy()
    state[:] = start
    return state


def _supervision_stages(simulation: Simulation) -> list[Stage]:
    """Return the stages of a motion controller that watches the position error, or waits for its axes to settle."""
    stages = []
    if math.isfinite(simulation.setpoints.supervision.position_error):
        stages.append(Stage("supervise", position_error_stage(), body=Body("tape", watch_position_error)))
    if simulation.setpoints.gates.size:
        stages.append(Stage("supervise", gate_stage(), body=Body("tape", wait_at_gate)))
    return stages
