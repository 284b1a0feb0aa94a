"""What a figure shows, read through matplotlib's public interface."""

import numpy as np
from matplotlib.colors import to_hex


def marks(axes):
    """Lines and marks by their label: x and y as lists, colour, and marker or style of the line."""
    found = {}
    for line in axes.lines:
        x, y = np.asarray(line.get_xdata(), float), np.asarray(line.get_ydata(), float)
        shape = line.get_marker() if line.get_marker() not in ("None", None, "") else line.get_linestyle()
        found.setdefault(line.get_label(), (x.tolist(), y.tolist(), to_hex(line.get_color()), shape))
    return found


def labels(axes, direction):
    """Texts at the ticks of an axis."""
    return [text.get_text() for text in getattr(axes, f"get_{direction}ticklabels")()]


def legend(on):
    """Texts of the legend of axes, or of the first one of a figure."""
    box = on.get_legend() if hasattr(on, "get_legend") else on.legends[0]
    return [text.get_text() for text in box.texts]


def size(figure):
    """Width and height [inch]."""
    return tuple(figure.get_size_inches().tolist())
