"""The sections of a run's report on its errors, spacing and bead."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from gantrysim.base.display import decimals_of
from gantrysim.bead import Bead, BeadValues
from gantrysim.job.losses import Losses, events
from gantrysim.machine.machine import Machine
from gantrysim.metrics.analysis import THOUSANDTH, Analysis
from gantrysim.metrics.budget import DESCRIPTIONS, Budget
from gantrysim.metrics.parts import PartValues
from gantrysim.plots.bead import draw_bead_along, draw_height_map
from gantrysim.plots.budget import draw_budget, draw_budget_along
from gantrysim.plots.error import draw_error
from gantrysim.plots.plan import draw_plan, plan_extent
from gantrysim.plots.spacing import draw_polar_spacing, draw_spacing
from gantrysim.plots.style import COLOURS, sheet, view_height
from gantrysim.record.run import Run
from gantrysim.report.document import Column, Section, Table
from gantrysim.report.headline import NO_ERROR

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Subject = TypeVar("Subject")

_UM = 1e3
# width of a plot across the page, and of one of two side by side [inch]
_WIDE = 10.7
_HALF = 5.3
_PLAN = 7.6  # width of a plan view [inch]


def budget_section(budget: Budget, machine: Machine) -> Section:
    """Return the section of the error budget."""
    values = budget.values
    numbers: list[str | Column] = [
        Column("share [%]", ".1f"),
        Column("rms [µm]", ".1f"),
        Column("95 % [µm]", ".1f"),
        Column("max [µm]", ".1f"),
        Column("at s [mm]", ".1f"),
        Column("t [s]", ".3f"),
        "x, y, z [mm]",
    ]

    def row(part: PartValues, *labels: str) -> list[str | float | None]:
        point = ",\N{NO-BREAK SPACE}".join(f"{value:z.1f}".replace("-", "−") for value in part.point)
        where = [None] * 3 if part.rms < NO_ERROR else [part.s, part.time, point]
        return [*labels, 100 * part.share, _UM * part.rms, _UM * part.p95, _UM * part.max, *where]

    links = Table(
        ["link", "span", *numbers],
        [row(part, name, DESCRIPTIONS[name]) for name, part in values.rows.items()],
        "Error normal to the requested path, its share of the mean square, and where it is largest",
        COLOURS,
    )
    axes = Table(
        ["axis", *numbers],
        [row(budget.values_of(part), axis) for axis, part in budget.servo_by_axis(machine).items()],
        "Tracking part by axis, to first order",
    )
    return Section(
        "Error budget",
        [
            "Errors are normal to the path. Contributions sum at every sample; a negative share offsets others. A link "
            "locates the error on the chain, as the difference of two traces; it does not say what caused it.",
            f"Lag of the nozzle along the path, not part of the contour error: {_UM * values.lag.rms:z.1f} µm rms, "
            f"max {_UM * values.lag.max:z.1f} µm.",
        ],
        table=[links, axes, _turns(budget)] if values.turns else [links, axes],
        figure=[
            drawn(draw_budget, budget, _WIDE, 4.4 if values.turns else 1.6),
            drawn(draw_budget_along, budget, _WIDE, 8.0),
        ],
    )


def _turns(budget: Budget) -> Table:
    names = [*budget.parts, "contour"]
    columns: list[str | Column] = [
        "stretch",
        Column("from s [mm]", ".1f"),
        Column("to s [mm]", ".1f"),
        *(Column(f"{name}, rms [µm]", ".1f") for name in names),
        Column("contour, max [µm]", ".1f"),
    ]
    rows = [
        [turn.name, *turn.s, *(_UM * turn.parts[name].rms for name in names), _UM * turn.parts["contour"].max]
        for turn in budget.values.turns
    ]
    return Table(columns, rows, "By turn of the path's tangent, and before and after the turns")


def errors_section(analysis: Analysis) -> Section:
    """Return the section of the errors over time."""
    values = analysis.values
    run = analysis.run
    rows = [
        [name, THOUSANDTH[unit], 1e3 * error.rms, 1e3 * error.max]
        for unit, (name, error) in zip(run.units, values.following.items(), strict=True)
    ]
    along = values.following_along
    rows.append(["along the path", "µm", _UM * along.rms, _UM * along.max])
    return Section(
        "Errors over time",
        figure=drawn(draw_error, analysis, _WIDE, 6.5 if len(set(run.units)) == 1 else 8.5),
        table=Table(
            ["axis", "unit", Column("rms", ".1f"), Column("max", ".1f")],
            rows,
            "Tracking error, commanded to encoder; rms and max in the row's unit",
        ),
    )


def faults_section(run: Run, losses: Losses | None) -> Section:
    """Return the section of the faults on purpose of a run, what the supervision did, and what they cost."""
    return Section("Faults on purpose", events(run), facts=[] if losses is None else losses.rows)


def plan_section(analysis: Analysis) -> Section:
    """Return the section of the plan view."""
    return Section("Plan view", figure=drawn(draw_plan, analysis, _PLAN, view_height(*plan_extent(analysis), _PLAN)))


def spacing_section(analysis: Analysis) -> Section:
    """Return the section of the spacing of neighbouring turns."""
    return Section(
        "Spacing of neighbouring turns",
        figure=[drawn(draw, analysis, _HALF, 4.8) for draw in (draw_polar_spacing, draw_spacing)],
    )


def bead_section(bead: Bead) -> Section:
    """Return the section of the bead of a run with glue."""
    values = bead.values
    height = view_height(float(np.ptp(bead.map.x)), float(np.ptp(bead.map.y)), _PLAN)
    remarks = [f"The height map has not settled: {values.ridge_note}."] if values.ridge else []
    if values.apart_share:
        remarks.append(f"{values.apart_note[0].upper()}{values.apart_note[1:]}.")
    return Section(
        "Bead",
        remarks or None,
        facts=_bead_facts(values),
        figure=[
            drawn(draw_height_map, bead, _PLAN, 0.9 * height),
            drawn(draw_bead_along, bead, _WIDE, 5.4 if bead.analysis.spacing.distance.size else 3.0),
        ],
        table=[_bead_sizes(values), _volumes(values)],
    )


def _bead_facts(values: BeadValues) -> list[tuple[str, str, str]]:
    error = f"{values.volume_error_percent:+z.2f}".replace("-", "−")
    facts = [
        ("Volume laid", f"{values.volume:.4g} mm³", f"{error} % of {values.requested_volume:.4g} mm³ requested"),
        ("Cross-section", f"{values.section.mean:z.3f} mm²", f"nominal {values.nominal:z.3f} mm²"),
        ("Width", f"{values.width.mean:z.3f} mm", f"{values.width.min:z.3f} to {values.width.max:z.3f} mm"),
    ]
    if values.clearance is not None and values.overlap_share is not None:
        between = "gap" if values.clearance.mean > 0 else "overlap"
        overlapping = f"turns overlap on {100 * values.overlap_share:z.1f} % of their length"
        covered = "none" if values.coverage is None else f"{100 * values.coverage:z.1f} %"
        facts += [
            (f"Mean {between} between turns", f"{abs(values.clearance.mean):z.3f} mm", ""),
            ("Coverage", covered, overlapping),
        ]
    return facts


def _bead_sizes(values: BeadValues) -> Table:
    rows = (
        ("cross-section", "mm²", values.section),
        ("width", "mm", values.width),
        ("clearance between neighbouring turns", "mm", values.clearance),
        ("start: missing glue", "mm", values.missing_at_start),
        ("stop: excess glue", "mm", values.excess_at_stop),
        ("start: visible delay", "mm", values.delay_at_start),
        ("stop: visible overrun", "mm", values.overrun_at_stop),
    )
    return Table(
        ["", "unit", *(Column(name, ".3f") for name in ("mean", "std", "min", "max"))],
        [[name, unit, sizes.mean, sizes.std, sizes.min, sizes.max] for name, unit, sizes in rows if sizes is not None],
        "The bead while the dispenser is on; missing and excess glue as a length of nominal bead",
    )


def _volumes(values: BeadValues) -> Table:
    descriptions = {
        "ramps": "requested by the program beyond the nominal section while the speed ramps",
        "starts": "valve opening: until the flow has settled",
        "running": "flow limit: while the flow is settled",
        "stops": "valve closing: from when the dispenser closes",
        "error": "total",
    }
    volumes = values.volume_error_parts | {"error": values.volume_error}
    return Table(
        [
            "part",
            Column("volume [mm³]", f".{decimals_of(values.volume)}f"),
            Column("of the requested volume [%]", ".3f"),
            "description",
        ],
        [
            [name, volume, 100 * volume / values.requested_volume, descriptions[name]]
            for name, volume in volumes.items()
        ],
        "Volume beyond the nominal section along the path; the parts sum to the error",
    )


def drawn(
    draw: Callable[[Figure, Subject], object], subject: Subject, width: float, height: float
) -> Callable[[], Figure]:
    """Return a function that draws a plot on a figure of its own, width by height [inch]."""

    def figure() -> Figure:
        with sheet(width, height) as figure:
            draw(figure, subject)
        return figure

    return figure
