"""The report of a tuning: answer, chart, table and details of the start and the tuned servo."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.quantity import MAX, RMS
from gantrysim.compare.runs.compared_run import ComparedRun
from gantrysim.compare.runs.compared_runs import ComparedRuns
from gantrysim.compare.runs.overlay_data import OverlayData
from gantrysim.compare.runs.overlays import draw_compared_budgets, draw_overlaid_errors
from gantrysim.compare.runs.runs_page import bars_size, budgets_table, checks_table, errors_size
from gantrysim.metrics.budget import Budget
from gantrysim.metrics.error_quantities import CONTOUR
from gantrysim.report import Column, Table
from gantrysim.report.sections import drawn_plot
from gantrysim.results.quantities import TORQUE_RIPPLE_PERCENT
from gantrysim.results.verdict import Verdict
from gantrysim.servo.gains import GAIN_NAMES
from gantrysim.servo.stability.margins import (
    CROSSOVER,
    DELAY_MARGIN,
    GAIN_MARGIN_ALONE,
    GAIN_MARGIN_LOWER,
    PHASE_MARGIN,
    SENSITIVITY,
    margins_of,
)
from gantrysim.study.acceptance import Acceptance, Scope, improve_command
from gantrysim.study.cases import OK, Row, verdict_columns
from gantrysim.study.study import Details, Plot, Report
from gantrysim.study.tuning import plots as drawing
from gantrysim.study.tuning.candidates import RANKS, Candidate
from gantrysim.study.tuning.objective import METRICS, RIPPLE, case_of, column, micrometres
from gantrysim.study.tuning.search import History, Phase
from gantrysim.study.tuning.servo import TUNED, UNITS, shown_gain, unit_in_modes
from gantrysim.study.tuning.stability import phase_margin
from gantrysim.study.tuning.study import TuningStudy

# The answer of a tuning: whether better gains were found, and what the verdict is with them.

_FEASIBLE_RANK = 1  # rank of a candidate that keeps all limits


def question(study: TuningStudy) -> str:
    """Return the question."""
    return f"Which gains minimise the {METRICS[study.metric]}?"


def answer(study: TuningStudy, rows: Sequence[Row]) -> str:
    """Return the metric at the start and tuned, in one sentence with what to do and what the verdict is then."""
    history = study.history(rows)
    name = f"{METRICS[study.metric]}, {machines(study)}"
    if history.best is history.start:
        rate = rated_candidate(study, history.start)
        return f"No better gains found: {name}, stays at {rate}{_verdict(study, history)}."
    change = f"{name}, is {rated_candidate(study, history.best)} instead of {rated_candidate(study, history.start)}"
    if history.best.order(0.01 * study.ripple)[0] != _FEASIBLE_RANK:
        return f"No gains within the limits of the search found: with the best of the others the {change}."
    return f"Run with --servo {TUNED}: the {change}{_verdict(study, history)}."


def machines(study: TuningStudy) -> str:
    """Return the machines of which the worst counts, in words."""
    return f"worst of {study.robust + 1} machines" if study.robust else "job's machine"


def rated_candidate(study: TuningStudy, candidate: Candidate) -> str:
    """Return the metric of a candidate, with the constraint that it misses."""
    rank = candidate.order(0.01 * study.ripple)[0]
    return micrometres(candidate.metric) + (f" ({RANKS[rank]})" if rank in (2, 3) else "")


def _verdict(study: TuningStudy, history: History) -> str:
    """Return the verdict on the job with the best gains, a clause."""
    servo = history.best.servo
    run = study.run(servo)
    if run.fault is not None:
        return f"; the job's own machine ends in a fault: {run.fault}"
    verdict = Verdict.of(case_of(study.job, servo, None).job(), run)
    acceptance = Acceptance.of({"status": OK, **verdict_columns(verdict)})
    assert acceptance is not None  # the run is complete
    scope = Scope.of([acceptance])
    if acceptance.keeps(scope.aspects):
        return f"; the job then keeps {scope.words}, with {scope.usage(acceptance)}{scope.remark(acceptance)}"
    return (
        f"; the job then still fails ({acceptance.failures(scope.aspects)}), and {improve_command(study.job)} tries "
        "what else can be changed"
    )


_AT_LIMIT = 0.98  # share of a limit from which it counts as reached
_CHART = "path"  # the plot of start and tuned over one another
_REASONS_OF_END = {
    "budget": "budget used up",
    "converged": "less than 0.2 % gained by three simplexes in succession",
    "no candidate": "no candidate kept the margin",
}


def report(study: TuningStudy, rows: Sequence[Row]) -> Report:
    """Return question, answer, chart of the error before and after, table of results, and details."""
    shown = plots(study, rows)
    chart = next((plot for plot in shown if plot.name == _CHART), None)
    (table,) = tables(study, rows)
    details = Details(notes(study, rows), plots=[plot for plot in shown if plot is not chart])
    return Report(question(study), answer(study, rows), chart, table, details)


def tables(study: TuningStudy, rows: Sequence[Row]) -> list[Table]:
    """Return the table of results: a row for each quantity, at the start and tuned, with its limit."""
    return [_results_table(study, rows, study.history(rows))]


def notes(study: TuningStudy, rows: Sequence[Row]) -> list[str]:
    """Return notes on the limit of the gains, the remaining error, and the course of the search."""
    history = study.history(rows)
    best = history.best
    limits = {
        "stability margin": max(margins.sensitivity for margins in study.stability.worst(best.servo))
        / study.stability.peak,
        "torque ripple": 100 * best.ripple / study.ripple,
    }
    reached = [name for name, share in limits.items() if _AT_LIMIT <= share <= 1]
    remarks = [f"Limiting constraint: {' and '.join(reached)}."] if reached else []
    budget = _budgets(study, history).get("tuned")
    if budget:
        parts = budget.values.parts
        link = max(parts, key=lambda link: parts[link].share)
        text = f"Largest part of the tuned contour error: {link}, {100 * parts[link].share:.0f} % of its mean square."
        if link == "program":
            text += " Tuning cannot fix program errors; the metric servo_rms is the servo's error alone."
        remarks.append(text)
    difference = study.difference_note(best.servo)
    if difference:
        remarks.append(difference)
    axes = "each axis by itself" if study.per_axis else "one factor for all axes"
    return [
        *remarks,
        f"Nelder-Mead over {', '.join(study.space.gains)}, {axes}, seed {study.seed}: {history.runs} runs (budget "
        f"{study.budget}) of {len(history.candidates)} candidates in {history.rounds} rounds; skipped, as no "
        f"frequency met the margin: {history.skipped}; ended: {_REASONS_OF_END[history.ended]}.",
        f"{TUNED} holds the tuned gains, for gantrysim run --servo or the table [servo] of the job.",
    ]


def plots(study: TuningStudy, rows: Sequence[Row]) -> list[Plot]:
    """Return the plots: error along the path, error budget, search, gains, loops, unseen machines."""
    history = study.history(rows)
    shown = [*_comparison_plots(_comparison(study, history)), *_search_plots(study, history)]
    if study.unseen:
        shown.append(_machines_plot(study, rows, history))
    return shown


def _comparison_plots(comparison: ComparedRuns | None) -> list[Plot]:
    """Return the plots of the start and the tuned servo over one another, as `gantrysim compare` shows two runs."""
    if comparison is None:
        return []
    bars = len(comparison.budgets) * len(comparison.runs)
    checks = checks_table(comparison.names, comparison.checks)
    return [
        Plot(
            _CHART,
            "Error along the path",
            "The nozzle's error normal to the requested path, positive to its left, and its parts, of start and tuned "
            "servo over one another on the job's own machine; below, their verdicts check by check.",
            drawn_plot(draw_overlaid_errors, comparison, *errors_size(comparison))(),
            tables=[] if checks is None else [checks],
            viewer=OverlayData(comparison).text(),
        ),
        Plot(
            "budget",
            "Error budget",
            "Parts of the error normal to the requested path by link of the chain, on the job's own machine. "
            "Tuning changes the servo part; it cannot mend the program, the encoder or a soft structure.",
            drawn_plot(draw_compared_budgets, comparison, *bars_size(bars))(),
            tables=[budgets_table(comparison)],
        ),
    ]


def _search_plots(study: TuningStudy, history: History) -> list[Plot]:
    start = history.start.servo
    tuned = history.best.servo
    axes = study.job.built_machine.axis_names
    metric = METRICS[study.metric]
    return [
        Plot(
            "search",
            "Search",
            f"Above: {metric} of every candidate, the largest of the machines it was run on. Below: gains of "
            f"{axes[0]} of the best candidate so far.",
            drawing.draw_search(history, metric, 0.01 * study.ripple),
        ),
        Plot(
            "gains",
            "Gains",
            f"Law {study.space.name}. Ratio of the tuned gains to those of the start; a gain that is 0 in either has "
            "none.",
            drawing.draw_gains(start, tuned, axes),
            tables=[_gains_table(study, history)],
        ),
        Plot(
            "loop",
            "Loops and margins",
            "The open loop L of every axis near -1, and |S| = |1/(1 + L)|; thin lines are the other machines on which "
            f"the margin is kept. A loop outside the disc of radius 1 - 1/{study.margin:g} around -1 has a gain margin "
            f"of at least {study.margin:g} and a phase margin of at least {phase_margin(study.margin):.0f} deg.",
            drawing.draw_loops(study.stability, start, tuned, axes),
            tables=[_margins_table(study, history)],
        ),
    ]


def _machines_plot(study: TuningStudy, rows: Sequence[Row], history: History) -> Plot:
    metric = METRICS[study.metric]
    unseen = {phase: unseen_metric(study, rows, phase) for phase in history.phases}
    searched = {
        phase: [result.metric for result in candidate.results.values()] for phase, candidate in history.phases.items()
    }
    return Plot(
        "machines",
        "Unseen machines",
        f"Cumulative distribution of the {metric} over {study.unseen} machines that the search did not use; "
        "machines with a fault are beyond the right end. Marks are the machines of the search.",
        drawing.draw_machines(unseen, searched, f"{metric} [µm]"),
    )


def unseen_metric(study: TuningStudy, rows: Sequence[Row], phase: Phase) -> Floats:
    """Return the metric on the unseen machines, (unseen,) [µm]; inf for a fault."""
    name = column(study.metric)
    return np.array([float(row[name]) if row["status"] == OK else math.inf for row in study.unseen_rows(rows, phase)])  # type: ignore[arg-type]


def _budgets(study: TuningStudy, history: History) -> dict[Phase, Budget]:
    """Return the error budgets on the job's own machine, of the phases without a fault there."""
    runs = {phase: study.run(candidate.servo) for phase, candidate in history.phases.items()}
    return {phase: Budget(run) for phase, run in runs.items() if run.fault is None}


