"""`gantrysim study speed`: the fastest path speed at which a job stays within a tolerance."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

from gantrysim.errors import at_least
from gantrysim.job.job import Job
from gantrysim.study.cases import Case, Row, measure
from gantrysim.study.criterion import Criterion
from gantrysim.study.runner import Measure
from gantrysim.study.speed.figures import figures
from gantrysim.study.speed.findings import findings, speed_of
from gantrysim.study.speed.search import DIGITS, next_speeds
from gantrysim.study.study import Plot, Rounds


@dataclass(frozen=True)
class SpeedStudy:
    """The fastest path speed within a tolerance: a sweep, then rounds inside the bracket.

    A figure need not grow with the speed. The answer is therefore the fastest speed below which every speed that was
    tried is within the tolerance; a run that a fault ends, or that is refused, is not.

    Args:
        job: whose speed is changed; its controller says how, see `Controller.arguments_at`.
        tolerance: of the figure, in its unit.
        figure: of a case's row, as contour_max.
        resolution: how closely the answer is looked for, relative.
        measure: from a case to its row.
    """

    job: Job
    tolerance: float
    figure: str = "contour_max"
    resolution: float = 0.01
    measure: Measure = measure

    name = "speed"
    plots = ("speed", "links")

    def __post_init__(self) -> None:
        _ = self.criterion, self.own
        at_least("resolution", self.resolution, 10.0 ** (1 - DIGITS))  # or the bracket could not be that narrow

    @cached_property
    def criterion(self) -> Criterion:
        """The figure with its tolerance."""
        return Criterion(self.figure, self.tolerance)

    @cached_property
    def own(self) -> float:
        """The program's own speed [mm/s]."""
        return self.job.controller.programmed_speed

    @property
    def title(self) -> str:
        """Heads the report."""
        return f"How fast may {self.job.name} be?"

    @property
    def settings(self) -> dict[str, Any]:
        """What the study does with the job."""
        return {"tolerance": self.tolerance, "figure": self.figure, "resolution": self.resolution}

    def overrides(self, speed: float) -> dict[str, Any]:
        """Return the values that make the job run at another path speed [mm/s], by their dotted keys."""
        return {f"program.{key}": value for key, value in self.job.controller.arguments_at(speed).items()}

    def rounds(self) -> Rounds:
        """Yield the speeds of one round after the other.

        Raises:
            InputError: there is no such figure.
        """
        overrides = self.overrides(self.own)
        self.criterion.check(self.measure(Case.of(self.job, overrides, "perfect follower")))
        tried: dict[float, bool] = {}
        number = 0
        while speeds := next_speeds(tried, self.own, self.resolution):
            number += 1
            rows = yield [Case.of(self.job, self.overrides(speed), round=number, speed_mm_s=speed) for speed in speeds]
            tried |= {speed_of(row): self.criterion.within(row) for row in rows}

    def findings(self, rows: list[Row]) -> list[str]:
        """Return the answer, what sets the limit there, and what happens beyond."""
        return findings(self, rows)

    def figures(self, rows: list[Row]) -> list[Plot]:
        """Return the figure over the speed with the tolerance, and the links' parts over the speed."""
        return figures(self, rows)
