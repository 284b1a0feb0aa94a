"""Candidates of a search, their results and their order."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.servo.servo import Servo

BATCH = 1  # candidates of a round, unless a simplex begins or shrinks
RANKS = {1: "feasible", 2: "torque ripple too high", 3: "margin too small", 4: "fault"}  # of candidates that are run


@dataclass(frozen=True)
class SearchLimits:
    """Limits of a search.

    Attributes:
        machines: number of machines on which a candidate is run.
        budget: maximum number of runs, at least 2 for each machine: the start and one candidate.
        ripple: largest torque ripple allowed, a share of the peak torque.
        seed: of the random numbers.
        batch: number of points of a simplex that are moved at once.
        of_largest: whether the metric is a largest error, which much velocity feed-forward may lower.
    """

    machines: int
    budget: int
    ripple: float
    seed: int
    batch: int = BATCH
    of_largest: bool = False


@dataclass(frozen=True)
class TrialResult:
    """Result of a run.

    Attributes:
        metric: to be minimised; inf where a fault ended the run.
        ripple: torque ripple as a share of the peak torque, the largest of all axes.
        fault: time of the fault that ended the run, or None [s].
    """

    metric: float
    ripple: float = 0.0
    fault: float | None = None


@dataclass(eq=False)
class Candidate:
    """A servo considered by the search.

    Attributes:
        round: of the search; 0 of the start.
        number: within its round, from 1.
        servo: with its gains.
        excess: of the margin, as in `Stability`; above 0 the margin is not kept.
        results: by the number of the machine.
        runs: number of runs the search had made when the candidate was last run.
        point: its coordinates, (d,); (0,) of a start that is not at a point.
    """

    round: int
    number: int
    servo: Servo
    excess: float = 0.0
    results: dict[int, TrialResult] = field(default_factory=dict)
    runs: int = 0
    point: Floats = field(default_factory=lambda: np.empty(0))

    def order(self, ripple: float) -> tuple[int, float]:
        """Return rank and amount from the results so far; `ripple` is the largest allowed, a share of peak torque."""
        faults = [result.fault for result in self.results.values() if result.fault is not None]
        if faults:
            # a later fault is nearer to none: the search has a slope to follow
            return 4, -min(faults)
        if self.excess > 0:
            # only the start is run without the margin
            return 3 if self.results else 5, self.excess
        if self.ripple > ripple:
            return 2, math.log(self.ripple / ripple)
        return 1, self.metric

    @property
    def metric(self) -> float:
        """The largest over the machines run so far."""
        return max((result.metric for result in self.results.values()), default=math.inf)

    @property
    def ripple(self) -> float:
        """The largest over the machines run so far."""
        return max((result.ripple for result in self.results.values()), default=math.inf)

    @property
    def hardest(self) -> int:
        """Number of the machine with the earliest fault, or else the largest metric."""
        faults = {
            machine: math.inf if result.fault is None else result.fault for machine, result in self.results.items()
        }
        return max(self.results, key=lambda machine: (-faults[machine], self.results[machine].metric))


@dataclass(frozen=True)
class Trial:
    """A planned run: a candidate on a machine, by its number."""

    candidate: Candidate
    machine: int
