"""`gantrysim study speed`: the fastest path speed at which a job stays within a tolerance."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property
from typing import Any

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import at_least
from gantrysim.job.job import Job, check_job
from gantrysim.study.acceptance import Acceptance, Criterion, JobCriterion, Scope, ToleranceStudy
from gantrysim.study.cases import Case, Row, measure
from gantrysim.study.runner import Measure
from gantrysim.study.study import Rounds

# The search for the fastest speed of a program that keeps its limits, with and without a warning.

SPEED_DIGITS = 4  # of a speed that is tried, and of the values that follow from it
RESOLUTION = 0.01  # relative width of the bracket of the fastest speed
_SWEEP = 9  # speeds of the first round, half an octave apart, the programmed one in the middle
_OCTAVES = 2  # on both sides of the programmed speed
_FURTHER_OCTAVES = 3  # more octaves on either side, one after the other, where the limit lies beyond
_SPEEDS_INSIDE = 3  # speeds per round inside the bracket


class Grade(IntEnum):
    """How well a run keeps its limits."""

    FAILED = 0
    WARNED = 1
    CLEAN = 2


@dataclass(frozen=True)
class SpeedAnswer:
    """The result of a search.

    Attributes:
        fastest: the fastest speed at which, and below which at all speeds tried, the run is within the tolerance; None
            if there is none [mm/s].
        above: the next faster speed tried, which is not within; None if there is none [mm/s].
        islands: faster speeds that are within again, ascending [mm/s].
    """

    fastest: float | None
    above: float | None
    islands: tuple[float, ...] = ()


def answer(tried: dict[float, bool]) -> SpeedAnswer:
    """Return the answer from whether each speed tried [mm/s] is within the tolerance."""
    speeds = sorted(tried)
    first = next((k for k, speed in enumerate(speeds) if not tried[speed]), len(speeds))
    islands = tuple(speed for speed in speeds[first:] if tried[speed])
    return SpeedAnswer(speeds[first - 1] if first else None, speeds[first] if first < len(speeds) else None, islands)


def answer_of(grades: dict[float, Grade], grade: Grade) -> SpeedAnswer:
    """Return the answer for runs of a grade or better, from the grade of each speed tried [mm/s]."""
    return answer({speed: reached >= grade for speed, reached in grades.items()})


def next_speeds_of_grades(grades: dict[float, Grade], programmed_speed: float, resolution: float) -> list[float]:
    """Return the speeds to try next for the fastest one without a failure, and then for that without a warning.

    Where every speed tried for the first has a warning, the second is not searched for beyond them.

    Args:
        grades: of the speeds tried.
        programmed_speed: of the job [mm/s].
        resolution: relative width of the brackets.
    """
    for grade in (Grade.WARNED, Grade.CLEAN):
        if grades and grade == Grade.CLEAN and answer_of(grades, grade).fastest is None:
            continue
        tried = {speed: reached >= grade for speed, reached in grades.items()}
        speeds = next_speeds(tried, programmed_speed, resolution)
        if speeds:
            return speeds
    return []


def speed_changes(job: Job, speed: float) -> dict[str, Any]:
    """Return the values of a job at another speed of its fastest motion [mm/s], with the same section of the bead.

    Raises:
        InputError: the program states no speed.
    """
    controller = job.controller
    factor = speed / controller.programmed_speed
    changes: dict[str, Any] = {}
    for key, value in controller.arguments_at(speed).items():
        # a number is printed for pasting, so that it must not end in digits of floating point
        changes[f"program.{key}"] = _few_digits(value) if isinstance(value, float) else value
    dispenser = job.dispenser
    if dispenser.flow:
        changes["dispenser.flow"] = _few_digits(factor * dispenser.flow)
    if dispenser.per_output:
        changes["dispenser.per_output"] = _few_digits(factor * dispenser.per_output)
    if dispenser.pressure and dispenser.needle is not None:
        flow = factor * float(dispenser.needle.flow(dispenser.pressure))
        changes["dispenser.pressure"] = _few_digits(float(dispenser.needle.pressure(flow)))
    return changes


def next_speeds(tried: dict[float, bool], programmed_speed: float, resolution: float) -> list[float]:
    """Return the speeds to try next, ascending; none at the end of the search [mm/s].

    First a sweep of two octaves on both sides of the programmed speed; then an octave at a time beyond its end, while
    everything tried is within the tolerance or nothing is; then speeds inside the bracket of the fastest one within and
    the next, evenly on a logarithmic scale, until it is narrow enough.

    Args:
        tried: whether each speed is within the tolerance.
        programmed_speed: of the job [mm/s].
        resolution: relative width of the bracket.
    """
    if not tried:
        return _rounded_speeds(programmed_speed * np.geomspace(2.0**-_OCTAVES, 2.0**_OCTAVES, _SWEEP))
    result = answer(tried)
    speeds = sorted(tried)
    furthest = 2.0 ** (_OCTAVES + _FURTHER_OCTAVES) * (1 - 1e-3)
    if result.fastest is None:
        if speeds[0] * furthest <= programmed_speed:
            return []
        return _rounded_speeds(np.array([0.5, math.sqrt(0.5)]) * speeds[0])
    if result.above is None:
        if speeds[-1] >= programmed_speed * furthest:
            return []
        return _rounded_speeds(np.array([math.sqrt(2.0), 2.0]) * speeds[-1])
    if result.above <= result.fastest * (1 + resolution):
        return []
    inside = _rounded_speeds(np.geomspace(result.fastest, result.above, _SPEEDS_INSIDE + 2)[1:-1])
    return [speed for speed in inside if speed not in tried]


def _rounded_speeds(speeds: Floats) -> list[float]:
    """Return speeds of few digits, each once."""
    return sorted({_few_digits(speed) for speed in speeds.tolist()})


def _few_digits(value: float) -> float:
    return float(f"{value:.{SPEED_DIGITS}g}")


@dataclass(frozen=True)
class SpeedStudy(ToleranceStudy):
    """The fastest path speed within a tolerance: a sweep, then rounds inside the bracket.

    The flow changes with the speed, so that the section of the bead stays. By the limits of the job, the fastest speed
    without a warning is searched for as well: the whole tolerance counts if a run of the sweep keeps it, otherwise
    the limits of the motion, with glue that is no worse than at the program's own speed.

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
        check_job(self.job)
        _ = self.criterion, self.programmed_speed
        # or the bracket could not be that narrow
        at_least("resolution", self.resolution, 10.0 ** (1 - SPEED_DIGITS))

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
        sweep = {speed_of(row): Acceptance.of(row) for row in rows if _round_of(row) == 1}
        return JobCriterion(scope=Scope.of(sweep.values(), sweep.get(self.programmed_speed)))

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
