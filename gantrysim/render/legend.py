"""Drawings of a bead's colour scale: upright beside the pictures of a film, level in the viewer."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from PIL import Image, ImageDraw

from gantrysim.render.colours import Scale
from gantrysim.render.encoding import Picture
from gantrysim.render.fonts import LINE, PAPER, Font, font
from gantrysim.report.plots.style import INK

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
        for text, row in zip(self._scale.labels(), (last, (first + last) // 2, first), strict=True):
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
