"""What the run of a job shows: its verdict, its duration, and what levers need to know of it."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

from gantrysim.base import memory
from gantrysim.base.errors import GantryError, InputError
from gantrysim.engine.linear import Engine
from gantrysim.engine.recording import dispensed_otherwise
from gantrysim.engine.simulate import records_in_parts
from gantrysim.glue.bead import Bead
from gantrysim.job.job import Job
from gantrysim.metrics.analysis import Analysis
from gantrysim.metrics.budget import Budget
from gantrysim.record.run import Run
from gantrysim.results.checks import FAIL, PASS
from gantrysim.results.score import burden_of, row_burden
from gantrysim.results.verdict import Verdict, motion_rows

# Shares of a run after which its path is judged, where it is only asked whether the run fails: most runs that fail are
# off their path early.
_PARTS = (0.08, 0.25, 0.6)

_OF_MOTION = ("built_servo", "margins", "setpoints", "start_wait")  # of a job, computed for its run


@dataclass(frozen=True)
class Outcome:
    """What a run of a job shows.

    Attributes:
        verdict: on the run; None for a job that is refused.
        duration: from the first to the last tick, nan for a job that is refused [s].
        failure: why there is no complete run: a refusal or a fault; empty otherwise.
        nominal: section of the requested bead, 0 without one [mm²].
        missing: mean over the starts of the glue missing there, as length of the requested bead [mm].
        excess: mean over the stops of the glue in excess there, likewise [mm].
        dots: volumes of the dots, with what is drawn into strings, 0 where none is requested [mm³].
        motion_fails: see `Motion.fails`.
    """

    verdict: Verdict | None
    duration: float = math.nan
    failure: str = ""
    nominal: float = 0.0
    missing: float = 0.0
    excess: float = 0.0
    dots: tuple[float, ...] = ()
    motion_fails: bool = False

    @property
    def burden(self) -> float:
        """See `burden_of`; inf without a complete run."""
        return math.inf if self.failure or self.verdict is None else burden_of(self.verdict)

    @property
    def state(self) -> str:
        """The verdict in a word; "fail" for a job that is refused."""
        return FAIL if self.verdict is None else self.verdict.state

    @property
    def passes(self) -> bool:
        """Whether the verdict is a pass."""
        return self.state == PASS


def motion_key(job: Job, before: float | None = None) -> str:
    """Return a text that is the same for jobs with the same motion, which differ in their glue alone.

    A start lead may hold the program back, and the needle stands in the record.

    Args:
        job: the job.
        before: time before the first dispensing of its program, if it is known [s].
    """
    if job.faults:
        return job.toml()
    content = job.model_dump(exclude={"bead", "tolerance"})
    lead = job.dispenser.start_lead
    if lead > 0:
        known = time_before_glue(job) if before is None else before
        lead = max(lead - known, 0.0)
    content["dispenser"] = {"needle": content["dispenser"]["needle"], "hold": lead}
    return json.dumps(content, sort_keys=True, default=str)


def time_before_glue(job: Job) -> float:
    """Return the time before the first dispensing of a job's program, 0 for a program that is refused [s]."""
    try:
        return job.controller.setpoints(job.servo.period).time_before_glue
    except GantryError:  # its run tells why
        return 0.0


def measured_together(jobs: Sequence[Job], motion: Motion | None = None) -> Measured:
    """Simulate jobs of the same motion, see `motion_key`, once for all; return what the run of each shows.

    Args:
        jobs: the jobs.
        motion: theirs, where a job with it has been simulated.
    """
    outcomes: list[Outcome] = []
    for job in jobs:
        try:
            motion = Motion.of(job) if motion is None else motion
            outcomes.append(motion.outcome(job))
        except GantryError as error:
            outcomes.append(Outcome(None, failure=str(error)))
    return Measured(tuple(outcomes), motion)


