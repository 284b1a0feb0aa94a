"""The panel below the pictures of a film: readout, error strip and colour scale."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from PIL import Image, ImageDraw

from gantrysim.base.errors import InputError
from gantrysim.render.colours import Scale
from gantrysim.render.encoding import Picture
from gantrysim.render.fonts import LINE, MUTED, PAPER, Font, font, rgb
from gantrysim.render.strip import Strip
from gantrysim.render.telemetry import Telemetry
from gantrysim.report.plots.style import COLOURS
from gantrysim.results.colours import INK, RUNS

# Drawings of a bead's colour scale: upright beside the pictures of a film, level in the viewer.

# of the upright scale, in sizes of the letters
_BAR = 0.9
_GAP = 0.5

BAR_HEIGHT = 34  # of the level bar with its text [pixels]
# heights of its parts [pixels]
_BAR_COLOURS = 12
_BAR_MARGIN = 6
_BAR_LETTERS = 12
_BAR_PAPER = "#14171c"
_BAR_INK = "#ebebeb"


class Legend:
    """An upright colour scale with three numbers beside it and its title above.

    Args:
        scale: the colour scale.
        font: of its text.
        narrow: whether the title is short and may be wrapped.

    Attributes:
        width: [pixels].
    """

    def __init__(self, scale: Scale, font: Font, narrow: bool = False) -> None:
        self._scale = scale
        self._font = font
        numbers = (_BAR + _GAP) * font.size + max(map(font.width, scale.labels()))
        unit = f" [{scale.unit}]" if scale.unit else ""
        self._title = [f"{scale.title}{unit}"]
        if narrow:
            self._title = font.wrapped(f"{scale.short_title}{unit}", numbers)
        self.width = round(max(numbers, *map(font.width, self._title))) + 2 * font.margin

    def picture(self, height: int) -> Picture:
        """Return the legend in a height [pixels], (height, width, 3)."""
        font = self._font
        bar = round(_BAR * font.size)
        image = Image.new("RGB", (self.width, height), PAPER)
        draw = ImageDraw.Draw(image)
        for number, line in enumerate(self._title):
            font.write(draw, (font.margin, 1 + round((0.08 + LINE * number) * font.size)), line, INK)
        first = 1 + round((LINE * len(self._title) + 0.5) * font.size)
        last = height - 1 - round(0.75 * font.size)
        column = round(font.margin + bar + _GAP * font.size)
        for text, place in zip(self._scale.labels(), self._scale.label_places, strict=True):
            row = round(last + place * (first - last))
            font.write(draw, (column, row), text, INK, "lm")
        picture = np.array(image)
        colours = self._scale.table[np.round(np.linspace(255, 0, last + 1 - first)).astype(int)]
        picture[first : last + 1, font.margin : font.margin + bar] = colours[:, None]
        return picture


@lru_cache(maxsize=2)
def colour_bar(scale: Scale, width: int) -> Picture:
    """Return a level colour scale with its ends and its title above, (BAR_HEIGHT, width, 3)."""
    image = Image.new("RGB", (width, BAR_HEIGHT), _BAR_PAPER)
    draw = ImageDraw.Draw(image)
    letters = font(_BAR_LETTERS)
    low, _, high = scale.labels()
    middle = (BAR_HEIGHT - _BAR_COLOURS) // 2
    room = width - 4 * _BAR_MARGIN - 2 * max(letters.width(low), letters.width(high))
    title = letters.shortened(f"bead: {scale.short_title} [{scale.unit}]".removesuffix(" []"), room)
    for text, x, anchor in ((low, _BAR_MARGIN, "lm"), (title, width / 2, "mm"), (high, width - _BAR_MARGIN, "rm")):
        letters.write(draw, (x, middle), text, _BAR_INK, anchor)
    picture = np.array(image)
    picture[-_BAR_COLOURS:] = scale.table[np.arange(width) * len(scale.table) // width]
    return picture


_ROW_HEIGHT = 0.18  # height of a panel of one row, relative to the frame's
_LEAST_HEIGHT = 66  # [pixels], for letters of 10
# heights of a row of the panel, and of one with only the strip, in sizes of the letters
_ROW = 6.6
_STRIP_ROW = 5.6
_LEAST_LETTERS = 9
_LEAST_STRIP = 12.5  # width of the strip in sizes of the letters
_ENOUGH_LETTERS = 0.75  # size of the letters at which a simpler layout is taken, relative to the largest of any layout
_BESIDE_FAULTS = 4.2  # width of the strip that fault messages leave free, in sizes of the letters
_MOST_FAULTS = 0.42  # height of fault messages, relative to the strip's
_WIDEST_READOUT = "contour error8888.8 mm/s"
_RULE = "#d5d9df"


def run_colours(count: int) -> tuple[str, ...]:
    """Return the colours of runs side by side; a single one has the contour error's colour in all plots."""
    if count == 1:
        return (COLOURS["contour"],)
    return RUNS[:count]


