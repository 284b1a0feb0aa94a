"""Figures of the common style are drawn once when they are saved, and are those that matplotlib draws in two passes."""

import io

import matplotlib
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from gantrysim.plots import style
from gantrysim.plots.style import add_legend, sheet


def saved(format):
    """Two plots with titles, labels and a legend outside, drawn on a sheet and saved; and how often lines are drawn."""
    drawn = []
    draw = Line2D.draw
    file = io.BytesIO()
    with pytest.MonkeyPatch.context() as patch, matplotlib.rc_context({"svg.hashsalt": "same"}), sheet(5, 4) as figure:
        patch.setitem(matplotlib.rcParams, "svg.hashsalt", "same")
        patch.setattr(Line2D, "draw", lambda self, renderer: drawn.append(self.get_label()) or draw(self, renderer))
        for axes in figure.subplots(2, 1, sharex=True):
            axes.plot(np.arange(300.0) ** 1.5, label="a line with a long name")
            axes.set(title="title", xlabel="time [s]", ylabel="error [µm]")
        add_legend(figure, 1)
        figure.savefig(file, format=format, metadata={"Date": None} if format == "svg" else {"Software": None})
    return file.getvalue(), drawn.count("a line with a long name")


@pytest.mark.parametrize("format", ["png", "svg"])
def test_a_sheet_is_drawn_once_as_matplotlib_draws_it_twice(format, monkeypatch):
    content, drawings = saved(format)
    assert drawings == 2 + 2  # the lines and their keys in the legend

    class Plain(Figure):
        pass

    monkeypatch.setattr(style, "_figure_class", lambda: Plain)
    twice, drawings = saved(format)
    assert drawings == 2 * (2 + 2)
    assert content == twice


def test_a_sheet_on_a_canvas_is_drawn_whole():
    with sheet(2, 2) as figure:
        figure.add_subplot().plot([0, 1], linewidth=20, color="black")
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
    assert (np.asarray(canvas.buffer_rgba())[..., 0] == 0).mean() > 0.05
