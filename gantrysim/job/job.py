"""A job: the program, machine, servo, dispenser and bead of a run, in one TOML file."""

from __future__ import annotations

import math
import os
from dataclasses import replace
from functools import cached_property
from typing import Any, Self

from gantrysim.base import memory
from gantrysim.base.errors import at_least, short_text, wrong_type
from gantrysim.base.progress import Progress
from gantrysim.base.user_code import is_code
from gantrysim.engine.linear import Engine
from gantrysim.engine.recording import dispenser_notes
from gantrysim.engine.simulate import perfect_follower, simulate
from gantrysim.engine.simulation import Simulation
from gantrysim.glue.bead import Bead, HeightMap
from gantrysim.glue.dispenser.command import output_note
from gantrysim.glue.dispenser.dispenser import VALVE
from gantrysim.job.loaded import LoadedJob
from gantrysim.job.margins import check_stability, machine_notes, servo_reason
from gantrysim.job.plan import Plan, check_fit, plan_of
from gantrysim.job.programs import checked_setpoints
from gantrysim.job.tolerance import Tolerance, ToleranceSettings
from gantrysim.machine.machine import Machine
from gantrysim.paths.path import Path
from gantrysim.record.run import Run
from gantrysim.record.setpoints import Setpoints
from gantrysim.servo.servo import Servo
from gantrysim.servo.stability.margins import Margins, margins_of


