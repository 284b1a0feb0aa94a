"""Blocks of letters and numbers."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

from gantrysim.controllers.fanuc.alarm import Alarm, BlockSource

COMMENT = r"\([^)]*\)?"
LETTERS = "ABCDFGHIJKLMNOPQRSTXYZ"
OF_FILE = " of "  # between the name of a block and that of its file
CORNERS = (",R", ",C")  # words of the corner at a motion's end
_SHOWN = 20  # characters of a number in a message
_NUMBER = re.compile(r"\s*([+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+))")
_DIGITS = 8


@dataclass(frozen=True)
class Words(BlockSource):
    """The words of a block.

    Attributes:
        codes: G.
        auxiliary: M.
        values: of the other letters, but N and O.
    """

    codes: tuple[float, ...]
    auxiliary: tuple[float, ...]
    values: dict[str, float]

    @cached_property
    def names(self) -> tuple[str, ...]:
        """The G and M codes by their names."""
        return (*self.g_names, *self.m_names)

    @cached_property
    def g_names(self) -> tuple[str, ...]:
        """The G codes by their names, as "G05.1"."""
        return tuple(_code_name("G", code) for code in self.codes)

    @cached_property
    def m_names(self) -> tuple[str, ...]:
        """The M codes by their names, as "M03"."""
        return tuple(_code_name("M", code) for code in self.auxiliary)


def _code_name(letter: str, code: float) -> str:
    """Return the name of a code, with two digits before the decimal point."""
    return f"{letter}{int(code):02}" if code.is_integer() else f"{letter}{code:04}"


def labelled_block(name: str, label: str) -> str:
    """Return the name of a block that has a number: that, with the file of subprograms in which the block stands."""
    _, of, file = name.partition(OF_FILE)
    return f"N{label[:_SHOWN]}{of}{file}"


def words_of(text: str, name: str, line: int) -> Words:
    """Return a block of letters and numbers.

    Raises:
        Alarm: an invalid word.
    """
    label = re.match(r"N\s*([0-9]+)", text)
    if label:
        name = labelled_block(name, label[1])
    codes: list[float] = []
    auxiliary: list[float] = []
    values: dict[str, float] = {}

    fail = BlockSource(name, line).fail
    position = 0
    while position < len(text):
        letter = text[position]
        if letter.isspace():
            position += 1
            continue
        comma = ""
        if letter == ",":
            comma = letter
            position += 1
            letter = text[position : position + 1]
            if comma + letter not in CORNERS:
                raise fail(9, f"{text[position - 1 : position + _SHOWN]!r}: a comma must stand before R or C")
        _check_address(text, position, fail)
        number = _NUMBER.match(text, position + 1)
        if not number:
            follows = text[position + 1 :].lstrip()
            if follows[:2] in ("--", "+-", "-+", "++") or follows[:1] in ("-", "+"):
                raise fail(6, f"{letter}{follows[:2]}: must be one sign at most, before the number")
            raise fail(5, f"address {letter} has no number")
        position = number.end()
        if text[position : position + 1] == ".":
            raise fail(7, f"{letter}{number[1][:_SHOWN]}.: must have one decimal point at most")
        if sum(digit.isdigit() for digit in number[1]) > _DIGITS:
            raise fail(3, f"{letter}{number[1][:_SHOWN]}: must have {_DIGITS} digits at most")
        value = float(number[1])
        if letter == "G":
            codes.append(value)
        elif letter == "M":
            auxiliary.append(value)
        elif letter not in "NO":
            if comma + letter in values:
                raise fail(9, f"address {comma}{letter} is given twice in the block")
            values[comma + letter] = value
    return Words(name, line, tuple(codes), tuple(auxiliary), values)


def _check_address(text: str, position: int, fail: Callable[[int, str], Alarm]) -> None:
    """Check that an address, a letter, stands at a position."""
    letter = text[position]
    shown = repr(text[position : position + _SHOWN])
    if letter in "+-" and position > 0 and text[position - 1] in ".0123456789":
        raise fail(6, f"{shown} after a number: must be one sign at most, before the number")
    if letter in "+-.0123456789":
        raise fail(4, f"{shown} has no address: must begin with a letter")
    if letter not in LETTERS:
        raise fail(9, f"address {letter!r}: must be one of {', '.join(LETTERS)}")
