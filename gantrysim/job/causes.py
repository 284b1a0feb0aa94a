"""The causes of a job's error: the job run again with one cause at a time switched off.

The links of the error budget locate the error on the chain: each is the difference of two traces. A link is not a
cause, as one cause acts on several links: encoder steps, amplified by kd, also shake the structure. Here the job is run
again without the cause, and its worth is the difference:

    worth = error of the job - error without the cause

All else stays, the gains included, which are those for the real machine. Effects do not add up to the error: causes act
together, and one may offset another, which then has a negative worth.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from gantrysim.base import memory
from gantrysim.base.columns import blocks
from gantrysim.base.errors import InputError, check_type
from gantrysim.base.quantity import number_text
from gantrysim.engine.linear import Engine
from gantrysim.engine.simulate import stepped_simulation
from gantrysim.engine.simulation import Simulation
from gantrysim.job.ideal import FINE_PERIOD, finely_sampled, on_the_path
from gantrysim.job.job import Job, check_job
from gantrysim.machine.geometry import Geometry
from gantrysim.machine.ideal import without_compliance, without_friction, without_winding
from gantrysim.machine.machine import Machine
from gantrysim.machine.timing import substeps_of
from gantrysim.metrics.analysis import Analysis, ErrorSpread
from gantrysim.metrics.budget import Budget
from gantrysim.metrics.parts import ERROR
from gantrysim.paths.path import Projection
from gantrysim.record.run import Run, check_run
from gantrysim.record.setpoints import Setpoints
from gantrysim.servo.servo import Servo

# What a job runs, and the errors of several such runs, made beside one another in threads.

Errors = dict[str, ErrorSpread]  # by link, and of the whole as "contour" [mm]


@dataclass(frozen=True)
class Setup:
    """What a job runs.

    Attributes:
        machine: the machine.
        servo: the servo.
        setpoints: the setpoints, at the servo's period.
        physics_step: as in `simulate` [s].
        ticks: servo ticks per setpoint of the program.
        engine: as in `simulate`.
    """

    machine: Machine
    servo: Servo
    setpoints: Setpoints
    physics_step: float | None = None
    ticks: int = 1
    engine: Engine = "loop"

    @property
    def step(self) -> float:
        """The physics step [s]."""
        return self.servo.period / substeps_of(
            self.machine, self.servo.period, self.physics_step, self.servo.inner_period
        )

    def run(self, progress: Callable[[float], None] | None = None) -> Run:
        """Run it without glue and return the record at the ticks of the program."""
        simulation = Simulation.of(self.machine, self.servo, self.setpoints, physics_step=self.physics_step)
        return stepped_simulation(simulation, engine=self.engine, progress=progress).record(every=self.ticks)


class RunOutcome(NamedTuple):
    """What a run shows.

    Attributes:
        errors: of the run; empty where it failed.
        failure: why it failed: a refusal, or a fault that ended it.
    """

    errors: Errors
    failure: str = ""


class _SameCommand(Analysis):
    """The analysis of a run that may have the command of another, whose projection it then is.

    Args:
        run: the run.
        other: analysis of the other run.
    """

    def __init__(self, run: Run, other: Analysis) -> None:
        super().__init__(run)
        self._other = other

    @cached_property
    def commanded(self) -> Projection:
        """Projection of the commanded positions."""
        other = self._other.run
        if self.run.requested is not other.requested or not np.array_equal(self.run.dispense, other.dispense):
            return super().commanded
        tip = self.run.commanded_tip
        same = all(np.array_equal(tip[block], other.commanded_tip[block]) for block in blocks(len(tip)))
        return self._other.commanded if same else super().commanded


def outcomes_of(
    setups: Sequence[Setup],
    progress: Callable[[float], None] | None = None,
    known: Analysis | None = None,
    *,
    by_link: bool = True,
) -> list[RunOutcome]:
    """Return what the runs of setups show, in their order.

    They are stepped without Python's lock, so that threads share the work. Of long runs, one is made at a time.

    Args:
        setups: what is run.
        progress: called now and then with the completed share, 0 to 1, from one thread at a time.
        known: analysis of a run that has the command of most of these.
        by_link: whether the errors of the links are computed, and not the contour error alone.
    """
    shares = [0.0] * len(setups)
    alone = threading.Lock()

    def run(number: int) -> RunOutcome:
        def advance(share: float) -> None:
            with alone:
                shares[number] = share
                if progress is not None:
                    progress(sum(shares) / len(shares))

        try:
            record = setups[number].run(advance)
        except InputError as error:
            return RunOutcome({}, str(error))
        if record.fault is not None:
            return RunOutcome({}, str(record.fault))
        return RunOutcome(errors_of(Budget(record if known is None else _SameCommand(record, known)), by_link=by_link))

    if not setups:
        return []
    is_long = any(len(setup.setpoints.position) > memory.LONG_RUN for setup in setups)
    with ThreadPoolExecutor(1 if is_long else os.cpu_count()) as pool:
        return list(pool.map(run, range(len(setups))))


def errors_of(budget: Budget, *, by_link: bool = True) -> Errors:
    """Return the errors of a run by link, if wanted, and as a whole."""
    links = budget.parts if by_link else {}
    return {name: ErrorSpread.of(part.size) for name, part in {**links, "contour": budget.contour}.items()}


TITLE = "contour error without one cause at a time, and rms by link [µm]"
HEADS = ("switched off", "rms", "max", "worth")  # and the links
CELL_FORM = ".1f"

_SAME_STEP = 1e-9  # relative


@dataclass(frozen=True)
class Cause:
    """A cause of error that can be switched off.

    Attributes:
        name: in a word.
        off: what a run without it is like.
        without: returns a setup without it, or the setup itself where it is absent.
        meaning: in a few words, where the name alone does not tell what it is.
    """

    name: str
    off: str
    without: Callable[[Setup], Setup]
    meaning: str = ""


def _without_sampling(setup: Setup) -> Setup:
    if (
        setup.servo.period <= max(FINE_PERIOD, setup.servo.inner_period)
        and not setup.servo.delay
        and not setup.servo.feedback_delay
    ):
        return setup
    servo, setpoints = finely_sampled(setup.machine, setup.servo, setup.setpoints)
    return replace(setup, servo=servo, setpoints=setpoints, ticks=round(setup.servo.period / servo.period))


def _without_counts(setup: Setup) -> Setup:
    exact = setup.servo.with_values(
        resolution=0.0, encoder_noise=0.0, interpolation_error=0.0, interpolation_error_twice=0.0
    )
    return setup if exact == setup.servo else replace(setup, servo=exact)


def _without_winding(setup: Setup) -> Setup:
    ideal = _on(without_winding)(setup)
    return replace(ideal, servo=ideal.servo.with_values(current_bandwidth=0.0)) if ideal is not setup else setup


def _without_compliance(setup: Setup) -> Setup:
    ideal = _on(without_compliance)(setup)
    return replace(ideal, servo=ideal.servo.with_values(feedback="motor")) if ideal is not setup else setup


def _on(machine: Callable[[Machine], Machine]) -> Callable[[Setup], Setup]:
    def without(setup: Setup) -> Setup:
        ideal = machine(setup.machine)
        return setup if ideal is setup.machine else replace(setup, machine=ideal)

    return without


def _without_program(setup: Setup) -> Setup:
    exact = on_the_path(setup.machine, setup.setpoints)
    return setup if exact is setup.setpoints else replace(setup, setpoints=exact)


CAUSES = (
    Cause(
        "program",
        "the command follows the requested path exactly, at the same progress",
        _without_program,
        "its commands leave the requested path",
    ),
    Cause(
        "sampling",
        f"the servo's period is at most {1e6 * FINE_PERIOD:g} µs, without delay",
        _without_sampling,
        "period and delay of the servo",
    ),
    Cause("counts", "the encoders are exact", _without_counts, "steps of the encoders"),
    Cause("friction", "only viscous friction is left", _on(without_friction)),
    Cause("winding", "the motors' current follows the demand at once", _without_winding, "lag of the motors' current"),
    Cause(
        "compliance",
        "the springs between motors and nozzle are rigid",
        _without_compliance,
        "springs between motors and nozzle",
    ),
)
# of a machine with errors of its geometry
GEOMETRY = Cause(
    "geometry",
    "the axes are straight and square, their travel is exact and without play",
    _on(lambda machine: machine.with_geometry(Geometry())),
)


@dataclass(frozen=True)
class Effect:
    """The effect of switching off a cause.

    Attributes:
        cause: the cause.
        before: errors of the job at the physics step of the run without the cause.
        without: errors without it; empty where that run failed.
        failure: why it failed.
    """

    cause: Cause
    before: Errors
    without: Errors
    failure: str = ""

    @property
    def worth(self) -> Errors:
        """Errors with the cause minus those without it, negative where it offsets other causes; empty if it failed."""
        return {
            name: ErrorSpread(before.rms - size.rms, before.max - size.max, before.p95 - size.p95)
            for name, size in self.without.items()
            for before in [self.before[name]]
        }


@dataclass(frozen=True)
class Causes:
    """Effects of the causes of a job's error; prints as a table.

    Attributes:
        errors: errors of the unchanged job.
        effects: effect of switching off each cause, in the order of `CAUSES`, and of `GEOMETRY` if the job has any.
    """

    errors: Errors
    effects: tuple[Effect, ...]

    @property
    def heads(self) -> tuple[str, ...]:
        """Headings of the table: `HEADS`, and the links."""
        return (*HEADS, *self._links)

    @property
    def _links(self) -> list[str]:
        return [name for name in self.errors if name != "contour"]

    @property
    def rows(self) -> list[tuple[str, list[float | None]]]:
        """Rows of the table, by `heads`: the cause switched off, and errors without it, None for a failed run [µm]."""
        links = self._links
        effects = [(effect.cause.name, _cells(effect.without, effect.worth, links)) for effect in self.effects]
        return [("nothing", _cells(self.errors, None, links)), *effects]

    @property
    def notes(self) -> list[str]:
        """Notes on runs that failed, and on runs compared with a run of the job at their own physics step."""
        notes = []
        for effect in self.effects:
            if effect.failure:
                notes.append(f"{effect.cause.name}: {effect.failure}")
            elif effect.before != self.errors:
                rms = cell_text(ERROR.in_unit(effect.before["contour"].rms))
                notes.append(f"{effect.cause.name}: compared with the job at the same physics step, {rms} µm rms")
        return notes

    def __str__(self) -> str:
        texts = [self.heads, *((name, *map(cell_text, cells)) for name, cells in self.rows)]
        widths = [max(7, len(head)) for head in self.heads[1:]]
        table = [
            f"{name:12}" + "".join(f" {cell:>{width}}" for cell, width in zip(cells, widths, strict=True))
            for name, *cells in texts
        ]
        return "\n".join([TITLE, *table, *self.notes])


def check_causes(job: Job) -> None:
    """Raise InputError for a job with deliberate faults, which would be a cause among the others."""
    if job.faults:
        raise InputError(f"job {job.name}: has deliberate faults: causes are those of the job without [[faults]]")


def causes_of(
    job: Job,
    run: Run | None = None,
    progress: Callable[[float], None] | None = None,
    *,
    budget: Budget | None = None,
    by_link: bool = True,
) -> Causes:
    """Rerun a job with one cause of `CAUSES` removed each time, and return the effect of each.

    Args:
        job: the job.
        run: record of the job, if it has been run.
        progress: function called from time to time with the completed share, 0 to 1.
        budget: of the record, if it is known; the record is then not needed.
        by_link: whether the errors of the links are computed, and not the contour error alone, which takes half as
            long.

    Raises:
        InputError: the job ends in a fault, has deliberate faults, or its dispenser is never on.
    """
    check_job(job)
    check_causes(job)
    setup = Setup(
        job.built_machine,
        job.built_servo,
        job.setpoints,
        job.simulation.physics_step,
        engine=job.engine_of_searches,
    )
    causes = CAUSES if setup.machine.geometry is None else (*CAUSES, GEOMETRY)

    def part(first: int, count: int) -> Callable[[float], None] | None:
        """Return the progress of some of the runs, the job's own first."""
        return None if progress is None else lambda share: progress((first + count * share) / (1 + len(causes)))

    if run is not None:
        check_run(run)
    if budget is not None:
        check_type("budget", budget, Budget, "a Budget", "gantrysim.Budget(run) returns one")
    record = run if budget is None else budget.analysis.run
    if record is None:
        # it is shown
        record = replace(setup, engine=job.simulation.engine or "mujoco").run(part(0, 1))
    if record.fault is not None:
        raise InputError(f"job {job.name}: ends in a fault, {record.fault}: causes are those of a complete run")
    known = Budget(record) if budget is None else budget
    if known.contradictions:
        raise InputError(f"job {job.name}: neither its errors nor their causes are known: {known.contradictions[0]}")
    effects = _effects(causes, setup, known, part(1, len(causes)), by_link=by_link)
    return Causes(errors_of(known, by_link=by_link), effects)


