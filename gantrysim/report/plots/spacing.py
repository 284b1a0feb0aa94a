"""Plots of the spacing of neighbouring turns."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from gantrysim.metrics.analysis import Analysis
from gantrysim.metrics.spacing import Spacing
from gantrysim.report.plots.style import add_legend, axes_on, thinned_line, turn_colours
from gantrysim.results.colours import INK

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure
    from matplotlib.projections.polar import PolarAxes

_MOST_NAMED = 5  # largest number of turns in a legend
_MOST_LINES = 100  # that stay lines in a page
# horizontal resolution of all turns' lines, and of one
_MOST_COLUMNS = 20_000
_LEAST_COLUMNS = 60


def draw_spacing(on: Figure | SubFigure | Axes, analysis: Analysis) -> Axes:
    """Draw the spacing over the angle within the turn; return the axes."""
    axes = axes_on(on)
    turns = analysis.spacing
    requested = analysis.run.requested.turn_spacing
    for k, rows, style in _by_turn(turns):
        axes.plot(360 * (turns.turn[rows] - k), turns.distance[rows], **style)
    if requested is not None:
        axes.axhline(requested, color=INK, lw=1.0, ls="--", label=f"requested: {requested:g} mm")
    axes.set(xlabel="tangent angle within the turn [deg]", ylabel="spacing [mm]", title="Spacing of neighbouring turns")
    axes.set_xticks(range(0, 361, 45))
    axes.set_xlim(0, 360)
    axes.ticklabel_format(axis="y", useOffset=False)
    add_legend(on)
    return axes


def draw_polar_spacing(on: Figure | SubFigure | Axes, analysis: Analysis) -> Axes:
    """Draw the spacing over the direction of the path's outward normal in its plane; return the axes, polar ones.

    The centre of the plot is not zero: the range of spacings fills the outer half.
    """
    axes = cast("PolarAxes", axes_on(on, projection="polar"))
    run = analysis.run
    turns = analysis.spacing
    requested = run.requested.turn_spacing
    first, last = run.requested.heading(turns.s[[0, -1]])
    to_the_left = 0.5 * np.pi * np.sign(last - first)
    for _, rows, style in _by_turn(turns):
        axes.plot(run.requested.heading(turns.s[rows]) - to_the_left, turns.distance[rows], **style)
    low = float(turns.distance.min())
    high = float(turns.distance.max())
    if requested is not None:
        circle = np.linspace(0, 2 * np.pi, 181)
        axes.plot(circle, np.full(181, requested), color=INK, lw=1.0, ls="--", label=f"requested: {requested:g} mm")
        low = min(low, requested)
        high = max(high, requested)
    reach = max(high - low, 1e-3)
    axes.set_rlim(low - reach, high + 0.05 * reach)
    axes.set_rticks(np.linspace(low, high, 3), [f"{r:.2f}" for r in np.linspace(low, high, 3)])
    axes.set_rlabel_position(22.5)
    axes.set_title("Spacing of neighbouring turns [mm] by direction")
    axes.spines["polar"].set_visible(False)
    return axes


def _by_turn(spacing: Spacing) -> Iterator[tuple[int, NDArray[np.intp], dict[str, Any]]]:
    """Number, points and style of the line of every turn; many turns become an image, with fewer points each."""
    turn = spacing.turn
    distance = spacing.distance
    numbers = range(math.floor(turn[0]), math.floor(turn[-1]) + 1)
    ends = np.append(np.searchsorted(turn, numbers), turn.size).tolist()
    present = [(k, begin, end) for k, (begin, end) in zip(numbers, pairwise(ends), strict=True) if begin < end]
    step = -(-len(present) // _MOST_NAMED)
    columns = max(_MOST_COLUMNS // len(present), _LEAST_COLUMNS)
    for i, ((k, begin, end), colour) in enumerate(zip(present, turn_colours(len(present)), strict=True)):
        rows, _ = thinned_line(np.arange(begin, end, dtype=np.float64), distance[begin:end], columns)
        label = f"turn {k + 1} to {k + 2}" if i % step == 0 else "_"  # that is not shown
        style = {"lw": 1.2, "color": colour, "label": label, "rasterized": len(present) > _MOST_LINES}
        yield k, rows.astype(np.intp), style
