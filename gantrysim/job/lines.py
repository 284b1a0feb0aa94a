"""The line of a job's program that is active at a time of its run."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeGuard, cast

import numpy as np
from numpy.typing import NDArray

from gantrysim.base import memory
from gantrysim.base.arrays import Floats
from gantrysim.job.basis import Basis, RigBasis
from gantrysim.job.job import Job

_CONTROLLER_PERIOD = 1e-3  # [s], of the ticks to which controllers round the ends of their moves


def program_lines(job: Basis, ticks: int) -> Callable[[float], int | None]:
    """Return a function from a time of the run [s] to the line of the program's text, None where it is not known.

    It is not known for a run that waits for its axes to settle, as waits shift the program against the run, for servo
    periods to which the controller rounds its moves otherwise, for long runs, whose setpoints are not in memory, nor
    without a job.

    Args:
        job: the job.
        ticks: of its run.
    """
    if not _has_lines(job, ticks):
        return lambda time: None
    delay = job.start_wait

    def line_at(time: float) -> int | None:
        return None if time < delay else job.controller.line_at(time - delay)

    return line_at


def program_lines_at(job: Basis, ticks: int, times: Floats) -> NDArray[np.intp]:
    """Return the lines of the program's text at times of the run [s], 0 where they are not known, (n,).

    Args:
        job: the job.
        ticks: of its run.
        times: of its run, (n,) [s].
    """
    lines = np.zeros(times.size, np.intp)
    if _has_lines(job, ticks):
        delay = job.start_wait
        begun = times >= delay
        lines[begun] = job.controller.lines_at(times[begun] - delay)
    return lines


def _has_lines(job: Basis, ticks: int) -> TypeGuard[Job]:
    """Return whether lines of the program are known by the run's time."""
    if isinstance(job, RigBasis):
        return False
    whole_periods = abs(job.built_servo.period - _CONTROLLER_PERIOD) <= 1e-12
    return ticks <= memory.LONG_RUN and whole_periods and not cast(Job, job).setpoints.gates.size
