"""What stands above the pictures of runs side by side: label and readout of each."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from gantrysim.plots.style import COLOURS, INK
from gantrysim.render.lettering import MUTED, PAPER, font, rgb
from gantrysim.render.readout import Readout

Picture = NDArray[np.uint8]

_LETTERS = 2.9  # height of a header with one line of readout in sizes of its letters
_LINE, _MARGIN = 1.25, 0.6  # of the size of the letters
_WIDTHS = {1: 34, 2: 22}  # of a header with so many lines of readout, in sizes of letters with which all fits
_LEAST = 10  # size of the letters, where those of the panel are no smaller [pixels]


class Header:
    """What stands above the picture of one of several runs: its label in its colour, and its readout.

    Args:
        readout: of the run.
        label: of the run.
        colour: of its curve.
        width: of the header [pixels].
        letters: size of those of the panel, the largest that these can have [pixels].
        lines: of the readout, 1 or 2.

    Attributes:
        size: width and height [pixels].
        font: of its letters.
        room: for the label [pixels].
    """

    def __init__(self, readout: Readout, label: str, colour: str, width: int, letters: int, lines: int = 1) -> None:
        least = min(letters, _LEAST)
        self.font = font(max(min(letters, int(width / _WIDTHS[lines])), least))
        self.size = width, round((_LETTERS + _LINE * (lines - 1)) * self.font.size)
        self._readout, self._colour = readout, colour
        self._margin = round(_MARGIN * self.font.size)
        self.room = width - 2 * self._margin
        self._rows = [round((0.78 + 1.34 * k) * self.font.size) for k in range(lines + 1)]
        self.call(label)

    def call(self, label: str) -> None:
        """Write the label, cut to the room for it."""
        bold = font(self.font.size, True)
        self._base = Image.new("RGB", self.size, PAPER)
        place = (self._margin, self._rows[0])
        text = bold.shortened(label, self.room)
        ImageDraw.Draw(self._base).text(place, text, rgb(self._colour), bold.face, anchor="lm")

    def picture(self, time: float) -> Picture:
        """Return the header at a time of the run [s], (height, width, 3).

        As far as there is room; when the run is over, that stands in front, and what was of the moment is left out.
        """
        image = self._base.copy()
        draw = ImageDraw.Draw(image)
        readout, letters = self._readout, self.font
        tick, last = readout.tick(time), f"at {readout.time[-1]:.2f} s"
        error = ("error", MUTED, error_text(readout, tick), "8888.8 µm")
        so_far = ("rms / max", MUTED, so_far_text(readout, tick), "8888 / 8888 µm")
        speed = ("speed", MUTED, f"{readout.speed[tick]:.1f} mm/s", "888.8 mm/s")
        said = [error, so_far, speed] if len(self._rows) == 2 else [error, speed, so_far]
        if readout.faulted(time):
            said = [(f"fault {last}", COLOURS["fault"], "", ""), so_far, error]
        elif readout.over(time):
            said = [(f"over {last}", MUTED, "", ""), so_far]
        column, rows = float(self._margin), self._rows[1:]
        for name, colour, text, widest in said:
            wide = letters.width(f"{name} {widest}".rstrip())
            if column + wide > self.size[0]:
                column, rows = float(self._margin), rows[1:]
            if not rows or column + wide > self.size[0]:
                break
            draw.text((round(column), rows[0]), name, rgb(colour), letters.face, anchor="lm")
            draw.text((round(column + letters.width(f"{name} ")), rows[0]), text, rgb(INK), letters.face, anchor="lm")
            column += wide + letters.size
        return np.asarray(image)


def headers(
    readouts: Sequence[Readout],
    labels: Sequence[str],
    colours: Sequence[str],
    width: int,
    letters: int,
    lines: int = 1,
) -> list[Header]:
    """Return the headers of runs side by side, of the same letters, their labels cut so that they can be told apart."""
    looks = zip(readouts, labels, colours, strict=True)
    made = [Header(*look, width, letters, lines) for look in looks]
    for header, label in zip(made, font(made[0].font.size, True).told_apart(labels, made[0].room), strict=True):
        header.call(label)
    return made


def error_text(readout: Readout, tick: int) -> str:
    """Return the contour error at a tick in words."""
    error = readout.error[tick]
    return f"{error:.1f} µm" if np.isfinite(error) else "off"


def so_far_text(readout: Readout, tick: int) -> str:
    """Return root mean square and largest contour error until a tick in words."""
    if not np.isfinite(readout.max[tick]):
        return "–"
    digits = 1 if readout.max[-1] < 100 else 0
    return f"{readout.rms[tick]:.{digits}f} / {readout.max[tick]:.{digits}f} µm"
