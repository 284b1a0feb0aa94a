"""Scatter of a job's figures with the zeros of its encoders.

A machine is switched on at any place within a count of its encoders. With Coulomb friction the axes stick and slip, and
what they do depends on where a count falls: the figures of a job are one draw from a distribution. Runs whose zeros
differ by less than a count give its mean and standard deviation.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError, whole_number
from gantrysim.base.quantity import MAX, MEAN, P95, RMS, STD, Quantity
from gantrysim.engine.batch import simulate_batch
from gantrysim.engine.positions import axis_positions
from gantrysim.glue.bead import Bead
from gantrysim.glue.bead.values import CLEARANCE, SECTION, VOLUME_ERROR_PERCENT, WIDTH
from gantrysim.job.job import Job
from gantrysim.machine.perturbation import Perturbation
from gantrysim.metrics.analysis import Analysis, torque_ripple
from gantrysim.metrics.budget import Budget
from gantrysim.metrics.error_quantities import ERRORS, LAG, SPEED_RIPPLE, TORQUE_RIPPLE
from gantrysim.metrics.parts import PartValues
from gantrysim.record.run import Run
from gantrysim.record.setpoints import Setpoints

_RUNS_TOGETHER = 8  # runs in memory at a time
_MOST_REPEATS = 1000  # repeats
_SIZES = (RMS, P95, MAX)


@dataclass(frozen=True)
class Figure:
    """A figure of a job and its scatter, in the unit of its quantity.

    Attributes:
        quantity: what it is.
        nominal: of the job itself.
        mean: over the repeats.
        std: standard deviation of the repeats, of a sample.
        low, high: smallest and largest of the repeats.
        count: number of repeats.
    """

    quantity: Quantity[Any]
    nominal: float
    mean: float
    std: float
    low: float
    high: float
    count: int

    @classmethod
    def of(cls, quantity: Quantity[Any], nominal: float, values: Floats) -> Figure:
        """Return the figure of a nominal value and of the repeats' values, (n,), in the quantity's unit."""
        return cls(
            quantity,
            nominal,
            float(values.mean()),
            float(values.std(ddof=1)),
            float(values.min()),
            float(values.max()),
            values.size,
        )

    @property
    def mean_error(self) -> float:
        """Standard error of the mean."""
        return self.std / math.sqrt(self.count)


@dataclass(frozen=True)
class Scatter:
    """Scatter of the figures of a job.

    Attributes:
        figures: by the keys of their quantities, such as "contour_rms_um".
        repeats: number of runs.
        seed: of the zeros.
        counts: by axis, the count of its encoder within which its zero varies [mm or deg].
        faults: number of repeats that ended in a fault; they are in no figure.
    """

    figures: Mapping[str, Figure]
    repeats: int
    seed: int
    counts: Mapping[str, float]
    faults: int


def scatter_of(
    job: Job, repeats: int, seed: int = 0, record: Run | None = None, progress: Callable[[float], None] | None = None
) -> Scatter:
    """Run a job several times with other zeros of its encoders, and return the scatter of its figures.

    Args:
        job: the job.
        repeats: number of runs, 2 to 1000.
        seed: of the zeros, which are uniform within half a count to both sides.
        record: the record of the job itself, if there is one already.
        progress: called with the completed share, 0 to 1.

    Raises:
        InputError: too few or too many repeats, a machine whose encoders have no counts, or fewer than two repeats
            without a fault.
    """
    check_repeats(job, repeats)
    nominal = figures_of(job, job.run() if record is None else record)
    counts = _counts(job)
    zeros = counts * np.random.default_rng(seed).uniform(-0.5, 0.5, (repeats, counts.size))
    values = []
    for first in range(0, repeats, _RUNS_TOGETHER):
        part = zeros[first : first + _RUNS_TOGETHER]
        runs = simulate_batch(
            [job.built_machine.perturbed(Perturbation(home_offset=tuple(-zero))) for zero in part],
            job.built_servo,
            [_moved_setpoints(job, zero) for zero in part],
            physics_step=job.simulation.physics_step,
            dispenser=job.dispenser,
            faults=job.faults,
            engine=job.engine_of_searches,
        )
        moved = [_moved_back(job, run, zero) for run, zero in zip(runs, part, strict=True)]
        values += [figures_of(job, run) for run in moved if run.fault is None]
        if progress is not None:
            progress(min(first + _RUNS_TOGETHER, repeats) / repeats)
    if len(values) < 2:
        raise InputError(f"repeat: {repeats - len(values)} of {repeats} runs ended in a fault, at least 2 must not")
    figures = {
        key: Figure.of(quantity, value, np.array([repeat[key][1] for repeat in values]))
        for key, (quantity, value) in nominal.items()
        if all(key in repeat for repeat in values)
    }
    names = job.built_machine.axis_names
    return Scatter(figures, repeats, seed, dict(zip(names, counts.tolist(), strict=True)), repeats - len(values))


def _counts(job: Job) -> Floats:
    """Return the counts of the encoders of the axes that the program moves, 0 for others, (axes,) [mm or deg]."""
    counts = np.array([drive.resolution for drive in job.built_servo.drives], dtype=np.float64)
    counts[np.ptp(axis_positions(job.built_machine, job.setpoints), axis=0) == 0] = 0.0
    return counts


def _moved_setpoints(job: Job, zero: Floats) -> Setpoints:
    """Return the setpoints moved against the counts by the zeros, (axes,) [mm or deg].

    Between them and the counts is all that a zero changes; the machine's home offset moves its true axes back.
    """
    machine = job.built_machine
    setpoints = job.setpoints
    names = machine.axis_names
    if set(setpoints.axes) <= set(names):
        shift = [zero[names.index(name)] for name in setpoints.axes]
        return replace(setpoints, position=setpoints.position + shift)
    # the program moves coordinates, the zeros are of the axes
    return replace(setpoints, axes=names, position=axis_positions(machine, setpoints) + zero)


def _moved_back(job: Job, run: Run, zero: Floats) -> Run:
    """Return the record with commands, encoders and motors in the coordinates of the job."""
    tip = job.built_machine.tip
    moved = {name: getattr(run, name) - zero for name in ("commanded", "encoder", "motor")}
    tips = {f"{name}_tip": tip(position) for name, position in moved.items()}
    if run.geometric_tip is not None:
        tips["geometric_tip"] = run.geometric_tip + tips["motor_tip"] - run.motor_tip
    return run.replaced(**moved, **tips)


def check_repeats(job: Job, repeats: int) -> None:
    """Raise InputError for a number of repeats out of its bounds, or a job whose encoders have no counts."""
    if whole_number("repeat", repeats, 2) > _MOST_REPEATS:
        raise InputError(f"repeat = {repeats:g}: must be at most {_MOST_REPEATS}")
    if not _counts(job).any():
        raise InputError(
            f"repeat: the encoders of machine {job.built_machine.name} have no counts within which their zeros could "
            "vary: all runs would be equal; leave it out"
        )


def scatters(job: Job) -> bool:
    """Whether the figures of a job depend on its encoders' zeros: an axis has both counts and Coulomb friction."""
    axes = job.built_machine.plain_axes
    return any(count > 0 and axis.coulomb > 0 for count, axis in zip(_counts(job), axes, strict=True))


