"""The verdict on a run: path, glue, stability and machine against their tolerances."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from html import escape
from typing import Any, NamedTuple, Self

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.display import Shown
from gantrysim.base.quantity import MAX, P95, number_text
from gantrysim.engine.recording import dispenser_loads
from gantrysim.glue.bead import Bead
from gantrysim.glue.dispenser.driven import Load
from gantrysim.job.basis import Basis, check_basis, program_lines
from gantrysim.job.losses import happened_events, reached_faults
from gantrysim.job.steps import lost_steps
from gantrysim.job.tolerance import DEFAULT, GIVEN, Bound, Tolerance
from gantrysim.machine.machine import Machine
from gantrysim.metrics.analysis import Analysis
from gantrysim.metrics.budget import Budget, p95_of
from gantrysim.metrics.error_quantities import CONTOUR
from gantrysim.metrics.parts import PartValues
from gantrysim.record.run import Run, check_run
from gantrysim.results.checks import FAIL, ORDER, PASS, SYMBOLS, UNJUDGED, WARN, Check, Place, Row, worst
from gantrysim.results.colours import STATES
from gantrysim.results.glue import GLUE, PlaceAt, glue_row
from gantrysim.results.verdict_quantities import LOADS, SPEED_RESERVE, STEPS_LOST, TORQUE_RESERVE
from gantrysim.servo.stability.margins import GAIN_MARGIN, SENSITIVITY, Margins, margins_of

PATH = "path"
STABILITY = "stability"
MACHINE = "machine"
PATH_STATISTICS = {"path_max": "max", "path_p95": "95 %"}  # of the contour error, by their limits

_FAULT_REMARK = "the run ended in a fault"
# style of a cell of the table in HTML
_CELL = "text-align:left;padding:2px 8px"


@dataclass(frozen=True, repr=False)
class Verdict(Shown):
    """Whether a run is good enough.

    Attributes:
        rows: verdict on path, glue, stability and machine.
        fault: description of the fault that ended the run early; empty for a complete run. No row is then judged.
        contradiction: why the errors of a complete run are not known, see `gantrysim.metrics.budget`; empty
            where they are. No row is then judged.
        stall: that the dispenser's motor stalls, or does not follow its command, when, and what it was asked for; empty
            where it follows.
        tolerance: limits; None for a run that a fault ended.
        disturbances: deliberate faults that occurred in a complete run, by time; its rows are judged with them.
    """

    rows: tuple[Row, ...]
    fault: str = ""
    tolerance: Tolerance | None = None
    disturbances: tuple[str, ...] = ()
    contradiction: str = ""
    stall: str = ""

    @classmethod
    def of(cls, job: Basis, run: Run) -> Verdict:
        """Return the verdict on a run of a job, from its record alone.

        Raises:
            InputError: the dispenser is never on in a run without a fault.
        """
        check_basis(job)
        check_run(run)
        if run.fault is not None:
            return cls.of_fault(run)
        analysis = Analysis(run)
        return cls.of_results(job, Budget(analysis), Bead(run, job.bead, analysis))

    @classmethod
    def of_fault(cls, run: Run) -> Verdict:
        """Return the verdict on a run that a fault ended: fail, without judging anything else."""
        rows = (Row(name, remark=_FAULT_REMARK) for name in (PATH, GLUE, STABILITY, MACHINE))
        return cls(tuple(rows), happened_events(run))

    @classmethod
    def of_results(
        cls,
        job: Basis,
        budget: Budget,
        bead: Bead,
        machine: Machine | None = None,
        *,
        is_checked: bool = True,
        known: MotionRows | None = None,
    ) -> Verdict:
        """Return the verdict on a run whose budget and bead are known.

        Args:
            job: the job, or the basis of a run without one.
            budget: error budget of the run.
            bead: bead of the run.
            machine: machine of the run if not the job's own; the margins are computed for it.
            is_checked: whether the errors are checked against one another first, which needs all links of the budget;
                a search, whose result runs once more to be shown, compares verdicts without.
            known: rows that the glue does not change, where these are known.
        """
        run = budget.analysis.run
        if run.fault is not None:
            return cls.of_fault(run)
        if is_checked and budget.contradictions:
            return cls.of_contradictions(budget.contradictions)
        tolerance = limits_with(job, bead)
        line_at = program_lines(job, len(run.time))
        place_at = places_of(run, line_at)
        loads = dispenser_loads(run, job.dispenser)
        motion = MotionRows.of(job, budget, machine) if known is None else known
        rows = (
            motion.path,
            glue_row(bead, tolerance, place_at, is_requested=job.dispenser.flows_at_all),
            motion.stability,
            _with_loads(motion.machine, loads, place_at),
        )
        disturbances = tuple(str(fault) for fault in reached_faults(run))
        return cls(rows, "", tolerance, disturbances, stall=_stall(loads, run))

    @classmethod
    def of_contradictions(cls, contradictions: tuple[str, ...]) -> Verdict:
        """Return the verdict on a run whose errors contradict one another: none, and nothing is blamed."""
        rows = (Row(name, remark="the errors of this run are not known") for name in (PATH, GLUE, STABILITY, MACHINE))
        because = "; ".join(contradictions)
        text = f"errors not known, because {because}. This is a defect of the analysis: please report the job."
        return cls(tuple(rows), contradiction=text)

    @property
    def unjudged(self) -> str:
        """Why no row is judged: a fault, or a contradiction; empty where they are."""
        return self.fault or self.contradiction

    @property
    def state(self) -> str:
        """The worst row: "pass", "warn" or "fail"; "warn" if a row is not judged and none fails."""
        if self.fault:
            return FAIL
        state = worst([row.state for row in self.rows])
        return WARN if state == UNJUDGED else state

    @property
    def worst_row(self) -> Row | None:
        """The row that fails, or else warns, by the largest share of a limit; None where all pass or none is judged."""
        row = max(self.rows, key=lambda row: row.severity)
        return row if row.state in (WARN, FAIL) else None

    @property
    def shown_row(self) -> str:
        """Name of the row that pictures of a bead show: "path" or "glue", whichever is worse; others have no place."""
        rows = [row for row in self.rows if row.name in (PATH, GLUE)]
        return max(rows, key=lambda row: row.severity).name if rows else PATH

    @property
    def path_limit(self) -> float | None:
        """Limit of the contour error in pictures [mm], see `shown_path_limit`; None where none is judged."""
        return None if self.tolerance is None else shown_path_limit(self[PATH], self.tolerance)

    @property
    def path_statistic(self) -> str:
        """Statistic of the contour error that `path_limit` bounds: "max" or "95 %"; empty where none is judged."""
        return "" if self.tolerance is None else PATH_STATISTICS[_shown_path_check(self[PATH])]

    @property
    def worst_check(self) -> Check | None:
        """The worst check of the worst row; None where there is no such row, or its remark alone says why it fails."""
        row = self.worst_row
        return None if row is None else row.worst_check

    @property
    def placed_check(self) -> Check | None:
        """The worst value whose time is known, also of a run that passes; None without any.

        Stability has no place: the next row by severity then has the worst one.
        """
        rows = sorted(self.rows, key=lambda row: row.severity, reverse=True)
        return next((check for row in rows for check in row.checks if check.place.time is not None), None)

    @property
    def worst_place(self) -> Place | None:
        """Where the run is worst: the place of `placed_check`; None without any."""
        check = self.placed_check
        return None if check is None else check.place

    @property
    def headline(self) -> str:
        """The verdict in one line."""
        if self.unjudged:
            return f"{SYMBOLS[self.state]} {self.state}: {self.unjudged}"
        blamed = [row.name for row in self.rows if row.state != PASS and row.state in (self.state, UNJUDGED)]
        causes = [*([self.stall] if self.stall else ()), *([", ".join(blamed)] if blamed else ())]
        names = f": {'; '.join(causes)}" if causes else ""
        # the fault in a word and its time: what it does is told beside it
        faults = ", ".join(text.partition(": ")[0] for text in self.disturbances)
        return f"{SYMBOLS[self.state]} {self.state}{names}{f'; with {faults}' if faults else ''}"

    @property
    def lines(self) -> tuple[str, ...]:
        """The verdict as text: its headline, and for a complete run a line for each displayed value."""
        if self.unjudged:
            return (f"verdict {self.headline}",)
        return (f"verdict {self.headline}", *(f"{head:12} {name:9} {text}" for head, name, text in self.cells))

    @property
    def cells(self) -> list[tuple[str, str, str]]:
        """The verdict as a table: state and name of a row beside its first text, then its other texts."""
        return [
            (f"{row.symbol} {row.state}", row.name, text) if k == 0 else ("", "", text)
            for row in self.rows
            for k, text in enumerate(row.texts or ("",))
        ]

    def __getitem__(self, name: str) -> Row:
        return next(row for row in self.rows if row.name == name)

    def __str__(self) -> str:
        return "\n".join(self.lines)

    def facts(self) -> dict[str, str]:
        rows = {row.name: f"{row.state}: {'; '.join(row.texts)}" for row in self.rows}
        return {"verdict": self.headline, **rows}

    def _repr_html_(self) -> str:
        return verdict_html(self.headline, self.rows)

    def content(self) -> dict[str, Any]:
        """Return the verdict for JSON."""
        rows = {row.name: row.content() for row in self.rows}
        return {
            "state": self.state,
            "headline": self.headline,
            "fault": self.fault or None,
            "contradiction": self.contradiction or None,
            "dispenser_stall": self.stall or None,
            "disturbances": list(self.disturbances),
            **rows,
        }


def path_row(contour: PartValues, tolerance: Tolerance, line_at: Callable[[float], int | None]) -> Row:
    """Return the verdict on the contour error of a complete run."""
    place = Place(time=contour.time, point=contour.point, line=line_at(contour.time))
    return Row.of(
        PATH,
        [
            Check.of(CONTOUR.statistic(MAX), tolerance.bound("path_max"), contour.max, place=place),
            Check.of(CONTOUR.statistic(P95), tolerance.bound("path_p95"), contour.p95),
        ],
    )


def begun_path_row(error: Floats, count: int | None, tolerance: Tolerance) -> Row:
    """Return the verdict on the contour error of a run of which only the first part is known, as if the rest had none.

    Args:
        error: of the ticks with glue so far, at least one, (m,) [mm].
        count: number of ticks with glue in the whole run; None where it is unknown, and the 95 % error with it.
        tolerance: of the run.
    """
    checks = [Check.of(CONTOUR.statistic(MAX), tolerance.bound("path_max"), float(error.max()))]
    if count is not None:
        whole = np.zeros(count)
        whole[: error.size] = error
        checks.append(Check.of(CONTOUR.statistic(P95), tolerance.bound("path_p95"), p95_of(whole)))
    return Row.of(PATH, checks)


def shown_path_limit(row: Row, tolerance: Tolerance) -> float:
    """Return the limit of the contour error in pictures [mm].

    It is that of the largest error, or that of the 95 % one where this is judged worse: a path that fails for it would
    otherwise be drawn within its tolerance everywhere.

    Args:
        row: the verdict on the path.
        tolerance: limits of the run.
    """
    limit: float = getattr(tolerance, _shown_path_check(row))
    return limit


def _shown_path_check(row: Row) -> str:
    """Return the name of the limit of the contour error in pictures."""
    states = {check.name: ORDER.index(check.state) for check in row.checks}
    return "path_p95" if states.get("path_p95", 0) > states.get("path_max", 0) else "path_max"


def stability_row(job: Basis, margins: tuple[Margins, ...] | None, tolerance: Tolerance) -> Row:
    """Return the verdict on the stability margins of a job's loops, which needs no run; None for unknown margins."""
    if margins is None:
        return Row(STABILITY, remark="the loop cannot be linearised: its margins are unknown")
    names = job.built_machine.axis_names
    gains = [axis.least_gain for axis in margins]
    peaks = [axis.sensitivity for axis in margins]
    weakest = int(np.argmin(gains))
    sharpest = int(np.argmax(peaks))
    unstable = [name for name, axis in zip(names, margins, strict=True) if not axis.stable]
    gain_bound = tolerance.bound("gain_margin", at_least=True)
    return Row.of(
        STABILITY,
        [
            Check.of(GAIN_MARGIN, gain_bound, gains[weakest], place=Place(axis=names[weakest])),
            Check.of(SENSITIVITY, tolerance.bound("sensitivity"), peaks[sharpest], place=Place(axis=names[sharpest])),
        ],
        f"unstable: {', '.join(unstable)}" if unstable else "",
    )


