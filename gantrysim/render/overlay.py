"""What stands below and above the pictures of a film: readout, error strip, scale of the bead's colours."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from gantrysim.errors import InputError
from gantrysim.plots.style import AXIS_COLOURS, COLOURS, INK
from gantrysim.render.colours import Scale
from gantrysim.render.header import error_text, so_far_text
from gantrysim.render.legend import Legend
from gantrysim.render.lettering import MUTED, PAPER, Font, font, rgb
from gantrysim.render.readout import Readout
from gantrysim.render.strip import Strip

Picture = NDArray[np.uint8]

_SHARE = 0.18  # of the frame's height, that a panel of one row has
_LEAST_HEIGHT = 66  # [pixels], for letters of 10
_PANEL_LETTERS = 6.6  # height of a row of the panel in sizes of its letters
_STRIP_LETTERS = 5.6  # likewise of the strip in a row of its own
_LEAST_LETTERS = 9
_LEAST_STRIP = 12.5  # width of the strip in sizes of the letters
_LETTERS_FOR_ROWS = 0.75  # of the largest letters, that a simpler arrangement must do with
_LINE, _MARGIN = 1.25, 0.6  # of the size of the letters
_BESIDE_FAULTS = 4.2  # width of the strip that the words of faults leave free, in sizes of the letters
_MOST_FAULTS = 0.42  # of the panel's height, that the words of faults may take
_WIDEST_READOUT = "contour error8888.8 mm/s"
_RUN_COLOURS = (COLOURS["tracking"], AXIS_COLOURS[1], COLOURS["structure"], AXIS_COLOURS[3])
_RULE = "#d5d9df"


def run_colours(count: int) -> tuple[str, ...]:
    """Return the colours of runs side by side; of one alone, that of the contour error in all plots."""
    return (COLOURS["contour"],) if count == 1 else _RUN_COLOURS[:count]


@dataclass(frozen=True)
class _Arrangement:
    """How readout, strip and legend lie: in one row, or the strip below; the legend's title in one line, or in several.

    Attributes:
        rows: 1 or 2.
        narrow: whether the legend is.
        letters: size [pixels].
    """

    rows: int
    narrow: bool
    letters: int

    def least(self, runs: int, end: float, scale: Scale | None) -> int:
        """The width that it needs [pixels]."""
        letters = font(self.letters)
        legend = 0 if scale is None else Legend(scale, letters, self.narrow).width
        strip = round(_LEAST_STRIP * self.letters)
        block = _block_width(runs, end, letters)
        return block + strip + legend if self.rows == 1 else max(block + legend, strip)


def _block_width(runs: int, end: float, letters: Font) -> int:
    """Width of the readout [pixels]."""
    words = _WIDEST_READOUT if runs == 1 else f"t {end:.2f} s"
    return round(round(_MARGIN * letters.size) + letters.width(words) + 1.8 * letters.size)


def _arranged(frame: tuple[int, int], runs: int, end: float, scale: Scale | None) -> _Arrangement:
    """The arrangement that suits a frame: the simplest whose letters are not much smaller than they could be.

    Raises:
        InputError: too narrow for any.
    """
    largest = int(max(_SHARE * frame[1], _LEAST_HEIGHT) / _PANEL_LETTERS)
    kinds = [(rows, narrow) for rows in ((1, 2) if runs == 1 else (1,)) for narrow in (False, True)[: 1 + bool(scale)]]
    fitting = []
    for rows, narrow in kinds:
        tried = (_Arrangement(rows, narrow, letters) for letters in range(largest, _LEAST_LETTERS - 1, -1))
        fitting += [next((one for one in tried if one.least(runs, end, scale) <= frame[0]), None)]
    found = [one for one in fitting if one is not None]
    if not found:
        least = min(_Arrangement(*kind, _LEAST_LETTERS).least(runs, end, scale) for kind in kinds)
        raise InputError(f"width of the film = {frame[0]}: must be at least {least}, for readout and error strip")
    enough = _LETTERS_FOR_ROWS * max(one.letters for one in found)
    return next(one for one in found if one.letters >= enough)


class Panel:
    """The panel below: readout of one run, or time alone of several; their error strip; scale of the colours.

    In a frame that is narrow for its height the strip stands below the readout. What stays from picture to picture is
    drawn once.

    Args:
        readouts: of the runs.
        frame: width and height of the film [pixels].
        title: of the one run.
        scale: of the beads' colours, None where they are plain.

    Attributes:
        size: width and height [pixels].
        font: of its letters.
        strip: the error strip.
        strip_left, strip_above: where it stands in the panel [pixels].
        legend_left: where the legend begins; it ends at the right edge, and at the strip where that is below [pixels].

    Raises:
        InputError: too narrow for readout and strip.
    """

    def __init__(
        self, readouts: Sequence[Readout], frame: tuple[int, int], title: str = "", scale: Scale | None = None
    ) -> None:
        end = max(float(readout.time[-1]) for readout in readouts)
        chosen = _arranged(frame, len(readouts), end, scale)
        width, self.font = frame[0], font(chosen.letters)
        row = max(round(_SHARE * frame[1]), _LEAST_HEIGHT)
        if int(row / _PANEL_LETTERS) > chosen.letters:
            row = round(_PANEL_LETTERS * chosen.letters)
        self._readouts, self._title = tuple(readouts), title
        self._margin = round(_MARGIN * self.font.size)
        block = _block_width(len(readouts), end, self.font)
        self._right = block - round(0.8 * self.font.size)
        legend = np.empty((row, 0, 3), np.uint8)
        if scale is not None:
            legend = Legend(scale, self.font, chosen.narrow).picture(row)
        self.legend_left = width - legend.shape[1]
        if chosen.rows == 1:
            self.size = width, row
            self.strip_left, self.strip_above = block, 1
            room = self.legend_left - block, row - 1
        else:
            self.size = width, row + round(_STRIP_LETTERS * self.font.size)
            self.strip_left, self.strip_above = self._margin, row
            room = width - self._margin, self.size[1] - row
        self._faults = self._worded(room)
        head = max((place + round(_LINE * letters) for _, _, place, letters in self._faults), default=0)
        self.strip = Strip(readouts, run_colours(len(readouts)), room, self.font, head)
        self._block = Image.new("RGB", (block, row), PAPER)
        self._label()
        self._base = np.empty((self.size[1], width, 3), np.uint8)
        self._base[:] = rgb(PAPER)
        self._base[:row, self.legend_left :] = legend
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
        block = self._read(time, speed)
        picture[: block.shape[0], : block.shape[1]] = block
        picture[0] = rgb(_RULE)
        strip = self._faulted(time, self.strip.picture(time))
        picture[self.strip_above :, self.strip_left : self.strip_left + strip.shape[1]] = strip
        return picture

    def _label(self) -> None:
        """Write all of the readout but its numbers."""
        draw = ImageDraw.Draw(self._block)
        names = ("", "t", "path speed", "contour error", "rms / max") if len(self._readouts) == 1 else ("t",)
        for row, name in enumerate(names):
            draw.text((self._margin, self._row(row)), name, rgb(MUTED), self.font.face, anchor="lm")
        if len(self._readouts) == 1:
            bold = font(self.font.size, True)
            room = self._right - self._margin - self.font.width(" ×8.88")
            draw.text((self._margin, self._row(0)), bold.shortened(self._title, room), rgb(INK), bold.face, anchor="lm")

    def _read(self, time: float, speed: float | None) -> Picture:
        block = self._block.copy()
        draw = ImageDraw.Draw(block)
        playing, now = "" if speed is None else f"×{speed:g}", f"{time:.2f} s"
        lines = [now, playing]
        if len(self._readouts) == 1:
            readout = self._readouts[0]
            tick = readout.tick(time)
            lines = [
                playing,
                now,
                f"{readout.speed[tick]:.1f} mm/s",
                error_text(readout, tick),
                so_far_text(readout, tick),
            ]
        for row, text in enumerate(lines):
            draw.text((self._right, self._row(row)), text, rgb(INK), self.font.face, anchor="rm")
        return np.asarray(block)

    def _row(self, row: int) -> int:
        """Middle of a line of the readout."""
        return round((row + 0.5) * (self._block.height - 0.6 * self.font.size) / 5 + 0.3 * self.font.size)

    def _worded(self, room: tuple[int, int]) -> list[tuple[Readout, str, int, int]]:
        """The faults in lines, with the run of each, its row and the size of its letters; cut where there are many."""
        head = "fault: " if len(self._readouts) == 1 else "■ fault: "
        broken = [one for one in self._readouts if one.run.fault is not None]
        width, high = room[0] - _BESIDE_FAULTS * self.font.size, _MOST_FAULTS * room[1]
        for size in range(self.font.size, 0, -1):
            each = max(1, int(high / (_LINE * size)) // max(len(broken), 1))
            told = [font(size).wrapped(f"{head}{one.run.fault}", width) for one in broken]
            if size <= _LEAST_LETTERS:
                told = [
                    [*lines[: each - 1], font(size).shortened(" ".join(lines[each - 1 :]), width)] for lines in told
                ]
            lines = [(one, line) for one, part in zip(broken, told, strict=True) for line in part if line]
            if len(lines) * _LINE * size <= high:
                break
        return [(one, line, round(row * _LINE * size), size) for row, (one, line) in enumerate(lines)]

    def _faulted(self, time: float, strip: Picture) -> Picture:
        """The strip with the faults that have ended runs until now, in words."""
        there = [fault for fault in self._faults if fault[0].faulted(time)]
        if not there:
            return strip
        image = Image.fromarray(strip)
        draw = ImageDraw.Draw(image)
        left = self.strip.left
        draw.rectangle((left, 0, self.strip.size[0], self.strip.above - 1), rgb(PAPER))
        colours = run_colours(len(self._readouts))
        for one, line, row, size in there:
            draw.text((left, row), line, rgb(COLOURS["fault"]), font(size).face)
            if line.startswith("■"):
                draw.text((left, row), "■", rgb(colours[self._readouts.index(one)]), font(size).face)
        return np.asarray(image)
