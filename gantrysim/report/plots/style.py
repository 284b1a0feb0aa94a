"""Style of all plots: colours, fonts, and the sheet they are drawn on."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.jit import jit
from gantrysim.results.colours import BAD, FAULT, INK, LINKS, MAGNITUDE, REQUESTED, ColourScale

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import ListedColormap
    from matplotlib.figure import Figure, SubFigure

COLUMNS = 1000  # horizontal resolution of a thinned line

RESOLUTION = 130.0  # of pictures [dpi]


FAR_LIMIT = 4.0  # times what is drawn, beyond which a limit is no longer on its scale
_ABOVE_LIMIT = 1.08  # top of the axis, of a limit

# of the links, the contour error that they add up to, the requested path, and faults
COLOURS = {"requested": REQUESTED, **LINKS, "contour": INK, "fault": FAULT}
# lengths of dashes and of the gaps between them, so that no line is known by its colour alone [pixels]
DASHES: dict[str, list[int]] = {
    "servo": [9, 3],
    "encoder": [2, 3],
    "geometry": [12, 3, 2, 3],
    "structure": [5, 3],
    "corner": [2, 6],
    "vertical": [1, 3],
}

_STYLE: dict[Any, Any] = {
    "font.size": 10,
    "axes.titlesize": 11,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": REQUESTED,
    "grid.alpha": 0.3,
    "grid.linewidth": 0.6,
    "legend.frameon": False,
    "savefig.dpi": RESOLUTION,
    "text.hinting": "no_hinting",  # letters are spaced evenly
    **dict.fromkeys(
        ("text.color", "axes.edgecolor", "axes.labelcolor", "axes.titlecolor", "xtick.color", "ytick.color"), INK
    ),
}


_OF_THE_PROCESS = ("backend", "backend_fallback", "interactive", "toolbar", "timezone", "datapath")


@contextmanager
def common_style(options: Mapping[Any, Any] | None = None) -> Iterator[None]:
    """Draw and save in the common style, with further options of matplotlib; a user's matplotlibrc has no effect."""
    import matplotlib  # slow to import

    known = matplotlib.rcParamsDefault
    defaults = {key: known[key] for key in known if key not in _OF_THE_PROCESS}
    with matplotlib.rc_context({**defaults, **_STYLE, **(options or {})}):
        yield


@contextmanager
def sheet(width: float, height: float) -> Iterator[Figure]:
    """Yield an empty figure of a width and height [inch] to draw on in the common style."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg  # slow to import
    from matplotlib.figure import Figure

    with common_style():
        figure = Figure(figsize=(width, height), layout="constrained")
        # so that `figure.canvas.draw()` draws
        FigureCanvasAgg(figure)
        yield figure


def axes_on(on: Figure | SubFigure | Axes, **options: Any) -> Axes:
    """Return the axes that a plot is drawn on: those given, or new ones that fill a figure."""
    from matplotlib.figure import FigureBase  # slow to import

    return on.add_subplot(**options) if isinstance(on, FigureBase) else on


def add_legend(on: Figure | SubFigure | Axes) -> None:
    """Add a legend below a figure's own plot, line under line as its texts may be long, or inside of given axes."""
    from matplotlib.figure import FigureBase  # slow to import

    if isinstance(on, FigureBase):
        on.legend(loc="outside lower center")
    else:
        on.legend(fontsize="small")


def draw_limit(axes: Axes, limit: float, signed: bool = True) -> None:
    """Draw the largest error of the path that a tolerance admits, on the side or both sides of zero [µm].

    Where it lies so far beyond what is drawn that nothing else would be seen, a text says so instead.

    Args:
        axes: of errors [µm], which are drawn.
        limit: of their size [µm].
        signed: whether the errors have a sign.
    """
    low, high = axes.get_ylim()
    text = limit_text(limit, signed)
    if limit > FAR_LIMIT * max(-low, high):
        text = f"{text}, beyond this scale"
        axes.text(0.995, 0.94, text, transform=axes.transAxes, ha="right", va="top", color=BAD, fontsize=8)
        return
    for side in (1, -1) if signed else (1,):
        axes.axhline(side * limit, color=BAD, lw=1.2, ls="--", label=text if side > 0 else "_")
    axes.set_ylim(min(low, -_ABOVE_LIMIT * limit) if signed else low, max(high, _ABOVE_LIMIT * limit))


def limit_text(limit: float, signed: bool = True) -> str:
    """Return a limit of errors [µm] in words."""
    return f"limit {'± ' if signed else ''}{limit:.3g} µm"


def line_style(name: str) -> Any:
    """Return matplotlib's line style of a name, solid for one without dashes."""
    lengths = DASHES.get(name)
    return "-" if lengths is None else (0, lengths)


def turn_colours(count: int) -> list[str]:
    """Return colours for the turns of a spiral, from light to dark."""
    return [MAGNITUDE.colour((1 + 2 * k) / (2 * count)) for k in range(count)]


def colour_map(scale: ColourScale) -> ListedColormap:
    """Return matplotlib's map of a scale, from its place 0 to its place 1."""
    from matplotlib.colors import ListedColormap  # slow to import

    return ListedColormap(scale.table() / 255)


def view_height(wide: float, high: float, width: float) -> float:
    """Return the height of a figure for a plan view with equal scales and a legend [inch].

    Args:
        wide: extent of the content from left to right.
        high: extent from bottom to top, in the same unit.
        width: width of the figure [inch].
    """
    return float(np.clip(0.85 * width * high / max(wide, 1e-9), 0.25 * width, 1.1 * width)) + 1.2


def thinned_line(x: Floats, y: Floats, columns: int = COLUMNS) -> tuple[Floats, Floats]:
    """Thin a line (m,) to the first, lowest, highest and last point of each of many columns; NaN remain as gaps."""
    size = -(-x.size // columns)
    if size <= 4:
        return x, y
    drawn = np.zeros(x.size, bool)
    _mark(drawn, y, size)
    return x[drawn], y[drawn]


@jit
def _mark(drawn: NDArray[np.bool_], y: Floats, size: int) -> None:
    """Mark the first, lowest, highest and last of every so many values, and every NaN; in place, as lines are long."""
    for begin in range(0, y.size, size):
        end = min(begin + size, y.size)
        low = high = -1
        for k in range(begin, end):
            if np.isnan(y[k]):
                drawn[k] = True
            elif low < 0:
                low = high = k
            elif y[k] < y[low]:
                low = k
            elif y[k] > y[high]:
                high = k
        drawn[begin] = drawn[end - 1] = True
        if low >= 0:
            drawn[low] = drawn[high] = True
