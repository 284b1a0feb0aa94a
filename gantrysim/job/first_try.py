"""What a job's file leaves open and its program or machine decides: machine and glue, with a sentence on the choice."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from gantrysim.base.errors import AxisError, InputError
from gantrysim.base.user_code import is_code
from gantrysim.controllers.controller import Controller
from gantrysim.glue.bead import BeadSettings
from gantrysim.glue.bead.section import Section
from gantrysim.glue.dispenser.needle import Needle
from gantrysim.job.content import JobContent
from gantrysim.job.defaults import GLUE, INTEGRAL_TIME, MACHINE, MACHINES, TURNING_MACHINE, smallest_machine
from gantrysim.job.recognition import Recognised
from gantrysim.job.settings import has_loop_gains
from gantrysim.machine.machine import Machine
from gantrysim.servo.laws import PD


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
            dialect=dialect,
        )


def glue_changes(job: JobContent, machine: Machine) -> dict[str, Any]:
    """Return the value that sets the amount of glue to what the needle of the job presses flat, by dotted name."""
    return {"dispenser.area": needle_area(machine, job.dispenser.needle, job.bead)}


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


def needle_area(machine: Machine, needle: Needle | None, bead: BeadSettings) -> float:
    """Return the largest cross-section of a bead that the needle's face presses flat, to three digits [mm²].

    More would rise beside the needle and leave a groove; less leaves the bead narrower. A machine that draws no needle
    has the default one. It is the section under the needle at the machine's zero: one that runs higher or lower lays
    the same glue.
    """
    drawn_face = Needle().face if machine.needle is None else machine.needle[0]
    face = drawn_face if needle is None else needle.face
    # a nozzle that hangs high above the work at home is lowered by its program; a bead is no higher than its needle
    is_high = machine.gap > face
    gap = bead.gap if is_high and bead.gap is not None else machine.gap
    section = Section.pressed_flat(min(gap, face), bead.contact_angle, face)
    return float(f"{section.area[0]:.3g}")


def choice_note(open_values: OpenValues, job: JobContent, controller: Controller, gap: float) -> str:
    """Return one sentence on what was chosen, and how to choose otherwise; empty where nothing was.

    Args:
        open_values: what nobody gave.
        job: with the choices.
        controller: with its program.
        gap: height of the machine's needle above the work at its zero [mm].
    """
    parts = []
    if open_values.dialect is not None:
        controller_name, reason = open_values.dialect
        parts.append(f"read by {controller_name}, as {reason} (--controller NAME)")
    if open_values.machine:
        parts.append(f"machine {job.machine}, the smallest for this program (--machine NAME)")
    if open_values.travel and job.travel:
        ways = ", ".join(f"{axis} {low:g} to {high:g} mm" for axis, (low, high) in job.travel.items())
        parts.append(f"its travel made {ways}, as large as the program, with the same masses and stiffness")
    if open_values.glue:
        area = job.dispenser.area
        where = f" {gap:.4g} mm above the work" if job.bead.gap is not None else ""
        parts.append(
            f"glue {area:g} mm² times path speed{_flow_text(job, controller)}, what the needle presses flat{where}, "
            f"none at standstill (--set dispenser.area={area:g} or --set dispenser.flow=100)"
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
    return f"chosen, as nothing was given: {'; '.join(parts)}" if parts else ""


def _flow_text(job: JobContent, controller: Controller) -> str:
    """Return the flow at the program's fastest speed, in words; empty where the program states no speed."""
    if is_code(job.program["controller"]):
        return ""
    try:
        speed = controller.programmed_speed
    except InputError:
        return ""
    return f", {job.dispenser.area * speed:.3g} mm³/s at {speed:.4g} mm/s"
