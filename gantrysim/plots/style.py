"""What all plots have in common: colours, type, and the sheet they are drawn on."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["AXIS_COLOURS", "COLOURS", "INK", "UM", "sheet"]

UM = 1e3  # micrometres in a millimetre

INK = "#1b1f24"  # of text, axes, and what is measured at the end of the chain

# One colour for each link of the chain, in every plot, after Okabe and Ito's palette for all kinds of colour vision;
# the axes of a machine have colours of their own, after Paul Tol's muted scheme.
COLOURS = {
    "requested": "#8a8f98",
    "generation": "#e69f00",
    "tracking": "#0072b2",
    "measurement": "#cc79a7",
    "structure": "#009e73",
    "contour": INK,
    "fault": "#d1203f",
}
AXIS_COLOURS = ("#3a9fc7", "#d55e00", "#8f8f2e", "#aa4499", "#44aa99", "#cc6677")

_STYLE: dict[Any, Any] = {
    "font.size": 10,
    "axes.titlesize": 11,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#8a8f98",
    "grid.alpha": 0.3,
    "grid.linewidth": 0.6,
    "legend.frameon": False,
    "savefig.dpi": 130,
    **dict.fromkeys(
        ("text.color", "axes.edgecolor", "axes.labelcolor", "axes.titlecolor", "xtick.color", "ytick.color"), INK
    ),
}


@contextmanager
def sheet(width: float, height: float) -> Iterator[Figure]:
    """Give an empty figure; what is drawn on it inside the block has the style of all plots.

    Args:
        width: of the figure [inch].
        height: of the figure [inch].
    """
    import matplotlib  # slow to import, and needed by the plots alone
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with matplotlib.rc_context(_STYLE):
        figure = Figure(figsize=(width, height), layout="constrained")
        FigureCanvasAgg(figure)
        yield figure
