"""Simulates jobs, each once, several at a time; those that differ in their glue alone share a run."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from operator import methodcaller
from typing import Any, Generic, TypeVar

from gantrysim.base import memory
from gantrysim.base.errors import whole_number
from gantrysim.engine.linear import difference_note
from gantrysim.job.job import Job
from gantrysim.metrics.analysis import Analysis
from gantrysim.metrics.budget import Budget
from gantrysim.remedy.course import Course, Prospect, forget_worst
from gantrysim.remedy.outcome import Motion, Outcome, content_key, motion_key, time_before_glue

# What was computed of runs, kept as long as there is room for it.

KEPT_ROOM = memory.LONG_RUN  # [kB]: a tick of a record with its analysis takes one
_ROUNDING = 1e-9  # of a burden

_Value = TypeVar("_Value")


class Recent(Generic[_Value]):
    """Values by a key; of those used last, as many as there is `KEPT_ROOM` for."""

    def __init__(self) -> None:
        # with their sizes [kB]; that used last at the end
        self._values: dict[str, tuple[_Value, float]] = {}

    def get(self, key: str) -> _Value | None:
        """Return the value of a key, None where it is not kept."""
        entry = self._values.pop(key, None)
        if entry is None:
            return None
        self._values[key] = entry
        return entry[0]

    def keep(self, key: str, value: _Value, size: float) -> None:
        """Keep a value of a size [kB], and drop those for which there is no room then."""
        self._values.pop(key, None)
        self._values[key] = value, size
        total = sum(stored for _, stored in self._values.values())
        while total > KEPT_ROOM:
            oldest = next(iter(self._values))
            total -= self._values.pop(oldest)[1]


# Jobs that levers make of one job, and what they have in common.

_MACHINE = {"machine", "names", "travel", "geometry"}
_OF_SERVO = ("built_servo", "margins")  # of a job, computed at their first use


class Family:
    """Jobs with other values than a base job.

    A job shares machine, controller and servo with the base where both specify the same, and a servo that the base does
    not have with the first job that had it: deriving one takes as long as a tenth of a run, or as a whole run where the
    machine has a closed chain.

    Args:
        base: the job.
    """

    def __init__(self, base: Job) -> None:
        self._base = base
        self._first: dict[str, Job] = {}  # by servo and machine
        # by program and period [s]
        self._before: dict[str, float] = {}

    def member(self, job: Job) -> Job:
        """Return a job that shares with others what it has in common with them."""
        shared = job.sharing(self._base)
        key = json.dumps(job.model_dump(include={"servo", *_MACHINE}), sort_keys=True, default=str)
        first = self._first.setdefault(key, shared)
        if first is shared:
            return shared
        computed = {name: first.__dict__[name] for name in _OF_SERVO if name in first.__dict__}
        return shared.model_copy(update=computed)

    def time_before_glue(self, job: Job) -> float:
        """Return the time before the first dispensing of a job's program, 0 for a program that is refused [s]."""
        key = json.dumps([job.servo.period, job.program], sort_keys=True, default=str)
        if key not in self._before:
            self._before[key] = time_before_glue(job)
        return self._before[key]


Progress = Callable[[int, int, str], None]  # called with the runs done, those known by now, and what runs


@dataclass
class Task:
    """What is under way, for the progress."""

    name: str = "the job"
    done: int = 0
    known: int = 1


