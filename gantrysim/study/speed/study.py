"""`gantrysim study speed`: the fastest path speed at which a job stays within a tolerance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from gantrysim.base.errors import at_least
from gantrysim.study.acceptance import Acceptance, Scope
from gantrysim.study.cases import Case, Row, measure
from gantrysim.study.criterion import Criterion, JobCriterion, ToleranceStudy
from gantrysim.study.runner import Measure
from gantrysim.study.speed.search import RESOLUTION, SPEED_DIGITS, Grade, next_speeds_of_grades, speed_changes
from gantrysim.study.study import Rounds


@dataclass(frozen=True)
class SpeedStudy(ToleranceStudy):
    """The fastest path speed within a tolerance: a sweep, then rounds inside the bracket.

    The flow changes with the speed, so that the section of the bead stays. By the limits of the job, the fastest speed
    without a warning is searched for as well: the whole tolerance counts if a run of the sweep keeps it, otherwise
    the limits of the motion.

    A metric need not increase with speed. The result is therefore the fastest speed up to which every speed tried is
    within the tolerance. A run that is refused or ends in a fault is out of tolerance.

    Args:
        job: job whose speed is changed, see `Controller.arguments_at`.
        tolerance: tolerance of the metric, in its unit; None for the limits of the job itself.
        metric: name of a value in a case's row, by default contour_max; None without a tolerance.
        resolution: relative width of the bracket at the end.
        measure: function from a case to its row.
    """

    resolution: float = RESOLUTION
    measure: Measure = measure

    name = "speed"
    plots = ("speed", "links")

    def __post_init__(self) -> None:
        _ = self.criterion, self.programmed_speed
        at_least("resolution", self.resolution, 10.0 ** (1 - SPEED_DIGITS))  # or the bracket could not be that narrow

    @cached_property
    def programmed_speed(self) -> float:
        """The programmed speed [mm/s]."""
        return self.job.controller.programmed_speed

    def overrides(self, speed: float) -> dict[str, Any]:
        """Return the values that make the job run at another path speed [mm/s], by their dotted keys."""
        return speed_changes(self.job, speed)

    def rounds(self) -> Rounds:
        """Yield the speeds of each round.

        Raises:
            InputError: an unknown metric.
        """
        self.criterion.check(self.measure(Case.of(self.job, self.overrides(self.programmed_speed), "perfect follower")))
        rows: list[Row] = []
        while speeds := next_speeds_of_grades(self.grades(rows), self.programmed_speed, self.resolution):
            number = 1 + max((_round_of(row) for row in rows), default=0)
            rows += yield [Case.of(self.job, self.overrides(speed), round=number, speed_mm_s=speed) for speed in speeds]

    def criterion_of(self, rows: Sequence[Row]) -> Criterion:
        """Return the criterion by which the rows are compared."""
        if not isinstance(self.criterion, JobCriterion):
            return self.criterion
        sweep = (Acceptance.of(row) for row in rows if _round_of(row) == 1)
        return JobCriterion(scope=Scope.of(sweep))

    def grades(self, rows: Sequence[Row]) -> dict[float, Grade]:
        """Return how well each speed of the rows [mm/s] keeps the limits."""
        criterion = self.criterion_of(rows)
        return {speed_of(row): _grade(criterion, row) for row in rows}


def _grade(criterion: Criterion, row: Row) -> Grade:
    if not criterion.within(row):
        return Grade.FAILED
    return Grade.WARNED if criterion.warning(row) else Grade.CLEAN


def _round_of(row: Row) -> int:
    number = row.get("round", 1)
    assert isinstance(number, float | int)
    return int(number)


def speed_of(row: Row) -> float:
    """Return the programmed path speed of a case [mm/s]."""
    speed = row["speed_mm_s"]
    assert isinstance(speed, float)
    return speed
