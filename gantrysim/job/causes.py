"""The causes of a job's error: the job run again with one cause at a time switched off.

The links of the error budget locate the error on the chain: each is the difference of two traces. A link is not a
cause, as one cause acts on several links: encoder steps, amplified by kd, also shake the structure. Here the job is run
again without the cause, and its worth is the difference:

    worth = error of the job - error without the cause

All else stays, the gains included, which are those for the real machine. Effects do not add up to the error: causes act
together, and one may offset another, which then has a negative worth.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from gantrysim.base.errors import InputError
from gantrysim.base.quantity import number_text
from gantrysim.job.ideal import FINE, finely_sampled, on_the_path
from gantrysim.job.job import Job
from gantrysim.job.setup import Errors, Setup, errors_of, outcomes_of
from gantrysim.machine.geometry import Geometry
from gantrysim.machine.ideal import without_compliance, without_friction, without_winding
from gantrysim.machine.machine import Machine
from gantrysim.metrics.analysis import ErrorSize
from gantrysim.metrics.budget import Budget
from gantrysim.metrics.parts import ERROR
from gantrysim.record.run import Run

TITLE = "contour error without one cause at a time, and rms by link [µm]"
HEADS = ("switched off", "rms", "max", "worth")  # and the links
CELL_FORM = ".2f"  # effects are often smaller than the decimals of `ERROR`

_SAME_STEP = 1e-9  # relative


@dataclass(frozen=True)
class Cause:
    """A cause of error that can be switched off.

    Attributes:
        name: in a word.
        off: what a run without it is like.
        without: returns a setup without it, or the setup itself where it is absent.
    """

    name: str
    off: str
    without: Callable[[Setup], Setup]


def _without_sampling(setup: Setup) -> Setup:
    if (
        setup.servo.period <= max(FINE, setup.servo.inner_period)
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
    Cause("program", "the command follows the requested path exactly, at the same progress", _without_program),
    Cause("sampling", f"the servo's period is at most {1e6 * FINE:g} µs, without delay", _without_sampling),
    Cause("counts", "the encoders are exact", _without_counts),
    Cause("friction", "only viscous friction is left", _on(without_friction)),
    Cause("winding", "the motors' current follows the demand at once", _without_winding),
    Cause("compliance", "the springs between motors and nozzle are rigid", _without_compliance),
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
            name: ErrorSize(self.before[name].rms - size.rms, self.before[name].max - size.max)
            for name, size in self.without.items()
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
                rms = cell_text(ERROR.scaled(effect.before["contour"].rms))
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
) -> Causes:
    """Rerun a job with one cause of `CAUSES` removed each time, and return the effect of each.

    Args:
        job: the job.
        run: record of the job, if it has been run.
        progress: function called from time to time with the completed share, 0 to 1.
        budget: of the record, if it is known; the record is then not needed.

    Raises:
        InputError: the job ends in a fault, has deliberate faults, or its dispenser is never on.
    """
    check_causes(job)
    setup = Setup(job.built_machine, job.built_servo, job.setpoints, job.simulation.physics_step)
    causes = CAUSES if setup.machine.geometry is None else (*CAUSES, GEOMETRY)

    def part(first: int, count: int) -> Callable[[float], None] | None:
        """Return the progress of some of the runs, the job's own first."""
        return None if progress is None else lambda share: progress((first + count * share) / (1 + len(causes)))

    record = run if budget is None else budget.analysis.run
    if record is None:
        record = setup.run(part(0, 1))
    if record.fault is not None:
        raise InputError(f"job {job.name}: ends in a fault, {record.fault}: causes are those of a complete run")
    known = Budget(record) if budget is None else budget
    if known.contradictions:
        raise InputError(f"job {job.name}: neither its errors nor their causes are known: {known.contradictions[0]}")
    return Causes(errors_of(known), _effects(causes, setup, known, part(1, len(causes))))


def _effects(
    causes: Sequence[Cause], setup: Setup, budget: Budget, progress: Callable[[float], None] | None
) -> tuple[Effect, ...]:
    """Return the effects of causes on the errors of a budget, from runs beside one another.

    A run without a cause that has another physics step is compared with one of the job at that step.
    """
    errors = errors_of(budget)
    refused: dict[str, str] = {}
    setups: dict[str | float, Setup] = {}  # by the cause without which it is, or by the physics step of the whole job
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
    outcomes = dict(zip(setups, outcomes_of(list(setups.values()), progress, budget.analysis), strict=True))

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
    return list(map(ERROR.scaled, sizes))


def cell_text(value: float | None) -> str:
    """Return a number of the table as text."""
    return number_text(value, CELL_FORM)
