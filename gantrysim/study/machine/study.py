"""`gantrysim study machine`: how many of all the machines that are built to one drawing keep to a tolerance."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from gantrysim.arrays import Floats
from gantrysim.errors import InputError, whole
from gantrysim.job.job import Job
from gantrysim.machine.perturbation import Perturbation
from gantrysim.machine.tolerances import Tolerances
from gantrysim.study.cases import Case, Row, measure
from gantrysim.study.criterion import Criterion
from gantrysim.study.machine.figures import figures
from gantrysim.study.machine.findings import findings
from gantrysim.study.runner import Measure
from gantrysim.study.study import Plot, Rounds

_MOST = 10_000  # samples: by then the yield is known to a hundredth


@dataclass(frozen=True)
class MachineStudy:
    """Monte Carlo over machines: the job runs on many that differ, each with the gains of the nominal one.

    The machines are drawn from a Latin hypercube: of n machines each factor has one in each n-th of its range.

    Args:
        job: to run.
        tolerance: of the figure, in its unit.
        figure: of a case's row, as contour_max.
        samples: number of machines besides the nominal one.
        spread: how far they differ.
        seed: of the random numbers; the same seed draws the same machines.
        measure: from a case to its row.
    """

    job: Job
    tolerance: float
    figure: str = "contour_max"
    samples: int = 128
    spread: Tolerances = field(default_factory=Tolerances)
    seed: int = 1
    measure: Measure = measure

    name = "machine"
    plots = ("yield", "influence", "scatter")

    def __post_init__(self) -> None:
        whole("seed", self.seed, 0)
        _ = self.criterion
        if not any(asdict(self.spread).values()):
            raise InputError("spread: must be above 0 for at least one factor")
        count = len(self._spreads)
        if whole("samples", self.samples, 1) < count + 3:
            raise InputError(f"samples = {self.samples}: must be at least {count + 3}, for {count} factors")
        if self.samples > _MOST:
            raise InputError(f"samples = {self.samples}: must be at most {_MOST}")

    @cached_property
    def criterion(self) -> Criterion:
        """The figure with its tolerance."""
        return Criterion(self.figure, self.tolerance)

    @property
    def title(self) -> str:
        """Heads the report."""
        return f"How many machines keep {self.job.name} within its tolerance?"

    @property
    def settings(self) -> dict[str, Any]:
        """What the study does with the job."""
        return {
            "tolerance": self.tolerance,
            "figure": self.figure,
            "samples": self.samples,
            "seed": self.seed,
            "spread": asdict(self.spread),
        }

    @cached_property
    def _spreads(self) -> dict[str, float]:
        """Tolerances of every factor by the name of its column."""
        return self.spread.columns(self.job.built_machine)

    @cached_property
    def machines(self) -> dict[str, Floats]:
        """The machines: values of every factor by the name of its column, (samples,)."""
        return self.spread.hypercube(self.job.built_machine, self.samples, self.seed)

    def perturbation(self, sample: int) -> Perturbation:
        """Return what of a machine differs from the nominal one.

        Args:
            sample: its number, from 1.
        """
        values = {name: float(column[sample - 1]) for name, column in self.machines.items()}
        return self.spread.perturbation(values, self.job.built_machine)

    def rounds(self) -> Rounds:
        """Yield the nominal machine and all the others.

        Raises:
            InputError: there is no such figure.
        """
        self.criterion.check(self.measure(Case.of(self.job, mode="perfect follower")))
        nominal, nothing = Case.of(self.job), dict.fromkeys(self.machines, 1.0)
        if self.spread.payload:
            nothing["payload_kg"] = 0.0
        yield [
            nominal.tagged(sample=0, **nothing),
            *(
                replace(nominal, perturbation=self.perturbation(number)).tagged(
                    sample=number, **{name: float(values[number - 1]) for name, values in self.machines.items()}
                )
                for number in range(1, self.samples + 1)
            ),
        ]

    def drawn(self, rows: list[Row]) -> tuple[Row, list[Row], Floats]:
        """Return the nominal machine's row, those of the others, and the figure of these, (samples,)."""
        nominal, others = rows[0], rows[1:]
        return nominal, others, np.array([self.criterion.value(row) for row in others])

    def findings(self, rows: list[Row]) -> list[str]:
        """Return the yield, what matters most, and what was varied."""
        return findings(self, rows)

    def figures(self, rows: list[Row]) -> list[Plot]:
        """Return the distribution of the figure, the factors' influence, and the figure over those that matter most."""
        return figures(self, rows)
