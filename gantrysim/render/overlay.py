"""What stands below and above the pictures of a film: readout, error strip, scale of the bead's colours."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from gantrysim.errors import InputError
from gantrysim.plots.style import AXIS_COLOURS, COLOURS, INK
from gantrysim.render.colours import Scale
from gantrysim.render.lettering import MUTED, PAPER, font, rgb
from gantrysim.render.readout import Readout
from gantrysim.render.strip import Strip

__all__ = ["Header", "Panel", "panel_height", "run_colours"]

Picture = NDArray[np.uint8]

_SHARE = 0.18  # of the frame's height, that the panel has
_LEAST_HEIGHT = 66  # [pixels], for letters of 10
_PANEL_LETTERS = 6.6  # height of the panel in sizes of its letters
_HEADER_LETTERS = 2.9  # likewise of a header
_HEADER_WIDTH = 34  # of a header, in sizes of letters with which all fits
_LEAST_LETTERS = 10
_LEAST_STRIP = 12.0  # width of the strip in sizes of the letters
_LINE = 1.25  # of the size of the letters
_MOST_FAULTS = 0.42  # of the panel's height, that the words of faults may take
_WIDEST_READOUT = "contour error8888.8 mm/s"
_RUN_COLOURS = (COLOURS["tracking"], AXIS_COLOURS[1], COLOURS["structure"], AXIS_COLOURS[3])
_RULE = "#d5d9df"


def panel_height(height: int) -> int:
    """Return the height of the panel in a frame [pixels]."""
    return max(round(_SHARE * height), _LEAST_HEIGHT)


def run_colours(count: int) -> tuple[str, ...]:
    """Return the colours of runs side by side; of one alone, that of the contour error in all plots."""
    return (COLOURS["contour"],) if count == 1 else _RUN_COLOURS[:count]


class Panel:
    """The panel below: readout of one run, or time alone of several; their error strip; scale of the colours.

    What stays from picture to picture is drawn once.

    Args:
        readouts: of the runs.
        size: width and height of the panel [pixels].
        title: of the one run.
        scale: of the beads' colours, None where they are plain.

    Attributes:
        size: width and height [pixels].
        font: of its letters.
        strip: the error strip.
        strip_left, strip_above: where it stands in the panel [pixels].

    Raises:
        InputError: too narrow for readout and strip.
    """

    def __init__(
        self, readouts: Sequence[Readout], size: tuple[int, int], title: str = "", scale: Scale | None = None
    ) -> None:
        self.size = width, height = size
        self.font = font(int(height / _PANEL_LETTERS))
        self._readouts = tuple(readouts)
        self._margin = round(0.6 * self.font.size)
        words = _WIDEST_READOUT if len(readouts) == 1 else "t 888.88 s"
        self._right = round(self._margin + self.font.width(words) + self.font.size)
        legend = self._legend(scale, height)
        self.strip_left, self.strip_above = round(self._right + 0.8 * self.font.size), 1
        room = width - self.strip_left - legend.shape[1], height - 1
        least = round(_LEAST_STRIP * self.font.size)
        if room[0] < least:
            raise InputError(
                f"width of the film = {width}: must be at least {width - room[0] + least}, for readout and error strip"
            )
        self._faults = self._worded(room)
        head = max((place + round(_LINE * letters) for _, _, place, letters in self._faults), default=0)
        self.strip = Strip(readouts, run_colours(len(readouts)), room, self.font, head)
        self._title = title
        self._block = self._labelled((self.strip_left, height))
        self._base = np.empty((height, width, 3), np.uint8)
        self._base[:] = rgb(PAPER)
        self._base[:, width - legend.shape[1] :] = legend
        self._base[0] = rgb(_RULE)

    def picture(self, time: float, speed: float | None = None) -> Picture:
        """Return the panel at a time of the run.

        Args:
            time: of the run [s].
            speed: seconds of the run in a second of the film, None in a picture that stands still.

        Returns:
            (height, width, 3).
        """
        picture = self._base.copy()
        picture[:, : self.strip_left] = self._read(time, speed)
        picture[0] = rgb(_RULE)
        strip = self._faulted(time, self.strip.picture(time))
        picture[self.strip_above :, self.strip_left : self.strip_left + strip.shape[1]] = strip
        return picture

    def _labelled(self, size: tuple[int, int]) -> Image.Image:
        """The block of the readout without its numbers."""
        block = Image.new("RGB", size, PAPER)
        draw = ImageDraw.Draw(block)
        names = ("", "t", "path speed", "contour error", "rms / max") if len(self._readouts) == 1 else ("t",)
        for row, name in enumerate(names):
            draw.text((self._margin, self._row(row)), name, rgb(MUTED), self.font.face, anchor="lm")
        if len(self._readouts) == 1:
            bold = font(self.font.size, True)
            room = self._right - self._margin - self.font.width(" ×8.88")
            draw.text((self._margin, self._row(0)), bold.shortened(self._title, room), rgb(INK), bold.face, anchor="lm")
        return block

    def _read(self, time: float, speed: float | None) -> Picture:
        block = self._block.copy()
        draw = ImageDraw.Draw(block)
        playing, now = "" if speed is None else f"×{speed:g}", f"{time:.2f} s"
        lines = [now, playing]
        if len(self._readouts) == 1:
            readout = self._readouts[0]
            tick = readout.tick(time)
            lines = [playing, now, f"{readout.speed[tick]:.1f} mm/s", _error(readout, tick), _so_far(readout, tick)]
        for row, text in enumerate(lines):
            draw.text((self._right, self._row(row)), text, rgb(INK), self.font.face, anchor="rm")
        return np.asarray(block)

    def _row(self, row: int) -> int:
        """Middle of a line of the readout."""
        return round((row + 0.5) * (self.size[1] - 0.6 * self.font.size) / 5 + 0.3 * self.font.size)

    def _worded(self, room: tuple[int, int]) -> list[tuple[Readout, str, int, int]]:
        """The faults in lines, with the run of each, its row and the size of its letters."""
        head = "fault: " if len(self._readouts) == 1 else "■ fault: "
        broken = [one for one in self._readouts if one.run.fault is not None]
        for size in range(self.font.size, 0, -1):
            lines = [
                (one, line)
                for one in broken
                for line in font(size).wrapped(f"{head}{one.run.fault}", room[0] - 5.5 * self.font.size)
            ]
            if len(lines) * _LINE * size <= _MOST_FAULTS * room[1]:
                break
        return [(one, line, round(row * _LINE * size), size) for row, (one, line) in enumerate(lines)]

    def _faulted(self, time: float, strip: Picture) -> Picture:
        """The strip with the faults that have ended runs until now, in words."""
        there = [fault for fault in self._faults if fault[0].faulted(time)]
        if not there:
            return strip
        image = Image.fromarray(strip)
        draw = ImageDraw.Draw(image)
        left, right = self.strip.left, self.strip.right
        draw.rectangle((left, 0, right, self.strip.above - 1), rgb(PAPER))
        colours = run_colours(len(self._readouts))
        for one, line, row, size in there:
            draw.text((left, row), line, rgb(COLOURS["fault"]), font(size).face)
            if line.startswith("■"):
                draw.text((left, row), "■", rgb(colours[self._readouts.index(one)]), font(size).face)
        return np.asarray(image)

    def _legend(self, scale: Scale | None, height: int) -> Picture:
        """The scale of the beads' colours, upright, with its numbers."""
        letters = self.font
        if scale is None:
            return np.full((height, 0, 3), 255, np.uint8)
        texts = scale.labels()
        title = f"{scale.title} [{scale.unit}]"
        bar = round(0.9 * letters.size)
        width = round(max(letters.width(title), bar + 0.5 * letters.size + max(map(letters.width, texts))))
        image = Image.new("RGB", (width + 2 * self._margin, height), PAPER)
        draw = ImageDraw.Draw(image)
        draw.text((self._margin, 1 + round(0.08 * letters.size)), title, rgb(INK), letters.face)
        first, last = 1 + round(1.75 * letters.size), height - 1 - round(0.75 * letters.size)
        table = scale.table[np.round(np.linspace(255, 0, last + 1 - first)).astype(int)]
        for text, row in zip(texts, (last, 0.5 * (first + last), first), strict=True):
            place = (round(self._margin + bar + 0.5 * letters.size), round(row))
            draw.text(place, text, rgb(INK), letters.face, anchor="lm")
        picture = np.array(image)
        picture[first : last + 1, self._margin : self._margin + bar] = table[:, None]
        return picture


