"""What is refused before a study begins, and where none of its cases has figures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gantrysim.engine.simulate import simulate
from gantrysim.errors import InputError
from gantrysim.job.job import Job
from gantrysim.metrics.analysis import Analysis
from gantrysim.study.cases import OK, Row, is_fault


class NoValuesError(InputError):
    """No case of a study has figures.

    Attributes:
        faulted: whether faults have ended some of them.
    """

    def __init__(self, text: str, faulted: bool) -> None:
        super().__init__(text)
        self.faulted = faulted


def check_job(job: Job) -> None:
    """Refuse a job that `run` would refuse: no study of it says anything.

    Raises:
        InputError: the job is refused as it stands, or its dispenser is never on.
    """
    Analysis(job.follow())
    # what a machine and its servo refuse of it, they refuse before they move: a servo period shows it
    whole, none = job.setpoints, np.zeros(0, np.int64)
    setpoints = replace(whole, position=whole.position[:2], dispense=whole.dispense[:2], gates=none)
    simulate(job.built_machine, job.built_servo, setpoints, physics_step=job.simulation.physics_step)


def check_values(rows: list[Row]) -> None:
    """Refuse the rows of a study in which no case has figures.

    Raises:
        NoValuesError: it is so; the text has the first reason.
    """
    if any(row["status"] == OK for row in rows):
        return
    faults = [row for row in rows if is_fault(row)]
    reason = (faults or rows)[0]["status"]
    raise NoValuesError(f"none of the study's {len(rows)} cases has figures: {reason}", bool(faults))
