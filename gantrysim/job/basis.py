"""What a run is judged, reported and filmed by: its job, or for a run without one its rig and default tolerances.

Of a program, the line that is active at a time of the run.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol, TypeGuard, cast

import numpy as np
from numpy.typing import NDArray

from gantrysim.base import memory
from gantrysim.base.arrays import Floats
from gantrysim.engine.recording import dispenser_notes
from gantrysim.engine.rig import Rig
from gantrysim.faults import InjectedFault
from gantrysim.glue.bead import BeadSettings
from gantrysim.glue.dispenser.dispenser import Dispenser
from gantrysim.job.job import Job, check_job
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

_CONTROLLER_PERIOD = 1e-3  # [s], of the ticks to which controllers round the ends of their moves


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


def program_lines(job: Basis, ticks: int) -> Callable[[float], int | None]:
    """Return a function from a time of the run [s] to the line of the program's text, None where it is not known.

    It is not known for a run that waits for its axes to settle, as waits shift the program against the run, for servo
    periods to which the controller rounds its moves otherwise, for long runs, whose setpoints are not in memory, nor
    without a job.

    Args:
        job: the job.
        ticks: of its run.
    """
    if not _has_lines(job, ticks):
        return lambda time: None
    delay = job.start_wait

    def line_at(time: float) -> int | None:
        return None if time < delay else job.controller.line_at(time - delay)

    return line_at


def program_lines_at(job: Basis, ticks: int, times: Floats) -> NDArray[np.intp]:
    """Return the lines of the program's text at times of the run [s], 0 where they are not known, (n,).

    Args:
        job: the job.
        ticks: of its run.
        times: of its run, (n,) [s].
    """
    lines = np.zeros(times.size, np.intp)
    if _has_lines(job, ticks):
        delay = job.start_wait
        begun = times >= delay
        lines[begun] = job.controller.lines_at(times[begun] - delay)
    return lines


def _has_lines(job: Basis, ticks: int) -> TypeGuard[Job]:
    """Return whether lines of the program are known by the run's time."""
    if isinstance(job, RigBasis):
        return False
    whole_periods = abs(job.built_servo.period - _CONTROLLER_PERIOD) <= 1e-12
    return ticks <= memory.LONG_RUN and whole_periods and not cast(Job, job).setpoints.gates.size