def _comparison(study: TuningStudy, history: History) -> ComparedRuns | None:
    """Return the runs of start and tuned servo beside one another; None where both end in a fault.

    A phase that ends in a fault on the job's own machine is left out.
    """
    compared = []
    for phase, candidate in history.phases.items():
        servo = candidate.servo
        run = study.run(servo)
        if run.fault is None:
            machine = study.job.built_machine
            values = {"built_servo": servo, "margins": margins_of(machine, servo)}
            job = study.job.sharing(study.job).model_copy(update=values)
            compared.append(ComparedRun.of(run.replaced(job=job), phase))
    return ComparedRuns(tuple(compared)) if compared else None


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _results_table(study: TuningStudy, rows: Sequence[Row], history: History) -> Table:
    budgets = _budgets(study, history)
    metric = METRICS[study.metric]
    results: list[dict[str, Any]] = []
    for phase, candidate in history.phases.items():
        values = budgets[phase].values.contour if phase in budgets else None
        margins = study.stability.worst(candidate.servo)
        result = {
            f"{metric}, {machines(study)} [µm]": _finite(candidate.metric),
            f"{CONTOUR.phrase(RMS)}, job's machine [{CONTOUR.unit}]": CONTOUR.in_unit(values.rms) if values else None,
            f"{CONTOUR.phrase(MAX)}, job's machine [{CONTOUR.unit}]": CONTOUR.in_unit(values.max) if values else None,
            GAIN_MARGIN_ALONE.head: min(axis.gain for axis in margins),
            PHASE_MARGIN.head: min(axis.phase for axis in margins),
            SENSITIVITY.head: max(axis.sensitivity for axis in margins),
            TORQUE_RIPPLE_PERCENT.head: TORQUE_RIPPLE_PERCENT.content(candidate.ripple),
        }
        if study.unseen:
            unseen = unseen_metric(study, rows, phase)
            for name, percent in (("median", 50), ("95 %", 95), ("worst", 100)):
                value = float(np.percentile(unseen, percent, method="inverted_cdf"))
                result[f"{metric}, {name} of {study.unseen} unseen [µm]"] = _finite(value)
            result["unseen machines within all limits"] = _feasible(study, rows, phase, candidate)
        results.append(result)
    limits = {
        GAIN_MARGIN_ALONE.head: study.margin,
        PHASE_MARGIN.head: phase_margin(study.margin),
        SENSITIVITY.head: study.stability.peak,
        TORQUE_RIPPLE_PERCENT.head: study.ripple,
    }
    return Table(
        ["", *(Column(phase, ".4g") for phase in history.phases), Column("limit", ".4g")],
        [
            *([name, *(result[name] for result in results), limits.get(name)] for name in results[0]),
            *_changed_gains(study, history),
        ],
        f"Results and changed gains; margins are the worst of {study.stability.machines} machines, torque ripple of "
        "those that were run",
    )


