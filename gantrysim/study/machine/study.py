"""The machine study: the yield of a job over machines built to one drawing."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError, whole_number
from gantrysim.job.job import check_job
from gantrysim.machine.perturbation import Perturbation
from gantrysim.machine.tolerances import Tolerances
from gantrysim.study.acceptance import Acceptance, Criterion, JobCriterion, Scope, ToleranceStudy
from gantrysim.study.cases import Case, Row, measure
from gantrysim.study.runner import Measure
from gantrysim.study.study import Rounds

_MOST_SAMPLES = 10_000  # samples: by then the yield is known to a hundredth


@dataclass(frozen=True)
class MachineStudy(ToleranceStudy):
    """Monte Carlo over differing machines, each with the servo gains of the nominal one.

    The machines are drawn from a Latin hypercube: of n machines, one lies in each n-th of a factor's range.

    Args:
        job: job to run.
        tolerance: tolerance of the metric, in its unit; None for the limits of the job itself.
        metric: name of a value in a case's row, by default contour_max; None without a tolerance.
        samples: number of machines besides the nominal one.
        spread: range of every factor.
        seed: seed of the random numbers; the same seed draws the same machines.
        measure: function from a case to its row.
    """

    samples: int = 128
    spread: Tolerances = field(default_factory=Tolerances)
    seed: int = 1
    measure: Measure = measure

    name = "machine"
    plots = ("yield", "influence", "scatter")

    def __post_init__(self) -> None:
        check_job(self.job)
        whole_number("seed", self.seed, 0)
        _ = self.criterion
        if not self.spread.columns(self.job.built_machine):
            raise InputError("spread: must be above 0 for at least one factor")
        count = len(self.spread.columns(self.job.built_machine))
        if whole_number("samples", self.samples, 1) < count + 3:
            raise InputError(f"samples = {self.samples}: must be at least {count + 3}, for {count} factors")
        if self.samples > _MOST_SAMPLES:
            raise InputError(f"samples = {self.samples}: must be at most {_MOST_SAMPLES}")

    @cached_property
    def machines(self) -> dict[str, Floats]:
        """Values of every factor by the name of its column, (samples,)."""
        return self.spread.hypercube(self.job.built_machine, self.samples, self.seed)

    def perturbation(self, sample: int) -> Perturbation:
        """Return the perturbation of a machine by its number, from 1."""
        values = {name: float(column[sample - 1]) for name, column in self.machines.items()}
        return self.spread.perturbation(values, self.job.built_machine)

    def rounds(self) -> Rounds:
        """Yield the nominal machine and all others.

        Raises:
            InputError: an unknown metric.
        """
        self.criterion.check(self.measure(Case.of(self.job, mode="perfect follower")))
        nominal = Case.of(self.job)
        nothing = dict.fromkeys(self.machines, 1.0)
        if self.spread.payload:
            nothing["payload_kg"] = 0.0
        cases = [nominal.tagged(sample=0, **nothing)]
        for sample in range(1, self.samples + 1):
            factors = {name: float(values[sample - 1]) for name, values in self.machines.items()}
            perturbed = replace(nominal, perturbation=self.perturbation(sample))
            cases.append(perturbed.tagged(sample=sample, **factors))
        yield cases

    def criterion_of(self, nominal: Row) -> Criterion:
        """Return the criterion for the rows: the job's full tolerance if the nominal machine keeps it."""
        if not isinstance(self.criterion, JobCriterion):
            return self.criterion
        return replace(self.criterion, scope=Scope.of([Acceptance.of(nominal)]))
