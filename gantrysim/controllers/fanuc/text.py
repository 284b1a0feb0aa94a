"""Parser of program text: words, modal codes, absolute and incremental coordinates.

Numbers are millimetres, or inches after G20, with or without a decimal point (calculator-type input).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from gantrysim.controllers.fanuc.alarm import Source
from gantrysim.controllers.fanuc.blocks import PLANES, Arc, Block, Dwell, Line, Plane, Rapid, Spiral
from gantrysim.controllers.fanuc.macro import Macro
from gantrysim.controllers.fanuc.words import COMMENT, Words
from gantrysim.controllers.speeds import SpeedWords
from gantrysim.paths.pieces import Vector

SPEEDS = SpeedWords(word=r"\bF|(?<=[0-9.\s])F", comment=COMMENT, key="feed")
_INCH = 25.4
_ENDS = "XYZ"
_CENTRES = "IJK"
_LENGTHS = set("XYZIJKQR")

# G codes and their settings
_MOTION: set[float] = {0, 1, 2, 3}
_PLANE: dict[float, Plane] = {17: "xy", 18: "zx", 19: "yz"}
_UNIT: dict[float, float] = {20: _INCH, 21: 1.0}
_ABSOLUTE: dict[float, bool] = {90: True, 91: False}
_EXACT_STOP: dict[float, bool] = {61: True, 64: False}
_SIDE: dict[float, int] = {40: 0, 41: 1, 42: -1}
_SYSTEMS = {54: 0, 55: 1, 56: 2, 57: 3, 58: 4, 59: 5}
_CONTOUR: dict[float, str] = {5.1: "Q", 8: "P"}  # look-ahead, and its switch
_DWELL = 4
_SET = 10
_HOME = 28
_LOCAL = 52
_MACHINE = 53
_SHIFT = 92
_NOTHING = {43, 44, 49, 80, 94}
_ALONE = {_SET, _HOME, _LOCAL, _SHIFT}
_KNOWN = {*_MOTION, *_PLANE, *_UNIT, *_ABSOLUTE, *_EXACT_STOP, *_SIDE, *_SYSTEMS, *_CONTOUR, *_ALONE}
_KNOWN |= {_DWELL, _MACHINE, *_NOTHING}
_GLUE: dict[float, bool] = {3: True, 5: False}  # M codes


@dataclass(frozen=True)
class SourceLine(Source):
    """A block and its source.

    Attributes:
        block: the block.
        idle: whether it is in G41 or G42 with an offset of 0, as without D.
        halting: whether it stops at its end in G64, as the program has G05.1 or G08 and they are off.
        continuous: whether the program asks for G64.
    """

    block: Block
    idle: bool = False
    halting: bool = False
    continuous: bool = False


def read(
    text: str, start: Vector, offsets: Mapping[str, float], rotary: str, skip: bool, steps: int
) -> tuple[SourceLine, ...]:
    """Return the motions of a program.

    Args:
        text: the program.
        start: initial position [mm].
        offsets: cutter compensation by its number D [mm].
        rotary: letter of the rotary axis.
        skip: whether blocks that begin with a slash are skipped.
        steps: most blocks that may run.

    Raises:
        Alarm: an invalid word, or invalid combination of words.
    """
    state = _State(list(start), offsets, rotary, start)
    macro = Macro(text, skip, steps, state.provided)
    blocks: list[SourceLine] = []
    state.governed = macro.has(r"M\s*0*[35](?![0-9])")
    state.contoured = macro.has(r"G\s*0*(?:5\.1|8)(?![0-9.])")
    for block in macro.blocks():
        made = state.run(block)
        blocks += [SourceLine(block.name, block.line, one, state.idle, state.halting, state.continuous) for one in made]
    return tuple(blocks)


@dataclass
class _State:
    """The modal state, which persists from block to block."""

    here: list[float]
    offsets: Mapping[str, float]
    rotary: str
    home: Vector
    system: int = 0
    systems: list[list[float]] = field(default_factory=lambda: [[0.0] * 3 for _ in _SYSTEMS])
    shift: list[float] = field(default_factory=lambda: [0.0] * 3)
    contoured: bool = False  # whether G05.1 or G08 switch the look-ahead
    ahead: bool = False
    angle: float = 0.0
    motion: float = 0
    plane: Plane = "xy"
    absolute: bool = True
    unit: float = 1.0
    side: int = 0  # of the cutter compensation: 1 left, -1 right
    offset: float = 0.0
    exact_stop: bool = False
    continuous: bool = False  # whether G64 is in the program
    feed: float | None = None
    governed: bool = False  # whether M03 and M05 switch the dispenser
    glue: bool = False

    def run(self, block: Words) -> list[Block]:
        """Apply a block's codes, and return its motions."""
        self._set_modes(block)
        values = dict(block.values)
        values.pop("H", None)
        alone = [code for code in block.codes if code in _ALONE]
        if alone:
            return self._alone(block, alone[0], values)
        if _DWELL in block.codes:
            return [self._dwell(block, values)]
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
            return []
        return [self._motion(block, values)]

    @property
    def idle(self) -> bool:
        """Whether cutter compensation is on without an offset."""
        return self.side != 0 and self.offset == 0

    @property
    def halting(self) -> bool:
        """Whether motions stop at their ends although G61 is off."""
        return self.contoured and not self.ahead and not self.exact_stop

    def provided(self, key: float | str) -> float | None:
        """Return a variable of the controller, as the position at the end of the block before; None for others."""
        if isinstance(key, str):
            return None
        if 5001 <= key <= 5003:
            i = int(key) - 5001
            return (self.here[i] - self._origin(i)) / self.unit
        if 5041 <= key <= 5043:
            return self.here[int(key) - 5041] / self.unit
        return None

    def _origin(self, i: int) -> float:
        """Position of the program's zero [mm]."""
        return self.systems[self.system][i] + self.shift[i]

    def _alone(self, block: Words, code: float, values: dict[str, float]) -> list[Block]:
        """G10 L2, G28, G52 and G92."""
        given = {i: values.pop(letter) * self.unit for i, letter in enumerate(_ENDS) if letter in values}
        moves: list[Block] = []
        if code == _SET:
            number = values.pop("P", 0.0)
            if values.pop("L", None) != 2 or not 1 <= number <= len(_SYSTEMS) or number != int(number):
                raise block.fail(9, f"G10 must be with L2 and P1 to P{len(_SYSTEMS)}, the coordinate systems")
            for i, value in given.items():
                self.systems[int(number) - 1][i] = value + (0.0 if self.absolute else self.systems[int(number) - 1][i])
        elif code == _HOME:
            over = tuple(self._place(given.get(i), i) for i in range(3))
            there = tuple(self.home[i] if i in given else None for i in range(3))
            moves = [Rapid(end=end, plane=self.plane, exact_stop=True, dispense=False) for end in (over, there)]
            self.here = [self.home[i] if i in given else self.here[i] for i in range(3)]
        else:
            for i, value in given.items():
                self.shift[i] = value if code == _LOCAL else self.here[i] - self.systems[self.system][i] - value
        if values:
            raise block.fail(9, f"address {next(iter(values))} is not used in G{code:g}")
        return moves

    def _set_modes(self, block: Words) -> None:
        for code in block.codes:
            if code not in _KNOWN:
                known = ", ".join(f"G{known:0{2 if known == int(known) else 4}}" for known in sorted(_KNOWN))
                raise block.fail(10, f"G{code:g}: must be one of {known}")
            if code in _MOTION:
                self.motion = code
            self.plane = _PLANE.get(code, self.plane)
            self.unit = _UNIT.get(code, self.unit)
            self.absolute = _ABSOLUTE.get(code, self.absolute)
            self.exact_stop = _EXACT_STOP.get(code, self.exact_stop)
            self.continuous = _EXACT_STOP.get(code) is False or (self.continuous and not self.exact_stop)
            self.side = _SIDE.get(code, self.side)
            self.system = _SYSTEMS.get(int(code), self.system)
            if code in _CONTOUR:
                switch = block.values.pop(_CONTOUR[code], None)
                if switch not in (0, 1):
                    raise block.fail(9, f"G{code:g} must have {_CONTOUR[code]}0 or {_CONTOUR[code]}1")
                self.ahead = switch == 1
        if "D" in block.values:
            number = f"{block.values.pop('D'):g}"
            if number not in self.offsets and number != "0":
                given = ", ".join(sorted(self.offsets)) or "none"
                raise block.fail(9, f"D{number}: must be one of the program's offsets, {given}")
            self.offset = float(self.offsets.get(number, 0.0))
        for code in block.auxiliary:
            self.glue = _GLUE.get(code, self.glue)

    def _dwell(self, block: Words, values: dict[str, float]) -> Dwell:
        seconds = values.pop("X", None)
        milliseconds = values.pop("P", None)
        time = seconds if seconds is not None else (milliseconds or 0.0) * 1e-3
        if values or (seconds is None and milliseconds is None) or time < 0:
            raise block.fail(9, "G04 must have X [s] or P [ms], at least 0, and no other address")
        return Dwell(time=time, dispense=self.glue)

    def _motion(self, block: Words, values: dict[str, float]) -> Block:
        for letter in _LENGTHS & values.keys():
            values[letter] *= self.unit
        if _MACHINE in block.codes:
            if self.motion not in (0, 1):
                raise block.fail(10, "G53 must be with G00 or G01")
            end = [values.pop(letter, None) for letter in _ENDS]
        else:
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
            "exact_stop": self.exact_stop or self.halting,
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
        if value is None:
            return None
        return value + (self._origin(i) if self.absolute else self.here[i])

    def _straight(self, block: Words, values: dict[str, float], common: dict[str, Any]) -> Block:
        if self.motion == 0:
            return Rapid(**{**common, "dispense": common["dispense"] and self.governed})
        return Line(feed=self._required_feed(block), **common)

    def _required_feed(self, block: Words) -> float:
        if self.feed is None:
            raise block.fail(11, "a motion at feed must have an F, in its block or before")
        return self.feed

    def _round(self, block: Words, values: dict[str, float], common: dict[str, Any], end: list[float | None]) -> Block:
        turning: dict[str, Any] = {"clockwise": self.motion == 2, "feed": self._required_feed(block)}
        first, second, across = PLANES[self.plane]
        i = values.pop(_CENTRES[first], None)
        j = values.pop(_CENTRES[second], None)
        up = values.pop(_CENTRES[across], None)
        change = values.pop("Q", None)
        turns = values.pop("L", None)
        radius = values.pop("R", None)
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
