"""Plots of the spacing of neighbouring turns."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, cast

import numpy as np
from numpy.typing import NDArray

from gantrysim.arrays import Floats
from gantrysim.metrics.analysis import Analysis
from gantrysim.plots.style import INK, add_legend, axes_on, thinned, turn_colours

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure
    from matplotlib.projections.polar import PolarAxes

_MOST_NAMED = 5  # largest number of turns in a legend
_MOST_DRAWN = 60  # largest number of turns that are drawn; of more, evenly chosen ones


def draw_spacing(on: Figure | SubFigure | Axes, analysis: Analysis) -> Axes:
    """Draw the spacing over the angle within the turn; return the axes."""
    axes = axes_on(on)
    turns, requested = analysis.spacing, analysis.run.requested.turn_spacing
    for k, chosen, colour, label in _by_turn(turns.turn):
        axes.plot(*thinned(360 * (turns.turn[chosen] - k), turns.distance[chosen]), lw=1.2, color=colour, label=label)
    if requested is not None:
        axes.axhline(requested, color=INK, lw=1.0, ls="--", label=f"requested: {requested:g} mm")
    title = f"Spacing of neighbouring turns{_drawn(turns.turn)}"
    axes.set(xlabel="tangent angle within the turn [deg]", ylabel="spacing [mm]", title=title)
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
    for _, chosen, colour, label in _by_turn(turns.turn):
        axes.plot(*thinned(outward[chosen], turns.distance[chosen]), lw=1.2, color=colour, label=label)
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
    axes.set_title(f"Spacing of neighbouring turns [mm] by direction{_drawn(turns.turn)}")
    axes.spines["polar"].set_visible(False)
    return axes


def _by_turn(turn: Floats) -> Iterator[tuple[int, NDArray[np.bool_], str, str]]:
    """Number, points, colour and label of every turn that is drawn; a label "_" is not shown."""
    number = np.floor(turn).astype(int)
    present = np.unique(number)
    present = present[np.unique(np.linspace(0, present.size - 1, min(present.size, _MOST_DRAWN)).round().astype(int))]
    step = -(-present.size // _MOST_NAMED)
    for i, (k, colour) in enumerate(zip(present.tolist(), turn_colours(present.size), strict=True)):
        yield k, number == k, colour, f"turn {k + 1} to {k + 2}" if i % step == 0 else "_"


def _drawn(turn: Floats) -> str:
    """Return which turns are drawn, where not all are."""
    count = np.unique(np.floor(turn)).size
    return f", {_MOST_DRAWN} of {count} turns" if count > _MOST_DRAWN else ""