def _readout_width(runs: int, end: float, letters: Font) -> int:
    """Return the width of the readout [pixels]."""
    widest = _WIDEST_READOUT if runs == 1 else f"t {end:.2f} s"
    return round(letters.margin + letters.width(widest) + 1.8 * letters.size)


def _layout(frame: tuple[int, int], runs: int, end: float, scale: Scale | None) -> tuple[int, bool, int]:
    """Return the simplest layout whose letters are not much smaller than in others.

    It is the number of rows, 2 with the strip below the readout; whether the legend has a short title in several lines;
    and the size of the letters [pixels].

    Raises:
        InputError: the frame is too narrow for any layout.
    """

    def least_width(rows: int, narrow: bool, size: int) -> int:
        legend = 0 if scale is None else Legend(scale, font(size), narrow).width
        strip = round(_LEAST_STRIP * size)
        readout = _readout_width(runs, end, font(size))
        if rows == 1:
            return readout + strip + legend
        return max(readout + legend, strip)

    largest = int(max(_ROW_HEIGHT * frame[1], _LEAST_HEIGHT) / _ROW)
    # from the simplest; the readout of several runs is short, their time alone: the strip has room beside it
    row_counts = (1, 2) if runs == 1 else (1,)
    narrow_choices = (False, True) if scale else (False,)
    kinds = [(rows, narrow) for rows in row_counts for narrow in narrow_choices]
    fitting = []
    for rows, narrow in kinds:
        for size in range(largest, _LEAST_LETTERS - 1, -1):
            if least_width(rows, narrow, size) <= frame[0]:
                fitting.append((rows, narrow, size))
                break
    if not fitting:
        least = min(least_width(rows, narrow, _LEAST_LETTERS) for rows, narrow in kinds)
        raise InputError(f"width of the film = {frame[0]}: must be at least {least}, for readout and error strip")
    enough = _ENOUGH_LETTERS * max(size for _, _, size in fitting)
    return next(layout for layout in fitting if layout[2] >= enough)