@dataclass(frozen=True)
class Motion:
    """A run, and what of it does not depend on the glue.

    Attributes:
        job: that ran.
        run: its record.
        budget: of the record; None where the run ended in a fault.
        is_shown: whether its verdict is shown, not only compared with others: then its errors are checked against one
            another, see `gantrysim.metrics.budget`, which takes as long as all else.
    """

    job: Job
    run: Run
    budget: Budget | None
    is_shown: bool = False

    @classmethod
    def of(cls, job: Job, engine: Engine | None = None) -> Motion:
        """Simulate a job.

        Args:
            job: the job.
            engine: as in `simulate`, for a run that is shown; by default that of searches.

        Raises:
            GantryError: the job is refused.
        """
        run = job.run(engine=engine or job.engine_of_searches)
        return cls.with_record(job, run, is_shown=engine is not None)

    @classmethod
    def with_record(cls, job: Job, run: Run, *, is_shown: bool = False) -> Motion:
        """Return the motion of a job from its record."""
        return cls(job, run, Budget(Analysis(run)) if run.fault is None else None, is_shown)

    @cached_property
    def fails(self) -> bool:
        """Whether the verdict is no pass whatever the glue, by path, stability or machine; True for a fault.

        It needs neither the bead nor the links of the error budget.
        """
        return self.budget is None or any(row_burden(row) > 0 for row in motion_rows(self.job, self.budget))

    def outcome(self, job: Job) -> Outcome:
        """Return what the run of a job with this motion shows.

        Raises:
            GantryError: the job is refused.
        """
        if self.budget is None:
            verdict = Verdict.of_fault(self.run)
            return Outcome(verdict, float(self.run.time[-1]), verdict.fault, motion_fails=True)
        run = self.run
        if job is not self.job:
            run = dispensed_otherwise(run, job.dispenser)
            same = {name: getattr(self.job, name) for name in _OF_MOTION if name in self.job.__dict__}
            job = job.sharing(self.job).model_copy(update=same)
        bead = Bead(run, job.bead, self.budget.analysis)
        is_laid = bead.nominal > 0 and bead.total_volume > 0
        return Outcome(
            Verdict.of_results(job, self.budget, bead, is_checked=self.is_shown),
            float(run.time[-1]),
            nominal=max(float(bead.nominal), 0.0),
            missing=float(bead.missing_at_starts.mean()) if is_laid else 0.0,
            excess=float(bead.excess_at_stops.mean()) if is_laid and bead.excess_at_stops.size else 0.0,
            # where none is requested, what is left is rounding
            dots=tuple(dot.volume + dot.string if dot.demand else 0.0 for dot in bead.dots),
            motion_fails=self.fails,
        )


class Judged(NamedTuple):
    """Whether a motion fails whatever the glue.

    Attributes:
        fails: see `Motion.fails`; False for a job that is refused.
        motion: the motion; None where it has failed early, or the job is refused.
    """

    fails: bool
    motion: Motion | None


def judged_motion(job: Job, motion: Motion | None = None) -> Judged:
    """Judge the motion of a job, simulated as far as needed if it is not known.

    Args:
        job: the job.
        motion: its motion, where a job with it has been simulated.
    """
    try:
        if motion is None:
            motion = _motion_unless_it_fails_early(job)
    except GantryError:  # its outcome tells why
        return Judged(False, None)
    return Judged(motion is None or motion.fails, motion)


def _motion_unless_it_fails_early(job: Job) -> Motion | None:
    """Return the motion of a job, None where the first part of its run is off its path: so is then the whole run."""
    job.check_loops()
    with job.locate_errors():
        simulation = job.prepared_simulation()
    ticks = len(simulation.position)
    is_in_loop = job.engine_of_searches == "loop" and simulation.hindrance is None
    if not is_in_loop or ticks > memory.LONG_RUN or simulation.servo.laws.runs > 1:
        return Motion.of(job)
    for run in records_in_parts(simulation, _PARTS):
        if len(run.time) < ticks and run.fault is None and _is_off_path(job, run):
            return None
    return Motion.with_record(job, run.replaced(job=job))


def _is_off_path(job: Job, run: Run) -> bool:
    """Return whether the contour error of a run, or of its first part, is above its limit."""
    try:
        distance = Analysis(run).nozzle.distance
    except InputError:  # no glue is laid so far
        return False
    return float(distance.max()) > job.limits(run.face).path_max


class Measured(NamedTuple):
    """What the runs of jobs with the same motion show.

    Attributes:
        outcomes: of each job.
        motion: of all; None where every job is refused.
    """

    outcomes: tuple[Outcome, ...]
    motion: Motion | None
