"""The needle lifted in dry moves, in the text of a program that never moves z."""

from __future__ import annotations

import re

from gantrysim.controllers.gcode.dialects import Dispense

_COMMENT = r"\([^)]*\)|;.*"
_HEIGHT = re.compile(r"Z|G91(?![.\d])|G17\.1|G18|G19", re.IGNORECASE)  # words with which z is not the one of the start
_RAPID = re.compile(r"\s*(N\d+\s*)?G0?0(?!\d)", re.IGNORECASE)
_FEED = re.compile(r"F\s*[0-9.]+", re.IGNORECASE)


def lifted(text: str, dispense: Dispense, start: float, height: float) -> str | None:
    """Return a program whose needle is lifted in its dry moves; None for one that sets z itself.

    Between M codes, the needle is lifted after the valve closes and lowered before it opens. Elsewhere a rapid move in
    the plane is one to a new place, before which the needle is lifted.

    Args:
        text: of the program.
        dispense: when the valve is open.
        start: height of the program's start, at which it lays its bead [mm].
        height: by which the needle is lifted [mm].
    """
    bare = re.sub(_COMMENT, "", text)
    if _HEIGHT.search(bare):
        return None
    up = f"G0 Z{start + height:g}"
    down = f"G0 Z{start:g}"
    lines = []
    for line in text.splitlines():
        words = re.sub(_COMMENT, "", line).upper()
        if dispense.by == "codes":
            before = [down] if _has(words, dispense.on) else []
            after = [up] if _has(words, dispense.off) else []
        else:
            is_travel = _RAPID.match(words) is not None and re.search("[XY]", words) is not None
            feed = _FEED.search(words)  # some firmware runs rapid moves at the feed
            suffix = f" {feed[0]}" if feed else ""
            before = [up + suffix] if is_travel else []
            after = [down] if is_travel else []
        lines += [*before, line, *after]
    return "\n".join(lines) + "\n"


def _has(words: str, codes: tuple[str, ...]) -> bool:
    """Return whether a line has one of the M codes, with its P."""
    patterns = [r"\s*".join(code.upper().split()) for code in codes]
    return any(re.search(rf"{pattern}(?![.\d])", words) for pattern in patterns)
