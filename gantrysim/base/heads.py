"""Heads of a table's columns: a name, and often a unit in brackets."""

from __future__ import annotations

import re

# Regular expressions that several readers of text share.

NUMBER = r"[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?"  # decimal


_GAPS = re.compile(r"[\s_.]+")
_OPENING = "[("
_CLOSING = "])"


def name_and_unit(head: str) -> tuple[str, str]:
    """Return the name and the unit of a head such as "x position [mm]"; the unit is "" where none is in brackets.

    The time is linear in the head's length, whatever brackets and blanks it has.
    """
    text = head.strip()
    if not text.endswith(tuple(_CLOSING)):
        return text, ""
    inside = max(text.rfind(bracket, 0, -1) for bracket in _CLOSING) + 1
    openings = [text.find(bracket, inside) for bracket in _OPENING]
    if max(openings) < 0:
        return text, ""
    first = min(opening for opening in openings if opening >= 0)
    return text[:first].rstrip(), text[first + 1 : -1].strip()


def spaced_name(name: str) -> str:
    """Return a name with single blanks for its blanks, underscores and points, such as "x position"."""
    return _GAPS.sub(" ", name.strip())
