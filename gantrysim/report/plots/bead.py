"""Plots of the bead: height, width, and clearance between turns."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.glue.bead import Bead
from gantrysim.report.plots.style import COLOURS, COLUMNS, axes_on, colour_map, thinned_line
from gantrysim.results.colours import BEAD, INK, MAGNITUDE, WIDTH

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

_DRY = 1e-3  # of the nozzle's height; less is no glue
# percentile of the width, and the limit of the axis over it
_USUAL = 95.0
_ABOVE = 1.6
# too little glue between two turns, and too much
_GAP = WIDTH.stops[1][2]
_OVERLAP = WIDTH.stops[-2][2]


def draw_height_map(on: Figure | SubFigure | Axes, bead: Bead) -> Axes:
    """Draw the height of the glue over the surface, in plan view; return the axes."""
    axes = axes_on(on)
    heights = bead.map.height
    x = bead.map.x
    y = bead.map.y
    half = 0.5 * bead.map.cell
    image = axes.imshow(
        np.ma.masked_less(heights, _DRY * bead.gap),
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
        axes.fill_between(length, clearance, 0, where=clearance < 0, color=_OVERLAP, lw=0, alpha=0.6, label="overlap")
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
    usual = _ABOVE * max(float(np.percentile(width, _USUAL)), nominal)
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
