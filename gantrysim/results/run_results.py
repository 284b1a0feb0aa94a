"""Everything that is evaluated of one run."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from gantrysim.base.errors import InputError
from gantrysim.glue.bead import Bead, BeadValues
from gantrysim.job.basis import Basis, program_lines
from gantrysim.job.causes import Causes
from gantrysim.job.job import Job
from gantrysim.job.losses import Losses
from gantrysim.job.scatter import Scatter
from gantrysim.machine.machine import Machine
from gantrysim.metrics.analysis import torque_ripple
from gantrysim.metrics.budget import Budget
from gantrysim.results.glue import DotVerdict, dot_verdicts
from gantrysim.results.glue_causes import GlueCauses
from gantrysim.results.verdict import Verdict, places_of
from gantrysim.servo.stability.loops import Margins


@dataclass(frozen=True)
class AxisLoop:
    """The servo loop of one axis in a run.

    Attributes:
        margins: at the home position; None where they are unknown.
        torque_ripple: while the dispenser is on, see `gantrysim.metrics.torque_ripple` [N·m].
        torque_ripple_share: of the peak torque.
    """

    margins: Margins | None
    torque_ripple: float
    torque_ripple_share: float


@dataclass(frozen=True)
class RunResults:
    """Results of a run, and of the further runs made to explain it.

    Attributes:
        basis: the job, or what judges a run without one.
        machine: on which it ran.
        budget: error budget of its record.
        bead: the bead; None where it is not evaluated.
        causes: worth of each cause of error; None unless the job was run again without each.
        glue_causes: worth of each cause of the bead's error; None where the glue passes, or they were not looked for.
        losses: what deliberate faults cost; None unless the job was run again without them.
        scatter: scatter of the figures; None unless the job was repeated.
    """

    basis: Basis
    machine: Machine
    budget: Budget
    bead: Bead | None = None
    causes: Causes | None = None
    glue_causes: GlueCauses | None = None
    losses: Losses | None = None
    scatter: Scatter | None = None

    @property
    def job(self) -> Job:
        """The job.

        Raises:
            InputError: a run without one.
        """
        if not isinstance(self.basis, Job):
            raise InputError("the run has no job: it was simulated from setpoints in Python")
        return self.basis

    @property
    def bead_values(self) -> BeadValues | None:
        """Values of the bead, None without glue."""
        return self.bead.values if self.bead is not None and self.bead.nominal > 0 else None

    @cached_property
    def dots(self) -> tuple[DotVerdict, ...]:
        """The dots of a complete run with their verdicts."""
        tolerance = self.verdict.tolerance
        if self.bead is None or tolerance is None:
            return ()
        run = self.budget.analysis.run
        return dot_verdicts(self.bead, tolerance, places_of(run, program_lines(self.basis, len(run.time))))

    @cached_property
    def loops(self) -> dict[str, AxisLoop]:
        """The servo loop of each axis by its name."""
        axes = self.machine.axes
        ripples = torque_ripple(self.budget.analysis.run).tolist()
        margins = self.basis.margins or (None,) * len(axes)
        return {
            axis.name: AxisLoop(axis_margins, ripple, ripple / axis.peak_torque)
            for axis, axis_margins, ripple in zip(axes, margins, ripples, strict=True)
        }

    @cached_property
    def verdict(self) -> Verdict:
        """Whether the run is good enough."""
        analysis = self.budget.analysis
        bead = Bead(analysis.run, self.basis.bead, analysis) if self.bead is None else self.bead
        return Verdict.of_results(self.basis, self.budget, bead)
