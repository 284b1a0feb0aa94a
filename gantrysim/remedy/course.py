"""A run that a search makes as far as it may still matter.

The burden of a verdict is a sum to which no check adds less than 0, see `gantrysim.results.score`. What is known of a
run therefore bounds it from below: after a part of the run the margins of the loops and the contour error so far, as if
the rest had none; after the whole run all but the glue; then all but the needle's passes through the glue. A search
drops a job whose bound is above what it looks for.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from gantrysim.base import memory
from gantrysim.base.errors import GantryError, InputError
from gantrysim.engine.simulate import records_in_parts
from gantrysim.engine.simulation import Simulation
from gantrysim.glue.bead import Bead
from gantrysim.job.job import Job
from gantrysim.metrics.analysis import Analysis
from gantrysim.record.run import Run
from gantrysim.remedy.outcome import Motion, Outcome
from gantrysim.results.glue import laid_row
from gantrysim.results.score import row_burden
from gantrysim.results.verdict import begun_path_row, limits_with, stability_row

# Shares of a run after which it is judged: most paths that fail do so early. The second is for a run that has come near
# the limit by then, as each look takes as long as the verdict on a path.
_EARLY_SHARE = 0.2
_LATE_SHARE = 0.6
_NEAR_LIMIT = 0.5  # of the limit


class Course:
    """The run of a motion, as far as it is made.

    Args:
        motion: the complete run, where it is known.
        burden: a lower bound of its burden that is known.

    Attributes:
        motion: the complete run; None before its end.
        burden: lower bound of the burden of each job with this motion.
        ticks: of the run that are in memory.
    """

    def __init__(self, motion: Motion | None = None, burden: float = 0.0) -> None:
        self.motion = motion
        self.burden = burden if motion is None else motion.burden
        self.ticks = 0
        self._parts: Iterator[Part | Motion] | None = None

    def advance(self, job: Job, limit: float) -> None:
        """Make the next part of the run, or all of it.

        Args:
            job: of this motion.
            limit: of the burden; inf where all of the run is wanted.

        Raises:
            GantryError: the job is refused; another one of the same motion need not be.
        """
        if self._parts is None:
            self._parts = _parts(job, self._shares(limit)) if limit < math.inf else iter([Motion.of(job)])
        try:
            known = next(self._parts)
        except GantryError:
            self._parts = None
            raise
        self.burden = max(self.burden, known.burden)
        self.ticks = known.ticks
        if isinstance(known, Motion):
            self.motion = known
            self._parts = None

    def _shares(self, limit: float) -> Iterator[float]:
        """Yield the shares of the run after which it is judged."""
        yield _EARLY_SHARE
        if self.burden >= _NEAR_LIMIT * limit:
            yield _LATE_SHARE

    def forget(self) -> None:
        """Forget the run, but for the bound of its burden."""
        self.motion = None
        self.ticks = 0
        self._parts = None


class Part(NamedTuple):
    """A run of which the first part is made.

    Attributes:
        burden: the least that it can have.
        ticks: of the whole run.
    """

    burden: float
    ticks: int


@dataclass
class Prospect:
    """What a job may show.

    Attributes:
        job: the job.
        course: of its motion.
        motion_key: of its motion, see `gantrysim.remedy.outcome.motion_key`.
        outcome: what its run shows, where that is known.
    """

    job: Job
    course: Course
    motion_key: str
    outcome: Outcome | None = None
    _laid: tuple[Job, Bead] | None = None
    _of_glue: float = 0.0

    @property
    def burden(self) -> float:
        """Lower bound of the burden."""
        return self.course.burden + self._of_glue

    def advance(self, limit: float) -> None:
        """Get to know more: run on, and at the end of the run judge the glue.

        Args:
            limit: of the burden, above which it does not matter; inf where all is wanted.
        """
        motion = self.course.motion
        try:
            if motion is None:
                self.course.advance(self.job, limit)
            elif limit < math.inf and self._laid is None and motion.budget is not None:
                self._laid = motion.laid(self.job)
                job, bead = self._laid
                self._of_glue = row_burden(laid_row(bead, limits_with(job, bead)))
            else:
                self.outcome = motion.outcome(self.job, self._laid)
        except GantryError as error:
            self.outcome = Outcome(None, failure=str(error))

    def judge_motion(self) -> Motion | None:
        """Run on until the motion is known to fail, or to its end; return it where it is complete."""
        while self.outcome is None and self.course.motion is None and self.course.burden <= 0:
            self.advance(0.0)
        motion = self.course.motion
        self.course.forget()
        return motion


def forget_worst(courses: Iterable[Course], room: int) -> None:
    """Forget the courses with the largest burden, so that there is room for the ticks of the others.

    The first of those with the least burden stays, as it is the next to go on.
    """
    held = sorted(dict.fromkeys(courses), key=lambda course: course.burden)
    total = 0
    for k, course in enumerate(held):
        total += course.ticks
        if k and total > room:
            course.forget()


def _parts(job: Job, shares: Iterable[float]) -> Iterator[Part | Motion]:
    """Yield what is known after shares of a job's run, and the complete motion."""
    job.check_loops()
    with job.locate_errors():
        simulation = job.prepared_simulation()
    ticks = len(simulation.position)
    is_in_loop = job.engine_of_searches == "loop" and simulation.hindrance is None
    if not is_in_loop or ticks > memory.LONG_RUN or simulation.servo.laws.runs > 1:
        yield Motion.of(job)
        return
    for run in records_in_parts(simulation, shares):
        if len(run.time) < ticks and run.fault is None:
            yield Part(_least_burden(job, simulation, run), ticks)
        else:
            yield Motion.with_record(job, run.replaced(job=job))


def _least_burden(job: Job, simulation: Simulation, run: Run) -> float:
    """Return the least burden that a run can have which begins like this."""
    tolerance = job.limits(run.face)
    of_loops = row_burden(stability_row(job, job.margins, tolerance))
    try:
        error = np.abs(Analysis(run).nozzle.distance)
    except InputError:  # no glue is laid so far
        return of_loops
    # the run may wait at gates for longer than its setpoints take
    waits = simulation.setpoints.gates.size > 0
    count = None if waits else int(np.count_nonzero(simulation.setpoints.dispense))
    return of_loops + row_burden(begun_path_row(error, count, tolerance))
