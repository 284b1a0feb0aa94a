"""Jobs that levers make of one job, and what they have in common."""

from __future__ import annotations

import json

from gantrysim.job.job import Job
from gantrysim.remedy.outcome import time_before_glue

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
        self._before: dict[str, float] = {}  # by program and period [s]

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
