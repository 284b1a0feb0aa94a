"""The sections of a run's report that show figures of one subject each."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from gantrysim import plots
from gantrysim.bead import Bead
from gantrysim.machine.machine import Machine
from gantrysim.metrics.analysis import THOUSANDTH, Analysis, Range
from gantrysim.metrics.budget import CAUSES, DESCRIPTIONS, Budget, PartValues
from gantrysim.report.document import Column, Section, Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Subject = TypeVar("Subject")

_UM = 1e3
_WIDE, _HALF = 10.7, 5.3  # of a figure as wide as the page, and of one of two side by side [inch]
_PLAN = 7.6  # of a view from above [inch]
_NOTHING = 1e-6  # rms of an error that is none [mm]
_MEANS = {link: f"{description}: {CAUSES[link]}" for link, description in DESCRIPTIONS.items()}


def budget_section(budget: Budget, machine: Machine) -> Section:
    """Return the section of the error budget."""
    figures = budget.values
    columns: list[str | Column] = [
        "link",
        "from one of its ends to the other",
        Column("share [%]", ".1f"),
        Column("rms [µm]", ".1f"),
        Column("95 % [µm]", ".1f"),
        Column("max [µm]", ".1f"),
        Column("at s [mm]", ".1f"),
        Column("t [s]", ".3f"),
        "x, y, z [mm]",
    ]

    def row(name: str, meaning: str, part: PartValues) -> list[str | float | None]:
        numbers = [100 * part.share, *(_UM * value for value in (part.rms, part.p95, part.max))]
        point = ",\N{NO-BREAK SPACE}".join(f"{value:.1f}".replace("-", "−") for value in part.point)
        where = [None] * 3 if part.rms < _NOTHING else [part.s, part.time, point]
        return [name, meaning, *numbers, *where]

    rows = [row(name, _MEANS[name], part) for name, part in figures.parts.items()]
    rows.append(row("contour", _MEANS["contour"], figures.contour))
    links = Table(
        columns,
        rows,
        "Error normal to the requested path; its share of the mean square, and where it is largest",
        plots.COLOURS,
    )
    by_axis = [
        row(name, "its following error", budget.values_of(part))
        for name, part in budget.tracking_by_axis(machine).items()
    ]
    axes = Table(["axis", "part", *columns[2:]], by_axis, "What every axis makes of the tracking part, to first order")
    tables = [links, axes]
    if figures.turns:
        tables.append(_turns(budget))
    text = [
        "At every tick the error of the nozzle normal to the requested path is the sum of the links' parts. A link's "
        "share of the mean square is the mean of its part times the whole error; a share below zero is that of a link "
        "that makes good for others.",
        f"Along the path the nozzle lags the command by {_UM * figures.lag.rms:.1f} µm rms, at most "
        f"{_UM * figures.lag.max:.1f} µm, which is no error normal to it.",
    ]
    tall = 4.4 if figures.turns else 1.6
    return Section(
        "Error budget",
        text,
        table=tables,
        figure=[
            drawn(plots.draw_budget, budget, _WIDE, tall),
            drawn(plots.draw_budget_along, budget, _WIDE, 8.0),
        ],
        alternative=[
            "The links' shares of the contour error's mean square as a stacked bar, and the rms error by turn.",
            "The contour error and the part of every link over the path's length.",
        ],
    )


def errors_section(analysis: Analysis) -> Section:
    """Return the section of the errors over time."""
    figures, run = analysis.values, analysis.run
    axes: list[list[str | float]] = [
        [name, THOUSANDTH[unit], 1e3 * spread.rms, 1e3 * spread.max]
        for unit, (name, spread) in zip(run.units, figures.tracking.items(), strict=True)
    ]
    along = figures.tracking_along
    axes.append(["along the path", "µm", _UM * along.rms, _UM * along.max])
    table = Table(
        ["axis", "unit", Column("rms", ".1f"), Column("max", ".1f")],
        axes,
        "Tracking error, commanded to encoder; rms and max in the row's unit",
    )
    return Section(
        "Errors over time",
        figure=drawn(plots.draw_error, analysis, _WIDE, 6.5 if len(set(run.units)) == 1 else 8.5),
        table=table,
        alternative="Tracking error of every axis, and the error normal to the requested path, over time.",
    )


def _turns(budget: Budget) -> Table:
    names = [*budget.parts, "contour"]
    columns: list[str | Column] = ["turn", Column("from s [mm]", ".1f"), Column("to s [mm]", ".1f")]
    columns += [Column(f"{name}, rms [µm]", ".1f") for name in names]
    columns.append(Column("contour, max [µm]", ".1f"))
    rows = []
    for turn in budget.values.turns:
        rms = [_UM * turn.parts[name].rms for name in names]
        rows.append([turn.turn, *turn.s, *rms, _UM * turn.parts["contour"].max])
    return Table(columns, rows, "By turn of the path's tangent")


def plan_section(analysis: Analysis) -> Section:
    """Return the section of the plan view."""
    tall = plots.view_height(*plots.plan_extent(analysis), _PLAN)
    return Section(
        "Plan view",
        figure=drawn(plots.draw_plan, analysis, _PLAN, tall),
        alternative="The requested path in plan view, and the nozzle's trace with its error magnified.",
    )


def spacing_section(analysis: Analysis) -> Section:
    """Return the section of the spacing, of a trace with neighbouring turns."""
    return Section(
        "Spacing of neighbouring turns",
        figure=[
            drawn(plots.draw_polar_spacing, analysis, _HALF, 4.8),
            drawn(plots.draw_spacing, analysis, _HALF, 4.8),
        ],
        alternative=[
            "Spacing of neighbouring turns over the direction in the path's plane, turn by turn.",
            "Spacing of neighbouring turns over the angle of the tangent within the turn, turn by turn.",
        ],
    )


def bead_section(bead: Bead) -> Section:
    """Return the section of a bead, of a run that asks for glue."""
    figures = bead.values
    columns: list[str | Column] = ["", "unit", *(Column(name, ".3f") for name in ("mean", "std", "min", "max"))]

    def row(name: str, unit: str, values: Range | None) -> list[str | float]:
        return [] if values is None else [name, unit, values.mean, values.std, values.min, values.max]

    rows = [
        row("cross-section", "mm²", figures.section),
        row("width", "mm", figures.width),
        row("clearance of neighbouring turns", "mm", figures.clearance),
        row("start: glue that is missing, as length", "mm", figures.start_shortfall),
        row("stop: glue that is too much, as length", "mm", figures.stop_excess),
        row("start: bead seen late by", "mm", figures.start_offset),
        row("stop: bead seen late by", "mm", figures.stop_offset),
    ]
    facts = [
        (
            "Volume laid",
            f"{figures.volume:.4g} mm³",
            f"{_signed(figures.volume_error_percent)} % against {figures.requested_volume:.4g} mm³ asked for",
        ),
        ("Cross-section", f"{figures.section.mean:.3f} mm²", f"nominal {figures.nominal:.3f} mm²"),
        ("Width", f"{figures.width.mean:.3f} mm", f"from {figures.width.min:.3f} to {figures.width.max:.3f} mm"),
    ]
    if figures.clearance is not None and figures.coverage is not None and figures.overlap_share is not None:
        between = "gap" if figures.clearance.mean > 0 else "overlap"
        facts += [
            (f"Mean {between} between turns", f"{abs(figures.clearance.mean):.3f} mm", ""),
            (
                "Covered",
                f"{100 * figures.coverage:.1f} %",
                f"turns overlap on {100 * figures.overlap_share:.1f} % of their length",
            ),
        ]
    volumes = Table(
        ["part", Column("volume [mm³]", ".4g"), Column("of what was asked for [%]", ".3f"), "what it is"],
        [
            [name, value, 100 * value / figures.requested_volume, meaning]
            for name, value, meaning in (
                (
                    "ramps",
                    figures.ramp_error,
                    "asked for by the program beyond the nominal section, as the speed ramps",
                ),
                ("starts", figures.start_error, "laid beyond what the program asks for until the flow has settled"),
                ("running", figures.steady_error, "the same while it has, as a limit makes it"),
                ("stops", figures.stop_error, "the same from where the dispenser closes"),
                ("error", figures.volume_error, "all of it"),
            )
        ],
        "Volume laid beyond the nominal section along the path, in parts that add up",
    )
    tall = plots.view_height(float(np.ptp(bead.map.x)), float(np.ptp(bead.map.y)), _PLAN)
    return Section(
        "Bead",
        [f"The height map has not settled: {figures.ridge_note}."] if figures.ridge else None,
        facts=facts,
        figure=[
            drawn(plots.draw_height_map, bead, _PLAN, 0.9 * tall),
            drawn(plots.draw_bead_along, bead, _WIDE, 5.4 if bead.clearance.size else 3.0),
        ],
        alternative=[
            "Map of the glue's height in plan view.",
            "Width of the bead along the nozzle's trace, and the gap or overlap between neighbouring turns.",
        ],
        table=[
            Table(
                columns,
                [one for one in rows if one],
                "The bead while the dispenser is on; its starts and stops in lengths of nominal bead",
            ),
            volumes,
        ],
    )


def _signed(value: float) -> str:
    text = f"{value:+.2f}"
    return text.replace("-", "−") if float(text) else text[1:]


def drawn(draw: Callable[[Figure, Subject], None], subject: Subject, width: float, height: float) -> Figure:
    """Return a plot on a sheet of its own, width by height [inch]."""
    with plots.sheet(width, height) as figure:
        draw(figure, subject)
    return figure
