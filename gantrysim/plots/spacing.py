"""The spacing of neighbouring turns."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, cast

import numpy as np
from numpy.typing import NDArray

from gantrysim.arrays import Floats
from gantrysim.metrics.analysis import Analysis
from gantrysim.plots.style import INK, turn_colours

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from matplotlib.projections.polar import PolarAxes

_MOST_NAMED = 5  # turns in a legend


def draw_spacing(figure: Figure, analysis: Analysis) -> None:
    """Draw the spacing of neighbouring turns, turn by turn."""
    axes = figure.add_subplot()
    turns, asked = analysis.spacing, analysis.run.requested.turn_spacing
    for k, chosen, colour, label in _by_turn(turns.turn):
        axes.plot(360 * (turns.turn[chosen] - k), turns.distance[chosen], lw=1.2, color=colour, label=label)
    if asked is not None:
        axes.axhline(asked, color=INK, lw=1.0, ls="--", label=f"asked for: {asked:g} mm")
    axes.set(
        xlabel="angle of the tangent within the turn [deg]",
        ylabel="spacing [mm]",
        title="Spacing of neighbouring turns along the normal",
    )
    axes.set_xticks(range(0, 361, 45))
    axes.set_xlim(0, 360)
    axes.ticklabel_format(axis="y", useOffset=False)
    figure.legend(loc="outside lower center", ncols=3)


def draw_polar_spacing(figure: Figure, analysis: Analysis) -> None:
    """Draw the spacing over the direction in which each point of a turn lies, as seen from the spiral's middle.

    The direction is that of the path's outward normal in its plane. The middle of the picture is not zero: what
    there is of spacings fills the outer half.
    """
    axes = cast("PolarAxes", figure.add_subplot(projection="polar"))
    run, turns = analysis.run, analysis.spacing
    asked = run.requested.turn_spacing
    heading = run.requested.heading(turns.s)
    outward = heading - 0.5 * np.pi * np.sign(heading[-1] - heading[0])
    for _, chosen, colour, label in _by_turn(turns.turn):
        axes.plot(outward[chosen], turns.distance[chosen], lw=1.2, color=colour, label=label)
    if asked is not None:
        round_ = np.linspace(0, 2 * np.pi, 181)
        axes.plot(round_, np.full(181, asked), color=INK, lw=1.0, ls="--", label=f"asked for: {asked:g} mm")
    shown = turns.distance if asked is None else np.append(turns.distance, asked)
    low, high = float(shown.min()), float(shown.max())
    reach = max(high - low, 1e-3)
    axes.set_rlim(low - reach, high + 0.05 * reach)
    axes.set_rticks(np.linspace(low, high, 3), [f"{r:.3f}" for r in np.linspace(low, high, 3)], fontsize=8)
    axes.set_rlabel_position(22.5)
    axes.set_title("Spacing [mm] over the direction in the path's plane")
    axes.spines["polar"].set_visible(False)


def _by_turn(turn: Floats) -> Iterator[tuple[int, NDArray[np.bool_], str, str]]:
    """Of every turn its number, its points, its colour, and its label where it is one that is named."""
    number = np.floor(turn).astype(int)
    present = np.unique(number)
    step = -(-present.size // _MOST_NAMED)
    for i, (k, colour) in enumerate(zip(present.tolist(), turn_colours(present.size), strict=True)):
        yield k, number == k, colour, f"turn {k + 1} to {k + 2}" if i % step == 0 else "_"
