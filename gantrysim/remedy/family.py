"""Jobs that levers make of one job, and what they have in common."""

from __future__ import annotations

import json

from gantrysim.job.job import Job

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

    def member(self, job: Job) -> Job:
        """Return a job that shares with others what it has in common with them."""
        shared = job.sharing(self._base)
        key = json.dumps(job.model_dump(include={"servo", *_MACHINE}), sort_keys=True, default=str)
        first = self._first.setdefault(key, shared)
        if first is shared:
            return shared
        computed = {name: first.__dict__[name] for name in _OF_SERVO if name in first.__dict__}
        return shared.model_copy(update=computed)
