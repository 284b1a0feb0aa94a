"""The contour error over time in the viewer, in the few points that MuJoCo's figures hold, with every peak."""

from __future__ import annotations

import itertools
import math

import mujoco
import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.render.strip import round_step

POINTS = 1000  # that a line of MuJoCo's holds
_LINES = 99  # the last is the mark of the present
_LEAST_RANGE = 1.0  # range of the error axis [µm]
_STEPS = 6  # of the time axis, at most
_INK = (0.99, 0.63, 0.15)
_MARK = (0.9, 0.9, 0.9)


def thinned_curve(time: Floats, value: Floats, points: int = POINTS) -> tuple[Floats, Floats]:
    """Return at most so many points of a curve, at least 2, with the extreme values of every part of it.

    Time is rising, (n,), the values are finite, (n,).
    """
    n = len(time)
    if n <= points:
        return time, value
    bins = points // 2
    edges = np.arange(bins + 1) * n // bins
    extremes = []
    for begin, end in itertools.pairwise(edges.tolist()):
        part = value[begin:end]
        extremes += sorted({begin + int(part.argmin()), begin + int(part.argmax())})
    return time[extremes], value[extremes]


def lines(time: Floats, value: Floats, points: int = POINTS, most: int = _LINES) -> list[tuple[Floats, Floats]]:
    """Return a curve with gaps as separate lines, of at most so many points together.

    Time is rising, (n,), the values are nan in the gaps, (n,). Gaps are bridged where there would be more lines than
    `most`.
    """
    on = np.isfinite(value)
    edges = np.flatnonzero(np.diff(on, prepend=False, append=False))
    parts = list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))
    if len(parts) > most:
        return [thinned_curve(time[on], value[on], points)]
    share = min(points / max(int(on.sum()), 1), 1.0)
    return [
        thinned_curve(time[begin:end], value[begin:end], max(int(share * (end - begin)), 2)) for begin, end in parts
    ]


class Chart:
    """The contour error over time.

    Attributes:
        figure: MuJoCo's figure.
    """

    def __init__(self) -> None:
        figure = mujoco.MjvFigure()
        mujoco.mjv_defaultFigure(figure)
        figure.title = "contour error [micron]"
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
        """Draw the contour error up to now.

        Args:
            time: (n,) [s].
            error: nan while the dispenser is off, (n,) [µm].
            until: end of the time axis, unless the last time is later [s].
        """
        figure = self.figure
        largest = float(np.nanmax(error)) if np.isfinite(error).any() else 0.0
        end = max(until, float(time[-1]), 1e-3)
        step = round_step(end / _STEPS)
        steps = math.ceil(end / step - 1e-9)
        top = round_step(max(largest, _LEAST_RANGE))
        figure.range[0] = (0, steps * step)
        figure.range[1] = (0, top)
        figure.gridsize[0] = steps + 1
        figure.xformat = "%.0f" if step >= 1 else "%.2g"
        figure.yformat = "%.0f" if top >= 5 else "%.2g"
        figure.linepnt[:] = 0
        curves = lines(time, error)
        for number, curve in enumerate(curves):
            self._line(number, *curve, _INK)
        self._line(len(curves), np.full(2, float(time[-1])), np.array([0.0, top]), _MARK)

    def _line(self, number: int, time: Floats, value: Floats, colour: tuple[float, float, float]) -> None:
        pairs: NDArray[np.float32] = np.column_stack([time, value]).astype(np.float32)
        self.figure.linedata[number, : pairs.size] = pairs.ravel()
        self.figure.linergb[number] = colour
        self.figure.linepnt[number] = len(pairs)
