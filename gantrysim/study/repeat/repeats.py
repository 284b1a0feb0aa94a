"""A repeat of a job: a case that may start between two servo ticks, and its nozzle's offset from the path."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.engine.simulate import simulate
from gantrysim.job.job import Job
from gantrysim.metrics import interpolated, offset_over_length
from gantrysim.metrics.analysis import Analysis
from gantrysim.record.run import Run
from gantrysim.record.setpoints import Setpoints
from gantrysim.study.cases import Case, Row, judged, verdict_row

PHASES = 8  # of a servo period, in which a program may start
ALL = "all"  # name of the variation of everything
_UM = 1e3


@dataclass(frozen=True)
class RepeatCase(Case):
    """A case whose program starts between two servo ticks.

    Attributes:
        phase: lead over a servo tick, in 1/`PHASES` of a servo period.
    """

    phase: int = 0

    @property
    def key(self) -> str:
        """Identity of the case, with its phase."""
        return f"{super().key}-{self.phase}"


def has_phase(job: Job) -> bool:
    """Return whether a job's program may start anywhere between two servo ticks."""
    return job.controller.free_running


def phased_setpoints(job: Job, phase: int) -> Setpoints:
    """Return the setpoints of a job whose program starts before a servo tick, every `PHASES`-th of a finer period.

    Args:
        job: whose program is not bound to servo ticks.
        phase: lead over the tick, in 1/`PHASES` of a servo period.
    """
    if not phase:
        return job.setpoints
    period = job.built_servo.period
    fine = job.controller.setpoints(period / PHASES)
    last = len(fine.position) - 1
    sent = np.concatenate([[0], np.arange(phase, last, PHASES), [last]])
    coarse = replace(
        fine,
        period=period,
        position=fine.position[sent],
        dispense=fine.dispense[sent],
        progress=None if fine.progress is None else fine.progress[sent],
    )
    return job.dispenser.held_back(coarse).hold(job.simulation.settle)


def places_along(analysis: Analysis, count: int) -> Floats:
    """Return at most `count` evenly spaced places on the requested path where glue is laid, by arc length [mm]."""
    s = analysis.commanded.s
    # a place counts if a tick of dispensing lies as near as ticks lie to each other within a stretch
    first = np.diff(analysis.ticks, prepend=analysis.ticks[0] - 2) > 1
    step = float(np.abs(np.diff(s))[~first[1:]].max(initial=0.0))
    even = np.linspace(s.min(), s.max(), count)
    ascending = np.sort(s)
    after = np.clip(np.searchsorted(ascending, even), 1, s.size - 1)
    distance = np.minimum(np.abs(even - ascending[after - 1]), np.abs(even - ascending[after]))
    return even[distance <= step]


def measure_repeat(case: Case, places: Sequence[float]) -> Row:
    """Run a repeat and return the nozzle's offset from the path at some places, as curves.

    Args:
        case: a `RepeatCase`.
        places: on the requested path by arc length [mm].
    """
    return judged(partial(_repeated, case), lambda run: {**_row(run, places), **verdict_row(case, run)})


def _repeated(case: Case) -> Run:
    assert isinstance(case, RepeatCase)
    job = case.job()
    machine = job.built_machine
    return simulate(
        machine if case.perturbation is None else machine.perturbed(case.perturbation),
        job.built_servo,
        phased_setpoints(job, case.phase),
        physics_step=job.simulation.physics_step,
        dispenser=job.dispenser,
        faults=job.faults,
    )


def _row(run: Run, places: Sequence[float]) -> Row:
    s, offset = offset_over_length(run.requested, run.nozzle[run.dispense])
    offsets = interpolated(np.array(places), s, offset)
    row: Row = {"contour_max_um": _UM * float(np.linalg.norm(offsets, axis=1).max()), "s_mm": list(places)}
    return row | {f"offset_{name}_um": np.round(_UM * offsets[:, i], 6).tolist() for i, name in enumerate("xyz")}
