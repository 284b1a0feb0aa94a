"""How long a job takes to compute."""

from __future__ import annotations

from time import perf_counter

from gantrysim.engine.simulate import simulate
from gantrysim.job.job import Job

_FIRST = 5_000  # setpoints that are run to see
# Whole time, with figures, plots and report, over the simulation's; measured on an225 with 1000 turns.
_ALL = 6.0


def computing_time(job: Job) -> float:
    """Return about how long this machine takes for a job, its figures, plots and report, without video [s].

    The first setpoints are run to see. Waits at gates count as long as they must be.

    Raises:
        InputError: as by `gantrysim.simulate`.
    """
    first = job.setpoints.until(_FIRST)
    for _ in range(2):  # the first compiles
        start = perf_counter()
        run = simulate(job.built_machine, job.built_servo, first, physics_step=job.simulation.physics_step)
        spent = perf_counter() - start
    return _ALL * spent / len(run.time) * job.setpoints.run_ticks
