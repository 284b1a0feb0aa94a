"""A job: the program, machine, servo, dispenser and bead of a run, in one TOML file."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path
from typing import Any

from gantrysim.base import memory
from gantrysim.base.errors import InputError, TimedError, at_least
from gantrysim.base.progress import Progress
from gantrysim.base.user_code import is_code
from gantrysim.engine.simulate import perfect_follower, simulate
from gantrysim.engine.simulation import Simulation
from gantrysim.job.choosing import chosen_job
from gantrysim.job.content import JobContent
from gantrysim.job.fitting import check_fit, check_servo_file
from gantrysim.job.given import Given
from gantrysim.job.margins import check_stability, machine_notes, servo_reason
from gantrysim.job.plan import Plan, plan_of
from gantrysim.job.program_place import share_text
from gantrysim.job.reading import Request, read_with_overrides
from gantrysim.job.user_controller import checked_setpoints
from gantrysim.machine.machine import Machine
from gantrysim.machine.travel import travel_edit
from gantrysim.record.run import Run
from gantrysim.record.setpoints import Setpoints
from gantrysim.servo.servo import Servo
from gantrysim.stability.margins import Margins, margins_of


class Job(JobContent):
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

    @classmethod
    def load(
        cls,
        job: str | os.PathLike[str],
        overrides: Iterable[str] = (),
        machine: str | None = None,
        servo: str | os.PathLike[str] | None = None,
        *,
        controller: str | None = None,
        placement: Mapping[str, float] | None = None,
        speed: float | None = None,
        allow_code: bool = False,
    ) -> Job:
        """Return a built-in job, the job in a TOML file, or one that runs a program file.

        A file that names its own code, a law or a controller, is refused unless `allow_code` is true or the file lies
        in the current working folder. Code that the overrides name may run.

        Args:
            job: name of a built-in job, or path.
            overrides: texts "key=value" with a TOML value; the key is dotted, as in program.loop_period, or its last
                parts if they are unique.
            machine: machine to use instead of the job's.
            servo: TOML file whose table [servo] replaces the job's, before the overrides.
            controller: controller that reads a program file, such as "fanuc"; by default chosen by the file's suffix.
            placement: placement of the program on the work, attributes of `Placement` by name.
            speed: speed of the program's fastest motion, see `at_speed` [mm/s].
            allow_code: whether code that the job or the servo file names may run, wherever the file lies.

        Raises:
            InputError: an unknown job, an invalid key or value, or code that may not run.
        """
        table = None if servo is None else Path(servo)
        request = Request(str(job), tuple(overrides), machine, table, controller, placement, allow_code)
        read = read_with_overrides(request)
        if read.refusal and not allow_code:
            raise InputError(read.refusal)
        chosen = chosen_job(cls, Given.of(read, request, speed), read.content, speed)
        if table is not None:
            check_servo_file(table, chosen.servo, chosen.built_machine)
        return chosen

    @classmethod
    def of_record(cls, file: Path) -> Job:
        """Return the job of a saved run; its own code is refused only if the job is run again."""
        read = read_with_overrides(Request(str(file)))
        return cls.of_content(read.content, read.label, read.refusal, is_record=True)

    def at_speed(self, speed: float) -> Job:
        """Return the job with its program at another speed.

        Args:
            speed: speed of the fastest motion; slower motions change in proportion [mm/s].

        Raises:
            InputError: the program states no speed, or the speed is not positive.
        """
        with self.located():
            arguments = self.controller.arguments_at(speed)
        return self.changed({f"program.{key}": _without_noise(value) for key, value in arguments.items()})

    @contextmanager
    def located(self) -> Iterator[None]:
        """Name the program's file, and the line where it is known, in errors that the program causes."""
        try:
            yield
        except InputError as error:
            text = str(error)
            line = None
            if isinstance(error, TimedError):
                line = self.controller.line_at(error.time - self._wait)
            if line is not None:
                text = f"line {line}: {text}"
            if not text.startswith("line "):
                raise
            raise InputError(f"{self.source or 'program'}: {text}") from None

    def sharing(self, other: Job) -> Job:
        """Return the job with machine, controller and servo shared with `other` where both jobs specify the same.

        The servo is shared only if `other` has built it, as it may be refused.
        """
        built: dict[str, Any] = {}
        if all(getattr(self, key) == getattr(other, key) for key in ("machine", "names", "travel", "geometry")):
            built["built_machine"] = other.built_machine
        if self.program == other.program:
            built["controller"] = other.controller
        elif not is_code(self.program["controller"]):
            share_text(self.program, other.program, self.controller, other.controller)
            built["controller"] = self.controller
        if "built_machine" in built and self.servo == other.servo:
            built |= {name: other.__dict__[name] for name in ("built_servo", "margins") if name in other.__dict__}
        return self.model_copy(update=built)

    def __deepcopy__(self, memo: dict[int, Any] | None = None) -> Job:
        return self  # immutable, and a compiled machine cannot be copied

    def __reduce__(self) -> tuple[Any, ...]:
        # without a compiled machine, which cannot be pickled
        return Job.of_content, (self.model_dump(), f"job {self.name}", self._refusal)

    @cached_property
    def notes(self) -> tuple[str, ...]:
        """Notes on the defaults used, the program, the machine at rest, low stability margins, and the syringe."""
        servo = self.built_servo
        notes = (*self._choice, *self.controller.notes, *machine_notes(self.built_machine, self.margins, servo))
        if self.dispenser.syringe is None:
            return notes
        return notes + self.dispenser.notes(self.follow().flow, servo.period)

    @cached_property
    def built_machine(self) -> Machine:
        """The compiled machine."""
        machine = Machine(self.machine, self.names)
        if self.travel:
            machine = machine.edited(travel_edit(machine.plain_axes, self.travel))
        return machine if self.geometry is None else machine.with_geometry(self.geometry)

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
        with self.located():
            return self.dispenser.held_back(self._sent).hold(settle)

    @property
    def _sent(self) -> Setpoints:
        """Setpoints of the program alone; not cached, as a long program would fill the memory."""
        setpoints = self.controller.setpoints(self.built_servo.period)
        name = self.program["controller"]
        return checked_setpoints(name, setpoints) if is_code(name) else setpoints

    @property
    def _wait(self) -> float:
        """Time for which the dispenser holds the program back [s]."""
        held = self.dispenser.held_back(self._sent)
        return (len(held.position) - len(self._sent.position)) * self._sent.period

    def run(self, progress: Progress = None, machine: Machine | None = None) -> Run:
        """Run the job and return the record, which refers to the job.

        Args:
            progress: as in `simulate`.
            machine: machine to run instead of the job's, such as a `perturbed` one; the servo remains that of the
                job's machine.

        Raises:
            InputError: a servo that is unstable on the job's machine, unless `simulation.allow_unstable`; and as
                `simulate`.
        """
        if not self.simulation.allow_unstable:
            check_stability(self.built_machine, self.built_servo, self.margins, self.servo, self._margins_at)
        with self.located():
            record = simulate(
                self.built_machine if machine is None else machine,
                self.built_servo,
                self.setpoints,
                physics_step=self.simulation.physics_step,
                dispenser=self.dispenser,
                faults=self.faults,
                progress=progress,
            )
        if len(record.time) > memory.LONG:
            self.__dict__.pop("setpoints", None)  # they fill the memory, and are computed again on demand
        return record.replaced(job=self)

    def without_faults(self) -> Job:
        """Return the job without its deliberate faults."""
        return self.model_copy(update={"faults": ()})

    def plan(self) -> Plan:
        """Return the planned motion of the job, without simulating it.

        Raises:
            InputError: a program that the controller or the machine refuses.
        """
        with self.located():
            self.check_fit()
            return plan_of(self.built_machine, self.program["controller"], self.setpoints, self.controller)

    def check_fit(self) -> None:
        """Raise InputError unless program and machine agree in frame and geometry; includes `check_faults`."""
        with self.located():
            check_fit(self.built_machine, self.controller, self.setpoints, self.program["controller"])
        self.check_faults()

    def check_faults(self) -> None:
        """Raise InputError for deliberate faults that the machine cannot have, or that begin after its end."""
        if self.faults:
            Simulation.of(
                self.built_machine,
                self.built_servo,
                self.setpoints,
                physics_step=self.simulation.physics_step,
                dispenser=self.dispenser,
                faults=self.faults,
            )

    def follow(self) -> Run:
        """Return the record of a machine that follows the program exactly, see `perfect_follower`."""
        with self.located():
            record = perfect_follower(self.built_machine, self.setpoints, dispenser=self.dispenser)
        return record.replaced(job=self)


def _without_noise(value: Any) -> Any:
    """Return a number without the last digits of floating point, so that a speed makes the value that it came from."""
    return float(f"{value:.12g}") if isinstance(value, float) else value
