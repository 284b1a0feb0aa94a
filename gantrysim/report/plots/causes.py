"""Plot of what the causes of a job's error are worth."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from gantrysim.base.quantity import number_text
from gantrysim.job.causes import CELL_FORM
from gantrysim.report.plots.style import COLOURS, UM
from gantrysim.results.colours import INK

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

_ROOM = 0.45  # beyond the bars for their numbers, of the largest
_LEAST_SCALE = 0.05  # half of the narrowest scale [µm]


def draw_causes(figure: Figure | SubFigure, worth: Mapping[str, Mapping[str, float]]) -> tuple[Axes, ...]:
    """Draw what each cause is worth in the contour error and in each link: a bar per cause, a panel per error.

    Args:
        figure: figure to draw on.
        worth: rms with the cause minus rms without it, by cause and by link or "contour"; nan where unknown [mm].

    Returns:
        The axes.
    """
    links = dict.fromkeys(link for sizes in worth.values() for link in sizes if link != "contour")
    errors = ("contour", *links)
    places = np.arange(len(worth))
    panels = figure.subplots(1, len(errors), sharey=True, squeeze=False)[0]
    for axes, error in zip(panels, errors, strict=True):
        size = np.array([UM * sizes[error] for sizes in worth.values()])
        bars = axes.barh(places, np.nan_to_num(size), 0.62, color=COLOURS[error])
        numbers = [number_text(value, CELL_FORM) for value in size]
        for text in axes.bar_label(bars, numbers, padding=3, fontsize=8):
            # inside of all others: the scale below leaves room
            text.set_in_layout(axes is panels[-1])
        low, high = (float(end) for end in (np.nanmin([0.0, *size]), np.nanmax([0.0, *size])))
        room = max(_ROOM * (high - low), _LEAST_SCALE)
        axes.set(xlim=(low - (room if low < 0 else 0), high + room), xlabel="worth [µm]")
        axes.set_title(error, loc="left")
        axes.axvline(0, color=INK, lw=0.8)
        axes.grid(visible=False, axis="y")
        axes.locator_params(axis="x", nbins=3)
        axes.tick_params(axis="y", length=0)
        axes.spines["left"].set_visible(False)
    panels[0].set_yticks(places, list(worth))
    panels[0].invert_yaxis()
    return tuple(panels)
