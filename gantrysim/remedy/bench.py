"""Simulates jobs, each once, several at a time; those that differ in their glue alone share a run."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass

from gantrysim.base.errors import whole
from gantrysim.job.job import Job
from gantrysim.remedy.outcome import Outcome, measured_together, motion_key

Progress = Callable[[int, int, str], None]  # called with the runs done, those known by now, and what runs


@dataclass
class Task:
    """What is under way, for the progress."""

    name: str = "the job"
    done: int = 0
    known: int = 1


class Bench:
    """Simulates jobs and keeps what their runs show; a job of the same content is simulated once.

    The physics runs without the interpreter's lock, so that threads share the work; what a job shows does not depend
    on the others, nor on their number.

    Args:
        base: the job from which the others differ; they share its machine and controller where these are the same.
        workers: maximum number of threads, by default one for each core.
        progress: called before the first run and after each.

    Raises:
        InputError: fewer than one worker.
    """

    def __init__(self, base: Job, workers: int | None = None, progress: Progress | None = None) -> None:
        cores = os.cpu_count() or 1
        self._workers = cores if workers is None else min(whole("workers", workers, 1), cores)
        self._base = base
        self._progress = progress
        self._outcomes: dict[str, Outcome] = {}
        self.task = Task()

    def measure(self, job: Job) -> Outcome:
        """Return what the run of a job shows."""
        return self.measure_all([job])[0]

    def measure_all(self, jobs: Sequence[Job]) -> list[Outcome]:
        """Return what the runs of jobs show, in their order."""
        keys = [job.toml() for job in jobs]
        missing = {key: job for key, job in zip(keys, jobs, strict=True) if key not in self._outcomes}
        self.task.known = self.task.done + len(missing)
        self._tell()
        motions: dict[str, dict[str, Job]] = {}
        for key, job in missing.items():
            motions.setdefault(motion_key(job), {})[key] = job.sharing(self._base)
        groups = [list(group.values()) for group in motions.values()]
        with ExitStack() as stack:
            results: Iterable[list[Outcome]] = map(measured_together, groups)
            if self._workers > 1 and len(groups) > 1:
                pool = stack.enter_context(ThreadPoolExecutor(self._workers))
                stack.callback(pool.shutdown, cancel_futures=True)  # those that have not begun at an interrupt
                results = pool.map(measured_together, groups)
            for group, outcomes in zip(motions.values(), results, strict=True):
                self._keep(dict(zip(group, outcomes, strict=True)))
        return [self._outcomes[key] for key in keys]

    def _keep(self, outcomes: Mapping[str, Outcome]) -> None:
        self._outcomes |= outcomes
        self.task.done += len(outcomes)
        self._tell()

    def _tell(self) -> None:
        if self._progress is not None:
            self._progress(self.task.done, self.task.known, self.task.name)