def figures_of(job: Job, run: Run) -> dict[str, tuple[Quantity[Any], float]]:
    """Return the figures of a run whose scatter counts: by key the quantity and the value, in its unit."""
    return {quantity.key: (quantity, quantity.factor * value) for quantity, value in _figures(job, run)}


def _figures(job: Job, run: Run) -> Iterator[tuple[Quantity[Any], float]]:
    analysis = Analysis(run)
    budget = Budget(analysis)
    for error in ERRORS:
        part = error.get(budget)
        if isinstance(part, PartValues):
            for statistic in _SIZES:
                yield error.statistic(statistic), getattr(part, statistic.name)
    for statistic in _SIZES:
        yield LAG.statistic(statistic), getattr(budget.values.lag, statistic.name)
    yield SPEED_RIPPLE, analysis.speed_ripple
    for axis, ripple in zip(run.axes, torque_ripple(run).tolist(), strict=True):
        yield TORQUE_RIPPLE.by_axis(()).of_axis(axis), ripple
    bead = Bead(run, job.bead, analysis)
    if not bead.nominal > 0:
        return
    yield WIDTH.statistic(MEAN), float(bead.width[bead.dispensing].mean())
    yield SECTION.statistic(STD), bead.values.section.std
    yield VOLUME_ERROR_PERCENT, bead.volume_error_percent
    if analysis.spacing.distance.size:
        yield CLEARANCE.statistic(MEAN), float(bead.clearance().mean())
