"""The sections of a run's report on its errors, spacing and bead."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from gantrysim.base.quantity import RANGE, RMS, number_text
from gantrysim.glue.bead import Bead, BeadValues
from gantrysim.glue.bead.values import BEAD, VOLUME_ERROR_PERCENT
from gantrysim.job.losses import Losses, events
from gantrysim.metrics.analysis import THOUSANDTH, Analysis
from gantrysim.metrics.budget import DESCRIPTIONS, Budget
from gantrysim.metrics.error_quantities import CONTOUR, FOLLOWING_ALONG, LAG, PROGRAM
from gantrysim.metrics.parts import PART_COLUMNS, PART_PLACE, PART_SIZES, PartValues
from gantrysim.record.run import Run
from gantrysim.report.document import Column, Section, Table
from gantrysim.report.headline import NO_ERROR, contour_sentence
from gantrysim.report.plots.bead import bead_picture, draw_bead_along
from gantrysim.report.plots.budget import draw_by_turn, draw_shares
from gantrysim.report.plots.pictures import (
    HALF_HEIGHT,
    PAGE_COLUMNS,
    PLOT_WIDTH,
    budget_plot,
    error_plot,
    height_plot,
    spacing_plot,
)
from gantrysim.report.plots.spacing import draw_polar_spacing
from gantrysim.report.plots.style import COLOURS, sheet
from gantrysim.report.rows import RowTexts, bead_rows, dot_rows, motion_rows, volume_error, volume_parts
from gantrysim.report.viewer_data import ViewerData
from gantrysim.results.glue import DotVerdict
from gantrysim.results.run_results import RunResults

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Subject = TypeVar("Subject")

_RMS, _, _MAX, _SHARE = PART_COLUMNS
_LISTED_DOTS = 1000  # rows of a table
_LOW_PLOT = 2.4  # height of the plots of the error budget [inch]


def summary_facts(budget: Budget) -> list[RowTexts]:
    """Return the most important values of a run as facts of a page."""
    values = budget.values
    errors = (
        (quantity.statistic(RMS).label, quantity.text(error.rms), f"max {quantity.text(error.max)}")
        for quantity, error in ((CONTOUR, values.contour), (PROGRAM, values.parts["program"]))
    )
    return facts_of([*errors, *motion_rows(budget.analysis)])


def budget_section(results: RunResults) -> Section:
    """Return the section of the error budget, after the run's most important values."""
    budget = results.budget
    values = budget.values
    shown = (_SHARE, *PART_SIZES, *PART_PLACE)
    numbers: list[str | Column] = [*(Column.of(quantity) for quantity in shown), "x, y, z [mm]"]

    def row(part: PartValues, *labels: str) -> list[str | float | None]:
        point = ",\N{NO-BREAK SPACE}".join(number_text(place, ".1f") for place in part.point)
        where = [None] * 3 if part.rms < NO_ERROR else [part.s, part.time, point]
        return [*labels, *(quantity.in_unit(quantity.get(part)) for quantity in (_SHARE, *PART_SIZES)), *where]

    links = Table(
        ["link", "span", *numbers],
        [row(part, name, DESCRIPTIONS[name]) for name, part in values.rows.items()],
        "Error normal to the requested path, its share of the mean square, and where it is largest",
        COLOURS,
    )
    axes = Table(
        ["axis", *numbers],
        [row(budget.values_of(part), axis) for axis, part in budget.servo_by_axis(results.machine).items()],
        "Servo part by axis, to first order",
    )
    return Section(
        "Error budget",
        [
            contour_sentence(budget, results.causes),
            "Errors are normal to the path. Contributions sum at every sample; a negative share offsets others. A link "
            "locates the error on the chain, as the difference of two traces; it does not say what caused it.",
            f"Lag of the nozzle along the path, not part of the contour error: {LAG.text(values.lag.rms)} rms, "
            f"max {LAG.text(values.lag.max)}.",
        ],
        table=[links, axes, _turns(budget)] if values.turns else [links, axes],
        figure=[
            drawn_plot(draw_shares, budget, HALF_HEIGHT, _LOW_PLOT),
            *([drawn_plot(draw_by_turn, budget, HALF_HEIGHT, _LOW_PLOT)] if values.turns else []),
        ],
        still=budget_plot(budget),
        facts=summary_facts(budget),
    )


def _turns(budget: Budget) -> Table:
    names = [*budget.parts, "contour"]
    columns: list[str | Column] = [
        "stretch",
        Column("from s [mm]", ".1f"),
        Column("to s [mm]", ".1f"),
        *(Column(f"{name}, {_RMS.head}", _RMS.form) for name in names),
        Column(f"contour, {_MAX.head}", _MAX.form),
    ]
    rows = [
        [
            turn.name,
            *turn.s,
            *(_RMS.in_unit(turn.parts[name].rms) for name in names),
            _MAX.in_unit(turn.parts["contour"].max),
        ]
        for turn in budget.values.turns
    ]
    return Table(columns, rows, "By turn of the path's tangent, and before and after the turns")


def errors_section(analysis: Analysis) -> Section:
    """Return the section of the errors over time."""
    values = analysis.values
    run = analysis.run
    errors = [(axis, THOUSANDTH[unit], values.following[axis]) for axis, unit in zip(run.axes, run.units, strict=True)]
    errors.append(("along the path", FOLLOWING_ALONG.unit, values.following_along))
    rows = [
        [name, unit, FOLLOWING_ALONG.in_unit(error.rms), FOLLOWING_ALONG.in_unit(error.max)]
        for name, unit, error in errors
    ]
    return Section(
        "Errors over time",
        figure=error_plot(analysis),
        table=Table(
            [
                "axis",
                "unit",
                *(Column(statistic.label, FOLLOWING_ALONG.form) for statistic in FOLLOWING_ALONG.statistics),
            ],
            rows,
            "Following error, commanded to encoder; rms and max in the row's unit",
        ),
    )