class Header:
    """What stands above the picture of one of several runs: its label in its colour, and its readout.

    Args:
        readout: of the run.
        label: of the run.
        colour: of its curve.
        width: of the header [pixels].
        letters: size of those of the panel, the largest that these can have [pixels].

    Attributes:
        size: width and height [pixels].
    """

    def __init__(self, readout: Readout, label: str, colour: str, width: int, letters: int) -> None:
        self._font = font(max(min(letters, int(width / _HEADER_WIDTH)), _LEAST_LETTERS))
        self.size = width, height = width, round(_HEADER_LETTERS * self._font.size)
        self._readout = readout
        self._margin = round(0.6 * self._font.size)
        bold = font(self._font.size, True)
        self._base = Image.new("RGB", self.size, PAPER)
        draw = ImageDraw.Draw(self._base)
        end = self._font.width("over at 888.88 s") + self._font.size
        text = bold.shortened(label, width - 2 * self._margin - end)
        height = self.size[1]
        draw.text((self._margin, round(0.27 * height)), text, rgb(colour), bold.face, anchor="lm")

    def picture(self, time: float) -> Picture:
        """Return the header at a time of the run [s], (height, width, 3)."""
        image = self._base.copy()
        draw = ImageDraw.Draw(image)
        readout, letters = self._readout, self._font
        width, height = self.size
        tick = readout.tick(time)
        if readout.over(time) or readout.faulted(time):
            word, colour = ("fault", COLOURS["fault"]) if readout.faulted(time) else ("over", MUTED)
            text = f"{word} at {readout.time[-1]:.2f} s"
            draw.text((width - self._margin, round(0.27 * height)), text, rgb(colour), letters.face, anchor="rm")
        column, row = float(self._margin), round(0.73 * height)
        for name, text, widest in (
            ("error", _error(readout, tick), "8888.8 µm"),
            ("rms / max", _so_far(readout, tick), "8888 / 8888 µm"),
            ("speed", f"{readout.speed[tick]:.1f} mm/s", "888.8 mm/s"),
        ):
            if column + letters.width(f"{name} {widest}") > width:
                break
            draw.text((round(column), row), name, rgb(MUTED), letters.face, anchor="lm")
            draw.text((round(column + letters.width(f"{name} ")), row), text, rgb(INK), letters.face, anchor="lm")
            column += letters.width(f"{name} {widest}") + letters.size
        return np.asarray(image)


def _error(readout: Readout, tick: int) -> str:
    error = readout.error[tick]
    return f"{error:.1f} µm" if np.isfinite(error) else "off"


def _so_far(readout: Readout, tick: int) -> str:
    if not np.isfinite(readout.max[tick]):
        return "–"
    digits = 1 if readout.max[-1] < 100 else 0
    return f"{readout.rms[tick]:.{digits}f} / {readout.max[tick]:.{digits}f} µm"
