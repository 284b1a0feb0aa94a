"""Causes of a bead's error: the bead of a record laid again without one cause at a time, and judged again.

The glue does not act on the motion, so that no run is needed: the dispenser's flow, or the nozzle's place, is computed
anew from the record.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError
from gantrysim.base.quantity import NOTHING, number_text
from gantrysim.engine.recording import dispensed_otherwise
from gantrysim.glue.bead import Bead
from gantrysim.glue.bead.trace import cumulated_sums, surface_steps
from gantrysim.glue.dispenser.command import Material
from gantrysim.glue.dispenser.dispenser import JET, VALVE, Dispenser
from gantrysim.glue.dispenser.jet import LARGEST_VALUE, Jet
from gantrysim.job.basis import program_lines
from gantrysim.job.job import Job
from gantrysim.metrics.analysis import Analysis
from gantrysim.record.run import Run
from gantrysim.results.checks import FAIL, PASS, Check, Row
from gantrysim.results.glue import glue_row
from gantrysim.results.verdict import places_of
from gantrysim.results.verdict_quantities import PLOUGHED

TITLE = "values of the glue without one cause at a time"

MAIN_CAUSE = 0.5  # share of an error from which on a cause is its main one

_LEAST_SHIFT = 1e-9  # of the nozzle [mm]
_OF_KINDS = ("pump", "piston", "motor", "jet")


@dataclass(frozen=True)
class GlueCause:
    """A cause of a bead's error that can be switched off.

    Attributes:
        name: in a word or two.
        off: what the bead without it is like.
        without: returns the record without it, or the record itself where it is absent.
        moves: whether that has another trace of the nozzle.
        meaning: in a few words, where the name alone does not tell what it is.
        dispenser: returns a dispenser without it; None for a cause that is none of the dispenser's.
    """

    name: str
    off: str
    without: Callable[[Job, Bead], Run]
    moves: bool = False
    meaning: str = ""
    dispenser: Callable[[Dispenser], Dispenser] | None = None


def without_dead_time(dispenser: Dispenser) -> Dispenser:
    """Return a dispenser without its dead times, and without the part of its leads that makes up for them."""
    if not dispenser.dead_time and not dispenser.closing_delay:
        return dispenser
    start = max(dispenser.start_lead - dispenser.dead_time, 0.0)
    stop = max(dispenser.stop_lead - dispenser.closing_delay, 0.0)
    return replace(dispenser, dead_time=0.0, closing_dead_time=None, start_lead=start, stop_lead=stop)


def without_lag(dispenser: Dispenser) -> Dispenser:
    """Return a dispenser whose flow follows its request after the dead time, without what compensates the lag."""
    dead = {"start_lead": dispenser.dead_time, "stop_lead": dispenser.closing_delay, "advance": dispenser.dead_time}
    leads = {name: min(getattr(dispenser, name), time) for name, time in dead.items()}
    changes: dict[str, Any] = {"opening": 0.0, "closing": 0.0, "syringe": None, **leads, "advance": 0.0}
    if dispenser.drive is not None:
        changes |= {**dict.fromkeys(_OF_KINDS), "kind": VALVE}
        if dispenser.per_e and not dispenser.filament:
            # also of a piston, whose stroke E is
            changes["e_volume"] = dispenser.per_e
    instant = replace(dispenser, **changes)
    is_same = replace(instant, **{name: getattr(dispenser, name) for name in (*leads, "advance")}) == dispenser
    return dispenser if is_same else instant


def without_shot_rate(dispenser: Dispenser) -> Dispenser:
    """Return a dispenser whose jet is ready for any number of drops in a second."""
    if dispenser.kind != JET:
        return dispenser
    return replace(dispenser, jet=replace(dispenser.jet or Jet(), top_rate=LARGEST_VALUE))


def _of_dispenser(name: str, off: str, change: Callable[[Dispenser], Dispenser], meaning: str = "") -> GlueCause:
    return GlueCause(name, off, _with_dispenser(change), meaning=meaning, dispenser=change)


def _with_dispenser(change: Callable[[Dispenser], Dispenser]) -> Callable[[Job, Bead], Run]:
    def without(job: Job, bead: Bead) -> Run:
        changed = change(job.dispenser)
        return bead.run if changed is job.dispenser else dispensed_otherwise(bead.run, changed)

    return without


def at_constant_speed(job: Job, bead: Bead) -> Run:
    """Return a record whose glue lies as if the nozzle passed all of its path at one speed, the median with glue.

    The dispenser gets the command of each place at the time at which the nozzle would then pass it. Dots, which are
    laid at rest, stay as they are.
    """
    run = bead.run
    steps = surface_steps(run) / run.period
    moving = run.dispense[:-1] & (steps > 0)
    if not moving.any():
        return run
    speed = float(np.median(steps[moving]))
    dispenser = job.dispenser
    before = math.ceil(dispenser.start_lead / run.period) + 1
    count = math.ceil(float(bead.length[-1]) / (speed * run.period)) + 1
    place = speed * run.period * np.arange(count, dtype=np.float64)
    tick = np.searchsorted(bead.length, place, "right") - 1
    on = np.concatenate([np.zeros(before, bool), run.dispense[tick]])

    def fed(values: Floats | None) -> Floats | None:
        if values is None:
            return None
        return np.concatenate([np.full(before, values[0]), np.interp(place, bead.length, values)])

    material = Material(fed(run.extrusion), fed(run.extruder), fed(run.analogue))
    flow = dispenser.flows(on, np.where(on, speed, 0.0), run.period, material)
    laid = cumulated_sums(flow[:-1] * run.period)[before:]
    volume = np.interp(bead.length, place, laid)
    constant = np.append(np.diff(volume) / run.period, 0.0)
    constant[0] += volume[0] / run.period
    demand = np.where(run.dispense, bead.nominal * np.append(steps, 0.0), 0.0)
    for dot in bead.dots:
        share = slice(*dot.share)
        constant[share] = run.flow[share]
        demand[share] = run.flow_demand[share]
    return run.replaced(flow=constant, flow_demand=demand)


def _with_nozzle_shift(keep: tuple[float, float, float]) -> Callable[[Job, Bead], Run]:
    """Return a function that takes the nozzle's contour error away along the axes of which 0 is kept."""

    def without(job: Job, bead: Bead) -> Run:
        analysis = bead.analysis
        shift = analysis.nozzle.offset * (1.0 - np.array(keep))
        if float(np.abs(shift).max(initial=0.0)) < _LEAST_SHIFT:
            return bead.run
        nozzle = np.array(bead.run.nozzle)
        nozzle[analysis.ticks] -= shift
        return bead.run.replaced(nozzle=nozzle)

    return without


