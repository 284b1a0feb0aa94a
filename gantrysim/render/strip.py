"""The contour errors of runs over time, drawn bold up to a cursor and faint after it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from gantrysim.base.arrays import Floats
from gantrysim.base.columns import blocks
from gantrysim.metrics.error_quantities import CONTOUR
from gantrysim.render.encoding import Picture
from gantrysim.render.fonts import MUTED, PAPER, Font, rgb
from gantrysim.render.telemetry import Telemetry
from gantrysim.report.plots.style import COLOURS
from gantrysim.results.colours import INK

_GREY = COLOURS["requested"]
_FAULT = COLOURS["fault"]
_HEADROOM = 1.06  # of the error axis over the largest error
_LEAST_ERROR = 1e-3  # largest error that is not drawn as zero [µm]
_FUTURE = 0.28  # opacity of the curves after the cursor
_OFF_OPACITY = 0.22  # opacity of the shade where the dispenser is off
_GRID = 0.30  # opacity of the lines at the ticks of the error axis
_SPOT = 0.24  # radius in sizes of the letters
# title, and name of the shade, from the longest; the first that fits is drawn
_NAMES = ((CONTOUR.head, "dispenser off"), (CONTOUR.head, "off"), (f"error [{CONTOUR.unit}]", "off"))


def round_step(least: float) -> float:
    """Return the smallest of 1, 2, 5 times a power of ten that is at least a positive number."""
    decade = 10.0 ** np.floor(np.log10(least))
    return float(next(factor * decade for factor in (1, 2, 5, 10) if factor * decade >= least * (1 - 1e-9)))


def axis_ticks(top: float, most: float) -> Floats:
    """Return ticks from 0 up to `top` at a round step, the shortest that is at least top / most."""
    step = round_step(top / most)
    return step * np.arange(np.floor(top / step * (1 + 1e-9)) + 1)


class Strip:
    """Draws the contour errors of runs over time, on one scale.

    Time and error lie at the middles of pixels:

        column(t) = left + t / end (right - left)        row(e) = bottom - e / top (bottom - above)

    Args:
        runs: telemetry of the runs.
        colours: of their curves.
        size: width and height of the strip [pixels].
        font: of its text.
        head: height above the curves, at least the title's [pixels].

    Attributes:
        end: time at the right end, where the longest run ends [s].
        top: error at the upper end [µm].
        left, right: first and last column of the curves.
        above, bottom: first and last row of the curves; the last is zero error.
        time_ticks, error_ticks: of the axes [s], [µm].
    """

    def __init__(
        self, runs: Sequence[Telemetry], colours: Sequence[str], size: tuple[int, int], font: Font, head: int = 0
    ) -> None:
        self.size = size
        width, height = size
        self._runs = tuple(runs)
        self._font = font
        self._colours = [np.array(rgb(colour)) for colour in colours]
        self.end = max(float(max(run.time[-1], run.run.period)) for run in runs)
        largest = max((float(run.max[-1]) for run in runs if np.isfinite(run.max[-1])), default=0.0)
        self.top = _HEADROOM * largest if largest > _LEAST_ERROR else 1.0
        self.above = max(round(1.3 * font.size), head)
        self.bottom = height - round(1.35 * font.size)
        self.error_ticks = axis_ticks(self.top, (self.bottom - self.above) / (1.15 * font.size))
        self.left = round(max(font.width(f"{tick:g}") for tick in self.error_ticks) + 0.5 * font.size)
        self.right = width - 1 - round(1.8 * font.size)
        self.time_ticks = axis_ticks(self.end, (self.right - self.left) / (4.5 * font.size))
        self._future, self._past = self._draw()

    def column(self, time: float) -> float:
        """Return the column of a time [s]; later than the end, the end's."""
        return self.left + min(max(time / self.end, 0.0), 1.0) * (self.right - self.left)

    def row(self, error: float) -> float:
        """Return the row of an error [µm]."""
        return self.bottom - error / self.top * (self.bottom - self.above)

    def picture(self, time: float) -> Picture:
        """Return the strip at a time of the run [s], (height, width, 3)."""
        cursor = round(self.column(time))
        picture = self._future.copy()
        picture[:, : cursor + 1] = self._past[:, : cursor + 1]
        thick = max(1, round(self._font.size / 10))
        first = min(max(cursor - thick // 2, self.left), self.right + 1 - thick)
        picture[self.above : self.bottom + 1, first : first + thick] = rgb(INK)
        radius = _SPOT * self._font.size
        for run, colour in zip(self._runs, self._colours, strict=True):
            error = run.error[run.tick(time)]
            if run.has_faulted(time):
                end = round(self.column(run.time[-1]))
                _draw_spot(picture, end, self.row(np.nan_to_num(error)), radius, np.array(rgb(_FAULT)))
            elif np.isfinite(error) and not run.has_ended(time):
                _draw_spot(picture, cursor, self.row(error), radius, colour)
        return picture

    def _draw(self) -> tuple[Picture, Picture]:
        """Return the strip as drawn to the right of the cursor, and to the left."""
        paper = Image.new("RGB", self.size, PAPER)
        off = self._off()
        grey = np.array(rgb(_GREY))
        self._write(ImageDraw.Draw(paper), bool(off.any()))
        base = np.asarray(paper, float)
        area = base[self.above : self.bottom + 1, self.left : self.right + 1]
        area[:, off] += _OFF_OPACITY * (grey - area[:, off])
        for tick in self.error_ticks:
            line = area[round(self.row(tick)) - self.above]
            line += (1.0 if tick == 0 else _GRID) * (grey - line)
        width = max(1.3, 0.13 * self._font.size)
        return self._with_curves(base, width / 1.3, _FUTURE), self._with_curves(base, width, 1.0)

    def _with_curves(self, base: Floats, thick: float, opacity: float) -> Picture:
        """Draw the curves; where they overlap they alternate as dashes."""
        picture = base.copy()
        area = picture[self.above : self.bottom + 1, self.left : self.right + 1]
        covered = [self._coverage(run, thick)[..., None] for run in self._runs]
        dash = np.arange(area.shape[1]) // round(0.7 * self._font.size) % len(covered)
        for last in range(len(covered)):
            part = area[:, dash == last]
            for k in range(len(covered)):
                run = (last + 1 + k) % len(covered)
                part += opacity * covered[run][:, dash == last] * (self._colours[run] - part)
            area[:, dash == last] = part
        return np.round(picture).astype(np.uint8)

    def _coverage(self, run: Telemetry, thick: float) -> Floats:
        """Return the share of every pixel that a curve covers: in each column between its extreme errors there."""
        columns = np.arange(self.left, self.right + 1)
        per_column = self.end / (self.right - self.left)
        edges = (np.append(columns, self.right + 1) - 0.5 - self.left) * per_column
        value = np.interp(edges, run.time, run.error, left=np.nan, right=np.nan)
        low = np.fmin(value[:-1], value[1:])
        high = np.fmax(value[:-1], value[1:])
        # a long run does not fit in memory
        for block in blocks(len(run.time)):
            column_of_tick = np.clip(np.round(run.time[block] / per_column).astype(int), 0, len(columns) - 1)
            np.fmin.at(low, column_of_tick, run.error[block])
            np.fmax.at(high, column_of_tick, run.error[block])
        rows = np.arange(self.above, self.bottom + 1)[:, None]
        upper = self.row(high) - 0.5 * thick  # type: ignore[arg-type]
        lower = self.row(low) + 0.5 * thick  # type: ignore[arg-type]
        return np.nan_to_num(np.clip(np.minimum(rows + 0.5, lower) - np.maximum(rows - 0.5, upper), 0.0, 1.0))

    def _off(self) -> NDArray[np.bool_]:
        """Return whether no run's dispenser is on at each column of the curves."""
        times = np.linspace(0.0, self.end, self.right + 1 - self.left)
        on = np.zeros(times.size, bool)
        for run in self._runs:
            tick = np.round(times / run.run.period).astype(int)
            inside = tick < len(run.time)
            on[inside] |= run.run.dispense[tick[inside]]
        return ~on

    def _write(self, draw: ImageDraw.ImageDraw, shaded: bool) -> None:
        """Draw title, numbers of the axes and name of the shade."""
        font = self._font
        above = round(0.08 * font.size)
        side = 0.8 * font.size
        for title, shade in _NAMES if shaded else [(title, "") for title, _ in _NAMES]:
            first = self.left + font.width(title) + (font.size + 1.4 * side) * shaded
            start = round(max(first, self.right - font.width(shade)))
            if start + font.width(shade) <= self.size[0] - 0.3 * font.size:
                break
        font.write(draw, (self.left, above), title, INK)
        if shaded:
            font.write(draw, (start, above), shade, MUTED)
            colour = tuple(round(p + 2 * _OFF_OPACITY * (g - p)) for p, g in zip(rgb(PAPER), rgb(_GREY), strict=True))
            box = (start - 1.4 * side, 0.28 * font.size, start - 0.4 * side, 0.28 * font.size + side)
            draw.rectangle([round(corner) for corner in box], colour)
        for tick in self.error_ticks:
            place = (round(self.left - 0.35 * font.size), round(self.row(tick)))
            font.write(draw, place, f"{tick:g}", MUTED, "rm")
        below = self.bottom + round(0.25 * font.size)
        for tick in self.time_ticks:
            column = round(self.column(tick))
            draw.line((column, self.bottom + 1, column, below - 1), rgb(_GREY))
            font.write(draw, (column, below), f"{tick:g}", MUTED, "ma")
        last = self.column(self.time_ticks[-1]) + font.width(f"{self.time_ticks[-1]:g}") / 2
        font.write(draw, (round(last + 0.3 * font.size), below), "s", MUTED)


def _draw_spot(picture: Picture, column: int, row: float, radius: float, colour: Floats) -> None:
    """Draw a disc with soft edges."""
    reach = int(np.ceil(radius)) + 1
    rows = np.arange(max(int(row) - reach, 0), min(int(row) + reach + 2, picture.shape[0]))
    columns = np.arange(max(column - reach, 0), min(column + reach + 1, picture.shape[1]))
    distance = np.hypot(rows[:, None] - row, columns - column)
    share = np.clip(radius + 0.5 - distance, 0.0, 1.0)[..., None]
    patch = picture[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    patch[:] = np.round(patch + share * (colour - patch))
