"""PRINT(...) as people write it: brackets about all that a PRINT shows, which mean nothing."""

from __future__ import annotations

import re

_BRACKETED = re.compile(r"PRINT[ \t]*\(", re.IGNORECASE)
_PLACES = re.compile(r"\"[^\"\n]*\"|'[^\n]*|\bREM\b[^\n]*|(?P<print>\bPRINT[ \t]*)\(", re.IGNORECASE)
_INSIDE = re.compile(r"\"[^\"\n]*\"|[()\n']")
_END = re.compile(r"[ \t]*(?:$|[:\n']|REM\b|ELSE\b)", re.IGNORECASE)


def without_print_brackets(text: str) -> str:
    """Return a text in which blanks replace the brackets about everything that a PRINT shows."""
    if not _BRACKETED.search(text):
        return text
    characters = list(text)
    for place in _PLACES.finditer(text):
        if place["print"] is None:
            continue
        begin = place.end() - 1
        end = _closing(text, begin)
        if end is not None and _END.match(text, end + 1):
            characters[begin] = " "
            characters[end] = " "
    return "".join(characters)


def _closing(text: str, begin: int) -> int | None:
    """Return where the bracket that opens at `begin` closes, None where it does not in its line."""
    depth = 0
    for part in _INSIDE.finditer(text, begin):
        if part[0] == "(":
            depth += 1
        elif part[0] == ")":
            depth -= 1
            if depth == 0:
                return part.start()
        elif part[0] in ("\n", "'"):
            return None
    return None