SPEED_CHANGES = GlueCause(
    "speed changes",
    "the nozzle passes all of its path at one speed",
    at_constant_speed,
    meaning="which the flow does not follow",
)
GLUE_CAUSES = (
    _of_dispenser("valve delay", "the flow begins to change at once, without the leads for it", without_dead_time),
    _of_dispenser(
        "lag", "the flow follows its request after the dead time", without_lag, "of the flow behind its request"
    ),
    _of_dispenser(
        "shot rate",
        "the jet is ready for every drop that comes due",
        without_shot_rate,
        "of the jet, which loses drops",
    ),
    SPEED_CHANGES,
    GlueCause("path error", "the nozzle is above the requested path", _with_nozzle_shift((0.0, 0.0, 1.0)), moves=True),
    GlueCause(
        "needle gap", "the needle's height above the work is exact", _with_nozzle_shift((1.0, 1.0, 0.0)), moves=True
    ),
)


@dataclass(frozen=True)
class GlueEffect:
    """The effect of switching off a cause of a bead's error.

    Attributes:
        cause: the cause.
        row: the verdict on the glue without it; None where that is not known.
        failure: why not.
    """

    cause: GlueCause
    row: Row | None
    failure: str = ""

    def value(self, name: str) -> float:
        """Return the value of a check by its name, in its unit; nan where it is unknown."""
        return math.nan if self.row is None else value_of(self.row, name)


def value_of(row: Row, name: str) -> float:
    """Return the value of a check of a row by its name, in its unit; nan without it."""
    return next((check.value for check in row.checks if check.name == name), math.nan)


@dataclass(frozen=True)
class GlueCauses:
    """Effects of the causes of a bead's error.

    Attributes:
        row: the verdict on the glue of the run.
        effects: effect of switching off each cause, in the order of `GLUE_CAUSES`.
        second_effects: effect of switching off the main cause of `told_check` together with each other one; empty
            without a main cause.
    """

    row: Row
    effects: tuple[GlueEffect, ...]
    second_effects: tuple[GlueEffect, ...] = ()

    @property
    def check(self) -> Check | None:
        """The check whose causes are told: the worst one."""
        return self.row.worst_check

    def worth(self, effect: GlueEffect, check: Check | None = None) -> float:
        """Return a value, by default the worst one, less that without a cause, in its unit; negative where it helps."""
        check = check or self.check
        return math.nan if check is None else check.value - effect.value(check.name)

    @property
    def heads(self) -> list[str]:
        """Headings of the table: the worst check first, what the cause is worth of it, then the other checks."""
        first, *others = (
            f"{check.label or check.quantity}{f' [{check.unit}]' if check.unit else ''}" for check in self.row.checks
        )
        return ["switched off", first, "worth", *others]

    @property
    def rows(self) -> list[list[str]]:
        """Rows of the table, by `heads`: the cause switched off, and the values without it."""
        first = self.row.checks[0]
        rows = [["nothing", *self._cells(self.row, NOTHING)]]
        for effect in self.effects:
            worth = number_text(first.value - effect.value(first.name), first.form)
            rows.append([effect.cause.name, *self._cells(effect.row, worth)])
        return rows

    def _cells(self, row: Row | None, worth: str) -> list[str]:
        values = [
            NOTHING if row is None else number_text(value_of(row, check.name), check.form) for check in self.row.checks
        ]
        return [values[0], worth, *values[1:]]

    @property
    def notes(self) -> list[str]:
        """Notes on causes whose effect is not known."""
        return [f"{effect.cause.name}: not known: {effect.failure}" for effect in self.effects if effect.failure]


