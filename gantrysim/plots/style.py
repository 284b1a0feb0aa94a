"""What all plots have in common: colours, type, and the sheet they are drawn on."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np

from gantrysim.arrays import Floats

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_COLUMNS = 1000  # of a plot, between which a line is told apart

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


def turn_colours(count: int) -> list[str]:
    """Return colours for the turns of a spiral in their order: dark to light, told apart by lightness alone."""
    from matplotlib import colormaps  # slow to import, and needed by the plots alone
    from matplotlib.colors import to_hex

    return [to_hex(colormaps["viridis"](0.28 + 0.54 * k / max(count - 1, 1))) for k in range(count)]


def view_height(wide: float, high: float, width: float) -> float:
    """Return the height of a view from above, in which both directions have one scale, with room for a legend [inch].

    Args:
        wide: what it shows from left to right.
        high: and from bottom to top, in the same unit.
        width: of the figure [inch].
    """
    return float(np.clip(0.85 * width * high / max(wide, 1e-9), 0.25 * width, 1.1 * width)) + 1.2


def thinned(x: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Return those points of a line that its picture needs: in each of many columns first, lowest, highest and last.

    What is not a number keeps its place as a gap.

    Args:
        x: from left to right, (m,).
        y: (m,).
    """
    size = -(-x.size // _COLUMNS)
    if size <= 4:
        return x, y
    rows = np.full((-(-x.size // size), size), np.nan)
    rows.flat[: x.size] = y
    first = np.arange(rows.shape[0]) * size
    low, high = (
        first + choose(np.where(np.isnan(rows), away, rows), axis=1)
        for choose, away in ((np.argmin, np.inf), (np.argmax, -np.inf))
    )
    gaps = np.flatnonzero(np.isnan(y))
    kept = np.unique(np.concatenate([first, low, high, first[1:] - 1, gaps, [x.size - 1]]))
    return x[kept], y[kept]
