"""Letters on pictures: one typeface in any size, and the colours of the paper that they stand on."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import cache
from importlib.resources import files
from io import BytesIO
from itertools import zip_longest

from PIL import ImageColor, ImageFont

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

    def told_apart(self, texts: Sequence[str], width: float) -> list[str]:
        """Return texts cut to a width [pixels], different ones to what can be told apart.

        They lose their ends, or their middles, or the words that all of them have: the first of these that leaves the
        words in which they differ, else the first that leaves no two the same.
        """
        tried = [
            [cut(text, width) for text in shorter(texts)]
            for shorter in (list, _without_common)
            for cut in (self.shortened, self._without_middle)
        ]
        apart = [short for short in tried if len(set(short)) == len(set(texts))] or tried
        differing = _differing(texts)
        whole = [
            short
            for short in apart
            if all(word in one for one, words in zip(short, differing, strict=True) for word in words)
        ]
        return (whole or apart)[0]

    def _without_middle(self, text: str, width: float) -> str:
        if self.width(text) <= width:
            return text
        for letters in range(len(text) - 1, 0, -1):
            head, tail = text[: letters - letters // 2].rstrip(), text[len(text) - letters // 2 :].lstrip()
            if self.width(f"{head}…{tail}") <= width:
                return f"{head}…{tail}"
        return "…"

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


def _without_common(texts: Sequence[str]) -> list[str]:
    """Texts with an ellipsis for the words that stand at the same places of all of them."""
    kept = [["…"] * len(texts) if len(set(words)) == 1 else words for words in _places(texts)]
    return [re.sub(" *…[ …]*", "…", " ".join(words)).strip() for words in zip(*kept, strict=True)]


def _differing(texts: Sequence[str]) -> list[list[str]]:
    """The words of each text that do not stand at the same place of all."""
    kept = [words for words in _places(texts) if len(set(words)) > 1]
    return [[words[k] for words in kept] for k in range(len(texts))]


def _places(texts: Sequence[str]) -> list[tuple[str, ...]]:
    """The words at the first place of all texts, at the second, and so on."""
    return list(zip_longest(*(text.split() for text in texts), fillvalue=""))
