"""Speeds inside a program, which is a text or a list of commands."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

_NUMBER = r"\s*\+?([0-9]+(?:\.[0-9]*)?|\.[0-9]+)"
_DIGITS = 8  # of a number


@dataclass(frozen=True)
class SpeedWords:
    """How a controller's language states speeds.

    Args:
        word: regular expression of what precedes the number in text.
        comment: regular expression of a comment in text.
        key: the argument of a command that is a speed.
    """

    word: str
    comment: str
    key: str

    def changed(self, program: str | list[dict[str, Any]], change: Callable[[float], float]) -> Any:
        """Return a program with every speed in it changed; a text keeps its comments and layout."""
        if not isinstance(program, str):
            return [
                {name: change(value) if name == self.key else value for name, value in command.items()}
                for command in program
            ]
        pattern = re.compile(f"({self.word}){_NUMBER}", re.IGNORECASE)
        # splitting at a group leaves the comments at every second place
        parts = re.split(f"({self.comment})", program)
        parts[::2] = [
            pattern.sub(lambda match: match[1] + _decimal(change(float(match[2]))), part) for part in parts[::2]
        ]
        return "".join(parts)

    def with_word(self, line: str, word: str, speed: float | None) -> str:
        """Return a line of text with one speed, in place of its own or before its comment; None for no speed."""
        found = re.search(self.comment, line)
        code = line[: found.start()] if found else line
        rest = line[found.start() :] if found else ""
        bare = re.sub(rf"\s*(?:{self.word}){_NUMBER}", "", code, flags=re.IGNORECASE)
        if speed is None:
            return bare + rest
        stripped = bare.rstrip()
        return f"{stripped} {word}{_decimal(speed)}{bare[len(stripped) :]}{rest}"


_FEED_WORD = re.compile(r"(?<![A-Z#<])F\s*(\+?[0-9]*\.?[0-9]+\.?|#[0-9]+|#<[^<>]*>|\[[^\]]*\])", re.IGNORECASE)
# lines after which another line than the next may run, or that set a feed in another way
_JUMPS = re.compile(r"\bO\s*[0-9<#]|GOTO|WHILE|END|IF|M\s*0*(?:98|99)(?![0-9])|G\s*6[567](?![0-9])", re.IGNORECASE)


def with_feed_words(text: str, feeds: Mapping[int, float], comment: str) -> str:
    """Return a program whose lines have other feeds, with as few words F as do it.

    A word F is modal: a line whose feed is that of the lines before needs none. After a line from which the program
    jumps, the next feed is stated again.

    Args:
        text: of the program.
        feeds: F of all lines that move at feed, by their numbers, in the program's unit.
        comment: regular expression of a comment.
    """
    lines = text.split("\n")
    jumps = re.search(r"GOTO", re.sub(comment, "", text), re.IGNORECASE) is not None
    modal: float | None = None
    for k, line in enumerate(lines):
        found = re.search(comment, line)
        code = line[: found.start()] if found else line
        rest = line[found.start() :] if found else ""
        own = _FEED_WORD.search(code)
        if k + 1 not in feeds:
            if own is not None:
                modal = float(own[1]) if own[1].strip("+.").replace(".", "").isdigit() else None
            if jumps or _JUMPS.search(code):
                modal = None
            continue
        feed = feeds[k + 1]
        word = f"F{_decimal(feed)}"
        if own is not None and (modal is None or feed != modal):
            if not _same(own[1], feed):
                code = code[: own.start()] + word + code[own.end() :]
        elif own is not None:
            code = (code[: own.start()] + code[own.end() :].lstrip(" ")).rstrip(" ") + (" " if rest else "")
        elif modal is None or feed != modal:
            stripped = code.rstrip()
            code = f"{stripped} {word}{code[len(stripped) :]}"
        lines[k] = code + rest
        modal = None if jumps else feed
    return "\n".join(lines)


def _same(word: str, feed: float) -> bool:
    """Return whether the number of a word F is a feed."""
    try:
        return float(word) == float(_decimal(feed))
    except ValueError:
        return False


def _decimal(number: float) -> str:
    """A number without an exponent and with at most eight digits, as controllers read it."""
    whole = len(str(int(number)))
    text = f"{number:.{max(_DIGITS - whole, 0)}f}"
    return text.rstrip("0").rstrip(".") if "." in text else text
