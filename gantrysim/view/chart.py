"""The contour error over time, in as few points as MuJoCo's figures hold, with every peak."""

from __future__ import annotations

import itertools
import math

import mujoco
import numpy as np
from numpy.typing import NDArray

from gantrysim.arrays import Floats

POINTS = 1000  # that a line of MuJoCo's holds
_LINES = 99  # the last is the mark of the present
_LEAST = 1.0  # that the axis of the error holds [µm]
_STEPS = 6  # of the axis of time, at most
_INK = (0.99, 0.63, 0.15)
_MARK = (0.9, 0.9, 0.9)


def thinned(time: Floats, value: Floats, points: int = POINTS) -> tuple[Floats, Floats]:
    """Return at most so many points of a curve, with the smallest and the largest value of every part of it.

    Args:
        time: (n,), rising.
        value: (n,), finite.
        points: at most, at least 2.
    """
    n = len(time)
    if n <= points:
        return time, value
    bins = points // 2
    edges = np.arange(bins + 1) * n // bins
    kept = []
    for begin, end in itertools.pairwise(edges.tolist()):
        part = value[begin:end]
        kept += sorted({begin + int(part.argmin()), begin + int(part.argmax())})
    return time[kept], value[kept]


def lines(time: Floats, value: Floats, points: int = POINTS, most: int = _LINES) -> list[tuple[Floats, Floats]]:
    """Return a curve with gaps as lines without, of at most so many points together.

    Args:
        time: (n,), rising.
        value: (n,), nan in the gaps.
        points: at most, in all lines together.
        most: lines at most; where there are more parts, the gaps are drawn through.
    """
    on = np.isfinite(value)
    edges = np.flatnonzero(np.diff(on, prepend=False, append=False))
    parts = list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))
    if len(parts) > most:
        return [thinned(time[on], value[on], points)]
    share = points / max(int(on.sum()), 1)
    drawn = []
    for begin, end in parts:
        own = (end - begin) if share >= 1 else max(int(share * (end - begin)), 2)
        drawn.append(thinned(time[begin:end], value[begin:end], own))
    return drawn


def ceiling(value: float) -> float:
    """Return the smallest of 1, 2, 5 times a power of ten that is no less than a value; 1 of none."""
    if not value > 0:
        return 1.0
    power = 10.0 ** math.floor(math.log10(value))
    return next(step * power for step in (1, 2, 5, 10) if step * power >= value * (1 - 1e-12))


class Chart:
    """The figure in the window.

    Attributes:
        figure: MuJoCo's.
    """

    def __init__(self) -> None:
        figure = mujoco.MjvFigure()
        mujoco.mjv_defaultFigure(figure)
        figure.title = "contour error [um]"
        figure.xlabel = "time [s]"
        figure.flg_extend = 0
        figure.flg_legend = 0
        figure.gridsize[:] = (2, 3)
        figure.figurergba[:] = (0.08, 0.09, 0.11, 0.75)
        figure.panergba[:] = (0.0, 0.0, 0.0, 0.35)
        figure.gridrgb[:] = (0.35, 0.35, 0.35)
        figure.linewidth = 1.5
        figure.minwidth = "00000"
        self.figure = figure

    def draw(self, time: Floats, error: Floats, until: float) -> None:
        """Draw the error until now.

        Args:
            time: (n,) [s].
            error: contour error, nan while the dispenser is off, (n,) [µm].
            until: end of the axis of time, further where the last time is [s].
        """
        figure = self.figure
        drawn = lines(time, error)
        largest = float(np.nanmax(error)) if np.isfinite(error).any() else 0.0
        right = max(until, float(time[-1]), 1e-3)
        step = ceiling(right / _STEPS)
        steps = math.ceil(right / step - 1e-9)
        top = ceiling(max(largest, _LEAST))
        figure.range[0], figure.range[1] = (0, steps * step), (0, top)
        figure.gridsize[0] = steps + 1
        figure.xformat = "%.0f" if step >= 1 else "%.2g"
        figure.yformat = "%.0f" if top >= 5 else "%.2g"
        figure.linepnt[:] = 0
        for number, (t, value) in enumerate(drawn):
            self._line(number, t, value, _INK)
        now = np.full(2, float(time[-1]))
        self._line(len(drawn), now, np.array([0.0, top]), _MARK)

    def _line(self, number: int, time: Floats, value: Floats, colour: tuple[float, float, float]) -> None:
        figure = self.figure
        pairs: NDArray[np.float32] = np.column_stack([time, value]).astype(np.float32)
        figure.linedata[number, : pairs.size] = pairs.ravel()
        figure.linergb[number] = colour
        figure.linepnt[number] = len(pairs)
