"""Plots of the spacing of neighbouring turns."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from gantrysim.arrays import Floats
from gantrysim.metrics.analysis import Analysis
from gantrysim.plots.style import INK, add_legend, axes_on, thinned, turn_colours

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure
    from matplotlib.projections.polar import PolarAxes

_MOST_NAMED = 5  # largest number of turns in a legend
_MOST_LINES = 100  # that stay lines in a page
_MOST_COLUMNS, _LEAST_COLUMNS = 20_000, 60  # horizontal resolution of all turns' lines, and of one


def draw_spacing(on: Figure | SubFigure | Axes, analysis: Analysis) -> Axes:
    """Draw the spacing over the angle within the turn; return the axes."""
    axes = axes_on(on)
    turns, requested = analysis.spacing, analysis.run.requested.turn_spacing
    for k, x, y, style in _by_turn(turns.turn, turns.turn, turns.distance):
        axes.plot(360 * (x - k), y, **style)
    if requested is not None:
        axes.axhline(requested, color=INK, lw=1.0, ls="--", label=f"requested: {requested:g} mm")
    axes.set(xlabel="tangent angle within the turn [deg]", ylabel="spacing [mm]", title="Spacing of neighbouring turns")
    axes.set_xticks(range(0, 361, 45))
    axes.set_xlim(0, 360)
    axes.ticklabel_format(axis="y", useOffset=False)
    add_legend(on, 3)
    return axes


def draw_polar_spacing(on: Figure | SubFigure | Axes, analysis: Analysis) -> Axes:
    """Draw the spacing over the direction of the path's outward normal in its plane; return the axes, polar ones.

    The centre of the plot is not zero: the range of spacings fills the outer half.
    """
    axes = cast("PolarAxes", axes_on(on, projection="polar"))
    run, turns = analysis.run, analysis.spacing
    requested = run.requested.turn_spacing
    heading = run.requested.heading(turns.s)
    outward = heading - 0.5 * np.pi * np.sign(heading[-1] - heading[0])
    for _, x, y, style in _by_turn(turns.turn, outward, turns.distance):
        axes.plot(x, y, **style)
    shown = turns.distance
    if requested is not None:
        circle = np.linspace(0, 2 * np.pi, 181)
        axes.plot(circle, np.full(181, requested), color=INK, lw=1.0, ls="--", label=f"requested: {requested:g} mm")
        shown = np.append(shown, requested)
    low, high = float(shown.min()), float(shown.max())
    reach = max(high - low, 1e-3)
    axes.set_rlim(low - reach, high + 0.05 * reach)
    axes.set_rticks(np.linspace(low, high, 3), [f"{r:.3f}" for r in np.linspace(low, high, 3)], fontsize=8)
    axes.set_rlabel_position(22.5)
    axes.set_title("Spacing of neighbouring turns [mm] by direction")
    axes.spines["polar"].set_visible(False)
    return axes


def _by_turn(turn: Floats, x: Floats, y: Floats) -> Iterator[tuple[int, Floats, Floats, dict[str, Any]]]:
    """Number, points and style of the line of every turn; many turns become an image, with fewer points each."""
    number = np.floor(turn).astype(int)
    begins = np.flatnonzero(np.diff(number, prepend=number[:1] - 1))
    count = begins.size
    step = -(-count // _MOST_NAMED)
    stretches = pairwise([*begins.tolist(), number.size])
    for i, ((begin, end), colour) in enumerate(zip(stretches, turn_colours(count), strict=True)):
        k = int(number[begin])
        label = f"turn {k + 1} to {k + 2}" if i % step == 0 else "_"  # that is not shown
        line = thinned(x[begin:end], y[begin:end], max(_MOST_COLUMNS // count, _LEAST_COLUMNS))
        yield k, *line, {"lw": 1.2, "color": colour, "label": label, "rasterized": count > _MOST_LINES}
