"""The spacing of neighbouring turns."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gantrysim.metrics import Analysis
from gantrysim.plots.style import AXIS_COLOURS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["draw_spacing"]


def draw_spacing(figure: Figure, analysis: Analysis) -> None:
    """Draw the spacing of neighbouring turns, turn by turn."""
    axes = figure.add_subplot()
    turns, asked = analysis.spacing, analysis.run.requested.turn_spacing
    number = np.floor(turns.turn).astype(int)
    for k in np.unique(number):
        chosen = number == k
        angle = 360 * (turns.turn[chosen] - k)
        colour = AXIS_COLOURS[k % len(AXIS_COLOURS)]
        axes.plot(angle, turns.distance[chosen], lw=1.2, color=colour, label=f"turn {k + 1} to {k + 2}")
    if asked is not None:
        axes.axhline(asked, color="0.3", lw=1.0, ls="--", label=f"asked for: {asked:g} mm")
    axes.set(
        xlabel="angle of the tangent within the turn [deg]",
        ylabel="spacing [mm]",
        title="Spacing of neighbouring turns along the normal",
    )
    axes.set_xticks(range(0, 361, 45))
    axes.set_xlim(0, 360)
    axes.ticklabel_format(axis="y", useOffset=False)
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