def _changed_gains(study: TuningStudy, history: History) -> list[list[Any]]:
    """Return a row for each gain of an axis that differs between the start and the tuned servo."""
    servos = [candidate.servo for candidate in history.phases.values()]
    axes = study.job.built_machine.axes
    rows = []
    for name in GAIN_NAMES:
        for a, axis in enumerate(axes):
            values = [servo.per_axis(name)[a] for servo in servos]
            # the search rounds all gains
            if len(set(map(shown_gain, values))) > 1:
                unit = unit_in_modes(servos[0], name, [axis.unit])
                rows.append([f"{name} of {axis.name} [{unit}]", *values, None])
    return rows


def _feasible(study: TuningStudy, rows: Sequence[Row], phase: Phase, candidate: Candidate) -> int:
    """Return the number of unseen machines with neither a fault nor too small a margin nor too much ripple."""
    return sum(
        row["status"] == OK
        and float(row[RIPPLE]) <= study.ripple  # type: ignore[arg-type]
        and float(study.unseen_stability.excess(candidate.servo, [k]).max()) <= 0
        for k, row in enumerate(study.unseen_rows(rows, phase))
    )


def _gains_table(study: TuningStudy, history: History) -> Table:
    servos = {phase: candidate.servo for phase, candidate in history.phases.items()}
    names = [name for name in GAIN_NAMES if any(any(servo.per_axis(name)) for servo in servos.values())]
    return Table(
        ["axis", "u", "", *(Column(f"{name} [{UNITS[name]}]", ".4g") for name in names)],
        [
            [axis.name, axis.unit, phase, *(servo.per_axis(name)[a] for name in names)]
            for a, axis in enumerate(study.job.built_machine.axes)
            for phase, servo in servos.items()
        ],
        "Gains; u is the unit of the axis",
    )


def _margins_table(study: TuningStudy, history: History) -> Table:
    worst = {phase: study.stability.worst(candidate.servo) for phase, candidate in history.phases.items()}
    shown = (GAIN_MARGIN_ALONE, GAIN_MARGIN_LOWER, PHASE_MARGIN, DELAY_MARGIN, SENSITIVITY, CROSSOVER)
    cells: list[list[Any]] = []
    for a, name in enumerate(study.job.built_machine.axis_names):
        for phase, margins in worst.items():
            cells.append([name, phase, *(quantity.in_unit(quantity.get(margins[a])) for quantity in shown)])
    return Table(
        ["axis", "", *map(Column.of, shown)],
        cells,
        f"Margins, worst of {study.stability.machines} machines; crossover on the job's machine",
    )