class Job(LoadedJob):
    """Complete description of a run, read from TOML and written back with every default.

    Attributes:
        name: name of the job: letters, digits, spaces and any of _ . + -
        machine: name of a built-in machine, or path of an MJCF file or of a machine table in TOML, relative to the
            folder of the job file; by default the smallest built-in machine with the program's axes.
        travel: travel of individual axes in place of the machine's, as in {x = [-20, 620]}; masses and stiffness stay
            the same [mm, deg].
        names: mapping for an MJCF that uses other names, as in {nozzle = "tip", x = "motor_x"}; see `Machine`.
        program: the controller, as `controller`, and its arguments: one of `PROGRAMS`, or your own class as
            "module:Class" or "path/to/file.py:Class".
        servo: arguments of `Servo.derive`.
        dispenser: arguments of `Dispenser`; for a program file without flow, area and pressure, the area is the section
            that the needle's face just presses flat.
        bead: shape of the bead and grid of its height map; see `BeadSettings`.
        simulation: physics step and settling time.
        geometry: geometric errors of the machine, by accuracy class or individually, see `Geometry`; none by default.
        tolerance: limits that a good run keeps; those not given have defaults.
        faults: deliberate faults, tables [[faults]] with a `kind` and its values; see `gantrysim.faults`.
        source: file that the program's text was read from, for messages; None for a program inside the job.
    """

    def __reduce__(self) -> tuple[Any, ...]:
        # without a compiled machine, which cannot be pickled
        return Job.of_content, (self.model_dump(), f"job {self.name}", self._refusal)

    @cached_property
    def notes(self) -> tuple[str, ...]:
        """Notes on the defaults used, the program, the machine at rest, low stability margins, engine and syringe."""
        servo = self.built_servo
        notes = (*self._choice, *self.controller.notes, *machine_notes(self.built_machine, self.margins, servo))
        if self.simulation.engine == "loop":
            hindrance = self.prepared_simulation().hindrance
            maker = "the compiled loop" if hindrance is None else "MuJoCo"
            reason = "" if hindrance is None else f": {hindrance}"
            notes = (*notes, f'simulation.engine = "loop": {maker} makes the physics steps{reason}')
        if self.controller.feeds_material:
            notes = (*notes, self.dispenser.material_note(is_advanced=self.setpoints.extruder is not None))
        dispenser = self.dispenser
        if self.controller.flow_output:
            notes = (*notes, output_note(self.controller.flow_output, dispenser.per_output))
        if dispenser.syringe is None and not dispenser.advance and dispenser.kind == VALVE:
            return notes
        return notes + dispenser_notes(self.follow(), dispenser)

    @cached_property
    def built_servo(self) -> Servo:
        """The servo with its gains."""
        self.check_law()
        return Servo.derive(self.built_machine.axes, **dict(self.servo))

    @property
    def servo_reason(self) -> str:
        """Explanation of what limits the natural frequency of the servo, and why it has notches."""
        return servo_reason(self.servo, self.built_machine, self.built_servo)

    @cached_property
    def margins(self) -> tuple[Margins, ...] | None:
        """Stability margins of each axis, None if the machine cannot be linearised."""
        return margins_of(self.built_machine, self.built_servo)

    def _margins_at(self, frequency: float) -> tuple[Margins, ...] | None:
        return self.changed({"servo.frequency": frequency}).sharing(self).margins

    @cached_property
    def setpoints(self) -> Setpoints:
        """The program's setpoints, held at the start for the dispenser's start lead and at the end to settle."""
        settle = at_least("settle", self.simulation.settle, 0, "s")
        with self.locate_errors():
            sent = self._program_setpoints
            held = self.dispenser.held_back(sent)
            # `start_wait` would plan the whole program once more
            self.__dict__["start_wait"] = (len(held.position) - len(sent.position)) * sent.period
            held = held.hold(settle)
        known = self._path_of_sibling
        # with what has been computed of it, as its table of points
        return replace(held, requested=known) if known is not None and known.coincides(held.requested) else held

    @cached_property
    def _path_of_sibling(self) -> Path | None:
        """Requested path of the job with which this one shares what is the same; None for none."""
        return None

    def sharing(self, other: Self) -> Self:
        """As of `LoadedJob`, and with the setpoints where these have been computed and are the same.

        Setpoints that are another's, as with another acceleration, still share the requested path where that is the
        same; and what fits the machine is not checked again where only the servo is another.
        """
        shared = super().sharing(other)
        sent = other.__dict__.get("setpoints")
        shared.__dict__["_path_of_sibling"] = other._path_of_sibling if sent is None else sent.requested
        is_same = (
            self.program == other.program
            and self.servo.period == other.servo.period
            and self.dispenser.start_lead == other.dispenser.start_lead
            and self.simulation.settle == other.simulation.settle
        )
        if is_same and not is_code(self.program["controller"]):
            for name in ("setpoints", "start_wait"):
                if name in other.__dict__:
                    shared.__dict__[name] = other.__dict__[name]
            # a machine that is not built yet may be refused
            is_on_it = shared.__dict__.get("built_machine") is other.__dict__.get("built_machine")
            is_glued_alike = shared.dispenser == other.dispenser and shared.bead == other.bead
            for name, is_alike in (("_program_fits", is_on_it), ("_cells_suit", is_on_it and is_glued_alike)):
                if is_alike and name in other.__dict__:
                    shared.__dict__[name] = True
        return shared

    @property
    def _program_setpoints(self) -> Setpoints:
        """Setpoints of the program alone; not cached, as a long program would fill the memory."""
        setpoints = self.controller.setpoints(self.built_servo.period)
        name = self.program["controller"]
        return checked_setpoints(name, setpoints) if is_code(name) else setpoints

    @cached_property
    def start_wait(self) -> float:
        """Time for which the dispenser holds the program back [s]."""
        if self.dispenser.start_lead <= 0:
            return 0.0
        sent = self._program_setpoints
        return (len(self.dispenser.held_back(sent).position) - len(sent.position)) * sent.period

    @property
    def engine_of_searches(self) -> Engine:
        """What makes the physics steps where many runs are made; a run that is shown is MuJoCo's by default."""
        return self.simulation.engine or "loop"

    def run(self, progress: Progress = None, machine: Machine | None = None, *, engine: Engine | None = None) -> Run:
        """Run the job and return the record, which refers to the job.

        Args:
            progress: as in `simulate`.
            machine: machine to run instead of the job's, such as a `perturbed` one; the servo remains that of the
                job's machine.
            engine: as in `simulate`, by default that of the job's settings.

        Raises:
            InputError: a servo that is unstable on the job's machine, unless `simulation.allow_unstable`; and as
                `simulate`.
        """
        self.check_loops()
        with self.locate_errors():
            record = simulate(
                self.built_machine if machine is None else machine,
                self.built_servo,
                self.setpoints,
                physics_step=self.simulation.physics_step,
                dispenser=self.dispenser,
                faults=self.faults,
                engine=engine or self.simulation.engine or "mujoco",
                progress=progress,
            )
        if len(record.time) > memory.LONG_RUN:
            # they fill the memory, and are computed again on demand
            self.__dict__.pop("setpoints", None)
        return record.replaced(job=self, rig=None)

    def check_loops(self) -> None:
        """Raise InputError for a servo that is unstable on the job's machine, unless `simulation.allow_unstable`."""
        if not self.simulation.allow_unstable:
            check_stability(self.built_machine, self.built_servo, self.margins, self.servo, self._margins_at)

    def limits(self, needle: float, width: float = math.nan) -> Tolerance:
        """Return the limits that a good run of the job keeps.

        Args:
            needle: outer diameter of the needle [mm].
            width: nominal width of the bead, nan where none is requested [mm].
        """
        counts = [axis.resolution for axis in self.built_machine.axes if axis.unit == "mm"]
        return Tolerance.of(self.tolerance or ToleranceSettings(), needle, counts, width)

    def without_faults(self) -> Job:
        """Return the job without its deliberate faults."""
        return self.model_copy(update={"faults": ()})

    def plan(self) -> Plan:
        """Return the planned motion of the job, without simulating it.

        Raises:
            InputError: a program that the controller or the machine refuses.
        """
        with self.locate_errors():
            self.check_fit()
            return plan_of(self.built_machine, self.program["controller"], self.setpoints, self.controller)

    def check_fit(self) -> None:
        """Raise InputError unless program and machine agree in frame and geometry; includes `check_faults`.

        The cells of the height map must suit the bead of a machine that follows the program exactly.
        """
        self.check_program()
        assert self._cells_suit

    def check_program(self) -> None:
        """Raise InputError unless program and machine agree in frame and geometry; includes `check_faults`."""
        self.check_faults()
        assert self._program_fits

    @cached_property
    def _program_fits(self) -> bool:
        """True, or an InputError for a program that does not fit its machine."""
        with self.locate_errors():
            check_fit(self.built_machine, self.controller, self.setpoints, self.program["controller"])
        return True

    @cached_property
    def _cells_suit(self) -> bool:
        """True, or an InputError for cells of the height map that do not suit the bead."""
        bead = Bead(self.follow(), self.bead)
        # without glue there is no map, unless its cells are asked for
        if self.bead.cell is not None or bead.nominal_section.width[0] > 0:
            HeightMap.check(bead)
        return True

    def check_faults(self) -> None:
        """Raise InputError for deliberate faults that the machine cannot have, or that begin after its end."""
        if self.faults:
            self.prepared_simulation()

    def prepared_simulation(self) -> Simulation:
        """Return the simulation of the job's run before its first step.

        Raises:
            InputError: as `simulate`.
        """
        return Simulation.of(
            self.built_machine,
            self.built_servo,
            self.setpoints,
            physics_step=self.simulation.physics_step,
            dispenser=self.dispenser,
            faults=self.faults,
        )

    def follow(self) -> Run:
        """Return the record of a machine that follows the program exactly, see `perfect_follower`."""
        with self.locate_errors():
            record = perfect_follower(self.built_machine, self.setpoints, dispenser=self.dispenser)
        return record.replaced(job=self)


def check_job(value: Any) -> None:
    """Raise InputError for anything but a job, with what to write instead of a name, a file or a run."""
    if isinstance(value, Job):
        return
    advice = "gantrysim.Job.load(file) returns one"
    if isinstance(value, str | os.PathLike):
        advice = f"write gantrysim.Job.load({short_text(os.fspath(value))})"
    elif isinstance(value, Run) and value.job is not None:
        advice = "write .job behind it"
    raise wrong_type("job", value, "a Job", advice)
