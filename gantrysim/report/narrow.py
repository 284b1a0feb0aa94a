"""Figures drawn again for a narrow page, as that of a phone: panels below one another, legends of fewer columns."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.legend import Legend

WIDTH = 5.2  # of a narrow figure [inch]: at 360 pixels its type of 10 points is still 10 pixels high
_LEAST = 1.7  # height of a panel [inch]
_MOST = 4.0
_AROUND = 0.9  # height of what stands above and below all panels [inch]
_LETTERS = 62  # of the legend's type in a line
_HANDLE = 7  # of a legend's entry before and after its label [letters]


def make_narrow(figure: Figure) -> bool:
    """Give a figure the width of a narrow page; return whether its panels allow that.

    Panels beside one another come below one another, in the order in which they were drawn. Figures whose panels are
    not in one grid, as a plot with a scale of colours beside it, stay as they are.
    """
    axes = list(figure.axes)
    places = [panel.get_subplotspec() for panel in axes]
    grids = {id(place.get_gridspec()) for place in places if place is not None}
    if None in places or len(grids) != 1 or any(panel.name != "rectilinear" for panel in axes):
        return False
    height = float(figure.get_figheight())
    if places[0].get_gridspec().ncols > 1:  # type: ignore[union-attr]
        height = _below_one_another(figure, axes)
    figure.set_layout_engine("constrained")
    figure.set_size_inches(WIDTH, height)
    owners: list[Figure | Axes] = [figure, *axes]
    for owner in owners:
        for legend in _legends(owner):
            _narrow_legend(owner, legend)
    return True


def _below_one_another(figure: Figure, axes: list[Axes]) -> float:
    """Put panels below one another; return the height of the figure [inch]."""
    whole = float(figure.get_figheight())
    shares = [float(panel.get_position(original=True).height) for panel in axes]
    heights = np.clip(np.array(shares) * whole, _LEAST, _MOST)
    grid = figure.add_gridspec(len(axes), 1, height_ratios=heights.tolist())
    for row, panel in enumerate(axes):
        panel.set_subplotspec(grid[row, 0])
        panel.tick_params(labelleft=True, labelbottom=True)  # a panel beside it had them for both
    return float(heights.sum()) + _AROUND


def _legends(owner: Figure | Axes) -> list[Legend]:
    legend = getattr(owner, "legend_", None)  # of axes
    return list(getattr(owner, "legends", [])) or ([] if legend is None else [legend])


def _narrow_legend(owner: Figure | Axes, legend: Legend) -> None:
    """Draw a legend again with as many columns as there is room for: matplotlib arranges it only once."""
    labels = [text.get_text() for text in legend.get_texts()]
    if legend._ncols == 1 or not labels:  # type: ignore[attr-defined]
        return
    columns = max(1, _LETTERS // (max(map(len, labels)) + _HANDLE))
    if columns >= legend._ncols:  # type: ignore[attr-defined]
        return
    outside = getattr(legend, "_outside_loc", None)
    options: dict[str, Any] = {"loc": "outside lower center"}
    if outside is None:
        corner = legend.get_bbox_to_anchor().transformed(legend.axes.transAxes.inverted())
        options = {"loc": legend._loc, "bbox_to_anchor": (corner.x0, corner.y0)}  # type: ignore[attr-defined]
    size = legend.get_texts()[0].get_fontsize()
    handles = legend.legend_handles
    legend.remove()
    owner.legend(handles, labels, ncols=columns, fontsize=size, frameon=False, **options)  # type: ignore[arg-type]
