"""What the run of a job shows: its verdict, its duration, and what levers need to know of it."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from gantrysim.base.errors import GantryError
from gantrysim.engine.linear import Engine
from gantrysim.engine.recording import dispensed_otherwise
from gantrysim.glue.bead import Bead
from gantrysim.job.job import Job
from gantrysim.metrics.analysis import Analysis
from gantrysim.metrics.budget import Budget
from gantrysim.record.run import Run
from gantrysim.results.checks import FAIL, PASS
from gantrysim.results.score import burden_of, row_burden
from gantrysim.results.verdict import MotionRows, Verdict

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
        motion_burden: see `Motion.burden`; inf for a job that is refused.
    """

    verdict: Verdict | None
    duration: float = math.nan
    failure: str = ""
    nominal: float = 0.0
    missing: float = 0.0
    excess: float = 0.0
    dots: tuple[float, ...] = ()
    motion_burden: float = math.inf

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


def least_burden(outcomes: Sequence[Outcome]) -> float:
    """Return the least burden of what jobs show, inf without any."""
    return min((outcome.burden for outcome in outcomes), default=math.inf)


def content_key(job: Job) -> str:
    """Return a text that is the same for jobs of the same content; it takes a fraction of the time of TOML."""
    return json.dumps(job.model_dump(), sort_keys=True, default=str)


def motion_key(job: Job, before: float | None = None) -> str:
    """Return a text that is the same for jobs with the same motion, which differ in their glue alone.

    A start lead may hold the program back, and the needle stands in the record.

    Args:
        job: the job.
        before: time before the first dispensing of its program, if it is known [s].
    """
    if job.faults:
        return content_key(job)
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

    @property
    def ticks(self) -> int:
        """Number of ticks of its record."""
        return len(self.run.time)

    @cached_property
    def rows(self) -> MotionRows:
        """The rows of the verdict that the glue does not change, of a complete run.

        They need neither the bead nor the links of the error budget.
        """
        assert self.budget is not None
        return MotionRows.of(self.job, self.budget)

    @cached_property
    def burden(self) -> float:
        """What path, stability and machine add to the burden of the verdict whatever the glue; inf for a fault."""
        return math.inf if self.budget is None else sum(map(row_burden, self.rows))

    def laid(self, job: Job) -> tuple[Job, Bead]:
        """Return a job with this motion that shares with it what is the same, and its bead.

        Raises:
            GantryError: the job is refused.
        """
        assert self.budget is not None
        run = self.run
        if job is not self.job:
            run = dispensed_otherwise(run, job.dispenser)
            same = {name: getattr(self.job, name) for name in _OF_MOTION if name in self.job.__dict__}
            job = job.sharing(self.job).model_copy(update=same)
        return job, Bead(run, job.bead, self.budget.analysis)

    def outcome(self, job: Job, laid: tuple[Job, Bead] | None = None) -> Outcome:
        """Return what the run of a job with this motion shows.

        Args:
            job: the job.
            laid: what `laid` returns for it, where that is known.

        Raises:
            GantryError: the job is refused.
        """
        if self.budget is None:
            verdict = Verdict.of_fault(self.run)
            return Outcome(verdict, float(self.run.time[-1]), verdict.fault)
        run = self.run
        job, bead = self.laid(job) if laid is None else laid
        is_laid = bead.nominal > 0 and bead.total_volume > 0
        return Outcome(
            Verdict.of_results(
                job,
                self.budget,
                bead,
                is_checked=self.is_shown,
                known=self.rows if job.tolerance == self.job.tolerance else None,
            ),
            float(run.time[-1]),
            nominal=max(float(bead.nominal), 0.0),
            missing=float(bead.missing_at_starts.mean()) if is_laid else 0.0,
            excess=float(bead.excess_at_stops.mean()) if is_laid and bead.excess_at_stops.size else 0.0,
            # where none is requested, what is left is rounding
            dots=tuple(dot.volume + dot.string if dot.demand else 0.0 for dot in bead.dots),
            motion_burden=self.burden,
        )
