"""The burden that a job has at least, before it is simulated.

The nozzle is nearer to the requested path than its command by at most the distance between the two, at every tick:

    contour error >= program's error - deviation        deviation: largest distance of the nozzle from its command

and so are the largest value and the 95th percentile. The program's error needs no simulation: it is that of a machine
that follows exactly. Of the deviation an upper bound is assumed: `REACH` times the largest in the runs of the job as it
is and of each of its levers alone. Stability is exact, and so is the contour error of a job that has been simulated
with other glue. Glue and machine are left out, as no row lowers a burden.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

from gantrysim.base.errors import GantryError
from gantrysim.job.job import Job
from gantrysim.metrics.parts import PartValues
from gantrysim.remedy.bench import Bench
from gantrysim.remedy.outcome import Motion, Outcome
from gantrysim.results.score import row_burden
from gantrysim.results.tolerance import Tolerance
from gantrysim.results.verdict import PATH, STABILITY, path_row, stability_row

REACH = 2.0
_SHARE = 0.5  # of a burden, in path and stability, below which there is no use in forecasts


class Forecast:
    """Forecasts the burden of a job with several levers set.

    Args:
        base: the job as it is.
        bench: has simulated it, and each of its levers alone.
    """

    def __init__(self, base: Job, bench: Bench) -> None:
        self._base = base
        self._bench = bench

    def is_worthwhile(self, present: Outcome) -> bool:
        """Return whether forecasts may rule out jobs that are no better than a present one: they take time, too."""
        if present.verdict is None:
            return False
        burden = sum(row_burden(present.verdict[name]) for name in (PATH, STABILITY))
        return burden >= _SHARE * present.burden and self._is_of_the_program

    @cached_property
    def _is_of_the_program(self) -> bool:
        """Whether the program's error exceeds the deviation that is assumed, for the job as it is."""
        budget = Motion.ideal(self._base).budget
        return budget is not None and budget.contour_values.max > self._reach([])

    def burden(self, job: Job, alone: Sequence[Job]) -> float:
        """Return the burden that a job has at least; 0 where nothing is known.

        Args:
            job: the job.
            alone: the jobs with each of its levers alone.
        """
        try:
            motion = self._bench.motion(job)
            reach = 0.0
            if motion is None:
                reach = self._reach(alone)
                motion = None if math.isinf(reach) else Motion.ideal(job)
            if motion is None or motion.budget is None:
                return 0.0
            contour = _less(motion.budget.contour_values, reach)
            tolerance = Tolerance.of(job, motion.run.face)
            path = path_row(contour, tolerance, lambda time: None)
            stability = stability_row(job, job.margins, tolerance)
        except GantryError:  # its run tells why it is refused
            return 0.0
        return row_burden(path) + row_burden(stability)

    def _reach(self, alone: Sequence[Job]) -> float:
        """Return the largest deviation that is assumed; inf where it is unknown [mm]."""
        return REACH * max(map(self._bench.deviation, (self._base, *alone)))


def _less(values: PartValues, reach: float) -> PartValues:
    """Return values of an error of which at most `reach` is taken away [mm]."""
    return replace(values, max=max(values.max - reach, 0.0), p95=max(values.p95 - reach, 0.0))
