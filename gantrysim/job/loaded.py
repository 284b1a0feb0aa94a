"""A job that is loaded from a file, with what its file and its caller leave open chosen for its program."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple, Self

from gantrysim.base.errors import AxisError, InputError, TimedError, wrong_type
from gantrysim.base.user_code import is_code
from gantrysim.controllers.controller import Controller
from gantrysim.glue.bead import BeadSettings
from gantrysim.glue.bead.section import Section
from gantrysim.glue.dispenser.needle import Needle
from gantrysim.job.content import Given, JobContent, Request, read_with_overrides
from gantrysim.job.loading import Recognised
from gantrysim.job.overrides import settings_of
from gantrysim.job.plan import check_servo_file
from gantrysim.job.program_place import fit_changes, share_text
from gantrysim.job.settings import (
    FILAMENT,
    GLUE,
    INTEGRAL_TIME,
    MACHINE,
    MACHINES,
    TURNING_MACHINE,
    has_loop_gains,
    smallest_machine,
)
from gantrysim.machine.machine import Machine
from gantrysim.machine.travel import travel_edit
from gantrysim.servo.laws import PD

# What a job's file leaves open and its program or machine decides: machine and glue, with a sentence on the choice.


CHOSEN = "chosen, as nothing was given: "  # begins the note on it


class OpenValues(NamedTuple):
    """What nobody gave.

    Attributes:
        machine: whether the machine is open.
        glue: whether the amount of glue is.
        integral_time: whether the servo's integral time is.
        height: whether the height of a program from a file is.
        place: whether its place in the plane is.
        travel: whether the travel of the machine is.
        gap: whether the height of the needle above the work is, where the height of a program from a file is given.
        speeds: whether the largest speeds of the program's axes are.
        acceleration: whether the acceleration of a program from a file is.
        dialect: what a program file was recognised as by its content; None where suffix or caller decides.
    """

    machine: bool
    glue: bool
    integral_time: bool
    height: bool
    place: bool
    travel: bool
    gap: bool
    speeds: bool
    acceleration: bool
    dialect: Recognised | None

    @classmethod
    def of(cls, content: Mapping[str, Any], dialect: Recognised | None = None) -> OpenValues:
        """Return what the content of a job's file, with the caller's values, leaves open."""
        dispenser = content.get("dispenser", {})
        program = content.get("program", {})
        servo = content.get("servo", {})
        law = servo.get("law", ())
        has_integral = PD.name not in ([law] if isinstance(law, str) else law)
        return cls(
            machine="machine" not in content,
            glue=not any(key in dispenser for key in GLUE),
            integral_time=has_integral and "integral_time" not in servo and not has_loop_gains(servo),
            height="source" in content and "z" not in program.get("placement", {}),
            place="source" in content and not {"x", "y"} & set(program.get("placement", {})),
            travel="machine" not in content and "travel" not in content,
            gap="source" in content and "z" in program.get("placement", {}) and "gap" not in content.get("bead", {}),
            speeds="axis_speeds" not in program,
            acceleration="source" in content and "acceleration" not in program,
            dialect=dialect,
        )


def glue_changes(job: JobContent, machine: Machine) -> dict[str, Any]:
    """Return the value that sets the amount of glue, by dotted name: what E feeds, or the needle presses flat."""
    if _feeds_material(job.controller) and job.dispenser.per_e:
        return {}
    if _feeds_material(job.controller):
        return {"dispenser.filament": job.controller.filament or FILAMENT}
    return {"dispenser.area": needle_area(machine, job.dispenser.needle, job.bead)}


def _feeds_material(controller: Controller) -> bool:
    """Return whether the program states the amount of material by E; False for a program that is refused."""
    try:
        return controller.feeds_material
    except InputError:
        return False


def machine_of(name: str, controller: Controller) -> str:
    """Return the built-in machine for a program that names none.

    Args:
        name: of the controller.
        controller: with its program; one that the controller refuses leaves the default, and so does the user's own
            code that raises anything: the run reports it.

    Raises:
        InputError: the program moves an axis that no machine for its controller has.
    """
    try:
        return TURNING_MACHINE if controller.commands_axes else smallest_machine(tuple(controller.axes))
    except AxisError as error:
        machines = ", ".join(f"{machine} ({', '.join(axes)})" for machine, axes in MACHINES.items())
        raise InputError(f"{error}; the built-in machines have the axes {machines}") from None
    except InputError:
        return MACHINE
    except (Exception, SystemExit):
        if not is_code(name):
            raise
        return MACHINE


def pressing_height(machine: Machine, face: float) -> float:
    """Return the height above the work at which a needle's face presses the default glue flat [mm].

    It is that of the machine at its zero, so that a needle that runs higher or lower lays the same section. Half the
    face stands for it where the needle hangs higher than it is wide, and its program lowers it.
    """
    return machine.gap if machine.gap <= face else 0.5 * face


def needle_face(machine: Machine, needle: Needle | None) -> float:
    """Return the outer diameter of the needle; a machine that draws none has the default one [mm]."""
    if needle is not None:
        return needle.face
    return Needle().face if machine.needle is None else machine.needle[0]


def needle_area(machine: Machine, needle: Needle | None, bead: BeadSettings) -> float:
    """Return the largest cross-section of a bead that the needle's face presses flat, to three digits [mm²].

    More would rise beside the needle and leave a groove; less leaves the bead narrower.
    """
    face = needle_face(machine, needle)
    section = Section.pressed_flat(pressing_height(machine, face), bead.contact_angle, face)
    return float(f"{section.area[0]:.3g}")


def choice_note(open_values: OpenValues, job: JobContent, controller: Controller, machine: Machine) -> str:
    """Return one sentence on what was chosen, and how to choose otherwise; empty where nothing was.

    Args:
        open_values: what nobody gave.
        job: with the choices.
        controller: with its program.
        machine: of the job.
    """
    gap = machine.gap
    parts = []
    if open_values.dialect is not None:
        controller_name, reason = open_values.dialect
        parts.append(f"read by {controller_name}, as {reason} (--controller NAME)")
    if open_values.machine:
        parts.append(f"machine {job.machine}, the smallest for this program (--machine NAME)")
    if open_values.travel and job.travel:
        ways = ", ".join(f"{axis} {low:g} to {high:g} mm" for axis, (low, high) in job.travel.items())
        parts.append(f"its travel made {ways}, as large as the program, with the same masses and stiffness")
    if open_values.glue and job.dispenser.filament:
        stated = "as the program states" if controller.filament else "which the program does not state"
        parts.append(
            f"glue as E feeds it, with a filament of {job.dispenser.filament:g} mm, {stated} (--set "
            "dispenser.filament=2.85, dispenser.e_volume=1 in mm³ for each mm of E, or dispenser.area=1)"
        )
    elif open_values.glue and job.dispenser.area:
        area = job.dispenser.area
        pressing = pressing_height(machine, needle_face(machine, job.dispenser.needle))
        where = "" if job.bead.gap is None and pressing == gap else f" {pressing:.4g} mm above the work"
        parts.append(
            f"glue {area:g} mm² times path speed{_flow_text(job, controller)}, what the needle presses flat{where}, "
            f"none at standstill (--set dispenser.area={area:g} or --set dispenser.flow=100)"
        )
    if open_values.acceleration and controller.assumed_acceleration:
        parts.append(
            f"acceleration {controller.assumed_acceleration:g} mm/s², which a file does not state (--set "
            "program.acceleration=inf for none)"
        )
    if open_values.integral_time:
        parts.append(
            f"integral time {INTEGRAL_TIME:g} s, as in the built-in jobs (--set servo.integral_time=inf for none)"
        )
    placement = job.program.get("placement", {})
    shift = [placement.get(axis, 0.0) for axis in "xy"]
    if open_values.place and any(shift):
        parts.append(
            f"program shifted by x {shift[0]:g}, y {shift[1]:g} mm, to the middle of the travel (--at 0,0 for its own "
            "place)"
        )
    if open_values.gap and job.bead.gap is not None:
        parts.append(
            f"needle {job.bead.gap:g} mm above the work, as placement.z leaves the lowest bead there (--set bead.gap "
            "where the surface lies higher)"
        )
    rise = placement.get("z", 0.0)
    if open_values.height and rise:
        parts.append(
            f"program {'raised' if rise > 0 else 'lowered'} by {abs(rise):g} mm, so that its lowest bead lies on the "
            f"work, the needle {gap if job.bead.gap is None else job.bead.gap:.4g} mm above it (--set "
            "program.placement.z=0 for its own heights)"
        )
    return f"{CHOSEN}{'; '.join(parts)}" if parts else ""


def _flow_text(job: JobContent, controller: Controller) -> str:
    """Return the flow at the program's fastest speed, in words; empty where the program states no speed."""
    if is_code(job.program["controller"]):
        return ""
    try:
        speed = controller.programmed_speed
    except InputError:
        return ""
    return f", {job.dispenser.area * speed:.3g} mm³/s at {speed:.4g} mm/s"