def faults_section(run: Run, losses: Losses | None) -> Section:
    """Return the section of the deliberate faults of a run, what the supervision did, and what they cost."""
    return Section("Deliberate faults", events(run), facts=[] if losses is None else losses.rows)


def path_section(results: RunResults, video: Path | None = None) -> Section:
    """Return the section of the nozzle's path: the page's viewer, and the film.

    Args:
        results: of the run.
        video: film of the run, included where it exists.
    """
    viewer = ViewerData(results)
    return Section(
        "Bead and path",
        video=video,
        poster=partial(bead_picture, results),
        viewer=viewer.text(),
        in_space=viewer.in_space,
    )


def spacing_section(analysis: Analysis) -> Section:
    """Return the section of the spacing of neighbouring turns."""
    return Section(
        "Spacing of neighbouring turns",
        figure=[drawn_plot(draw_polar_spacing, analysis, HALF_HEIGHT, 4.8), spacing_plot(analysis)],
    )


def bead_section(bead: Bead) -> Section:
    """Return the section of the bead of a run with glue."""
    values = bead.values
    remarks = [f"The height map has not settled: {values.ridge_note}."] if values.ridge else []
    if values.apart_share:
        remarks.append(f"{values.apart_note[0].upper()}{values.apart_note[1:]}.")
    return Section(
        "Bead",
        remarks or None,
        facts=facts_of(bead_rows(values)),
        figure=drawn_plot(_coarse_bead, bead, PLOT_WIDTH, 5.4 if bead.analysis.spacing.distance.size else 3.0),
        table=[_bead_sizes(values), _volumes(values)],
    )


def dots_section(bead: Bead, dots: Sequence[DotVerdict]) -> Section:
    """Return the section of the dots of a run, with the height map if there is no bead."""
    columns = (
        ("volume [mm³]", ".4f"),
        ("requested [mm³]", ".4f"),
        ("error [%]", "+.1f"),
        ("diameter [mm]", ".2f"),
        ("height [mm]", ".2f"),
        ("off its place [mm]", ".2f"),
        ("string [%]", ".1f"),
    )
    rows: list[list[str | float | None]] = [
        [
            str(verdict.number),
            "" if verdict.place.line is None else str(verdict.place.line),
            *verdict.dot.place[:2],
            verdict.dot.volume,
            verdict.wanted,
            None if math.isnan(verdict.volume_error) else verdict.volume_error,
            verdict.dot.diameter,
            verdict.dot.cap.height,
            verdict.dot.place_error,
            verdict.dot.string_percent,
            verdict.state,
        ]
        for verdict in dots[:_LISTED_DOTS]
    ]
    remainder = f"; the first {_LISTED_DOTS} of {len(dots)}, summary.json has all" if len(dots) > _LISTED_DOTS else ""
    table = Table(
        [
            "dot",
            "line",
            Column("x [mm]", ".3f"),
            Column("y [mm]", ".3f"),
            *(Column(name, form) for name, form in columns),
            "verdict",
        ],
        rows,
        f"Dots as laid: caps on the work, and the share of their glue that the needle draws into a string{remainder}",
    )
    map_ = [] if bead.nominal > 0 else [height_plot(bead)]
    return Section("Dots", facts=facts_of(dot_rows(dots)), figure=map_, table=[table])


def _bead_sizes(values: BeadValues) -> Table:
    ranges = [(quantity, quantity.get(values)) for quantity in BEAD if quantity.statistics]
    return Table(
        ["", "unit", *(Column(statistic.label, ".2f") for statistic in RANGE)],
        [
            [quantity.label, quantity.unit, *(quantity.in_unit(getattr(sizes, statistic.name)) for statistic in RANGE)]
            for quantity, sizes in ranges
            if sizes is not None
        ],
        "The bead while the dispenser is on; missing and excess glue as a length of nominal bead",
    )


def _volumes(values: BeadValues) -> Table:
    whole = volume_error(values)
    return Table(
        [
            "part",
            Column(f"volume [{whole.unit}]", whole.form),
            Column(f"of the requested volume [{VOLUME_ERROR_PERCENT.unit}]", ".3f"),
            "description",
        ],
        [
            [name, part.get(values), 100 * part.get(values) / values.requested_volume, part.meaning]
            for name, part in (*volume_parts(values).items(), ("error", whole))
        ],
        "Volume beyond the nominal section along the path; the parts sum to the error",
    )


def facts_of(rows: Iterable[RowTexts]) -> list[RowTexts]:
    """Return rows of name, value and remark as facts of a page."""
    return [(f"{name[0].upper()}{name[1:]}", value, remark) for name, value, remark in rows]


def _coarse_bead(figure: Figure, bead: Bead) -> None:
    draw_bead_along(figure, bead, PAGE_COLUMNS)


def drawn_plot(
    draw: Callable[[Figure, Subject], object], subject: Subject, width: float, height: float
) -> Callable[[], Figure]:
    """Return a function that draws a plot on a figure of its own, width by height [inch]."""

    def figure() -> Figure:
        with sheet(width, height) as figure:
            draw(figure, subject)
        return figure

    return figure
