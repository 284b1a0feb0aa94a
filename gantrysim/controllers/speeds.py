"""Speeds inside a program, which is a text or a list of commands."""

from __future__ import annotations

import re
from collections.abc import Callable
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


def _decimal(number: float) -> str:
    """A number without an exponent and with at most eight digits, as controllers read it."""
    whole = len(str(int(number)))
    text = f"{number:.{max(_DIGITS - whole, 0)}f}"
    return text.rstrip("0").rstrip(".") if "." in text else text