def limits_with(job: Basis, bead: Bead) -> Tolerance:
    """Return the limits that a good run of a job keeps, with those that follow from the width of its bead."""
    width = float(bead.nominal_section.width[0]) if bead.nominal > 0 else math.nan
    return job.limits(bead.run.face, width)


class MotionRows(NamedTuple):
    """The rows of the verdict on a complete run that its glue does not change.

    Attributes:
        path, stability: the rows.
        machine: without the loads of the dispenser's motor.
    """

    path: Row
    stability: Row
    machine: Row

    @classmethod
    def of(cls, job: Basis, budget: Budget, machine: Machine | None = None) -> Self:
        """Return the rows of a job's run; arguments as of `Verdict.of_results`."""
        run = budget.analysis.run
        tolerance = job.limits(run.face)
        line_at = program_lines(job, len(run.time))
        margins = job.margins if machine is None else margins_of(machine, job.built_servo)
        return cls(
            path_row(budget.contour_values, tolerance, line_at),
            stability_row(job, margins, tolerance),
            machine_row(job, run, tolerance, places_of(run, line_at)),
        )


def machine_verdict(job: Basis, run: Run) -> Row:
    """Return the verdict on the drives of a complete run of a job, which needs neither budget nor bead."""
    tolerance = job.limits(run.face)
    place_at = places_of(run, program_lines(job, len(run.time)))
    machine = machine_row(job, run, tolerance, place_at)
    return _with_loads(machine, dispenser_loads(run, job.dispenser), place_at)


