"""The plots of a search, with their tables: before and after, the search itself, the loops, machines not seen."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from gantrysim.controllers.servo import GAIN_NAMES, Servo
from gantrysim.metrics.budget import LINKS, Budget
from gantrysim.plots.style import COLOURS
from gantrysim.report import Column, Table
from gantrysim.study.cases import Row
from gantrysim.study.study import Plot
from gantrysim.tuning import drawing
from gantrysim.tuning.findings import NOTHING, label, unseen_values
from gantrysim.tuning.search import Candidate, History
from gantrysim.tuning.servo import UNITS
from gantrysim.tuning.stability import phase_margin

if TYPE_CHECKING:
    from gantrysim.tuning.study import TuningStudy

_UM = 1e3
_STAGES = ("before", "after")


def figures(study: TuningStudy, rows: list[Row]) -> list[Plot]:
    """Return the links before and after, the error along the path, the search, its gains, the loops, the machines."""
    history = study.history(rows)
    servos = dict(zip(_STAGES, (history.start.servo, history.best.servo), strict=True))
    runs = {stage: study.run(servo) for stage, servo in servos.items()}
    budgets = {stage: Budget(run) for stage, run in runs.items() if run.fault is None}
    plots = []
    if budgets:
        plots += [
            Plot(
                "budget",
                "Before and after",
                "Root mean square of the parts of the error normal to the requested path, each from one link of the "
                "chain, on the job's own machine. Gains mend the tracking part; what the program, the encoder and the "
                "mechanics make of the error, they do not.",
                drawing.draw_links({stage: budget.values for stage, budget in budgets.items()}),
                tables=[_links_table(budgets)],
            ),
            Plot(
                "path",
                "Error along the path",
                "The nozzle's error normal to the requested path, positive to its left, and what of it is the tracking "
                "part, each on a scale of its own.",
                drawing.draw_path(budgets),
            ),
        ]
    plots += [
        Plot(
            "search",
            "The search",
            f"Above the {label(study.figure)} of every candidate on the hardest machine that it was run on, in the "
            "order of the runs; the line is the best one so far"
            + (", on all machines" if study.robust else "")
            + f". Below the gains of {study.job.built_machine.axis_names[0]} of the best one so far, as multiples of "
            "those found.",
            drawing.draw_search(history, label(study.figure), 0.01 * study.ripple),
        ),
        Plot(
            "gains",
            "The gains",
            f"Law {study.searched_law}. Factors from the gains before to those after; what was none or has become none "
            "has no factor.",
            drawing.draw_gains(servos["before"], servos["after"], study.job.built_machine.axis_names),
            tables=_gains_tables(study, servos, history),
        ),
        Plot(
            "loop",
            "The loops and their margin",
            f"The open loop of every axis near -1, and the peak of |S| = |1/(1 + L)|: thin lines are those of the "
            f"other machines of the search. A loop that stays out of the disc of radius 1 - 1/{study.margin:g} round "
            f"-1 has a gain margin of {study.margin:g} and a phase margin of {phase_margin(study.margin):.0f} deg at "
            "least.",
            drawing.draw_loops(study.stability, servos, study.robust + 1, study.job.built_machine.axis_names),
        ),
    ]
    if study.unseen:
        values = {stage: unseen_values(study, rows, stage) for stage in _STAGES}
        plots.append(
            Plot(
                "machines",
                "Machines that the search has not seen",
                f"Share of {study.unseen} machines with the figure or less, before and after; machines that did not "
                "finish are beyond the right end. Marks are the machines of the search.",
                drawing.draw_machines(
                    values, {stage: _seen(history, stage) for stage in _STAGES}, f"{label(study.figure)} [µm]"
                ),
                tables=[_machines_table(study, values)],
            )
        )
    return plots


def _seen(history: History, stage: str) -> list[float]:
    candidate = history.start if stage == "before" else history.best
    return [one.figure for one in candidate.measured.values() if math.isfinite(one.figure)]


def _links_table(budgets: dict[str, Budget]) -> Table:
    columns: list[str | Column] = ["link"]
    for name, form in (("rms [µm]", ".4g"), ("95 % [µm]", ".4g"), ("max [µm]", ".4g"), ("share [%]", ".1f")):
        columns += [Column(f"{name}, {stage}", form) for stage in budgets]
    rows: list[list[Any]] = []
    for link in (*LINKS, "contour"):
        parts = [
            budget.values.contour if link == "contour" else budget.values.parts[link] for budget in budgets.values()
        ]
        of = [[_UM * part.rms, _UM * part.p95, _UM * part.max, 100 * part.share] for part in parts]
        numbers = [number for same in zip(*of, strict=True) for number in same]
        rows.append([link, *(numbers if max(own[0] for own in of) > NOTHING else [None] * len(numbers))])
    return Table(columns, rows, "Error normal to the path on the job's own machine", COLOURS)


def _gains_tables(study: TuningStudy, servos: dict[str, Servo], history: History) -> list[Table]:
    axes = study.job.built_machine.axes
    names = [name for name in GAIN_NAMES if any(any(getattr(servo, name)) for servo in servos.values())]
    gains = Table(
        ["axis", "u", "", *(Column(f"{name} [{UNITS[name]}]", ".4g") for name in names)],
        [
            [axis.name, axis.unit, stage, *(getattr(servo, name)[a] for name in names)]
            for a, axis in enumerate(axes)
            for stage, servo in servos.items()
        ],
        "Gains before and after",
    )
    candidates: dict[str, Candidate] = dict(zip(_STAGES, (history.start, history.best), strict=True))
    margins = []
    for a, axis in enumerate(axes):
        for stage, servo in servos.items():
            found = [study.stability.margins(servo, k)[a] for k in range(study.robust + 1)]
            numbers = [
                min(one.gain for one in found),
                max(one.gain_lower for one in found),
                min(one.phase for one in found),
                1e3 * min(one.delay for one in found),
                max(one.sensitivity for one in found),
                found[0].crossover,
            ]
            margins.append([axis.name, stage, *numbers])
    columns = [
        Column("gain margin", ".2f"),
        Column("down to", ".2f"),
        Column("phase margin [deg]", ".1f"),
        Column("delay margin [ms]", ".2f"),
        Column("peak of |S|", ".2f"),
        Column("crossover [Hz]", ".1f"),
    ]
    over = "the job's own machine" if not study.robust else f"{study.robust + 1} machines"
    held = Table(
        ["axis", "", *columns], margins, f"Margins, the worst of {over}; the crossover is that of the job's own"
    )
    ripple = Table(
        ["", Column("torque ripple [% of the peak torque]", ".2f")],
        [
            [stage, 100 * candidate.ripple if math.isfinite(candidate.ripple) else None]
            for stage, candidate in candidates.items()
        ],
        f"Torque ripple, the largest of all axes and machines; at most {study.ripple:g} % may be",
    )
    return [gains, held, ripple]


def _machines_table(study: TuningStudy, values: dict[str, Any]) -> Table:
    rows = []
    for stage, found in values.items():
        ordered = sorted(float(value) for value in found)
        last = len(ordered) - 1
        picked = [ordered[round(share * last)] for share in (0.0, 0.5, 0.95, 1.0)]
        rows.append([stage, *(value if math.isfinite(value) else None for value in picked)])
    columns = [Column(f"{name} [µm]", ".4g") for name in ("least", "median", "95 %", "worst")]
    return Table(["", *columns], rows, f"{label(study.figure).capitalize()} on {study.unseen} machines not seen")
