"""The class of figures that plots are drawn on: matplotlib's, saved in less time with the same result."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from types import FunctionType
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.axis import Axis


class Sheet(Figure):
    """A figure that is drawn once when it is saved, where matplotlib draws it twice and arranges its ticks many times.

    Of the first drawing, which has no output, nothing remains but the layout.
    """

    def savefig(self, *args: Any, **options: Any) -> None:
        with _remembered_ticks(self):
            super().savefig(*args, **options)

    def arrange(self, resolution: float) -> None:
        """Lay the figure out for a resolution [dpi] once and for all: it is saved faster from then on."""
        engine = self.get_layout_engine()
        if engine is not None:
            with _remembered_ticks(self), _at_resolution(self, resolution):
                engine.execute(self)
            self.set_layout_engine("none")

    def pixels(self, resolution: float) -> NDArray[np.uint8]:
        """Return the figure drawn at a resolution [dpi], (height, width, 4)."""
        # that of `arrange` knows the sizes of all texts
        canvas: Any = self.canvas if type(self.canvas) is FigureCanvasAgg else FigureCanvasAgg(self)
        with _remembered_ticks(self), _at_resolution(self, resolution):
            canvas.draw()
        return np.asarray(canvas.buffer_rgba())

    def draw(self, renderer: Any) -> None:
        engine = self.get_layout_engine()
        is_muted = isinstance(renderer.draw_path, FunctionType)  # in the place of a method
        if engine is not None and is_muted:
            engine.execute(self)
        else:
            super().draw(renderer)


@contextmanager
def _at_resolution(figure: Figure, resolution: float) -> Iterator[None]:
    usual = figure.dpi
    figure.dpi = resolution
    try:
        yield
    finally:
        figure.dpi = usual


@contextmanager
def _remembered_ticks(figure: Figure) -> Iterator[None]:
    """Let the axes of a figure keep their ticks and the extents of their labels until view, place or resolution change.

    Each spine, axis label and title asks for them, some fourteen times in all; most answers are the same.
    """
    axes = figure.axes
    every = [cast("Axis", axis) for panel in axes for axis in (panel.xaxis, panel.yaxis)]
    for axis in every:
        memory = _TickMemory(axis)
        # methods of the class, found again once those of the object are gone
        vars(axis).update(_update_ticks=memory.ticks, _get_ticklabel_bboxes=memory.boxes)
    try:
        yield
    finally:
        for axis in every:
            del vars(axis)["_update_ticks"], vars(axis)["_get_ticklabel_bboxes"]


class _TickMemory:
    """The ticks of an axis that are drawn, and the extents of their labels, as computed last."""

    def __init__(self, axis: Any) -> None:
        self._axis = axis
        self._compute_ticks = axis._update_ticks
        self._compute_boxes = axis._get_ticklabel_bboxes
        self._state: object = None
        self._ticks: list[Any] = []
        self._boxes: tuple[list[Any], list[Any]] | None = None

    def ticks(self) -> list[Any]:
        """Return the ticks that are drawn, with their labels and places brought up to date."""
        state = self._current_state()
        if state != self._state:
            self._ticks = self._compute_ticks()
            self._boxes = None
            self._state = state
        return self._ticks

    def boxes(self, ticks: list[Any], renderer: Any) -> tuple[list[Any], list[Any]]:
        """Return the extents of the labels of ticks, on this side of the axes and on the other."""
        if ticks is not self._ticks or self._current_state() != self._state:
            return cast("tuple[list[Any], list[Any]]", self._compute_boxes(ticks, renderer))
        if self._boxes is None:
            self._boxes = self._compute_boxes(ticks, renderer)
        return self._boxes

    def _current_state(self) -> object:
        """Return what places and texts of the ticks depend on while a figure is saved."""
        low, high = self._axis.get_view_interval()
        return low, high, self._axes_bounds(), self._axis.get_figure(root=True).dpi

    def _axes_bounds(self) -> tuple[float, float, float, float]:
        bounds: tuple[float, float, float, float] = self._axis.axes.bbox.bounds
        return bounds
