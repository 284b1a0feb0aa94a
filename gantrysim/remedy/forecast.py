"""The burden that a job has at least, before it is simulated.

The nozzle is nearer to the requested path than its command by at most the distance between the two, at every tick:

    contour error >= program's error - deviation        deviation: distance of the nozzle from its command

and so are the largest value and the 95th percentile of the two sides. The program's error needs no simulation: it is
that of a machine that follows exactly. Of the deviation an upper bound is assumed, at each place of the requested path:
`REACH` times the largest near that place, `gantrysim.remedy.deviation`, in the runs of the job as it is and of each of
its levers alone. A job whose program waits until the axes settle has no forecast of the percentile, as it is not known
how long it waits. Stability is exact, and so is the contour error of a job that has been simulated with other glue.
Glue and machine are left out, as no row lowers a burden.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from gantrysim.base import memory
from gantrysim.base.arrays import Floats
from gantrysim.base.errors import GantryError
from gantrysim.engine.positions import axis_positions
from gantrysim.engine.record_columns import needle_values
from gantrysim.job.job import Job
from gantrysim.metrics.parts import PartValues
from gantrysim.record.run import Run
from gantrysim.remedy.bench import Bench
from gantrysim.remedy.deviation import largest_of, part_of
from gantrysim.remedy.outcome import Outcome
from gantrysim.remedy.recent import Recent
from gantrysim.results.score import row_burden
from gantrysim.results.tolerance import Tolerance
from gantrysim.results.verdict import PATH, STABILITY, path_row, stability_row
from gantrysim.servo.laws.law import Law

REACH = 2.0
_TICK = 0.016  # of the error of a program [kB]
_SHARE = 0.5  # of a burden, in path and stability, below which there is no use in forecasts


@dataclass(frozen=True)
class ProgramError:
    """Distance of a program's command from its requested path while the dispenser is on.

    Attributes:
        distance: at the ticks, (m,) [mm].
        part: of the path at the ticks, see `gantrysim.remedy.deviation`, (m,).
        length: of the requested path [mm].
        waits: whether the program waits for its axes to settle.
    """

    distance: Floats
    part: np.ndarray
    length: float
    waits: bool

    @classmethod
    def of(cls, job: Job) -> ProgramError:
        """Return the error of a job's program.

        Raises:
            GantryError: the job is refused.
        """
        setpoints = job.setpoints
        servo = job.built_servo
        for law in servo.laws.added:
            setpoints = law.sent(servo.laws.by_name(), setpoints)
        tip = job.built_machine.tip(axis_positions(job.built_machine, setpoints))
        on = np.flatnonzero(setpoints.dispense)
        foot = setpoints.requested.follow(tip[on], None if setpoints.progress is None else setpoints.progress[on])
        if len(tip) > memory.LONG:
            job.__dict__.pop("setpoints", None)  # they fill the memory, and are computed again on demand
        length = float(setpoints.requested.length)
        return cls(np.asarray(foot.distance), part_of(foot.s, length), length, setpoints.gates.size > 0)


class Forecast:
    """Forecasts the burden of a job with several levers set.

    Args:
        base: the job as it is.
        bench: has simulated it, and each of its levers alone.
    """

    def __init__(self, base: Job, bench: Bench) -> None:
        self._base = base
        self._bench = bench
        self._errors: Recent[ProgramError] = Recent()

    def is_worthwhile(self, present: Outcome) -> bool:
        """Return whether forecasts may rule out jobs that are no better than a present one: they take time, too."""
        if present.verdict is None:
            return False
        burden = sum(row_burden(present.verdict[name]) for name in (PATH, STABILITY))
        return burden >= _SHARE * present.burden and self._is_of_the_program

    @cached_property
    def _is_of_the_program(self) -> bool:
        """Whether most of what the path adds to the burden of the job as it is would be forecast without its run."""
        motion = self._bench.motion(self._base)
        if motion is None or motion.budget is None:
            return False
        path = self._path_burden(self._base, motion.budget.contour_values)
        return path > 0 and self._path_burden(self._base, self._least_error(self._base, [])) >= _SHARE * path

    def burden(self, job: Job, alone: Sequence[Job]) -> float:
        """Return the burden that a job has at least; 0 where nothing is known.

        Args:
            job: the job.
            alone: the jobs with each of its levers alone.
        """
        try:
            motion = self._bench.motion(job)
            if motion is None:
                contour = self._least_error(job, alone)
            elif motion.budget is None:
                return 0.0
            else:
                contour = motion.budget.contour_values
            stability = stability_row(job, job.margins, self._tolerance(job))
            return self._path_burden(job, contour) + row_burden(stability)
        except GantryError:  # its run tells why it is refused
            return 0.0

    def _path_burden(self, job: Job, contour: PartValues) -> float:
        """Return what a contour error adds to the burden of a job."""
        return row_burden(path_row(contour, self._tolerance(job), lambda time: None))

    @staticmethod
    def _tolerance(job: Job) -> Tolerance:
        return Tolerance.of(job, needle_values(job.built_machine, job.dispenser).get("face", Run.face))

    def _least_error(self, job: Job, alone: Sequence[Job]) -> PartValues:
        """Return the least contour error of a job, whose place is unknown [mm]."""
        error = self._error(job)
        reach = REACH * largest_of(map(self._bench.deviation, (self._base, *alone)), error.length)
        least = np.maximum(error.distance - reach[error.part], 0.0)
        p95 = 0.0 if error.waits else float(np.percentile(least, 95))
        return PartValues(0.0, p95, float(least.max()), 0.0, math.nan, math.nan, (math.nan, math.nan, math.nan))

    def _error(self, job: Job) -> ProgramError:
        """Return the error of a job's program, which is computed once for jobs with the same program."""
        key = _program_key(job)
        error = self._errors.get(key)
        if error is None:
            error = ProgramError.of(job)
            self._errors.keep(key, error, _TICK * len(error.distance))
        return error


def _program_key(job: Job) -> str:
    """Return a text that is the same for jobs whose setpoints, and the machine to which they are sent, are the same."""
    content = job.model_dump(include={"machine", "names", "travel", "geometry", "program"})
    content["held"] = (job.dispenser.start_lead, job.simulation.settle)
    shapes = any(type(law).sent is not Law.sent for law in job.built_servo.laws.added)
    # a law that shapes the command does so by its parameters, which may depend on the loop
    content["servo"] = job.servo.model_dump() if shapes else job.servo.period
    return json.dumps(content, sort_keys=True, default=str)
