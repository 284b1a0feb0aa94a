"""From cases that differ in gains and machine to their rows: simulated together, and no more worked out than is asked.

A row has the sizes of the contour error, those of the tracking part of the error budget where they are asked for, the
torque ripple, and the gains; that of a run which a fault has ended has the fault's time and the gains.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from gantrysim.arrays import Floats
from gantrysim.controllers.servo import GAIN_NAMES, Servo
from gantrysim.engine.batch import simulate_batch
from gantrysim.errors import GantryError, InputError
from gantrysim.job.job import Job, ServoSettings
from gantrysim.machine.machine import Machine
from gantrysim.machine.perturbation import Perturbation
from gantrysim.metrics.analysis import Analysis, torque_ripple
from gantrysim.metrics.budget import Budget
from gantrysim.run import Run
from gantrysim.study.cases import OK, Case, Row, Value, judged
from gantrysim.tuning.search import Measured

FIGURES = tuple(f"{link}_{statistic}" for link in ("contour", "tracking") for statistic in ("rms", "p95", "max"))

_STATISTICS: dict[str, Callable[[Floats], float]] = {
    "rms": lambda size: float(np.sqrt(np.mean(size**2))),
    "p95": lambda size: float(np.percentile(size, 95)),
    "max": lambda size: float(size.max()),
}
_THOUSANDTHS = 1e3
_TOGETHER = 8  # runs whose records are held at once
_FAULT_TIME, _RIPPLE = "fault_time_s", "torque_ripple_percent"


def column(figure: str) -> str:
    """Return the name of a figure in a row, with its unit."""
    return f"{figure}_um"


def case_of(job: Job, servo: Servo, perturbation: Perturbation | None, **tags: Value) -> Case:
    """Return the case of a job with other gains, on a machine that differs from its own."""
    gains = {f"servo.{name}": list(getattr(servo, name)) for name in GAIN_NAMES}
    return Case.of(job, gains, perturbation=perturbation).tagged(**tags)


def measured(row: Row, figure: str) -> Measured:
    """Return what the search is to know of a row."""
    if row["status"] != OK:  # of what was refused there is no time
        return Measured(math.inf, math.inf, float(row.get(_FAULT_TIME) or 0.0))  # type: ignore[arg-type]
    return Measured(float(row[column(figure)]), 0.01 * float(row[_RIPPLE]))  # type: ignore[arg-type]


def measure_together(cases: Sequence[Case], figure: str = "contour_rms") -> list[Row]:
    """Simulate cases of one job or several, that differ from it in their gains and machines alone, and return rows.

    Args:
        cases: as `case_of` makes them.
        figure: one of `FIGURES`, which the rows have besides those of the contour error.

    Raises:
        GantryError: a case in which something else is changed.
    """
    rows: list[Row] = []
    for first in range(0, len(cases), _TOGETHER):
        lot = cases[first : first + _TOGETHER]
        try:
            rows += [_row(run, case, figure) for run, case in zip(_simulated(lot), lot, strict=True)]
        except InputError:  # of one of them, which is to say why
            rows += [_alone(case, figure) for case in lot]
    return rows


def _alone(case: Case, figure: str) -> Row:
    try:
        (run,) = _simulated([case])
    except InputError as error:
        refusal = error

        def refuse() -> Run:
            raise refusal

        return judged(refuse, lambda run: {})
    return _row(run, case, figure)


def _base(case: Case) -> Job:
    """Return the job that cases share, with its machine and setpoints built once."""
    return replace(case, overrides=()).job()


def _simulated(cases: Sequence[Case]) -> list[Run]:
    jobs = [_base(case) for case in cases]
    return simulate_batch(
        [_machine(case) for case in cases],
        [_servo(case) for case in cases],
        [job.setpoints for job in jobs],
        physics_step=[job.simulation.physics_step for job in jobs],
        dispenser=[job.dispenser for job in jobs],
        threads=1,
    )


def _machine(case: Case) -> Machine:
    machine = _base(case).built_machine
    return machine if case.perturbation is None else _perturbed(machine, case.perturbation)


@lru_cache(maxsize=64)
def _perturbed(machine: Machine, perturbation: Perturbation) -> Machine:
    return machine.perturbed(perturbation)


def _servo(case: Case) -> Servo:
    job, changes = _base(case), case.settings
    known = {f"servo.{name}" for name in GAIN_NAMES}
    if other := sorted(set(changes) - known):
        raise GantryError(f"a case that changes {other[0]}: only {', '.join(sorted(known))} may differ")
    settings = ServoSettings(**{**dict(job.servo), **{key.removeprefix("servo."): changes[key] for key in changes}})
    return Servo.derive(job.built_machine.axes, **dict(settings))


def _row(run: Run, case: Case, figure: str) -> Row:
    row = judged(lambda: run, lambda run: _figures(run, _base(case), figure))
    time: Row = {} if run.fault is None else {_FAULT_TIME: run.fault.time}
    servo = _servo(case)
    gains: Row = {
        f"{name}_{axis}": gain for name in GAIN_NAMES for axis, gain in zip(run.axes, getattr(servo, name), strict=True)
    }
    return {**row, **time, **gains}


def _figures(run: Run, job: Job, figure: str) -> Row:
    analysis = Analysis(run)
    sizes = {"contour": analysis.nozzle.distance}
    if figure.startswith("tracking"):
        sizes["tracking"] = Budget(analysis).parts["tracking"].size
    row: Row = {}
    for link, size in sizes.items():
        for statistic, of in _STATISTICS.items():
            row[column(f"{link}_{statistic}")] = _THOUSANDTHS * of(size)
    peak = np.array([axis.peak_torque for axis in job.built_machine.axes])  # the drive knows the nominal motor's alone
    return {**row, _RIPPLE: 100 * float((torque_ripple(run) / peak).max())}
