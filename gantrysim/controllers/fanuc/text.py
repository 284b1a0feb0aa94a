"""Parser of program text: words, modal codes, absolute and incremental coordinates.

Numbers are millimetres, or inches after G20, with or without a decimal point (calculator-type input).
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from gantrysim.controllers.fanuc.alarm import Source
from gantrysim.controllers.fanuc.blocks import PLANES, Arc, Block, Dwell, Line, Plane, Rapid, Spiral
from gantrysim.controllers.paths.pieces import Vector
from gantrysim.controllers.speeds import SpeedWords

_COMMENT = r"\([^)]*\)?"
SPEEDS = SpeedWords(word=r"\bF|(?<=[0-9.\s])F", comment=_COMMENT, key="feed")
_NUMBER = re.compile(r"\s*([+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+))")
_LETTERS = "ABCDFGIJKLMNOPQRSTXYZ"
_DIGITS = 8
_INCH = 25.4
_ENDS, _CENTRES = "XYZ", "IJK"
_LENGTHS = set("XYZIJKQR")

# G codes and their settings
_MOTION: set[float] = {0, 1, 2, 3}
_PLANE: dict[float, Plane] = {17: "xy", 18: "zx", 19: "yz"}
_UNIT: dict[float, float] = {20: _INCH, 21: 1.0}
_ABSOLUTE: dict[float, bool] = {90: True, 91: False}
_EXACT_STOP: dict[float, bool] = {61: True, 64: False}
_SIDE: dict[float, int] = {40: 0, 41: 1, 42: -1}
_DWELL, _NOTHING = 4, {54, 94}
_KNOWN = {*_MOTION, *_PLANE, *_UNIT, *_ABSOLUTE, *_EXACT_STOP, *_SIDE, _DWELL, *_NOTHING}
_GLUE: dict[float, bool] = {3: True, 5: False}  # M codes
_ENDS_PROGRAM = (2, 30)


@dataclass(frozen=True)
class SourceLine(Source):
    """A block and its source."""

    block: Block


@dataclass(frozen=True)
class _Words(Source):
    codes: tuple[float, ...]  # G
    auxiliary: tuple[float, ...]  # M
    values: dict[str, float]


def read(text: str, start: Vector, offsets: Mapping[str, float], rotary: str, skip: bool) -> tuple[SourceLine, ...]:
    """Return the motions of a program.

    Args:
        text: the program.
        start: initial position [mm].
        offsets: cutter compensation by its number D [mm].
        rotary: letter of the rotary axis.
        skip: whether blocks that begin with a slash are skipped.

    Raises:
        Alarm: an invalid word, or invalid combination of words.
    """
    state = _State(list(start), offsets, rotary)
    blocks: list[SourceLine] = []
    words = list(_blocks(text, skip))
    state.governed = any(code in _GLUE for block in words for code in block.auxiliary)
    for block in words:
        made = state.run(block)
        if made is not None:
            blocks.append(SourceLine(block.name, block.line, made))
    return tuple(blocks)


def _blocks(text: str, skip: bool) -> Iterator[_Words]:
    """The blocks up to M02 or M30."""
    count = 0
    for line, written in enumerate(text.splitlines(), 1):
        for part in re.sub(_COMMENT, " ", written).split(";"):
            plain = part.strip().upper()
            if not plain or plain.startswith("%"):
                continue
            if plain.startswith("/"):
                if skip:
                    continue
                plain = plain[1:].lstrip()
            count += 1
            words = _words(plain, f"block {count}", line)
            if words.codes or words.auxiliary or words.values:
                yield words
            if any(code in _ENDS_PROGRAM for code in words.auxiliary):
                return


def _words(text: str, name: str, line: int) -> _Words:
    label = re.match(r"N\s*([0-9]+)", text)
    if label:
        name = f"N{label[1]}"
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
            raise fail(6, f"{text[at:]!r} after a number: must be one sign at most, before the number")
        if letter in "+-.0123456789":
            raise fail(4, f"{text[at:]!r} has no address: must begin with a letter")
        if letter not in _LETTERS:
            raise fail(9, f"address {letter!r}: must be one of {', '.join(_LETTERS)}")
        found = _NUMBER.match(text, at + 1)
        if not found:
            follows = text[at + 1 :].lstrip()
            if follows[:2] in ("--", "+-", "-+", "++") or follows[:1] in ("-", "+"):
                raise fail(6, f"{letter}{follows[:2]}: must be one sign at most, before the number")
            raise fail(5, f"address {letter} has no number")
        at = found.end()
        if text[at : at + 1] == ".":
            raise fail(7, f"{letter}{found[1]}.: must have one decimal point at most")
        if sum(digit.isdigit() for digit in found[1]) > _DIGITS:
            raise fail(3, f"{letter}{found[1]}: must have {_DIGITS} digits at most")
        value = float(found[1])
        if letter == "G":
            codes.append(value)
        elif letter == "M":
            auxiliary.append(value)
        elif letter not in "NO":
            if letter in values:
                raise fail(9, f"address {letter} is given twice in the block")
            values[letter] = value
    return _Words(name, line, tuple(codes), tuple(auxiliary), values)


@dataclass
class _State:
    """The modal state, which persists from block to block."""

    here: list[float]
    offsets: Mapping[str, float]
    rotary: str
    angle: float = 0.0
    motion: float = 0
    plane: Plane = "xy"
    absolute: bool = True
    unit: float = 1.0
    side: int = 0  # of the cutter compensation: 1 left, -1 right
    offset: float = 0.0
    exact_stop: bool = False
    feed: float | None = None
    governed: bool = False  # whether M03 and M05 switch the dispenser
    glue: bool = False

    def run(self, block: _Words) -> Block | None:
        """Apply a block's codes, and return its motion, if any."""
        self._set_modes(block)
        values = dict(block.values)
        if _DWELL in block.codes:
            return self._dwell(block, values)
        if "F" in values:
            self.feed = values.pop("F") * self.unit
            if self.feed <= 0:
                raise block.fail(11, f"F = {self.feed:g}: must be greater than 0")
        for ignored in "ST":
            values.pop(ignored, None)
        if not values.keys() & {*_ENDS, *_CENTRES, "Q", "L", "R", self.rotary}:
            if values:
                letter = next(iter(values))
                raise block.fail(9, f"address {letter} is not used in this block")
            return None
        return self._motion(block, values)

    def _set_modes(self, block: _Words) -> None:
        for code in block.codes:
            if code not in _KNOWN:
                known = ", ".join(f"G{known:02}" for known in sorted(_KNOWN))
                raise block.fail(10, f"G{code:g}: must be one of {known}")
            if code in _MOTION:
                self.motion = code
            self.plane = _PLANE.get(code, self.plane)
            self.unit = _UNIT.get(code, self.unit)
            self.absolute = _ABSOLUTE.get(code, self.absolute)
            self.exact_stop = _EXACT_STOP.get(code, self.exact_stop)
            self.side = _SIDE.get(code, self.side)
        if "D" in block.values:
            number = f"{block.values.pop('D'):g}"
            if number not in self.offsets and number != "0":
                given = ", ".join(sorted(self.offsets)) or "none"
                raise block.fail(9, f"D{number}: must be one of the program's offsets, {given}")
            self.offset = float(self.offsets.get(number, 0.0))
        for code in block.auxiliary:
            self.glue = _GLUE.get(code, self.glue)

    def _dwell(self, block: _Words, values: dict[str, float]) -> Dwell:
        seconds = values.pop("X", None)
        milliseconds = values.pop("P", None)
        time = seconds if seconds is not None else (milliseconds or 0.0) * 1e-3
        if values or (seconds is None and milliseconds is None) or time < 0:
            raise block.fail(9, "G04 must have X [s] or P [ms], at least 0, and no other address")
        return Dwell(time=time, dispense=self.glue)

    def _motion(self, block: _Words, values: dict[str, float]) -> Block:
        for letter in _LENGTHS & values.keys():
            values[letter] *= self.unit
        end = [self._place(values.pop(letter, None), i) for i, letter in enumerate(_ENDS)]
        rotary = values.pop(self.rotary, None)
        if rotary is not None:
            self.angle = rotary if self.absolute else self.angle + rotary
            rotary = self.angle
        common: dict[str, Any] = {
            "end": tuple(end),
            "rotary": rotary,
            "compensation": self.side * self.offset,
            "plane": self.plane,
            "exact_stop": self.exact_stop,
            "dispense": self.glue if self.governed else None,
        }
        if self.motion in (0, 1):
            made: Block = self._straight(block, values, common)
        else:
            made = self._round(block, values, common, end)
        if values:
            letter = next(iter(values))
            raise block.fail(9, f"address {letter} is not used in G{self.motion:02g}")
        self.here = [there if there is not None else here for there, here in zip(end, self.here, strict=True)]
        return made

    def _place(self, value: float | None, i: int) -> float | None:
        if value is None or self.absolute:
            return value
        return self.here[i] + value

    def _straight(self, block: _Words, values: dict[str, float], common: dict[str, Any]) -> Block:
        if self.motion == 0:
            return Rapid(**{**common, "dispense": common["dispense"] and self.governed})
        return Line(feed=self._required_feed(block), **common)

    def _required_feed(self, block: _Words) -> float:
        if self.feed is None:
            raise block.fail(11, "a motion at feed must have an F, in its block or before")
        return self.feed

    def _round(self, block: _Words, values: dict[str, float], common: dict[str, Any], end: list[float | None]) -> Block:
        turning: dict[str, Any] = {"clockwise": self.motion == 2, "feed": self._required_feed(block)}
        first, second, across = PLANES[self.plane]
        i, j = values.pop(_CENTRES[first], None), values.pop(_CENTRES[second], None)
        up = values.pop(_CENTRES[across], None)
        change, turns, radius = values.pop("Q", None), values.pop("L", None), values.pop("R", None)
        centre = (i or 0.0, j or 0.0)
        if change is None and turns is None and (up is None or end[across] is None):
            if up is not None:
                plane = {"xy": "G17", "zx": "G18", "yz": "G19"}[self.plane]
                letters = f"{_CENTRES[first]} and {_CENTRES[second]}"
                raise block.fail(21, f"address {_CENTRES[across]} in {plane}: the centre must be given by {letters}")
            by_radius = radius is not None or (i is None and j is None)  # R has priority
            return Arc(centre=None if by_radius else centre, radius=radius, **turning, **common)
        if radius is not None:
            raise block.fail(5122, "R in a spiral: the centre must be given by I, J, K of its plane")
        return Spiral(centre=centre, change=change, turns=turns, height_per_turn=up, **turning, **common)