class Bench:
    """Simulates jobs and keeps what their runs show; a job of the same content is simulated once.

    The glue does not change the motion: a job that differs in its glue alone from one before need not be simulated
    either, as long as that motion is kept.

    The physics runs without the interpreter's lock, so that threads share the work; what a job shows does not depend
    on the others, nor on their number.

    Args:
        base: the job from which the others differ; they share its machine and controller where these are the same.
        workers: maximum number of threads, by default one for each core.
        progress: called before the first run and after each.

    Attributes:
        family: of the jobs.
        task: what is under way.

    Raises:
        InputError: fewer than one worker.
    """

    def __init__(self, base: Job, workers: int | None = None, progress: Progress | None = None) -> None:
        cores = os.cpu_count() or 1
        self._workers = cores if workers is None else min(whole_number("workers", workers, 1), cores)
        self.family = Family(base)
        self._progress = progress
        self._outcomes: dict[str, Outcome] = {}
        self._motions: Recent[Motion] = Recent()  # by `motion_key`
        # known lower bounds of the burden, by the same
        self._bounds: dict[str, float] = {}
        self.task = Task()

    def show(self, job: Job) -> None:
        """Simulate a job as it is shown, not for a search.

        Raises:
            GantryError: the job is refused.
        """
        self._tell()
        self.add(job, Budget(Analysis(job.run())))

    def add(self, job: Job, budget: Budget) -> None:
        """Add a job that has run, with the error budget of its record."""
        run = budget.analysis.run
        motion = Motion(job, run, budget if run.fault is None else None, is_shown=True)
        self._keep_motion(self.motion_key(job), motion)
        self._keep({content_key(job): motion.outcome(job)})

    def shown_budget(self, job: Job) -> Budget | None:
        """Return the error budget of a job's run as it is shown; None where that is not kept, or ended in a fault."""
        motion = self._motions.get(self.motion_key(job))
        return motion.budget if motion is not None and motion.is_shown else None

    def confirm(self, job: Job) -> tuple[Outcome, str]:
        """Return what the run of a job shows that is not for a search, and a note where it differs from the search's.

        Raises:
            GantryError: the job is refused.
        """
        motion = Motion.of(self.family.member(job), job.simulation.engine or "mujoco")
        searched = self._motions.get(self.motion_key(job)) or Motion.of(self.family.member(job))
        return motion.outcome(motion.job), difference_note(motion.run, searched.run)

    def motion(self, job: Job) -> Motion:
        """Return the run of a job, as searches simulate it.

        Raises:
            GantryError: the job is refused.
        """
        key = self.motion_key(job)
        motion = self._motions.get(key)
        if motion is None:
            self.task.known = self.task.done + 1
            self._tell()
            motion = Motion.of(self.family.member(job))
            self._keep_motion(key, motion)
            self.task.done += 1
            self._tell()
        return motion

    def measure(self, job: Job) -> Outcome:
        """Return what the run of a job shows."""
        return self.measure_all([job])[0]

    def measure_all(self, jobs: Sequence[Job]) -> list[Outcome]:
        """Return what the runs of jobs show, in their order."""
        return [outcome for outcome in self.promising(jobs, lambda _: math.inf) if outcome is not None]

    def promising(self, jobs: Sequence[Job], limit: Callable[[Sequence[Outcome]], float]) -> list[Outcome | None]:
        """Return what the runs of jobs show, None for those whose burden is above a limit, in their order.

        Those are simulated only until that is known, see `gantrysim.remedy.course`. The job of which the least burden
        is known is simulated next, so that a limit that follows from what others show is soon low.

        Args:
            jobs: the jobs.
            limit: returns the limit for what some of them show.
        """
        keys = [content_key(job) for job in jobs]
        missing = {key: job for key, job in zip(keys, jobs, strict=True) if key not in self._outcomes}
        known = [self._outcomes[key] for key in dict.fromkeys(keys) if key in self._outcomes]
        prospects = self._prospects(missing)
        with self._mapping(len(prospects)) as mapped:
            while batch := self._next(prospects, least := limit(known)):
                list(mapped(methodcaller("advance", least), batch.values()))
                for key, prospect in batch.items():
                    motion = prospect.course.motion
                    if motion is not None:
                        self._keep_motion(prospect.motion_key, motion)
                    if prospect.outcome is not None:
                        del prospects[key]
                        known.append(prospect.outcome)
                        self._keep({key: prospect.outcome})
                forget_worst((prospect.course for prospect in prospects.values()), KEPT_ROOM)
        self._drop(prospects.values())
        return [self._outcomes.get(key) for key in keys]

    def motions_fail(self, jobs: Sequence[Job]) -> list[bool]:
        """Return whether the motion of each job fails whatever its glue; a refused job has none."""
        keys = [self.motion_key(job) for job in jobs]
        outcomes = {key: self._outcomes.get(content_key(job)) for key, job in zip(keys, jobs, strict=True)}
        fails = {key: outcome.motion_burden > 0 for key, outcome in outcomes.items() if outcome is not None}
        prospects = self._prospects({key: job for key, job in zip(keys, jobs, strict=True) if key not in fails})
        with self._mapping(len(prospects)) as mapped:
            judged = mapped(methodcaller("judge_motion"), prospects.values())
            for (key, prospect), motion in zip(prospects.items(), judged, strict=True):
                fails[key] = prospect.outcome is None and prospect.course.burden > 0
                if motion is not None:
                    self._keep_motion(key, motion)
                self.task.done += 1
                self._tell()
        self._drop(prospects.values())
        return [fails[key] for key in keys]

    def _prospects(self, jobs: Mapping[str, Job]) -> dict[str, Prospect]:
        """Return what jobs may show, by the same keys; those with the same motion share its course."""
        motions = {key: self.motion_key(job) for key, job in jobs.items()}
        courses = {key: Course(self._motions.get(key), self._bounds.get(key, 0.0)) for key in motions.values()}
        self.task.known = self.task.done + len(motions)
        self._tell()
        return {
            key: Prospect(self.family.member(job), courses[motions[key]], motions[key]) for key, job in jobs.items()
        }

    def _next(self, prospects: Mapping[str, Prospect], limit: float) -> dict[str, Prospect]:
        """Return those to simulate next, each of another motion: at most as many as there are threads."""
        within = [key for key, prospect in prospects.items() if prospect.burden <= limit + _ROUNDING]
        within.sort(key=lambda key: prospects[key].burden)
        batch: dict[str, str] = {}
        for key in within:
            batch.setdefault(prospects[key].motion_key, key)
            if len(batch) == self._workers:
                break
        return {key: prospects[key] for key in batch.values()}

    def _drop(self, prospects: Iterable[Prospect]) -> None:
        """Keep of jobs that are not simulated on what bounds their burden."""
        for prospect in prospects:
            self._bounds[prospect.motion_key] = prospect.course.burden
        self.task.done = self.task.known

    @contextmanager
    def _mapping(self, count: int) -> Iterator[Callable[..., Iterable[Any]]]:
        """Yield what maps a function over so many arguments: `map`, or that of several threads."""
        if self._workers == 1 or count < 2:
            yield map
            return
        with ThreadPoolExecutor(self._workers) as pool:
            try:
                yield pool.map
            finally:
                # those that have not begun at an interrupt
                pool.shutdown(cancel_futures=True)

    def motion_key(self, job: Job) -> str:
        """Return a text that is the same for jobs with the same motion, see `motion_key`."""
        return motion_key(job, self.family.time_before_glue(job) if job.dispenser.start_lead > 0 else 0.0)

    def _keep_motion(self, key: str, motion: Motion) -> None:
        self._motions.keep(key, motion, len(motion.run.time))

    def _keep(self, outcomes: Mapping[str, Outcome]) -> None:
        self._outcomes |= outcomes
        self.task.done += len(outcomes)
        self._tell()

    def _tell(self) -> None:
        if self._progress is not None:
            self._progress(self.task.done, self.task.known, self.task.name)
