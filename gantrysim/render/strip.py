"""The contour error of runs over time, as a strip whose past is drawn bold, up to a cursor."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from gantrysim.arrays import Floats
from gantrysim.plots.style import COLOURS, INK
from gantrysim.render.lettering import MUTED, PAPER, Font, rgb
from gantrysim.render.readout import Readout

Picture = NDArray[np.uint8]

_GREY, _FAULT = COLOURS["requested"], COLOURS["fault"]
_HEADROOM = 1.06  # of the error axis over the largest error
_LEAST = 1e-3  # largest error that is shown as one [µm]
_FAINT = 0.28  # of the time to come, against the past
_OFF = 0.22  # of the shade where the dispenser is off
_GRID = 0.30
# title, and what the shade is; the first that there is room for
_NAMES = (("contour error [µm]", "dispenser off"), ("contour error [µm]", "off"), ("error [µm]", "off"))


def ticks_of(top: float, most: float) -> Floats:
    """Return ticks from 0 up to `top` in steps of 1, 2 or 5 times a power of ten, the shortest not below top / most."""
    least = top / most
    decade = 10.0 ** np.floor(np.log10(least))
    step = next(factor * decade for factor in (1, 2, 5, 10) if factor * decade >= least * (1 - 1e-9))
    return step * np.arange(np.floor(top / step * (1 + 1e-9)) + 1)


class Strip:
    """Draws the contour errors of runs over the time of the run, on one scale.

    Time and error lie at the middles of pixels:

        column(t) = left + t / end (right - left)        row(e) = bottom - e / top (bottom - above)

    Args:
        readouts: of the runs.
        colours: of their curves, one each.
        size: width and height of the strip [pixels].
        font: of its letters.
        head: height above the curves, by default that of the title [pixels].

    Attributes:
        size: width and height [pixels].
        end: time at the right end, that of the longest run [s].
        top: error at the upper end [µm].
        left, right: first and last column of the curves.
        above, bottom: their first and last row; the last is that of no error.
        time_ticks: [s].
        error_ticks: [µm].
    """

    def __init__(
        self,
        readouts: Sequence[Readout],
        colours: Sequence[str],
        size: tuple[int, int],
        font: Font,
        head: int = 0,
    ) -> None:
        self.size = width, height = size
        self._readouts, self._font = tuple(readouts), font
        self._colours = [np.array(rgb(colour)) for colour in colours]
        self.end = max(float(max(one.time[-1], one.run.period)) for one in readouts)
        largest = max((float(one.max[-1]) for one in readouts if np.isfinite(one.max[-1])), default=0.0)
        self.top = _HEADROOM * largest if largest > _LEAST else 1.0
        self.above = max(round(1.3 * font.size), head)
        self.bottom = height - round(1.35 * font.size)
        self.error_ticks = ticks_of(self.top, (self.bottom - self.above) / (1.15 * font.size))
        self.left = round(max(font.width(f"{tick:g}") for tick in self.error_ticks) + 0.5 * font.size)
        self.right = width - 1 - round(1.8 * font.size)
        self.time_ticks = ticks_of(self.end, (self.right - self.left) / (4.5 * font.size))
        self._to_come, self._past = self._drawn()

    def column(self, time: float) -> float:
        """Return the column of a time [s], that of the end for later ones."""
        return self.left + min(max(time / self.end, 0.0), 1.0) * (self.right - self.left)

    def row(self, error: float) -> float:
        """Return the row of an error [µm]."""
        return self.bottom - error / self.top * (self.bottom - self.above)

    def picture(self, time: float) -> Picture:
        """Return the strip at a time of the run [s], (height, width, 3)."""
        cursor = round(self.column(time))
        picture = self._to_come.copy()
        picture[:, : cursor + 1] = self._past[:, : cursor + 1]
        thick = max(1, round(self._font.size / 10))
        first = min(max(cursor - thick // 2, self.left), self.right + 1 - thick)
        picture[self.above : self.bottom + 1, first : first + thick] = rgb(INK)
        for readout, colour in zip(self._readouts, self._colours, strict=True):
            error = readout.error[readout.tick(time)]
            if readout.faulted(time):
                ended = round(self.column(readout.time[-1]))
                _spot(picture, ended, self.row(np.nan_to_num(error)), 0.24 * self._font.size, np.array(rgb(_FAULT)))
            elif np.isfinite(error) and not readout.over(time):
                _spot(picture, cursor, self.row(error), 0.24 * self._font.size, colour)
        return picture

    def _drawn(self) -> tuple[Picture, Picture]:
        """What lies right of the cursor, and what left of it."""
        paper = Image.new("RGB", self.size, PAPER)
        draw = ImageDraw.Draw(paper)
        self._write(draw)
        base = np.asarray(paper, float)
        area = base[self.above : self.bottom + 1, self.left : self.right + 1]
        area[:, self._off()] += _OFF * (np.array(rgb(_GREY)) - area[:, self._off()])
        for tick in self.error_ticks:
            line = area[round(self.row(tick)) - self.above]
            line += (1.0 if tick == 0 else _GRID) * (np.array(rgb(_GREY)) - line)
        width = max(1.3, 0.13 * self._font.size)
        return self._with_curves(base, width / 1.3, _FAINT), self._with_curves(base, width, 1.0)

    def _with_curves(self, base: Floats, thick: float, share: float) -> Picture:
        """A picture with the curves on it; where they lie on each other they show by turns, as dashes."""
        picture = base.copy()
        area = picture[self.above : self.bottom + 1, self.left : self.right + 1]
        covered = [self._coverage(readout, thick)[..., None] for readout in self._readouts]
        turn = np.arange(area.shape[1]) // round(0.7 * self._font.size) % len(covered)
        for last in range(len(covered)):
            part = area[:, turn == last]
            for k in range(len(covered)):
                run = (last + 1 + k) % len(covered)
                part += share * covered[run][:, turn == last] * (self._colours[run] - part)
            area[:, turn == last] = part
        return np.round(picture).astype(np.uint8)

    def _coverage(self, readout: Readout, thick: float) -> Floats:
        """Share of every pixel that a curve covers: in each column from its smallest to its largest error there."""
        columns = np.arange(self.left, self.right + 1)
        per_column = self.end / (self.right - self.left)
        edges = (np.append(columns, self.right + 1) - 0.5 - self.left) * per_column
        value = np.interp(edges, readout.time, readout.error, left=np.nan, right=np.nan)
        low, high = np.fmin(value[:-1], value[1:]), np.fmax(value[:-1], value[1:])
        at = np.clip(np.round(readout.time / per_column).astype(int), 0, len(columns) - 1)
        np.fmin.at(low, at, readout.error)
        np.fmax.at(high, at, readout.error)
        rows = np.arange(self.above, self.bottom + 1)[:, None]
        upper, lower = self.row(high) - 0.5 * thick, self.row(low) + 0.5 * thick  # type: ignore[arg-type]
        covered: Floats = np.clip(np.minimum(rows + 0.5, lower) - np.maximum(rows - 0.5, upper), 0.0, 1.0)
        return np.nan_to_num(covered)

    def _off(self) -> NDArray[np.bool_]:
        """Whether no run's dispenser is on at each column of the curves."""
        times = np.linspace(0.0, self.end, self.right + 1 - self.left)
        on = np.zeros(times.size, bool)
        for readout in self._readouts:
            tick = np.round(times / readout.run.period).astype(int)
            there = tick < len(readout.time)
            on[there] |= readout.run.dispense[tick[there]]
        return ~on

    def _write(self, draw: ImageDraw.ImageDraw) -> None:
        """Title, axes' numbers, and what the shade is."""
        font = self._font
        above, side = round(0.08 * font.size), 0.8 * font.size
        shaded = bool(self._off().any())
        for title, shade in _NAMES if shaded else [(title, "") for title, _ in _NAMES]:
            first = self.left + font.width(title) + (font.size + 1.4 * side) * shaded
            start = round(max(first, self.right - font.width(shade)))
            if start + font.width(shade) <= self.size[0] - 0.3 * font.size:
                break
        draw.text((self.left, above), title, rgb(INK), font.face)
        if shaded:
            draw.text((start, above), shade, rgb(MUTED), font.face)
            colour = tuple(round(p + 2 * _OFF * (g - p)) for p, g in zip(rgb(PAPER), rgb(_GREY), strict=True))
            box = (start - 1.4 * side, 0.28 * font.size, start - 0.4 * side, 0.28 * font.size + side)
            draw.rectangle([round(corner) for corner in box], colour)
        for tick in self.error_ticks:
            place = (round(self.left - 0.35 * font.size), round(self.row(tick)))
            draw.text(place, f"{tick:g}", rgb(MUTED), font.face, anchor="rm")
        below = self.bottom + round(0.25 * font.size)
        for tick in self.time_ticks:
            column = round(self.column(tick))
            draw.line((column, self.bottom + 1, column, below - 1), rgb(_GREY))
            draw.text((column, below), f"{tick:g}", rgb(MUTED), font.face, anchor="ma")
        last = self.column(self.time_ticks[-1]) + font.width(f"{self.time_ticks[-1]:g}") / 2
        draw.text((round(last + 0.3 * font.size), below), "s", rgb(MUTED), font.face, anchor="la")


def _spot(picture: Picture, column: int, row: float, radius: float, colour: Floats) -> None:
    """Paint a disc with soft edges."""
    reach = int(np.ceil(radius)) + 1
    rows = np.arange(max(int(row) - reach, 0), min(int(row) + reach + 2, picture.shape[0]))
    columns = np.arange(max(column - reach, 0), min(column + reach + 1, picture.shape[1]))
    away = np.hypot(rows[:, None] - row, columns - column)
    share = np.clip(radius + 0.5 - away, 0.0, 1.0)[..., None]
    patch = picture[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    patch[:] = np.round(patch + share * (colour - patch))
