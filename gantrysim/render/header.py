"""Headers above the pictures of runs side by side: label and readout of each; the line of a verdict."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from PIL import Image, ImageDraw

from gantrysim.plots.style import COLOURS, INK
from gantrysim.render.encoding import Picture
from gantrysim.render.fonts import LINE, MUTED, PAPER, font
from gantrysim.render.telemetry import Telemetry

_HEIGHT = 2.9  # of a header with one line of readout, in sizes of its letters
_WIDTHS = {1: 34, 2: 22}  # by lines of readout, that hold all of it, in sizes of the letters
_VERDICT_HEIGHT = 1.8  # of its line, in sizes of its letters
_LEAST = 10  # size of the letters, unless the panel's are smaller [pixels]


class Header:
    """Label of a run in the colour of its curve, and its readout.

    Args:
        run, label, colour: of the run.
        width: of the header [pixels].
        largest: size of the letters [pixels].
        lines: of the readout, 1 or 2.

    Attributes:
        size: width and height [pixels].
        font: of the readout.
        room: width available for the label [pixels].
    """

    def __init__(self, run: Telemetry, label: str, colour: str, width: int, largest: int, lines: int = 1) -> None:
        self.font = font(max(min(largest, int(width / _WIDTHS[lines])), min(largest, _LEAST)))
        self.size = width, round((_HEIGHT + LINE * (lines - 1)) * self.font.size)
        self.room = width - 2 * self.font.margin
        self._run = run
        first, *self._rows = (round((0.78 + 1.34 * k) * self.font.size) for k in range(lines + 1))
        self._base = Image.new("RGB", self.size, PAPER)
        bold = font(self.font.size, True)
        text = bold.shortened(label, self.room)
        bold.write(ImageDraw.Draw(self._base), (self.font.margin, first), text, colour, "lm")

    def picture(self, time: float) -> Picture:
        """Return the header at a time of the run [s], (height, width, 3).

        Values that do not fit are left out. After the end of the run its state comes first, without momentary values.
        """
        run = self._run
        tick = run.tick(time)
        end = f"at {run.time[-1]:.2f} s"
        error = ("error", MUTED, run.error_text(tick), "8888.8 µm")
        rms_max = ("rms / max", MUTED, run.rms_max_text(tick), "8888 / 8888 µm")
        speed = ("speed", MUTED, f"{run.speed(tick):.1f} mm/s", "888.8 mm/s")
        if run.faulted(time):
            values = [(f"fault {end}", COLOURS["fault"], "", ""), rms_max, error]
        elif run.ended(time):
            values = [(f"ended {end}", MUTED, "", ""), rms_max]
        else:
            # in two lines the longest value has the second to itself
            values = [error, rms_max, speed] if len(self._rows) == 1 else [error, speed, rms_max]
        image = self._base.copy()
        letters = self.font
        draw = ImageDraw.Draw(image)
        column = float(letters.margin)
        rows = self._rows
        for name, colour, text, widest in values:
            width = letters.width(f"{name} {widest}".rstrip())
            if column + width > self.size[0]:
                column = float(letters.margin)
                rows = rows[1:]
            if not rows or column + width > self.size[0]:
                break
            letters.write(draw, (round(column), rows[0]), name, colour, "lm")
            letters.write(draw, (round(column + letters.width(f"{name} ")), rows[0]), text, INK, "lm")
            column += width + letters.size
        return np.asarray(image)


def headers(
    runs: Sequence[Telemetry], labels: Sequence[str], colours: Sequence[str], width: int, largest: int, lines: int = 1
) -> list[Header]:
    """Return the headers of runs side by side, with labels shortened so that they stay different."""
    first = Header(runs[0], labels[0], colours[0], width, largest, lines)
    labels = font(first.font.size, True).distinct(labels, first.room)
    return [
        Header(run, label, colour, width, largest, lines)
        for run, label, colour in zip(runs, labels, colours, strict=True)
    ]


def verdict_line(verdict: str, width: int, largest: int) -> Picture:
    """Return a line with a verdict, for the upper left corner of a picture, (height, width, 3).

    Args:
        verdict: headline of the verdict; its symbol and word say it without colour.
        width: available [pixels]; a longer line is cut.
        largest: size of the letters [pixels].
    """
    letters = font(largest, True)
    text = letters.shortened(verdict, width - 2 * letters.margin)
    size = min(width, round(letters.width(text)) + 2 * letters.margin), round(_VERDICT_HEIGHT * letters.size)
    image = Image.new("RGB", size, PAPER)
    letters.write(ImageDraw.Draw(image), (letters.margin, size[1] / 2), text, INK, "lm")
    return np.asarray(image)
