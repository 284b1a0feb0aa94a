"""Text in pictures: DejaVu Sans in any size, and the colours of text and background."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import cache
from importlib.resources import files
from io import BytesIO
from itertools import zip_longest

from PIL import ImageColor, ImageDraw, ImageFont

PAPER = "#ffffff"
MUTED = "#5b626c"  # of secondary text
LINE = 1.25  # line spacing in sizes of the letters
_TEXT_MARGIN = 0.6  # around text in sizes of the letters


class Font:
    """DejaVu Sans in one size; all its digits have the same width.

    Attributes:
        size: of the letters [pixels].
        face: the font as Pillow draws it.
        margin: space around text [pixels].
    """

    def __init__(self, size: int, bold: bool = False) -> None:
        self.size = size
        self.margin = round(_TEXT_MARGIN * size)
        name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
        with (files("matplotlib") / "mpl-data" / "fonts" / "ttf" / name).open("rb") as file:
            # the basic layout draws the same letters whether or not libraqm is installed
            self.face = ImageFont.truetype(BytesIO(file.read()), size, layout_engine=ImageFont.Layout.BASIC)

    def write(
        self, draw: ImageDraw.ImageDraw, place: tuple[float, float], text: str, colour: str, anchor: str = "la"
    ) -> None:
        """Draw a line of text at a column and row, which are its left upper end or Pillow's other anchors."""
        draw.text(place, text, rgb(colour), self.face, anchor)

    def width(self, text: str) -> float:
        """Return the length of a line of text [pixels]."""
        return float(self.face.getlength(text))

    def shortened(self, text: str, width: float) -> str:
        """Return a text cut at its end to a width [pixels], with an ellipsis where it is cut."""
        if self.width(text) <= width:
            return text
        while text and self.width(f"{text}…") > width:
            text = text[:-1].rstrip()
        return f"{text}…"

    def distinct(self, texts: Sequence[str], width: float) -> list[str]:
        """Return texts cut to a width [pixels] so that different texts stay different.

        They lose their ends, their middles, or the words they share: the first of these that keeps all words in which
        they differ, else the first that leaves no two the same.
        """
        candidates = []
        for shorter in (list(texts), _without_common(texts)):
            for cut in (self.shortened, self._without_middle):
                candidates.append([cut(text, width) for text in shorter])  # noqa: PERF401
        distinct = [cuts for cuts in candidates if len(set(cuts)) == len(set(texts))] or candidates
        # words in which the texts differ, a list for each text
        differing = list(zip(*(words for words in _columns(texts) if len(set(words)) > 1), strict=True))
        for cuts in distinct:
            if all(word in text for text, words in zip(cuts, differing, strict=False) for word in words):
                return cuts
        return distinct[0]

    def _without_middle(self, text: str, width: float) -> str:
        if self.width(text) <= width:
            return text
        for length in range(len(text) - 1, 0, -1):
            tail = length // 2
            cut = f"{text[: length - tail].rstrip()}…{text[len(text) - tail :].lstrip()}"
            if self.width(cut) <= width:
                return cut
        return "…"

    def wrapped(self, text: str, width: float) -> list[str]:
        """Return a text in lines of at most a width [pixels], where its words allow that."""
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
    """Return a font, made once for each size."""
    return Font(size, bold)


def rgb(colour: str) -> tuple[int, int, int]:
    """Return a colour's red, green and blue, 0 to 255 each."""
    red, green, blue = ImageColor.getrgb(colour)[:3]
    return red, green, blue


def _without_common(texts: Sequence[str]) -> list[str]:
    """Return texts with an ellipsis for the words that all of them share at one place."""
    columns = [["…"] * len(texts) if len(set(words)) == 1 else words for words in _columns(texts)]
    return [re.sub(" *…[ …]*", "…", " ".join(words)).strip() for words in zip(*columns, strict=True)]


def _columns(texts: Sequence[str]) -> list[tuple[str, ...]]:
    """Return the first words of all texts, their second words, and so on."""
    return list(zip_longest(*(text.split() for text in texts), fillvalue=""))