class Panel:
    """Readout of one run, or the time of several; their error strip; the colour scale of the beads.

    In a frame that is narrow for its height the strip stands below the readout. Constant parts are drawn once.

    Args:
        runs: telemetry of the runs.
        frame: width and height of the film [pixels].
        title: of a single run.
        scale: of the beads' colours, None for plain beads.

    Attributes:
        size: width and height [pixels].
        font: of its text.
        strip: the error strip.
        strip_left, strip_above: first column and row of the strip [pixels].
        legend_left: first column of the legend, which ends at the right edge [pixels].

    Raises:
        InputError: the frame is too narrow for readout and strip.
    """

    def __init__(
        self, runs: Sequence[Telemetry], frame: tuple[int, int], title: str = "", scale: Scale | None = None
    ) -> None:
        self._runs = tuple(runs)
        self._title = title
        end = max(float(run.time[-1]) for run in runs)
        rows, narrow, letters = _layout(frame, len(runs), end, scale)
        width = frame[0]
        self.font = font(letters)
        row = max(round(_ROW_HEIGHT * frame[1]), _LEAST_HEIGHT)
        if int(row / _ROW) > letters:
            row = round(_ROW * letters)
        readout = _readout_width(len(runs), end, self.font)
        self._right = readout - round(0.8 * self.font.size)
        legend = np.empty((row, 0, 3), np.uint8)
        if scale is not None:
            legend = Legend(scale, self.font, narrow).picture(row)
        self.legend_left = width - legend.shape[1]
        if rows == 1:
            self.size = width, row
            self.strip_left = readout
            self.strip_above = 1
            room = self.legend_left - readout, row - 1
        else:
            self.size = width, row + round(_STRIP_ROW * self.font.size)
            self.strip_left = self.font.margin
            self.strip_above = row
            room = width - self.font.margin, self.size[1] - row
        self._faults = self._fault_lines(room)
        head = max((place + round(LINE * size) for _, _, place, size in self._faults), default=0)
        self.strip = Strip(runs, run_colours(len(runs)), room, self.font, head)
        self._labels = Image.new("RGB", (readout, row), PAPER)
        self._draw_labels()
        self._base = np.empty((self.size[1], width, 3), np.uint8)
        self._base[:] = rgb(PAPER)
        self._base[:row, self.legend_left :] = legend

    def picture(self, time: float, speed: float | None = None) -> Picture:
        """Return the panel at a time of the run, (height, width, 3).

        Args:
            time: of the run [s].
            speed: seconds of the run in a second of the film, None for a single picture.
        """
        picture = self._base.copy()
        readout = self._readout(time, speed)
        picture[: readout.shape[0], : readout.shape[1]] = readout
        picture[-1] = rgb(_RULE)
        strip = self._with_faults(time, self.strip.picture(time))
        picture[self.strip_above :, self.strip_left : self.strip_left + strip.shape[1]] = strip
        return picture

    def _draw_labels(self) -> None:
        """Draw the constant part of the readout."""
        draw = ImageDraw.Draw(self._labels)
        names = ("", "t", "path speed", "contour error", "rms / max") if len(self._runs) == 1 else ("t",)
        for row, name in enumerate(names):
            self.font.write(draw, (self.font.margin, self._row(row)), name, MUTED, "lm")
        if len(self._runs) == 1:
            bold = font(self.font.size, True)
            title = bold.shortened(self._title, self._right - self.font.margin - self.font.width(" ×8.88"))
            bold.write(draw, (self.font.margin, self._row(0)), title, INK, "lm")

    def _readout(self, time: float, speed: float | None) -> Picture:
        image = self._labels.copy()
        draw = ImageDraw.Draw(image)
        playback = "" if speed is None else f"×{speed:g}"
        run_time = f"{time:.2f} s"
        lines = [run_time, playback]
        if len(self._runs) == 1:
            run = self._runs[0]
            tick = run.tick(time)
            lines = [playback, run_time, f"{run.speed(tick):.1f} mm/s", run.error_text(tick), run.rms_max_text(tick)]
        for row, text in enumerate(lines):
            self.font.write(draw, (self._right, self._row(row)), text, INK, "rm")
        return np.asarray(image)

    def _row(self, line: int) -> int:
        """Return the middle of a line of the readout."""
        return round((line + 0.5) * (self._labels.height - 0.6 * self.font.size) / 5 + 0.3 * self.font.size)

    def _fault_lines(self, room: tuple[int, int]) -> list[tuple[Telemetry, str, int, int]]:
        """Return the lines of fault messages, each with its run, its row and the size of its letters.

        The letters shrink until the messages fit; at the least legible size these are cut.
        """
        head = "fault: " if len(self._runs) == 1 else "■ fault: "
        faulted = [run for run in self._runs if run.run.fault is not None]
        width = room[0] - _BESIDE_FAULTS * self.font.size
        height = _MOST_FAULTS * room[1]
        for size in range(self.font.size, 0, -1):
            letters = font(size)
            lines_per_run = max(1, int(height / (LINE * size)) // max(len(faulted), 1))
            lines = []
            for run in faulted:
                message = letters.wrapped(f"{head}{run.run.fault}", width)
                if size <= _LEAST_LETTERS:
                    last = letters.shortened(" ".join(message[lines_per_run - 1 :]), width)
                    message = [*message[: lines_per_run - 1], last]
                lines += [(run, line) for line in message if line]
            if len(lines) * LINE * size <= height:
                break
        return [(run, line, round(row * LINE * size), size) for row, (run, line) in enumerate(lines)]

    def _with_faults(self, time: float, strip: Picture) -> Picture:
        """Return the strip headed by the messages of faults that have ended runs by a time."""
        faults = [fault for fault in self._faults if fault[0].has_faulted(time)]
        if not faults:
            return strip
        image = Image.fromarray(strip)
        draw = ImageDraw.Draw(image)
        column = self.strip.left
        draw.rectangle((column, 0, self.strip.size[0], self.strip.above - 1), rgb(PAPER))
        colours = run_colours(len(self._runs))
        for run, line, row, size in faults:
            font(size).write(draw, (column, row), line, COLOURS["fault"])
            if line.startswith("■"):
                font(size).write(draw, (column, row), "■", colours[self._runs.index(run)])
        return np.asarray(image)
