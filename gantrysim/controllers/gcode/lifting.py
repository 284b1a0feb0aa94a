"""The needle lifted in dry moves, in the text of a program that never moves z."""

from __future__ import annotations

import re

from gantrysim.controllers.valve import Valve

_COMMENT = r"\([^)]*\)|;.*"
_HEIGHT = re.compile(r"Z|G91(?![.\d])|G17\.1|G18|G19", re.IGNORECASE)  # words with which z is not the one of the start
_RAPID = re.compile(r"\s*(N\d+\s*)?G0?0(?!\d)", re.IGNORECASE)
_FEED = re.compile(r"F\s*[0-9.]+", re.IGNORECASE)


def lifted(text: str, valve: Valve, start: float, height: float) -> str | None:
    """Return a program whose needle is lifted in its dry moves; None for one that sets z itself.

    The needle is lifted after the valve closes and lowered before it opens. A rapid move in the plane that lays no glue
    is one to a new place, before which the needle is lifted.

    Args:
        text: of the program.
        valve: what opens it.
        start: height of the program's start, at which it lays its bead [mm].
        height: by which the needle is lifted [mm].
    """
    bare = re.sub(_COMMENT, "", text)
    if _HEIGHT.search(bare):
        return None
    up = f"G0 Z{start + height:g}"
    down = f"G0 Z{start:g}"
    lines = []
    is_open = not valve.output
    for line in text.splitlines():
        words = re.sub(_COMMENT, "", line).upper()
        before = []
        after = []
        if _has(words, valve.off):
            after.append(up)
            is_open = False
        elif _has(words, valve.on):
            before.append(down)
            is_open = True
        is_dry = valve.at_work or not valve.output
        if is_dry and _RAPID.match(words) is not None and re.search("[XY]", words) is not None:
            feed = _FEED.search(words)  # some firmware runs rapid moves at the feed
            before.append(f"{up} {feed[0]}" if feed else up)
            if is_open:
                after.append(down)
        lines += [*before, line, *after]
    return "\n".join(lines) + "\n"


def _has(words: str, codes: tuple[str, ...]) -> bool:
    """Return whether a line has one of the M codes, with its P."""
    patterns = [r".*?".join(rf"{word[0]}\s*0*{word[1:]}(?![.\d])" for word in code.upper().split()) for code in codes]
    return any(re.search(pattern, words) for pattern in patterns)
