"""What a run is judged, reported and filmed by: its job, or for a run without one its rig and default tolerances."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

from gantrysim.engine.recording import dispenser_notes
from gantrysim.engine.rig import Rig
from gantrysim.faults import InjectedFault
from gantrysim.glue.bead import BeadSettings
from gantrysim.glue.dispenser.dispenser import Dispenser
from gantrysim.job.job import check_job
from gantrysim.job.margins import machine_notes
from gantrysim.job.tolerance import Tolerance, ToleranceSettings
from gantrysim.machine.machine import Machine
from gantrysim.record.run import Run
from gantrysim.servo.servo import Servo
from gantrysim.servo.stability.margins import Margins, margins_of

WITHOUT_JOB = (
    "No job: the run was simulated from setpoints in Python. All tolerances, and the shape of the bead, are defaults. "
    "Causes and changes are found, and a [tolerance] is given, in a job: gantrysim.Job.load."
)


class Basis(Protocol):
    """What results need of a job, see `gantrysim.job.job.Job`."""

    @property
    def name(self) -> str:
        """Name of the job."""

    @property
    def built_machine(self) -> Machine:
        """The compiled machine."""

    @property
    def built_servo(self) -> Servo:
        """The servo with its gains."""

    @property
    def margins(self) -> tuple[Margins, ...] | None:
        """Stability margins of each axis, None where they are not known."""

    @property
    def servo_reason(self) -> str:
        """Explanation of the servo's gains."""

    @property
    def dispenser(self) -> Dispenser:
        """Dispenser of the glue."""

    @property
    def bead(self) -> BeadSettings:
        """Shape of the bead and grid of its height map."""

    @property
    def faults(self) -> Sequence[InjectedFault]:
        """Deliberate faults."""

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on what was chosen and what is unusual."""

    def limits(self, needle: float, width: float = math.nan) -> Tolerance:
        """Return the limits that a good run keeps, see `gantrysim.job.job.Job.limits`."""


def check_basis(value: object) -> None:
    """Raise InputError for what is likely to be given in the place of a job: a run, a name or a file."""
    if not isinstance(value, RigBasis):
        check_job(value)


@dataclass(frozen=True, eq=False)
class RigBasis:
    """The rig of a run without a job, with default tolerances and a default bead.

    Attributes:
        rig: machine, servo and dispenser.
        run: the record.
    """

    rig: Rig
    run: Run

    @property
    def name(self) -> str:
        return "simulation"

    @property
    def built_machine(self) -> Machine:
        return self.rig.machine

    @property
    def built_servo(self) -> Servo:
        return self.rig.servo

    @cached_property
    def margins(self) -> tuple[Margins, ...] | None:
        return None if self.rig.has_own_law else margins_of(self.rig.machine, self.rig.servo)

    @property
    def servo_reason(self) -> str:
        return "the gains are those of the servo that was given"

    @property
    def dispenser(self) -> Dispenser:
        return self.rig.dispenser

    @property
    def bead(self) -> BeadSettings:
        return BeadSettings()

    @property
    def faults(self) -> Sequence[InjectedFault]:
        return self.run.injected

    @cached_property
    def notes(self) -> tuple[str, ...]:
        rig = self.rig
        dispenser = dispenser_notes(self.run, rig.dispenser) if rig.dispenser.flows_at_all else ()
        return (WITHOUT_JOB, *machine_notes(rig.machine, self.margins, rig.servo), *dispenser)

    def limits(self, needle: float, width: float = math.nan) -> Tolerance:
        counts = [axis.resolution for axis in self.rig.machine.axes if axis.unit == "mm"]
        return Tolerance.of(ToleranceSettings(), needle, counts, width)
