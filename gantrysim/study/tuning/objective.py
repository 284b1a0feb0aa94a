"""The objective: rows of cases that differ in gains and machine alone, simulated together.

A row has the contour error and the torque ripple, the servo part of the error budget where the metric needs it, and
the gains; that of a run ended by a fault has the fault's time and the gains.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gantrysim.base.errors import GantryError, InputError
from gantrysim.base.quantity import MAX, P95, RMS, number_text
from gantrysim.engine.batch import simulate_batch
from gantrysim.job.job import Job
from gantrysim.job.settings import ServoSettings
from gantrysim.machine.machine import Machine
from gantrysim.machine.perturbation import Perturbation
from gantrysim.metrics.analysis import Analysis, ErrorSpread, torque_ripple
from gantrysim.metrics.budget import Budget
from gantrysim.metrics.error_quantities import CONTOUR, SERVO
from gantrysim.record.run import Run
from gantrysim.results.quantities import TORQUE_RIPPLE_PERCENT
from gantrysim.servo.gains import GAIN_NAMES
from gantrysim.servo.servo import Servo
from gantrysim.study.cases import OK, Case, Row, Value, judged_row, perturbed_machine
from gantrysim.study.tuning.candidates import TrialResult

_STATISTICS = (RMS, P95, MAX)
_QUANTITIES = {
    error.statistic(statistic).name: (error, statistic) for error in (CONTOUR, SERVO) for statistic in _STATISTICS
}
OF_LARGEST = frozenset(name for name, (_, statistic) in _QUANTITIES.items() if statistic is MAX)
METRICS = {name: error.phrase(statistic) for name, (error, statistic) in _QUANTITIES.items()}
RIPPLE = TORQUE_RIPPLE_PERCENT.key

_RUNS_TOGETHER = 8  # runs whose records are held at once
_FAULT_TIME = "fault_time_s"


def column(metric: str) -> str:
    """Return the column of a metric in study.csv, with its unit."""
    error, statistic = _QUANTITIES[metric]
    return error.statistic(statistic).key


def micrometres(value: float) -> str:
    """Return the value of a metric with its unit; a run without one ended in a fault."""
    return f"{number_text(value, '.4g')} {CONTOUR.unit}" if math.isfinite(value) else "fault"


def case_of(job: Job, servo: Servo, perturbation: Perturbation | None, **tags: Value) -> Case:
    """Return the case of a job with other gains, on a perturbed machine or its own."""
    gains = {f"servo.{name}": list(servo.per_axis(name)) for name in GAIN_NAMES}
    return Case.of(job, gains, perturbation=perturbation).tagged(**tags)


def trial_result(row: Row, metric: str) -> TrialResult:
    """Return the result of a trial from its row."""
    # a refused case has no fault time
    if row["status"] != OK:
        return TrialResult(math.inf, math.inf, float(row.get(_FAULT_TIME) or 0.0))  # type: ignore[arg-type]
    return TrialResult(float(row[column(metric)]), 0.01 * float(row[RIPPLE]))  # type: ignore[arg-type]


def measure_together(cases: Sequence[Case], metric: str = "contour_rms") -> list[Row]:
    """Simulate cases that differ from their jobs in gains and machine alone, and return their rows.

    Args:
        cases: as `case_of` makes them.
        metric: one of `METRICS`, a column of the rows besides the contour error.

    Raises:
        GantryError: a case changes something else.
    """
    rows: list[Row] = []
    for first in range(0, len(cases), _RUNS_TOGETHER):
        lot = cases[first : first + _RUNS_TOGETHER]
        try:
            rows += [_row(run, case, metric) for run, case in zip(_simulated_runs(lot), lot, strict=True)]
        except InputError:  # one of them is refused
            rows += [_measure(case, metric) for case in lot]
    return rows


def _measure(case: Case, metric: str) -> Row:
    try:
        (run,) = _simulated_runs([case])
    except InputError:
        # refused again; its row has the reason
        return judged_row(lambda: _simulated_runs([case])[0], lambda run: {})
    return _row(run, case, metric)


def _base(case: Case) -> Job:
    """Return the job that cases share, with its machine and setpoints built once."""
    return replace(case, overrides=()).job()


def _simulated_runs(cases: Sequence[Case]) -> list[Run]:
    jobs = [_base(case) for case in cases]
    return simulate_batch(
        [_machine(case) for case in cases],
        [_servo(case) for case in cases],
        [job.setpoints for job in jobs],
        physics_step=[job.simulation.physics_step for job in jobs],
        dispenser=[job.dispenser for job in jobs],
        faults=[job.faults for job in jobs],
        threads=1,
        engine=jobs[0].engine_of_searches,
    )


def _machine(case: Case) -> Machine:
    machine = _base(case).built_machine
    return machine if case.perturbation is None else perturbed_machine(machine, case.perturbation)


def _servo(case: Case) -> Servo:
    job = _base(case)
    changes = case.settings
    allowed = {f"servo.{name}" for name in GAIN_NAMES}
    other = sorted(set(changes) - allowed)
    if other:
        raise GantryError(f"a case that changes {other[0]}: only {', '.join(sorted(allowed))} may differ")
    settings = ServoSettings(**{**dict(job.servo), **{key.removeprefix("servo."): changes[key] for key in changes}})
    return Servo.derive(job.built_machine.axes, **dict(settings))


def _row(run: Run, case: Case, metric: str) -> Row:
    row = judged_row(lambda: run, lambda run: _values(run, _base(case), metric))
    time: Row = {} if run.fault is None else {_FAULT_TIME: run.fault.time}
    servo = _servo(case)
    gains: Row = {}
    for name in GAIN_NAMES:
        for axis, gain in zip(run.axes, servo.per_axis(name), strict=True):
            gains[f"{name}_{axis}"] = gain
    return {**row, **time, **gains}


def _values(run: Run, job: Job, metric: str) -> Row:
    analysis = Analysis(run)
    sizes = {CONTOUR: analysis.nozzle.distance}
    if metric.startswith(SERVO.name):
        sizes[SERVO] = Budget(analysis).parts[SERVO.name].size
    row: Row = {}
    for error, size in sizes.items():
        spread = ErrorSpread.of(size)
        for statistic in _STATISTICS:
            row[error.statistic(statistic).key] = error.in_unit(getattr(spread, statistic.name))
    # of the nominal motor, as the drive has it
    peak = np.array([axis.peak_torque for axis in job.built_machine.axes])
    return {**row, RIPPLE: 100 * float((torque_ripple(run) / peak).max())}
