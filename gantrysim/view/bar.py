"""The scale of the bead's colours, as a picture that lies above the chart."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from gantrysim.render.colours import Scale
from gantrysim.render.lettering import font

HEIGHT = 34  # [pixels]
_STRIP = 12  # of it, the colours [pixels]
_MARGIN = 6  # [pixels]
_LETTERS = 12  # [pixels]
_GROUND, _INK = (20, 23, 28), (235, 235, 235)


@lru_cache(maxsize=2)
def colour_bar(scale: Scale, width: int) -> NDArray[np.uint8]:
    """Return the colours from low to high with their numbers, (HEIGHT, width, 3)."""
    image = Image.new("RGB", (width, HEIGHT), _GROUND)
    draw, letters = ImageDraw.Draw(image), font(_LETTERS)
    low, _, high = scale.labels()
    middle = (HEIGHT - _STRIP) // 2
    room = width - 4 * _MARGIN - 2 * max(letters.width(low), letters.width(high))
    title = letters.shortened(f"bead: {scale.title} [{scale.unit}]", room)
    for text, x, anchor in ((low, _MARGIN, "lm"), (title, width / 2, "mm"), (high, width - _MARGIN, "rm")):
        draw.text((x, middle), text, fill=_INK, font=letters.face, anchor=anchor)
    picture = np.array(image)
    picture[-_STRIP:] = scale.table[np.arange(width) * len(scale.table) // width]
    return picture
