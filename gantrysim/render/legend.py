"""The scale of the beads' colours, upright, with its title and its numbers."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from gantrysim.plots.style import INK
from gantrysim.render.colours import Scale
from gantrysim.render.lettering import PAPER, Font, rgb

Picture = NDArray[np.uint8]

_LINE = 1.25  # of the size of the letters
_SHORT = {"contour error": "error", "width of the bead": "width"}
_MARGIN, _BAR, _GAP = 0.6, 0.9, 0.5  # in sizes of the letters


class Legend:
    """The colours from low to high with three numbers beside them, and the title above.

    Args:
        scale: of the colours.
        letters: its font.
        narrow: whether the title is short and may stand in two lines.

    Attributes:
        width: [pixels].
    """

    def __init__(self, scale: Scale, letters: Font, narrow: bool = False) -> None:
        self._scale, self._letters = scale, letters
        numbers = (_BAR + _GAP) * letters.size + max(map(letters.width, scale.labels()))
        self._lines = [f"{scale.title} [{scale.unit}]"]
        if narrow:
            self._lines = letters.wrapped(f"{_SHORT.get(scale.title, scale.title)} [{scale.unit}]", numbers)
        self._margin = round(_MARGIN * letters.size)
        self.width = round(max(numbers, *map(letters.width, self._lines))) + 2 * self._margin

    def picture(self, height: int) -> Picture:
        """Return it in a height [pixels], (height, width, 3)."""
        letters, margin, bar = self._letters, self._margin, round(_BAR * self._letters.size)
        image = Image.new("RGB", (self.width, height), PAPER)
        draw = ImageDraw.Draw(image)
        for number, line in enumerate(self._lines):
            row = 1 + round((0.08 + _LINE * number) * letters.size)
            draw.text((margin, row), line, rgb(INK), letters.face)
        first = 1 + round((_LINE * len(self._lines) + 0.5) * letters.size)
        last = height - 1 - round(0.75 * letters.size)
        table = self._scale.table[np.round(np.linspace(255, 0, last + 1 - first)).astype(int)]
        for text, beside in zip(self._scale.labels(), (last, (first + last) // 2, first), strict=True):
            place = (round(margin + bar + _GAP * letters.size), beside)
            draw.text(place, text, rgb(INK), letters.face, anchor="lm")
        picture = np.array(image)
        picture[first : last + 1, margin : margin + bar] = table[:, None]
        return picture