class LoadedJob(JobContent):
    """A job with its machine, see `gantrysim.job.job.Job`."""

    @classmethod
    def load(
        cls,
        job: str | os.PathLike[str],
        overrides: Iterable[str] | Mapping[str, Any] = (),
        machine: str | None = None,
        servo: str | os.PathLike[str] | None = None,
        *,
        controller: str | None = None,
        placement: Mapping[str, float] | None = None,
        speed: float | None = None,
        allow_code: bool = False,
    ) -> Self:
        """Return a built-in job, the job in a TOML file, or one that runs a program file.

        A file that names its own code, a law or a controller, is refused unless `allow_code` is true or the file lies
        in the current working folder. Code that the overrides name may run.

        Args:
            job: name of a built-in job, or path.
            overrides: values by their keys, such as {"program.loop_period": 0.002}, None for the default; or texts
                "key=value" with a TOML value. A key is dotted, or its last parts if they are unique.
            machine: machine to use instead of the job's.
            servo: TOML file whose table [servo] has values that replace the job's, before the overrides; one that gives
                a gain of the loop, or a rule for one, replaces all of these.
            controller: controller that reads a program file, such as "fanuc"; by default chosen by the file's suffix.
            placement: placement of the program on the work, attributes of `Placement` by name.
            speed: speed of the program's fastest motion, see `at_speed` [mm/s].
            allow_code: whether code that the job or the servo file names may run, wherever the file lies.

        Raises:
            InputError: an unknown job, an invalid key or value, or code that may not run.
        """
        if servo is not None and not isinstance(servo, str | os.PathLike):
            raise wrong_type("servo", servo, "a TOML file", "give values as overrides, such as {'servo.kp': 0.5}")
        table = None if servo is None else Path(servo)
        request = Request(str(job), settings_of(overrides), machine, table, controller, placement, allow_code)
        read = read_with_overrides(request)
        if read.refusal and not allow_code:
            raise InputError(read.refusal)
        chosen = cls.of_given(Given.of(read, request, speed), read.content, speed)
        if table is not None:
            check_servo_file(table, chosen.servo, chosen.built_machine)
        return chosen

    @classmethod
    def of_record(cls, file: Path) -> Self:
        """Return the job of a saved run; its own code is refused only if the job is run again."""
        read = read_with_overrides(Request(str(file)))
        return cls.of_content(read.content, read.label, read.refusal, is_record=True)

    @classmethod
    def of_given(cls, given: Given, content: dict[str, Any], speed: float | None, sibling: Self | None = None) -> Self:
        """Return the job of a content, with a machine, glue and a place for its program where nobody gave any.

        Args:
            given: what the job is loaded from.
            content: of it, with the values that were given.
            speed: of the program's fastest motion; None for its own [mm/s].
            sibling: job of the same file, with which machine and program are shared where they are the same.

        Raises:
            InputError: an invalid key or value.
        """
        job = cls.of_content(content, given.label)
        with job.locate_errors():
            job = job.with_called_files()
        if speed is not None:
            job = job.at_speed(speed)
        return job._with_choices(OpenValues.of(content, given.dialect), sibling).with_given(given)

    def loaded_with(
        self,
        values: Mapping[str, Any],
        *,
        in_file: bool = False,
        speed: float | None = None,
        sibling: Self | None = None,
    ) -> Self:
        """Return the job as it is loaded with further values: what nobody gives is chosen again, and may be another.

        A job that was not loaded gives every value itself.

        Args:
            values: by their full dotted keys, after the caller's options.
            in_file: whether the values stand in the job's file, and no options are given.
            speed: of the program's fastest motion, in place of the one that the caller gave [mm/s].
            sibling: job of the same file, with which machine and program are shared where they are the same; by default
                this one.

        Raises:
            InputError: an invalid key or value.
        """
        if self.given is None:
            changed = self.changed(values)
            return changed if speed is None else changed.at_speed(speed)
        content = self.given.with_values(values, in_file=in_file)
        if speed is None and not in_file:
            speed = self.given.speed
        return self.of_given(self.given, content, speed, self if sibling is None else sibling)

    def _with_choices(self, open_values: OpenValues, sibling: Self | None) -> Self:
        """Return the job with a machine and glue for its program, where nobody gave any; its first note says so."""
        name = self.program["controller"]
        job = self
        if open_values.machine:
            with self.locate_errors():
                job = job.changed({"machine": machine_of(name, job.controller)}).sharing(job)
        if open_values.acceleration and job.controller.assumed_acceleration:
            job = job.changed({"program.acceleration": job.controller.assumed_acceleration})
        if sibling is not None:
            job = job.sharing(sibling)
        if open_values.glue:
            job = job.changed(glue_changes(job, job.built_machine)).sharing(job)
        if not is_code(name):
            changes = fit_changes(job, job.built_machine, job.controller, open_values)
            job = job.changed(changes).sharing(job) if changes else job
        note = choice_note(open_values, job, job.controller, job.built_machine)
        return job.with_choice(note) if note else job

    def at_speed(self, speed: float) -> Self:
        """Return the job with its program at another speed.

        Args:
            speed: speed of the fastest motion; slower motions change in proportion [mm/s].

        Raises:
            InputError: the program states no speed, or the speed is not positive.
        """
        with self.locate_errors():
            arguments = self.controller.arguments_at(speed)
        return self.changed({f"program.{key}": _without_noise(value) for key, value in arguments.items()})

    @contextmanager
    def locate_errors(self) -> Iterator[None]:
        """Name the program's file, and the line where it is known, in errors that the program causes."""
        try:
            yield
        except InputError as error:
            text = str(error)
            line = None
            if isinstance(error, TimedError):
                line = self.controller.line_at(error.time - self.start_wait)
            if line is not None:
                text = f"line {line}: {text}"
            if not text.startswith("line "):
                raise
            raise InputError(f"{self.source or 'program'}: {text}") from None

    def sharing(self, other: Self) -> Self:
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

    @cached_property
    def built_machine(self) -> Machine:
        """The compiled machine."""
        machine = Machine(self.machine, self.names)
        if self.travel:
            machine = machine.edited(travel_edit(machine.plain_axes, self.travel))
        return machine if self.geometry is None else machine.with_geometry(self.geometry)

    @property
    def start_wait(self) -> float:
        """Time for which the dispenser holds the program back [s]."""
        return 0.0


def _without_noise(value: Any) -> Any:
    """Return a number without the last digits of floating point, so that a speed makes the value that it came from."""
    return float(f"{value:.12g}") if isinstance(value, float) else value
