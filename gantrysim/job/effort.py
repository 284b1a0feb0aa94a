"""How long a job will take to compute."""

from __future__ import annotations

from dataclasses import replace
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np

from gantrysim.engine.simulate import simulate

if TYPE_CHECKING:
    from gantrysim.job.job import Job

_SAMPLE = 2000  # ticks that are timed
_FIGURES = 2e-5  # of a tick, for error budget, bead, plots and report, as measured on an225 [s]
_MINUTE, _HOUR = 60.0, 3600.0


def computing_time(job: Job) -> float:
    """Return about how long a run of a job will take here, with plots and report, without causes and video [s].

    Its first ticks are run for that.
    """
    whole = job.setpoints

    def of_a_tick(ticks: int) -> float:
        part = replace(
            whole, position=whole.position[:ticks], dispense=whole.dispense[:ticks], gates=np.zeros(0, np.int64)
        )
        begun = perf_counter()
        run = simulate(job.built_machine, job.built_servo, part, physics_step=job.simulation.physics_step)
        return (perf_counter() - begun) / len(run.time)

    of_a_tick(2)  # compiles what is to be timed
    return whole.run_ticks * (of_a_tick(_SAMPLE) + _FIGURES)


def in_words(seconds: float) -> str:
    """Return a duration to one or two digits, in s, min or h."""
    if seconds < 1.5 * _MINUTE:
        return f"{seconds:.0f} s"
    return f"{seconds / _MINUTE:.0f} min" if seconds < 1.5 * _HOUR else f"{seconds / _HOUR:.1f} h"
