"""Figures of the common style are drawn once when they are saved, and are those that matplotlib draws in two passes."""

import io

import matplotlib
import numpy as np
import pytest
from matplotlib.axis import Axis
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


def gallery(figure):
    """Draw axes whose ticks depend on one another, on their place, or on what was drawn before."""
    left, middle, right = figure.subfigures(1, 3)
    upper, lower = left.subplots(2, 1, sharex=True)
    upper.plot(1e6 + np.linspace(0, 1, 50))  # an offset beside the axis
    upper.xaxis.tick_top()
    lower.semilogy(np.linspace(1e-3, 50, 50))
    lower.minorticks_on()
    left.align_ylabels()
    polar = middle.add_subplot(projection="polar")
    polar.plot(np.linspace(0, 6, 100), np.linspace(1, 2, 100))
    polar.set_rticks([1, 1.5, 2], ["1", "1.5", "2"], fontsize=8)
    picture = right.add_subplot()
    figure.colorbar(picture.imshow(np.arange(12.0).reshape(3, 4)), ax=picture, label="height [mm]", shrink=0.8)
    picture.secondary_xaxis("top", functions=(np.square, np.sqrt))
    for axes in (upper, lower, picture):
        axes.set(title="title", xlabel="time [s]", ylabel="error [µm]")


def saved_twice(format):
    """What is saved of a gallery, and again once it is narrower and seen elsewhere; how often ticks are arranged."""
    files = io.BytesIO(), io.BytesIO()
    arranged = []
    arrange = Axis._update_ticks
    with pytest.MonkeyPatch.context() as patch, sheet(11, 4) as figure:
        patch.setitem(matplotlib.rcParams, "svg.hashsalt", "same")
        patch.setattr(Axis, "_update_ticks", lambda self: arranged.append(self) or arrange(self))
        gallery(figure)
        metadata = {"Date": None} if format == "svg" else {"Software": None}
        figure.savefig(files[0], format=format, metadata=metadata)
        figure.set_size_inches(9, 3)
        figure.axes[1].set(xlim=(10, 20), ylim=(1, 1e4))
        figure.axes[2].set_title("a title")
        figure.savefig(files[1], format=format, metadata=metadata, dpi=90)
    return [file.getvalue() for file in files], len(arranged)


@pytest.mark.parametrize("format", ["png", "svg"])
def test_ticks_that_are_remembered_are_those_that_matplotlib_arranges_again(format, monkeypatch):
    content, arrangements = saved_twice(format)
    monkeypatch.setattr(style, "_figure_class", lambda: Figure)
    plain, plain_arrangements = saved_twice(format)
    assert content == plain
    assert content[0] != content[1]
    assert arrangements < 0.5 * plain_arrangements


def test_axes_arrange_their_ticks_themselves_after_a_sheet_is_saved():
    with sheet(4, 3) as figure:
        axes = figure.add_subplot()
        figure.savefig(io.BytesIO())
    assert not any(name.startswith("_update_ticks") for name in vars(axes.xaxis))
    assert axes.xaxis._update_ticks.__func__ is Axis._update_ticks


def test_a_sheet_on_a_canvas_is_drawn_whole():
    with sheet(2, 2) as figure:
        figure.add_subplot().plot([0, 1], linewidth=20, color="black")
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
    assert (np.asarray(canvas.buffer_rgba())[..., 0] == 0).mean() > 0.05
