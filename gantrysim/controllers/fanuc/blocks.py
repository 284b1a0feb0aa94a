"""The blocks of a program: letters and numbers, and what they state as values."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

from gantrysim.base.errors import InputError, at_least, finite, positive
from gantrysim.controllers.fanuc.alarm import Alarm, BlockSource
from gantrysim.paths.pieces import XY, YZ, ZX, Frame

End = tuple[float | None, ...]
Plane = Literal["xy", "zx", "yz"]

# the plane's axes and its normal, as indices of x, y, z
PLANES: dict[Plane, tuple[int, int, int]] = {"xy": (0, 1, 2), "zx": (2, 0, 1), "yz": (1, 2, 0)}
FRAMES: dict[Plane, Frame] = {"xy": XY, "zx": ZX, "yz": YZ}

COMMENT = r"\([^)]*\)?"
LETTERS = "ABCDFGHIJKLMNOPQRSTXYZ"
OF_FILE = " of "  # between the name of a block and that of its file
CORNERS = (",R", ",C")  # words of the corner at a motion's end
_SHOWN = 20  # characters of a number in a message
_NUMBER = re.compile(r"\s*([+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+))")
_DIGITS = 8


@dataclass(frozen=True, kw_only=True)
class Motion:
    """The arguments of every motion.

    Args:
        end: absolute x, y[, z] of the end; None, or omitted, for an axis that stays [mm].
        rotary: angle of the rotary axis at the end; None if it stays [deg].
        compensation: cutter compensation, positive to the left of the path (G41), negative to the right (G42) [mm].
        plane: "xy" (G17), "zx" (G18) or "yz" (G19).
        exact_stop: whether to stop at the end (G61).
        dispense: whether glue is laid; by default in all motions except rapid ones and lines straight up or down.
        rounding: radius of the corner to the next motion, `,R`; 0 for none [mm].
        chamfer: of the corner to the next motion, `,C`, from the corner along both; 0 for none [mm].
    """

    end: End = ()
    rotary: float | None = None
    compensation: float = 0.0
    plane: Plane = "xy"
    exact_stop: bool = False
    dispense: bool | None = None
    rounding: float = 0.0
    chamfer: float = 0.0

    def __post_init__(self) -> None:
        at_least("rounding", self.rounding, 0, "mm")
        at_least("chamfer", self.chamfer, 0, "mm")
        if self.rounding and self.chamfer:
            raise InputError(f"rounding = {self.rounding:g} mm with a chamfer: must be one of them")
        end = tuple(self.end)
        if len(end) > 3:
            raise InputError(f"end of {len(end)} numbers: must be at most three, x, y, z")
        end += (None,) * (3 - len(end))
        for name, value in zip("xyz", end, strict=True):
            if value is not None:
                finite(f"end {name}", value, "mm")
        object.__setattr__(self, "end", end)
        if self.rotary is not None:
            finite("rotary", self.rotary, "deg")
        finite("compensation", self.compensation, "mm")
        if self.plane not in PLANES:
            raise InputError(f"plane = {self.plane!r}: must be one of {', '.join(PLANES)}")


@dataclass(frozen=True, kw_only=True)
class Rapid(Motion):
    """A straight move at the rapid feed, G00, without glue."""


@dataclass(frozen=True, kw_only=True)
class Line(Motion):
    """A straight move, G01.

    Args:
        feed: F; None for that of the block before [mm/min; deg/min for the rotary axis alone].
    """

    feed: float | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_feed(self.feed)


@dataclass(frozen=True, kw_only=True)
class Arc(Motion):
    """A circular arc, or a helix if the plane's normal axis moves, G02 and G03.

    Args:
        centre: relative to the start, along the plane's first and second axis [mm].
        radius: R instead of the centre; negative for more than half a circle [mm].
        clockwise: G02 if true, viewed against the plane's normal.
        feed: F [mm/min].
    """

    centre: tuple[float, float] | None = None
    radius: float | None = None
    clockwise: bool = True
    feed: float | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_feed(self.feed)
        _check_centre(self.centre)
        if self.radius is not None:
            finite("radius", self.radius, "mm")


@dataclass(frozen=True, kw_only=True)
class Spiral(Motion):
    """Spiral interpolation, or conical if the plane's normal axis moves, G02 and G03.

    The number of turns follows from the first that is given of the change of the radius per turn, the height per
    turn, and `turns`. Any given change and height per turn must lead to the end point.

    Args:
        centre: relative to the start, along the plane's first and second axis [mm].
        clockwise: G02 if true, viewed against the plane's normal.
        change: Q, signed change of the radius per turn [mm].
        height_per_turn: K in the XY plane, J in ZX, I in YZ [mm].
        turns: L, with a partial turn counted as one.
        feed: F [mm/min].
    """

    centre: tuple[float, float] = (0.0, 0.0)
    clockwise: bool = True
    change: float | None = None
    height_per_turn: float | None = None
    turns: float | None = None
    feed: float | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_feed(self.feed)
        _check_centre(self.centre)
        for name, unit in (("change", "mm"), ("height_per_turn", "mm"), ("turns", "")):
            if getattr(self, name) is not None:
                finite(name, getattr(self, name), unit)


@dataclass(frozen=True, kw_only=True)
class Dwell:
    """A stop, G04.

    Args:
        time: [s].
        dispense: whether glue is laid.
    """

    time: float
    dispense: bool = False

    def __post_init__(self) -> None:
        at_least("time of the dwell", self.time, 0, "s")


Block = Rapid | Line | Arc | Spiral | Dwell


def _check_feed(feed: float | None) -> None:
    if feed is not None:
        positive("feed", feed, "mm/min")


def _check_centre(centre: tuple[float, float] | None) -> None:
    if centre is not None:
        if len(centre) != 2:
            raise InputError(f"centre of {len(centre)} numbers: must be two, along the plane's axes")
        for value in centre:
            finite("centre", value, "mm")


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
