"""Plot of the bead as it is laid: in plan view, at its true width, coloured by what spoils it."""

from __future__ import annotations

import io
import math
from typing import TYPE_CHECKING

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.glue.bead import Bead
from gantrysim.report.plots.style import COLOURS, UM, axes_on, colour_map, common_style, sheet
from gantrysim.results.colours import INK, RIGHT, SHARE, WIDTH, ColourScale
from gantrysim.results.run_results import RunResults
from gantrysim.results.verdict import PATH

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import PolyCollection
    from matplotlib.figure import Figure, SubFigure

_PIECES = 3000  # of the bead, each of one colour
_DRY = 0.02  # of the nominal width; a narrower bead is none
_MARGIN = 0.06  # around the bead, of its extent


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
    axes.margins(_MARGIN)
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
            if bead.width[inside].max() < _DRY * nominal:
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
        budget = results.budget
        analysis = budget.analysis
        size = UM * np.interp(np.arange(len(bead.length)), analysis.ticks, budget.contour.size)
        values = bead.along(size)
        limit = UM * tolerance.path_max
        return values / limit, SHARE, ("contour error", "0", f"{SHARE.high * limit:.3g} µm")
    limit = tolerance.bead_width
    span = WIDTH.high * limit
    words = (f"width, of {nominal:.3g} mm", f"−{span:g} %", f"+{span:g} %")
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
