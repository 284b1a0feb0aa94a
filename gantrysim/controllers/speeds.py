"""Speeds and set points of the flow inside a program, and stretches of its path that can have speeds of their own."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.record.setpoints import Setpoints

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
        code, remark = _code_and_comment(line, self.comment)
        bare = re.sub(rf"\s*(?:{self.word}){_NUMBER}", "", code, flags=re.IGNORECASE)
        return bare + remark if speed is None else _code_with_word(bare, f"{word}{_decimal(speed)}") + remark


def _code_and_comment(line: str, comment: str) -> tuple[str, str]:
    """Return a line's code, and what follows from its comment on."""
    match = re.search(comment, line)
    return (line[: match.start()], line[match.start() :]) if match else (line, "")


def _code_with_word(code: str, word: str) -> str:
    """Return code with a word at its end, before its blanks."""
    stripped = code.rstrip()
    return f"{stripped} {word}{code[len(stripped) :]}"


_VALUE = r"\s*(\+?[0-9]*\.?[0-9]+\.?|#[0-9]+|#<[^<>]*>|\[[^\]]*\])"
_FEED = r"(?<![A-Z#<])F"
_SPINDLE = r"(?<![A-Z#<])S"
_ANALOGUE = r"M\s*0*6[78]\s*E\s*0*{number}(?![0-9.])\s*Q"
# lines after which another line than the next may run, or that set a feed in another way
_JUMPS = re.compile(r"\bO\s*[0-9<#]|GOTO|WHILE|END|IF|M\s*0*(?:98|99)(?![0-9])|G\s*6[567](?![0-9])", re.IGNORECASE)


def with_feed_words(text: str, feeds: Mapping[int, float], comment: str) -> str:
    """Return a program whose lines have other feeds, with as few words F as do it.

    Args:
        text: of the program.
        feeds: F of all lines that move at feed, by their numbers, in the program's unit.
        comment: regular expression of a comment.
    """
    return _with_modal_words(text, feeds, comment, (_FEED, "F"))


def with_flow_words(text: str, values: Mapping[int, float], comment: str, output: str) -> str:
    """Return a program whose lines have other set points of the flow, with as few words as do it.

    Args:
        text: of the program.
        values: of all lines that lay glue, by their numbers.
        comment: regular expression of a comment.
        output: "S", or with its number "M67 E0".
    """
    if output == "S":
        return _with_modal_words(text, values, comment, (_SPINDLE, "S"))
    number = output.rpartition("E")[2]
    return _with_modal_words(text, values, comment, (_ANALOGUE.format(number=number), f"{output} Q"))


def _with_modal_words(text: str, values: Mapping[int, float], comment: str, word: tuple[str, str]) -> str:
    """Return a program whose lines have other values of a word.

    The word is modal: a line whose value is that of the lines before needs none. After a line from which the program
    jumps, the next value is stated again.

    Args:
        text: of the program.
        values: of lines, by their numbers.
        comment: regular expression of a comment.
        word: regular expression of what precedes the number, and what is written there.
    """
    before, written = word
    pattern = re.compile(before + _VALUE, re.IGNORECASE)
    lines = text.split("\n")
    jumps = re.search(r"GOTO", re.sub(comment, "", text), re.IGNORECASE) is not None
    modal: float | None = None
    for k, line in enumerate(lines):
        code, remark = _code_and_comment(line, comment)
        match = pattern.search(code)
        value = values.get(k + 1)
        if value is None:
            if match is not None:
                modal = _value(match[1])
            if jumps or _JUMPS.search(code):
                modal = None
            continue
        if match is not None:
            if _value(match[1]) != float(_decimal(value)):
                code = f"{code[: match.start()]}{written}{_decimal(value)}{code[match.end() :]}"
        elif modal != value:
            code = _code_with_word(code, f"{written}{_decimal(value)}")
        lines[k] = code + remark
        modal = None if jumps else value
    return "\n".join(lines)


def _value(word: str) -> float | None:
    """Return the number of a word, None for an expression."""
    try:
        return float(word)
    except ValueError:
        return None


def _decimal(number: float) -> str:
    """A number without an exponent and with at most eight digits, as controllers read it."""
    whole = len(str(int(number)))
    text = f"{number:.{max(_DIGITS - whole, 0)}f}"
    return text.rstrip("0").rstrip(".") if "." in text else text


@dataclass(frozen=True)
class Stretches:
    """Consecutive stretches of a program's requested path.

    Attributes:
        ends: arc length of the requested path at which each stretch ends, ascending, (m,) [mm].
        places: where the program states the speed of each: a line of its text, or a number of its own, (m,).
        speeds: programmed path speed of each, 0 where no speed is stated, as for a rapid move, (m,) [mm/s].
    """

    ends: Floats
    places: NDArray[np.intp]
    speeds: Floats

    @classmethod
    def of(cls, lengths: Sequence[float], places: Sequence[int], speeds: Sequence[float]) -> Stretches:
        """Return stretches of some lengths [mm]."""
        return cls(np.cumsum(np.asarray(lengths, float)), np.array(places, np.intp), np.array(speeds, float))

    @classmethod
    def of_lines(cls, setpoints: Setpoints, lines: NDArray[np.intp], speeds: Mapping[int, float]) -> Stretches:
        """Return the stretches along which the lines of a text are active.

        Args:
            setpoints: of the program, with their progress.
            lines: active at every setpoint, (n,).
            speeds: stated path speeds by line [mm/s].
        """
        assert setpoints.progress is not None
        last = np.flatnonzero(np.append(np.diff(lines) != 0, True))
        ends = np.maximum.accumulate(setpoints.progress)[last]
        ends[-1:] = setpoints.requested.length
        places = lines[last]
        return cls(ends, places, np.array([speeds.get(line, 0.0) for line in places.tolist()]))

    def at(self, s: Floats) -> NDArray[np.intp]:
        """Return the index of the stretch at arc lengths of the requested path, (n,)."""
        return np.minimum(np.searchsorted(self.ends, s), self.ends.size - 1)

    @property
    def lengths(self) -> Floats:
        """Lengths of the stretches, (m,) [mm]."""
        return np.diff(self.ends, prepend=0.0)
