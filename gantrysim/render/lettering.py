"""Letters on pictures: one typeface in any size, and the colours of the paper that they stand on."""

from __future__ import annotations

from functools import cache
from importlib.resources import files
from io import BytesIO

from PIL import ImageColor, ImageFont

__all__ = ["MUTED", "PAPER", "Font", "font", "rgb"]

PAPER = "#ffffff"
MUTED = "#5b626c"  # of what is not the matter itself


class Font:
    """A size of DejaVu Sans, whose figures are all equally wide.

    Args:
        size: of the letters [pixels].
        bold: whether its bold cut.

    Attributes:
        size: [pixels].
        face: as Pillow draws it.
    """

    def __init__(self, size: int, bold: bool = False) -> None:
        self.size = size
        name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
        with (files("matplotlib") / "mpl-data" / "fonts" / "ttf" / name).open("rb") as file:
            # the same letters whatever other libraries of shaping there are
            self.face = ImageFont.truetype(BytesIO(file.read()), size, layout_engine=ImageFont.Layout.BASIC)

    def width(self, text: str) -> float:
        """Return the length of a text in one line [pixels]."""
        return float(self.face.getlength(text))

    def shortened(self, text: str, width: float) -> str:
        """Return a text cut to a width [pixels], with an ellipsis where something was cut."""
        if self.width(text) <= width:
            return text
        while text and self.width(f"{text}…") > width:
            text = text[:-1].rstrip()
        return f"{text}…"

    def wrapped(self, text: str, width: float) -> list[str]:
        """Return a text in lines of no more than a width [pixels], as far as its words allow."""
        lines = [""]
        for word in text.split():
            longer = f"{lines[-1]} {word}".strip()
            if lines[-1] and self.width(longer) > width:
                lines.append(word)
            else:
                lines[-1] = longer
        return lines


@cache
def font(size: int, bold: bool = False) -> Font:
    """Return a font, the same one at every call."""
    return Font(size, bold)


def rgb(colour: str) -> tuple[int, int, int]:
    """Return a colour's red, green and blue, 0 to 255 each."""
    red, green, blue = ImageColor.getrgb(colour)[:3]
    return red, green, blue