def glue_causes_of(job: Job, bead: Bead) -> GlueCauses | None:
    """Return what each cause of a complete run's glue error is worth; None where no check of the glue fails or warns.

    Args:
        job: the job.
        bead: of its run.
    """
    row = _judged_row(job, bead)
    if row.worst_check is None or row.state == PASS:
        return None
    effects = tuple(_effects(job, bead, row))
    main = _main_effect(row, effects)
    second_effects = () if main is None else tuple(_effects_on_rest(job, bead, main))
    return GlueCauses(row, effects, second_effects)


def told_check(row: Row) -> Check | None:
    """Return the check whose causes are told: the worst one that is the dispenser's matter; None without any."""
    others = (check for check in row.checks if check.state == FAIL and check.name != PLOUGHED.name)
    return next(others, row.worst_check)


def _main_effect(row: Row, effects: Iterable[GlueEffect]) -> GlueEffect | None:
    """Return the effect of the cause that is worth most of what is told, at least half of it; None without one."""
    check = told_check(row)
    known = [effect for effect in effects if check is not None and not math.isnan(effect.value(check.name))]
    if check is None or not known:
        return None
    main = min(known, key=lambda effect: effect.value(check.name))
    return main if check.value - main.value(check.name) >= MAIN_CAUSE * check.value else None


def _effects_on_rest(job: Job, bead: Bead, main: GlueEffect) -> Iterator[GlueEffect]:
    """Yield the effects of switching off each other cause together with the main one; those that are absent are not."""
    first = main.cause
    main_run = first.without(job, bead)
    after = Bead(main_run, job.bead, Analysis(main_run) if first.moves else bead.analysis)
    for cause in GLUE_CAUSES:
        if cause.name == first.name:
            continue
        run = _without_both(first, cause, job, bead, after)
        if run is not None:
            analysis = Analysis(run) if cause.moves else after.analysis
            yield GlueEffect(cause, _judged_row(job, Bead(run, job.bead, analysis)))


def _without_both(first: GlueCause, second: GlueCause, job: Job, bead: Bead, after: Bead) -> Run | None:
    """Return the record without two causes; None where the second is absent.

    Args:
        first: a cause.
        second: another one.
        job: the job.
        bead: of its run.
        after: bead without the first cause.
    """
    if first.dispenser is not None and not second.moves:
        changed = job.model_copy(update={"dispenser": first.dispenser(job.dispenser)})
        run = second.without(changed, bead)
        return None if run is bead.run else run
    if first.dispenser is None and not first.moves and second.dispenser is not None:
        dispenser = second.dispenser(job.dispenser)
        if dispenser is job.dispenser:
            return None
        return first.without(job.model_copy(update={"dispenser": dispenser}), bead)
    run = second.without(job, after)
    return None if run is after.run else run


def _effects(job: Job, bead: Bead, row: Row) -> Iterator[GlueEffect]:
    dispenser = job.dispenser
    # by speed of path or E, or an output of the program
    follows_speed = bool(dispenser.per_e or dispenser.area or dispenser.per_output)
    for cause in GLUE_CAUSES:
        if cause is SPEED_CHANGES and follows_speed:
            cause = replace(cause, meaning="which the flow follows late")
        try:
            run = cause.without(job, bead)
            if run is bead.run:
                yield GlueEffect(cause, row)
                continue
            analysis = Analysis(run) if cause.moves else bead.analysis
            yield GlueEffect(cause, _judged_row(job, Bead(run, job.bead, analysis)))
        except InputError as error:
            yield GlueEffect(cause, None, str(error))


def _judged_row(job: Job, bead: Bead) -> Row:
    run = bead.run
    width = float(bead.nominal_section.width[0]) if bead.nominal > 0 else float("nan")
    place_at = places_of(run, program_lines(job, len(run.time)))
    return glue_row(bead, job.limits(run.face, width), place_at, is_requested=job.dispenser.flows_at_all)
