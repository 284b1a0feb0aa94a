"""What a job's file leaves open and its program or machine decides: machine and glue, with a sentence on the choice."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from gantrysim.base.errors import InputError
from gantrysim.base.user_code import is_code
from gantrysim.bead import BeadSettings
from gantrysim.bead.section import Section
from gantrysim.controllers.controller import Controller
from gantrysim.dispenser.needle import Needle
from gantrysim.job.content import JobContent
from gantrysim.job.defaults import GLUE, INTEGRAL_TIME, MACHINE, TURNING_MACHINE, smallest_machine
from gantrysim.job.settings import has_loop_gains
from gantrysim.machine.machine import Machine
from gantrysim.servo.laws import PD


class OpenValues(NamedTuple):
    """What nobody gave.

    Attributes:
        machine: whether the machine is open.
        glue: whether the amount of glue is.
        integral_time: whether the servo's integral time is.
    """

    machine: bool
    glue: bool
    integral_time: bool

    @classmethod
    def of(cls, content: Mapping[str, Any]) -> OpenValues:
        """Return what the content of a job's file, with the caller's values, leaves open."""
        dispenser = content.get("dispenser", {})
        servo = content.get("servo", {})
        law = servo.get("law", ())
        has_integral = PD.name not in ([law] if isinstance(law, str) else law)
        return cls(
            machine="machine" not in content,
            glue=not any(key in dispenser for key in GLUE),
            integral_time=has_integral and "integral_time" not in servo and not has_loop_gains(servo),
        )


def machine_of(name: str, controller: Controller) -> str:
    """Return the built-in machine for a program that names none.

    Args:
        name: of the controller. The user's own code is not asked here: a run reports what it raises.
        controller: with its program; one that the controller refuses leaves the default, and the run reports it.
    """
    if is_code(name):
        return MACHINE
    if controller.commands_axes:
        return TURNING_MACHINE
    try:
        return smallest_machine(controller.axes)
    except InputError:
        return MACHINE


def needle_area(machine: Machine, needle: Needle | None, bead: BeadSettings) -> float:
    """Return the largest cross-section of a bead that the needle's face presses flat, to three digits [mm²].

    More would rise beside the needle and leave a groove; less leaves the bead narrower. A machine that draws no needle
    has the default one.
    """
    drawn_face = Needle().face if machine.needle is None else machine.needle[0]
    face = drawn_face if needle is None else needle.face
    gap = machine.gap if bead.gap is None else bead.gap
    # a nozzle that hangs high above the work at home is lowered by its program; a bead is no higher than its needle
    section = Section.pressed_flat(min(gap, face), bead.contact_angle, face)
    return float(f"{section.area[0]:.3g}")


def choice_note(open_values: OpenValues, job: JobContent, controller: Controller) -> str:
    """Return one sentence on what was chosen, and how to choose otherwise."""
    parts = []
    if open_values.machine:
        parts.append(f"machine {job.machine}, the smallest for this program (--machine NAME)")
    if open_values.glue:
        area = job.dispenser.area
        parts.append(
            f"glue {area:g} mm² times path speed{_flow_text(job, controller)}, what the needle presses flat, none at "
            f"standstill (--set dispenser.area={area:g} or --set dispenser.flow=100)"
        )
    if open_values.integral_time:
        parts.append(
            f"integral time {INTEGRAL_TIME:g} s, as in the built-in jobs (--set servo.integral_time=inf for none)"
        )
    return f"chosen, as nothing was given: {'; '.join(parts)}"


def _flow_text(job: JobContent, controller: Controller) -> str:
    """Return the flow at the program's fastest speed, in words; empty where the program states no speed."""
    if is_code(job.program["controller"]):
        return ""
    try:
        speed = controller.programmed_speed
    except InputError:
        return ""
    return f", {job.dispenser.area * speed:.3g} mm³/s at {speed:.4g} mm/s"
