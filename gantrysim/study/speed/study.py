"""`gantrysim study speed`: the fastest path speed at which a job stays within a tolerance."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import at_least
from gantrysim.study.cases import Case, Row, measure
from gantrysim.study.criterion import ToleranceStudy
from gantrysim.study.runner import Measure
from gantrysim.study.study import Rounds

_DIGITS = 4  # of a speed
_SWEEP = 9  # speeds of the first round, half an octave apart, the programmed one in the middle
_OCTAVES = 2  # on both sides of the programmed speed
_FURTHER = 3  # more octaves on either side, one after the other, where the limit lies beyond
_INSIDE = 3  # speeds per round inside the bracket


@dataclass(frozen=True)
class SpeedStudy(ToleranceStudy):
    """The fastest path speed within a tolerance: a sweep, then rounds inside the bracket.

    A metric need not increase with speed. The result is therefore the fastest speed up to which every speed tried is
    within the tolerance. A run that is refused or ends in a fault is out of tolerance.

    Args:
        job: job whose speed is changed, see `Controller.arguments_at`.
        tolerance: tolerance of the metric, in its unit; None for the limits of the job itself.
        metric: name of a value in a case's row, by default contour_max; None without a tolerance.
        resolution: relative width of the bracket at the end.
        measure: function from a case to its row.
    """

    resolution: float = 0.01
    measure: Measure = measure

    name = "speed"
    plots = ("speed", "links")

    def __post_init__(self) -> None:
        _ = self.criterion, self.programmed_speed
        at_least("resolution", self.resolution, 10.0 ** (1 - _DIGITS))  # or the bracket could not be that narrow

    @cached_property
    def programmed_speed(self) -> float:
        """The programmed speed [mm/s]."""
        return self.job.controller.programmed_speed

    def overrides(self, speed: float) -> dict[str, Any]:
        """Return the values that make the job run at another path speed [mm/s], by their dotted keys."""
        return {f"program.{key}": value for key, value in self.job.controller.arguments_at(speed).items()}

    def rounds(self) -> Rounds:
        """Yield the speeds of each round.

        Raises:
            InputError: an unknown metric.
        """
        self.criterion.check(self.measure(Case.of(self.job, self.overrides(self.programmed_speed), "perfect follower")))
        tried: dict[float, bool] = {}
        number = 0
        while speeds := next_speeds(tried, self.programmed_speed, self.resolution):
            number += 1
            rows = yield [Case.of(self.job, self.overrides(speed), round=number, speed_mm_s=speed) for speed in speeds]
            tried |= self.tried(rows)

    def tried(self, rows: Sequence[Row]) -> dict[float, bool]:
        """Return whether each speed of the rows [mm/s] is within the tolerance."""
        return {speed_of(row): self.criterion.within(row) for row in rows}


def speed_of(row: Row) -> float:
    """Return the programmed path speed of a case [mm/s]."""
    speed = row["speed_mm_s"]
    assert isinstance(speed, float)
    return speed


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
        return _rounded(programmed_speed * np.geomspace(2.0**-_OCTAVES, 2.0**_OCTAVES, _SWEEP))
    result = answer(tried)
    speeds = sorted(tried)
    furthest = 2.0 ** (_OCTAVES + _FURTHER) * (1 - 1e-3)
    if result.fastest is None:
        if speeds[0] * furthest <= programmed_speed:
            return []
        return _rounded(np.array([0.5, math.sqrt(0.5)]) * speeds[0])
    if result.above is None:
        if speeds[-1] >= programmed_speed * furthest:
            return []
        return _rounded(np.array([math.sqrt(2.0), 2.0]) * speeds[-1])
    if result.above <= result.fastest * (1 + resolution):
        return []
    inside = _rounded(np.geomspace(result.fastest, result.above, _INSIDE + 2)[1:-1])
    return [speed for speed in inside if speed not in tried]


def _rounded(speeds: Floats) -> list[float]:
    """Return speeds of few digits, each once."""
    return sorted({float(f"{speed:.{_DIGITS}g}") for speed in speeds})
