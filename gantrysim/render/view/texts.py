"""What the viewer shows beside the machine: texts of the moment, the keys and a fault, and the chart of the error."""

from __future__ import annotations

import itertools
import math
import textwrap
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.render.strip import round_step
from gantrysim.render.telemetry import Telemetry
from gantrysim.render.view.clock import Clock
from gantrysim.render.view.source import Source

Row = tuple[str, str]

_WIDTH = 44  # of a line of a fault message
_BEHIND_PACE = 0.9  # of the requested speed, below which the actual one is shown
# the viewer's font is limited to ASCII
_ASCII = str.maketrans({"µ": "u", "·": " ", "²": "2", "³": "3", "°": " deg", "–": "-", "−": "-", "×": "x"})

_CAMERA_KEYS = (("[ ], Esc", "switch camera, free camera"), ("Drag, wheel", "turn, move, zoom"))
REPLAY_KEYS = (
    ("Space", "pause or resume"),
    ("Left, Right", "1 s back, forward"),
    ("Up, Down", "double, halve speed"),
    ("Home, Backspace", "go to start"),
    *_CAMERA_KEYS,
)
LIVE_KEYS = (
    ("Space", "pause or resume"),
    ("Up, Down", "double, halve speed"),
    ("Home, Backspace", "restart"),
    ("Double click", "select a body"),
    ("Ctrl + right drag", "push the selected body"),
    ("Ctrl + left drag", "twist the selected body"),
    *_CAMERA_KEYS,
)
_HINT = ("Space", "pause and show keys")

LINE_POINTS = 1000  # that a line of MuJoCo's holds
_LINES = 99  # the last is the mark of the present
_LEAST_RANGE = 1.0  # range of the error axis [µm]
_AXIS_STEPS = 6  # of the time axis, at most
_INK = (0.99, 0.63, 0.15)
_MARK = (0.9, 0.9, 0.9)


class Texts(NamedTuple):
    """The texts in the window, in rows of two columns: values of the moment, keys, and the fault if there is one."""

    values: tuple[Row, ...]
    keys: tuple[Row, ...]
    fault: tuple[Row, ...]


class ViewState(NamedTuple):
    """State of the viewer.

    Attributes:
        clock: with the requested speed.
        pace: actual speed, in seconds of the run per second; None if unknown.
        push: force of the mouse on the machine [N].
        keys: whether all keys are listed.
    """

    clock: Clock
    pace: float | None
    push: float
    keys: bool


def moment_texts(name: str, source: Source, telemetry: Telemetry, view: ViewState) -> Texts:
    """Return the texts of a source's present tick.

    Args:
        name: of the job.
        source: of the run.
        telemetry: of its record.
        view: state of the viewer.
    """
    clock = view.clock
    pace = view.pace
    push = view.push
    tick = source.tick
    paused = clock.is_paused
    ended = source.over
    time = float(telemetry.time[tick])
    error = float(telemetry.error[tick])
    behind = not (paused or ended) and pace is not None and pace < _BEHIND_PACE * clock.speed
    values = [
        ("live" if source.live else "replay", plain(name)),
        ("time", f"{time:.2f} of {max(source.until, time):.2f} s"),
        ("path speed", f"{telemetry.speed(tick):.1f} mm/s"),
        ("contour error", f"{error:.1f} micron" if np.isfinite(error) else "dispenser off"),
        ("speed", f"{clock.speed:g} x" + (f", actual {pace:.2g} x" if behind else "")),
    ]
    if push > 0:
        values.append(("push", f"{push:.0f} N" if push >= 10 else f"{push:.1f} N"))
    if paused or ended:
        values.append(("", "ended" if ended else "paused"))
    fault = source.fault
    lines = textwrap.wrap(plain(str(fault)), _WIDTH) if fault is not None else []
    keys: tuple[Row, ...] = (_HINT,)
    if view.keys:
        keys = LIVE_KEYS if source.live else REPLAY_KEYS
    return Texts(
        tuple(values),
        keys,
        tuple(("" if number else "fault", line) for number, line in enumerate(lines)),
    )


def plain(text: str) -> str:
    """Return a text in ASCII, which the viewer's font is limited to."""
    return text.replace("µm", "micron").translate(_ASCII).encode("ascii", "replace").decode()


def thinned_curve(time: Floats, value: Floats, points: int = LINE_POINTS) -> tuple[Floats, Floats]:
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


def lines(time: Floats, value: Floats, points: int = LINE_POINTS, most: int = _LINES) -> list[tuple[Floats, Floats]]:
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
        step = round_step(end / _AXIS_STEPS)
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
