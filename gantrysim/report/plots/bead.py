"""Plots of the bead: as it is laid, coloured by what spoils it; height, width, and clearance between turns."""

from __future__ import annotations

import io
import math
from typing import TYPE_CHECKING

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.quantity import UM
from gantrysim.glue.bead import Bead
from gantrysim.report.plots.style import COLOURS, COLUMNS, axes_on, colour_map, common_style, sheet, thinned_line
from gantrysim.results.colours import BEAD, INK, MAGNITUDE, RIGHT, SHARE, WIDTH, ColourScale
from gantrysim.results.run_results import RunResults
from gantrysim.results.verdict import PATH

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import PolyCollection
    from matplotlib.figure import Figure, SubFigure


_PIECES = 3000  # of the bead, each of one colour
_NARROWEST_BEAD = 0.02  # of the nominal width; a narrower bead is none
_BEAD_MARGIN = 0.06  # around the bead, of its extent

_THINNEST_GLUE = 1e-3  # of the nozzle's height; less is no glue
# percentile of the width, and the limit of the axis over it
_USUAL_PERCENTILE = 95.0
_ABOVE_LIMIT = 1.6
# too little glue between two turns, and too much
_GAP = WIDTH.stops[1][2]
_OVERLAP_COLOUR = WIDTH.stops[-2][2]


def draw_laid(on: Figure | SubFigure | Axes, results: RunResults, text_size: float = 10.0) -> Axes:
    """Draw the bead in plan view at its true width, with a scale and the worst place of the verdict; return the axes.

    It is coloured by the error of the path or the deviation of its width, whichever is judged worse.
    """
    axes = axes_on(on)
    run = results.budget.analysis.run
    bead = results.bead
    line = run.requested.position(np.linspace(0, run.requested.length, 4000))
    axes.plot(line[:, 0], line[:, 1], color=COLOURS["requested"], lw=0.6, zorder=1)
    if bead is not None:
        _draw_stations(axes, results, bead, text_size)
        _draw_dots(axes, results, bead)
    place = results.verdict.worst_place
    if place is not None and place.point is not None and results.verdict.worst_row is not None:
        x, y, _ = place.point
        axes.plot(x, y, marker="o", ms=13, mfc="none", mec="white", mew=4, zorder=5)
        axes.plot(x, y, marker="o", ms=13, mfc="none", mec=INK, mew=2, zorder=6)
        plate = {"boxstyle": "round,pad=0.15", "fc": "white", "ec": "none", "alpha": 0.8}
        axes.annotate(
            "worst",
            (x, y),
            (0, 9),
            textcoords="offset points",
            ha="center",
            va="bottom",
            fontsize=text_size,
            color=INK,
            weight="bold",
            bbox=plate,
            zorder=7,
        )
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_axis_off()
    axes.margins(_BEAD_MARGIN)
    return axes


def bead_picture(results: RunResults) -> bytes:
    """Return the bead as a JPEG picture, 800 by 450 pixels: what stands in a film's place until it plays."""
    with sheet(8.0, 4.5) as figure:
        draw_laid(figure, results)
    file = io.BytesIO()
    with common_style():
        figure.savefig(file, format="jpeg", dpi=100, pil_kwargs={"quality": 80})
    return file.getvalue()


def _draw_dots(axes: Axes, results: RunResults, bead: Bead) -> None:
    """Draw the dots as wide as they lie, coloured by the deviation of their volume."""
    from matplotlib.patches import Circle

    limit = results.basis.limits(bead.run.face).dot_volume
    errors = [verdict.volume_error for verdict in results.dots] or [math.nan] * len(bead.dots)
    for dot, error in zip(bead.dots, errors, strict=True):
        colour = RIGHT if math.isnan(error) else WIDTH.colour(error / limit)
        x, y = dot.foot[:2]
        axes.add_patch(Circle((float(x), float(y)), dot.cap.radius, fc=colour, ec=INK, lw=0.5, zorder=2))
    axes.autoscale_view()