def machine_row(job: Basis, run: Run, tolerance: Tolerance, place_at: PlaceAt) -> Row:
    """Return the verdict on the reserves of torque and speed, and on lost steps."""
    return Row.of(MACHINE, list(_machine_checks(job, run, tolerance, place_at)))


def _with_loads(machine: Row, loads: Sequence[Load], place_at: PlaceAt) -> Row:
    """Return the verdict on the drives with that on the dispenser's motor."""
    return Row.of(MACHINE, [*machine.checks, *(_load_check(load, place_at) for load in loads)]) if loads else machine


def _load_check(load: Load, place_at: PlaceAt) -> Check:
    quantity = LOADS[load.name]
    bound = Bound(quantity.name, load.limit, GIVEN)
    return replace(Check.of(quantity, bound, load.value, place=place_at(load.tick)), unit=load.unit)


def _stall(loads: Sequence[Load], run: Run) -> str:
    """Return what happens first where the dispenser's motor exceeds its limits; empty where it keeps them."""
    exceeded = [load for load in loads if load.exceeds]
    if not exceeded:
        return ""
    first = min(exceeded, key=lambda load: load.tick)
    asked = f"{first.name} {number_text(first.value, '.4g')} {first.unit}, limit {first.limit:.4g} {first.unit}"
    return f"the dispenser's motor {first.event} at t = {run.time[first.tick]:.4f} s: {asked}"


