"""Blocks of letters and numbers."""

from __future__ import annotations

import re
from dataclasses import dataclass

from gantrysim.controllers.fanuc.alarm import Source

COMMENT = r"\([^)]*\)?"
LETTERS = "ABCDFGHIJKLMNOPQRSTXYZ"
_SHOWN = 20  # characters of a number in a message
_NUMBER = re.compile(r"\s*([+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+))")
_DIGITS = 8


@dataclass(frozen=True)
class Words(Source):
    """The words of a block.

    Attributes:
        codes: G.
        auxiliary: M.
        values: of the other letters, but N and O.
    """

    codes: tuple[float, ...]
    auxiliary: tuple[float, ...]
    values: dict[str, float]


def words_of(text: str, name: str, line: int) -> Words:
    """Return a block of letters and numbers.

    Raises:
        Alarm: an invalid word.
    """
    label = re.match(r"N\s*([0-9]+)", text)
    if label:
        name = f"N{label[1][:_SHOWN]}"
    codes: list[float] = []
    auxiliary: list[float] = []
    values: dict[str, float] = {}

    fail = Source(name, line).fail
    at = 0
    while at < len(text):
        letter = text[at]
        if letter.isspace():
            at += 1
            continue
        if letter in "+-" and at > 0 and text[at - 1] in ".0123456789":
            raise fail(6, f"{text[at : at + _SHOWN]!r} after a number: must be one sign at most, before the number")
        if letter in "+-.0123456789":
            raise fail(4, f"{text[at : at + _SHOWN]!r} has no address: must begin with a letter")
        if letter not in LETTERS:
            raise fail(9, f"address {letter!r}: must be one of {', '.join(LETTERS)}")
        found = _NUMBER.match(text, at + 1)
        if not found:
            follows = text[at + 1 :].lstrip()
            if follows[:2] in ("--", "+-", "-+", "++") or follows[:1] in ("-", "+"):
                raise fail(6, f"{letter}{follows[:2]}: must be one sign at most, before the number")
            raise fail(5, f"address {letter} has no number")
        at = found.end()
        if text[at : at + 1] == ".":
            raise fail(7, f"{letter}{found[1][:_SHOWN]}.: must have one decimal point at most")
        if sum(digit.isdigit() for digit in found[1]) > _DIGITS:
            raise fail(3, f"{letter}{found[1][:_SHOWN]}: must have {_DIGITS} digits at most")
        value = float(found[1])
        if letter == "G":
            codes.append(value)
        elif letter == "M":
            auxiliary.append(value)
        elif letter not in "NO":
            if letter in values:
                raise fail(9, f"address {letter} is given twice in the block")
            values[letter] = value
    return Words(name, line, tuple(codes), tuple(auxiliary), values)