def _effects(
    causes: Sequence[Cause],
    setup: Setup,
    budget: Budget,
    progress: Callable[[float], None] | None,
    *,
    by_link: bool,
) -> tuple[Effect, ...]:
    """Return the effects of causes on the errors of a budget, from runs beside one another.

    A run without a cause that has another physics step is compared with one of the job at that step.
    """
    errors = errors_of(budget, by_link=by_link)
    refused: dict[str, str] = {}
    # by the cause without which it is, or by the physics step of the whole job
    setups: dict[str | float, Setup] = {}
    steps: dict[str, float] = {}
    for cause in causes:
        try:
            ideal = cause.without(setup)
        except InputError as error:
            refused[cause.name] = str(error)
            continue
        if ideal is not setup:
            setups[cause.name] = ideal
            if abs(ideal.step - setup.step) >= _SAME_STEP * setup.step:
                steps[cause.name] = ideal.step
                setups[ideal.step] = replace(setup, physics_step=ideal.step)
    shown = outcomes_of(list(setups.values()), progress, budget.analysis, by_link=by_link)
    outcomes = dict(zip(setups, shown, strict=True))

    def effect(cause: Cause) -> Effect:
        if cause.name in refused:
            return Effect(cause, errors, {}, refused[cause.name])
        if cause.name not in outcomes:
            return Effect(cause, errors, errors)
        without = outcomes[cause.name]
        if without.failure or cause.name not in steps:
            return Effect(cause, errors, without.errors, without.failure)
        step = steps[cause.name]
        before = outcomes[step]
        if before.failure:
            return Effect(cause, errors, {}, f"with it, at the same physics step of {step:g} s: {before.failure}")
        return Effect(cause, before.errors, without.errors)

    return tuple(map(effect, causes))


def _cells(errors: Errors, worth: Errors | None, links: list[str]) -> list[float | None]:
    if not errors:
        return [None] * (len(HEADS) - 1 + len(links))
    contour = errors["contour"]
    change = None if worth is None else worth["contour"].rms
    sizes = (contour.rms, contour.max, change, *(errors[link].rms for link in links))
    return list(map(ERROR.in_unit, sizes))


def cell_text(value: float | None) -> str:
    """Return a number of the table as text."""
    return number_text(value, CELL_FORM)
