"""The line of a job's program that is active at a time of its run."""

from __future__ import annotations

from collections.abc import Callable

from gantrysim.base import memory
from gantrysim.job.job import Job

_CONTROLLER_PERIOD = 1e-3  # [s], of the ticks to which controllers round the ends of their moves


def program_lines(job: Job, ticks: int) -> Callable[[float], int | None]:
    """Return a function from a time of the run [s] to the line of the program's text, None where it is not known.

    It is not known for a run that waits for its axes to settle, as waits shift the program against the run, for servo
    periods to which the controller rounds its moves otherwise, nor for long runs, whose setpoints are not in memory.

    Args:
        job: the job.
        ticks: of its run.
    """
    if ticks > memory.LONG or abs(job.built_servo.period - _CONTROLLER_PERIOD) > 1e-12 or job.setpoints.gates.size:
        return lambda time: None
    period = job.setpoints.period
    delay = 0.0
    if job.dispenser.start_lead > 0:  # it may hold the program back
        sent = len(job.controller.setpoints(period).position)
        settling = round(job.simulation.settle / period)
        delay = (len(job.setpoints.position) - settling - sent) * period

    def line_at(time: float) -> int | None:
        return None if time < delay else job.controller.line_at(time - delay)

    return line_at