def places_of(run: Run, line_at: Callable[[float], int | None]) -> PlaceAt:
    """Return a function of a tick of a run that returns where the nozzle is, and the line of the program."""

    def place_at(tick: int) -> Place:
        x, y, z = run.nozzle[tick].tolist()
        time = float(run.time[tick])
        return Place(time=time, point=(x, y, z), line=line_at(time))

    return place_at


def _machine_checks(job: Basis, run: Run, tolerance: Tolerance, place_at: PlaceAt) -> Iterator[Check]:
    """Yield the checks of the smallest reserves of torque and speed, and of the steps that steppers have lost."""
    servo = job.built_servo
    torque: dict[str, tuple[float, int]] = {}
    speed: dict[str, tuple[float, int]] = {}
    for a, axis in enumerate(job.built_machine.axes):
        # in open loop its current is the same under every load
        if servo.modes[a] != "stepper":
            limit = min(axis.peak_torque, servo.drives[a].torque_limit)
            torque[axis.name] = _reserve(run.demand[:, a], limit)
        if np.isfinite(axis.speed_limit) and len(run.time) > 1:
            speed[axis.name] = _reserve(np.gradient(run.motor[:, a], run.period), axis.speed_limit)
    for quantity, reserves in ((TORQUE_RESERVE, torque), (SPEED_RESERVE, speed)):
        if reserves:
            weakest = min(reserves, key=lambda axis: reserves[axis][0])
            reserve, tick = reserves[weakest]
            place = place_at(tick)
            yield Check.of(
                quantity,
                tolerance.bound(quantity.name, at_least=True),
                reserve,
                place=Place(weakest, place.time, place.point, place.line),
            )
    for lost in lost_steps(job.built_machine, servo, run):
        yield Check.of(STEPS_LOST, Bound(STEPS_LOST.name, 0.0, DEFAULT), lost.most, place=Place(lost.axis, lost.time))


def _reserve(values: np.ndarray, limit: float) -> tuple[float, int]:
    """Return the unused share of a limit [%], and the tick of the largest value."""
    tick = int(np.abs(values).argmax())
    return 100 * (1 - abs(float(values[tick])) / limit), tick


def verdict_html(headline: str, rows: Sequence[Row]) -> str:
    """Return the verdict as a table in HTML: shape, word and colour of each row, and its worst value with the limit."""
    lines = "".join(
        f"<tr><td>{_badge(row.state)}</td>"
        f'<th style="{_CELL}">{escape(row.name)}</th><td style="{_CELL}">{escape(next(iter(row.texts), ""))}</td></tr>'
        for row in rows
    )
    title = f'<caption style="text-align:left;font-weight:bold">verdict {escape(headline)}</caption>'
    return f"<table>{title}{lines}</table>"


def _badge(state: str) -> str:
    """Return a state as its shape and word on its colour, which stands on any background."""
    style = f"background:{STATES[state]};color:#fff;padding:1px 7px;border-radius:3px;white-space:nowrap"
    return f'<span style="{style}">{SYMBOLS[state]} {escape(state)}</span>'