def _draw_stations(axes: Axes, results: RunResults, bead: Bead, text_size: float) -> None:
    from matplotlib.collections import PolyCollection

    nominal = float(bead.nominal_section.width[0]) if bead.nominal > 0 else 0.0
    if not nominal or not bead.wet_stretches.size:
        return
    step = -(-bead.place.size // _PIECES)
    values, scale, ends = _colouring(results, bead, nominal)
    polygons = []
    shades = []
    normal = np.stack([-np.sin(bead.heading), np.cos(bead.heading)], axis=1)
    half = 0.5 * bead.width[:, None] * normal
    edges = bead.point[:, :2] + half, bead.point[:, :2] - half
    for first, after in bead.wet_stretches.tolist():
        for begin in range(first, after - 1, step):
            end = min(begin + step, after - 1)
            inside = slice(begin, end + 1)
            if bead.width[inside].max() < _NARROWEST_BEAD * nominal:
                continue
            polygons.append(np.concatenate([edges[0][inside], edges[1][inside][::-1]]))
            piece = values[inside]
            shades.append(piece[np.abs(piece).argmax()])
    collection = PolyCollection(
        polygons,
        array=scale.places(np.array(shades)),
        cmap=colour_map(scale),
        clim=(0, 1),
        edgecolors="face",
        linewidths=0.8,
        zorder=2,
        rasterized=True,
    )
    axes.add_collection(collection)
    axes.autoscale_view()
    _add_scale(axes, collection, ends, text_size)


def _colouring(results: RunResults, bead: Bead, nominal: float) -> tuple[Floats, ColourScale, tuple[str, str, str]]:
    """Return values at the stations in tolerances, their scale, and title and ends of the scale in words."""
    tolerance = results.basis.limits(results.budget.analysis.run.face)
    if results.verdict.shown_row == PATH:
        contour = results.budget.contour
        values = bead.along(bead.at_all_ticks(lambda rows: UM * contour.at(rows).size))
        limit = UM * (results.verdict.path_limit or tolerance.path_max)
        return values / limit, SHARE, (f"contour error, limit {limit:.3g} µm", "0", f"{SHARE.high * limit:.3g} µm")
    limit = tolerance.bead_width
    span = WIDTH.high * limit
    words = (f"width, limits {nominal:.3g} mm ± {limit:g} %", f"−{span:g} %", f"+{span:g} %")
    return 100 * (bead.width / nominal - 1) / limit, WIDTH, words


def _add_scale(axes: Axes, collection: PolyCollection, ends: tuple[str, str, str], text_size: float) -> None:
    title, low, high = ends
    bar = axes.inset_axes((0.36, -0.045, 0.28, 0.022))
    scale = axes.figure.colorbar(collection, cax=bar, orientation="horizontal", ticks=[])
    if scale.solids is not None:
        scale.solids.set_rasterized(True)
    for text, place, align in ((low, (-0.03, 0.5), "right"), (high, (1.03, 0.5), "left")):
        bar.text(*place, text, transform=bar.transAxes, ha=align, va="center", fontsize=text_size)
    bar.text(0.5, -0.6, title, transform=bar.transAxes, ha="center", va="top", fontsize=text_size)


def draw_height_map(on: Figure | SubFigure | Axes, bead: Bead) -> Axes:
    """Draw the height of the glue over the surface, in plan view; return the axes."""
    axes = axes_on(on)
    heights = bead.map.height
    x = bead.map.x
    y = bead.map.y
    half = 0.5 * bead.map.cell
    image = axes.imshow(
        np.ma.masked_less(heights, _THINNEST_GLUE * bead.gap),
        origin="lower",
        extent=(x[0] - half, x[-1] + half, y[0] - half, y[-1] + half),
        cmap=colour_map(MAGNITUDE),
        vmin=0.0,
        interpolation="none",
        zorder=2,
    )
    axes.set(aspect="equal", xlabel="x [mm]", ylabel="y [mm]", title="Bead height")
    bar = axes.figure.colorbar(image, ax=axes, label="height [mm]", shrink=0.8)
    if bead.settings.squashed and bead.gap <= float(heights.max()):
        bar.ax.axhline(bead.gap, color=INK, lw=1.0)
        place = (0, bead.gap)
        units = ("axes fraction", "data")
        bar.ax.annotate("gap", place, (-2, 0), units, "offset points", ha="right", va="center", fontsize=8)
    return axes


def draw_bead_along(figure: Figure | SubFigure, bead: Bead, columns: int = COLUMNS) -> tuple[Axes, ...]:
    """Draw the bead's width along the trace, and the clearance between neighbouring turns; return the axes.

    Args:
        figure: to draw on.
        bead: the bead.
        columns: horizontal resolution, see `thinned`.
    """
    turns = bead.analysis.spacing.distance.size > 0
    upper, *lower = figure.subplots(2 if turns else 1, sharex=True, squeeze=False)[:, 0]
    upper.plot(*thinned_line(bead.place, bead.width, columns), color=BEAD, lw=1.2, label="width")
    nominal = float(bead.nominal_section.width[0])
    upper.axhline(nominal, color=INK, lw=1.0, ls="--", label=f"nominal: {nominal:.3f} mm")
    upper.set(ylabel="width [mm]")
    _clip(upper, bead.place, bead.width, nominal)
    upper.set_title("Bead width", loc="right")
    upper.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=2)
    for axes in lower:
        analysis = bead.analysis
        s, clearance = thinned_line(analysis.spacing.s, bead.clearance(), columns)
        on = bead.length[analysis.ticks]
        length = np.interp(s, np.maximum.accumulate(analysis.nozzle.s), on)
        axes.fill_between(length, clearance, 0, where=clearance > 0, color=_GAP, lw=0, alpha=0.6, label="gap")
        axes.fill_between(
            length, clearance, 0, where=clearance < 0, color=_OVERLAP_COLOUR, lw=0, alpha=0.6, label="overlap"
        )
        axes.plot(length, clearance, color=INK, lw=0.8)
        axes.axhline(0, color=INK, lw=0.8)
        axes.set(ylabel="clearance [mm]")
        axes.set_title("Clearance to the next turn: spacing less bead width", loc="right")
        axes.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=2)
    for axes in (upper, *lower):
        axes.margins(x=0.01)
        last = len(bead.length) - 1
        off = np.concatenate([[0], bead.stretches.ravel(), [last]]).clip(max=last).reshape(-1, 2)
        for start, stop in bead.length[off]:
            if stop > start:
                axes.axvspan(start, stop, color=COLOURS["requested"], alpha=0.2, lw=0)
    (lower[-1] if lower else upper).set_xlabel("distance along the nozzle's path [mm]")
    return (upper, *lower)


def _clip(axes: Axes, place: Floats, width: Floats, nominal: float) -> None:
    """Scale the axis to the usual width, and annotate the largest one if that is beyond."""
    widest = int(width.argmax())
    usual = _ABOVE_LIMIT * max(float(np.percentile(width, _USUAL_PERCENTILE)), nominal)
    if width[widest] <= usual:
        axes.set_ylim(bottom=0)
        return
    axes.set_ylim(0, usual)
    right = place[widest] > 0.5 * place[-1]
    axes.annotate(
        f"maximum {width[widest]:.3g} mm at {place[widest]:.4g} mm",
        (place[widest], usual),
        (-8 if right else 8, -12),
        textcoords="offset points",
        ha="right" if right else "left",
        color=BEAD,
    )
