"""The modal state of a program: words of a block in, moves out."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, replace
from typing import Any

from gantrysim.controllers.gcode.dialect import Dialect, Dispense
from gantrysim.controllers.gcode.frames import Frames, unit_of
from gantrysim.controllers.gcode.lines import Words
from gantrysim.controllers.gcode.moves import (
    ARC,
    DWELL,
    EXACT_PATH,
    EXACT_STOP,
    LINE,
    PLANES,
    Moves,
    centre_by_radius,
    swept_angle,
)
from gantrysim.controllers.gcode.splines import chords
from gantrysim.errors import InputError

_AXES, _CENTRES = "XYZ", "IJK"
_MOTION = {0, 10, 20, 30, 50, 51}
_LENGTHS = "IJKR"
_RELATIVE = 1e-3  # difference of an arc's radii, of the radius
_WORST = 100  # times the tolerance, which the relative one does not excuse
_COARSE = 2.54  # times the tolerance, in inches
_FARTHEST = 1e7  # [mm]


@dataclass
class Modes:
    """The modes that M70 saves.

    Attributes:
        plane: index, of G17, G18, G19.
        path: mode of `Moves` [mm].
        naive: tolerance of merged lines [mm].
        centres: whether I, J, K are absolute (G90.1).
        feed_code: 930, 940 or 950.
        feed: F as programmed.
        spindle: S.
    """

    plane: int = 0
    path: float = math.inf
    naive: float = 0.0
    centres: bool = False
    feed_code: int = 940
    feed: float = 0.0
    spindle: float = 0.0


class Modal:
    """Applies the words of blocks one after the other.

    Args:
        moves: to which moves are added.
        dialect: the words.
        dispense: when glue is laid.
        tolerance: of an arc's radius at its end [mm].
        lacking: letters of axes that the machine lacks, which are counted and skipped.
        tools: lengths of tools by number [mm].
        path: initial mode of corners, as of `Moves` [mm].
        given: parameters by name.
    """

    def __init__(
        self,
        moves: Moves,
        dialect: Dialect,
        dispense: Dispense,
        tolerance: float,
        lacking: str,
        tools: dict[int, float],
        path: float,
        given: dict[str, float],
    ) -> None:
        self.moves, self.dialect, self.dispense = moves, dialect, dispense
        self.tolerance, self.lacking = tolerance, lacking
        self.frames = Frames(list(moves.start), tools=tools)
        self.frames.stored = {280: list(moves.start), 300: list(moves.start)}
        self.modes = Modes(path=path)
        self.ignored: Counter[str] = Counter()
        self.motion: int | None = 10 if dialect.extrudes else 0
        self.glue = False
        self.extruder, self.relative_extruder = 0.0, False
        self._saved: dict[int, tuple[Modes, float, bool]] = {}  # by the depth of calls
        self._restored: set[int] = set()  # depths at whose end they come back
        self._control: complex | None = None  # of the cubic before, to the next one's first
        self.line = self.depth = 0
        self._given = given

    def run(self, words: Words) -> bool:
        """Apply a block; return whether the program goes on.

        Raises:
            InputError: a word, or a combination of words, that the dialect refuses.
        """
        values: dict[str, float] = {}
        codes: list[int] = []
        auxiliary: list[int] = []
        for letter, value in words:
            if letter == "G":
                codes.append(round(10 * value))
                if abs(codes[-1] - 10 * value) > 1e-6:
                    raise InputError(f"G{value:g}: must have one decimal at most")
            elif letter == "M":
                auxiliary.append(round(value))
                if auxiliary[-1] != value and not self.dialect.lenient:
                    raise InputError(f"M{value:g}: must be a whole number")
            elif letter in values and letter != "N":
                raise InputError(f"{letter} is given twice in the block")
            else:
                values[letter] = value
        values.pop("N", None)
        if auxiliary:
            if self.dialect.extrudes and not codes:  # the words of the others are theirs
                return self._auxiliary(auxiliary, values)
            going = self._auxiliary(auxiliary, values)
        else:
            going = True
        in_machine = False
        special = 0
        for code in codes:
            if code in _MOTION and not (code == 50 and self.dialect.extrudes):
                self.motion = code
            elif code == 530:
                in_machine = True
            elif code in (40, 100, 280, 281, 300, 301, 520, 920) and code not in self.dialect.nothing:
                if special:
                    raise InputError(
                        f"G{special / 10:g} and G{code / 10:g} in one block: must be in blocks of their own"
                    )
                special = code
            else:
                self._mode(code, values)
        if "F" in values:
            self.modes.feed = values.pop("F")
            if self.modes.feed < 0:
                raise InputError(f"F = {self.modes.feed:g}: must be at least 0")
        for letter in self.lacking:
            if letter in values:
                values.pop(letter)
                self.ignored[f"axis {letter}"] += 1
        if special:
            self._special(special, values)
        if values and (not special or (special == 40 and not _MOTION.isdisjoint(codes))):
            self._move(values, in_machine)
        if values:
            self._left(values)
        return going

    def _left(self, values: dict[str, float]) -> None:
        for letter in list(values):
            if letter in self.dialect.letters:
                self.modes.spindle = values[letter] if letter == "S" else self.modes.spindle
                if letter != "S":
                    self.ignored[letter] += 1
                del values[letter]
        if values:
            letter = next(iter(values))
            if letter in "ABCUVW":
                raise InputError(f"{letter}: the machine has the axes x, y, z; skip_axes = {letter!r} skips the word")
            if not self.dialect.lenient:
                raise InputError(f"{letter}{values[letter]:g}: is not used in this block")
            self.ignored[letter] += 1

    def _auxiliary(self, codes: list[int], values: dict[str, float]) -> bool:
        going = True
        for code in codes:
            number = values.get("P")
            switched = self.dispense.switch(code, number) if self.dispense.by == "codes" else None
            if switched is not None:
                self.glue = switched
            if code in (2, 30):
                going = False
            elif code in (82, 83) and self.dialect.extrudes:
                self.relative_extruder = code == 83
            elif code in (70, 71, 72, 73) and not self.dialect.extrudes:
                self._memory(code)
            elif code in self.dialect.unheeded:
                if switched is None:
                    self.ignored[f"M{code}"] += 1
            elif self.dialect.lenient:
                self.ignored[f"M{code}"] += 1
            else:
                raise InputError(f"M{code}: is no word of {self.dialect.name}")
            if 62 <= code <= 68 or 100 <= code < 200 or code in (19, 50, 51, 52, 53, 61):
                for letter in "PQERL":
                    values.pop(letter, None)
        if self.dialect.extrudes and codes and not {82, 83} & set(codes):
            values.clear()
        return going

    def _memory(self, code: int) -> None:
        if code in (70, 73):
            self._saved[self.depth] = replace(self.modes), self.frames.unit, self.frames.absolute
            self._restored.discard(self.depth)
            if code == 73:
                self._restored.add(self.depth)
        elif code == 71:
            self._saved.pop(self.depth, None)
        elif self.depth in self._saved:
            modes, self.frames.unit, self.frames.absolute = self._saved[self.depth]
            self.modes = replace(modes)
        else:
            raise InputError("M72: must follow M70 or M73 in the same subroutine")

    def left(self, depth: int) -> None:
        """Note that a subroutine ends, at the depth of its call."""
        self.depth = depth
        if depth in self._restored and depth in self._saved:
            self._memory(72)
        self._restored.discard(depth)
        self._saved.pop(depth, None)

    def _mode(self, code: int, values: dict[str, float]) -> None:
        modes, frames = self.modes, self.frames
        if code in (170, 180, 190):
            modes.plane = (code - 170) // 10
        elif code in (200, 210):
            frames.unit = unit_of(code)
        elif code in (900, 910):
            frames.absolute = code == 900
            if self.dialect.extrudes:
                self.relative_extruder = code == 910
        elif code in (901, 911):
            modes.centres = code == 901
        elif code in (930, 940, 950):
            modes.feed_code = code
        elif code == 610:
            modes.path, modes.naive = EXACT_PATH, 0.0
        elif code == 611:
            modes.path, modes.naive = EXACT_STOP, 0.0
        elif code == 640:
            p, q = values.pop("P", None), values.pop("Q", None)
            values.pop("R", None)
            modes.path = p * frames.unit if p else math.inf
            modes.naive = (q if q is not None else p or 0.0) * frames.unit
            if min(modes.path, modes.naive) < 0:
                raise InputError("G64: P and Q must be at least 0")
        elif 540 <= code <= 590 and code % 10 == 0:
            frames.system = (code - 530) // 10
        elif code in (591, 592, 593):
            frames.system = code - 584
        elif code in (430, 431, 432, 490):
            self._tool_length(code, values)
        elif code in (70, 80):
            frames.diameter = code == 70
        elif code in (921, 922, 923):
            frames.shift = list(frames.kept) if code == 923 else [0.0] * 3
            if code == 921:
                frames.kept = [0.0] * 3
        elif code == 400:
            pass
        elif code in (410, 411, 420, 421):
            raise InputError(f"G{code / 10:g}: cutter compensation is not simulated; program the nozzle's path")
        elif code in self.dialect.refused:
            raise InputError(f"G{code / 10:g}: {self.dialect.refused[code]} is not simulated")
        elif code in self.dialect.nothing or self.dialect.lenient:
            self.ignored[f"G{code / 10:g}"] += 1
            if self.dialect.lenient:
                values.clear()
        else:
            raise InputError(f"G{code / 10:g}: is no word of {self.dialect.name}")

    def _tool_length(self, code: int, values: dict[str, float]) -> None:
        frames = self.frames
        if code == 490:
            frames.tool = 0.0
        elif code == 431:
            frames.tool = frames.unit * values.pop("Z", 0.0)
            for letter in "XY":
                values.pop(letter, None)
        else:
            length = frames.tools.get(int(values.pop("H", 0)), 0.0)
            frames.tool = length + (frames.tool if code == 432 else 0.0)

    def _special(self, code: int, values: dict[str, float]) -> None:
        frames = self.frames
        if code == 40:
            times = [values.pop(letter) * unit for letter, unit in self.dialect.dwell.items() if letter in values]
            if not times or min(times) < 0:
                words = " or ".join(self.dialect.dwell)
                raise InputError(f"G4: must have {words}, at least 0")
            self._dwell(times[0])
        elif code in (281, 301):
            frames.stored[code - 1] = list(frames.here)
        elif code in (280, 300):
            if any(letter in values for letter in _AXES):
                moved = [letter in values for letter in _AXES]
                self._line(frames.end(values, False), 0.0, False)
            else:
                moved = [True] * 3
            stored = frames.stored[code]
            self._line([there if m else h for there, h, m in zip(stored, frames.here, moved, strict=True)], 0.0, False)
        elif code in (520, 920):
            if "E" in values and self.dialect.extrudes:
                self.extruder = values.pop("E")
            frames.set_shift(values, code == 520)
        else:
            kind, number = values.pop("L", None), values.pop("P", 0.0)
            if kind in (2, 20):
                frames.set_offset(number, values, kind == 20)
            elif kind == 1:
                frames.tools[int(number)] = frames.unit * values.pop("Z", 0.0)
                self._forget(values)
            elif kind in (0, 10, 11):
                self.ignored[f"G10 L{kind:g}"] += 1
                self._forget(values)
            else:
                raise InputError(f"G10 L{kind}: must be L1, L2, L10, L11 or L20")

    @staticmethod
    def _forget(values: dict[str, float]) -> None:
        for letter in "XYZABCUVWRIJQ":
            values.pop(letter, None)

    def _move(self, values: dict[str, float], in_machine: bool) -> None:
        letters = values.keys()
        moves = not letters.isdisjoint("XYZ@^") or (self.motion in (20, 30) and not letters.isdisjoint("IJKR"))
        if self.motion in (50, 51):
            moves = moves or not letters.isdisjoint("IJPQ")
        fed = self._fed(values) if self.dialect.extrudes and "E" in values else 0.0
        if not moves:
            if fed and self.motion in (0, 10):  # a retraction: the nozzle stands
                feed = self.modes.feed * self.frames.unit / 60
                self._dwell(abs(fed) / feed if feed else 0.0)
            return
        frames = self.frames
        start = frames.here
        if in_machine and self.motion not in (0, 10):
            raise InputError("G53: must be with G0 or G1")
        if self.motion in (20, 30):
            self._arc(frames, start, values, fed)
        elif self.motion in (50, 51):
            self._spline(frames, values)
        else:
            end = frames.end(values, in_machine)
            rapid = self.motion == 0 and not self.dialect.extrudes
            if self.motion is None:
                raise InputError("axis words without a motion: must have G0, G1, G2 or G3")
            self._line(end, 0.0 if rapid else self._feed(math.dist(start, end)), not rapid, fed)
        if self.motion not in (50, 51):
            self._control = None

    def _fed(self, values: dict[str, float]) -> float:
        """Material that a move feeds [mm]."""
        e = values.pop("E")
        if self.relative_extruder:
            self.extruder += e
            return e * self.frames.unit
        fed, self.extruder = e - self.extruder, e
        return fed * self.frames.unit

    def _feed(self, length: float) -> float:
        """Path speed of a move at feed [mm/s]."""
        modes = self.modes
        if modes.feed <= 0:
            raise InputError("a motion at feed must have an F above 0, in its block or before")
        if modes.feed_code == 930:
            return max(modes.feed * length / 60, 1e-9)
        feed = modes.feed * self.frames.unit / 60
        if modes.feed_code == 950:
            if modes.spindle == 0:
                raise InputError("G95: feed per revolution must have a spindle speed S")
            return feed * abs(modes.spindle)
        return feed

    def _lays(self, at_feed: bool, fed: float) -> bool:
        by = self.dispense.by
        return self.glue if by == "codes" else fed > 0 if by == "extrusion" else at_feed

    def _line(self, end: list[float], feed: float, at_feed: bool, fed: float = 0.0) -> None:
        if not max(map(abs, end)) <= _FARTHEST:
            raise InputError(f"end at {[round(v, 3) for v in end]} mm: must be within {_FARTHEST:g} mm")
        modes = self.modes
        self.moves.add(LINE, end, feed, modes.path, modes.naive, self._lays(at_feed, fed), self.line, fed)
        self.frames.here = end

    def _dwell(self, time: float) -> None:
        glue = self.glue and self.dispense.by == "codes"
        self.moves.add(DWELL, self.frames.here, time, EXACT_STOP, 0.0, glue, self.line)

    def _arc(self, frames: Frames, start: list[float], values: dict[str, float], fed: float) -> None:
        clockwise = self.motion == 20
        for letter in _LENGTHS:
            if letter in values:
                values[letter] *= frames.unit
        u, v, w = PLANES[self.modes.plane]
        turns = values.pop("P", 1.0)
        if turns != int(turns) or not 1 <= turns <= 10_000:
            raise InputError(f"P = {turns:g}: must be a whole number of turns, from 1 to 10000")
        before = frames.program(start)
        end = frames.end(values, False)
        after = frames.program(end)
        a, b = complex(before[u], before[v]), complex(after[u], after[v])
        i, j = values.pop(_CENTRES[u], None), values.pop(_CENTRES[v], None)
        if _CENTRES[w] in values:
            raise InputError(f"{_CENTRES[w]} in G{17 + self.modes.plane}: the centre must be given in the plane")
        radius = values.pop("R", None)
        if radius is not None:
            if i is not None or j is not None:
                raise InputError("arc by R and by its centre: must be one of them")
            centre = centre_by_radius(a, b, radius, clockwise, self.tolerance)
        elif i is None and j is None:
            raise InputError(f"arc without {_CENTRES[u]}, {_CENTRES[v]} and R: must have a centre or a radius")
        else:
            centre = complex(i or 0.0, j or 0.0) + (0.0 if self.modes.centres else a)
        angle = self._checked(a - centre, b - centre, clockwise, int(turns))
        middle = list(before)
        middle[u], middle[v] = centre.real, centre.imag
        placed = frames.machine(middle)
        if self.modes.plane and frames.turns[frames.system]:
            raise InputError(f"G{17 + self.modes.plane} arc under a turned coordinate system: must be in G17")
        length = math.hypot(angle * 0.5 * (abs(a - centre) + abs(b - centre)), end[w] - start[w])
        feed, modes = self._feed(length), self.modes
        if not max(*map(abs, end), *map(abs, placed)) <= _FARTHEST:
            raise InputError(f"arc to {[round(c, 3) for c in end]} mm: must be within {_FARTHEST:g} mm")
        glue = self._lays(True, fed)
        self.moves.add(
            ARC, end, feed, modes.path, modes.naive, glue, self.line, fed, (placed[u], placed[v]), modes.plane, angle
        )
        frames.here = end

    def _checked(self, begin: complex, end: complex, clockwise: bool, turns: int) -> float:
        radius, reached = abs(begin), abs(end)
        if min(radius, reached) < 1e-6:
            raise InputError("radius = 0 mm: must be greater than 0 mm")
        error = abs(radius - reached)
        tolerance = self.tolerance * (1.0 if self.frames.unit == 1.0 else _COARSE)
        if error > _WORST * tolerance or (error > tolerance and error > _RELATIVE * max(radius, reached)):
            raise InputError(
                f"radius = {radius:.6g} mm at the start, {reached:.6g} mm at the end: difference {error:.4g} mm "
                f"must be at most arc_tolerance, {tolerance:g} mm"
            )
        return swept_angle(begin, end, clockwise, turns)

    def _spline(self, frames: Frames, values: dict[str, float]) -> None:
        if self.modes.plane:
            raise InputError(f"G5 in G{17 + self.modes.plane}: must be in G17")
        before = frames.program(frames.here)
        words: dict[str, Any] = {letter: values.pop(letter, None) for letter in "IJPQ"}
        scaled = {letter: None if value is None else value * frames.unit for letter, value in words.items()}
        after = frames.program(frames.end(values, False))
        a, b = complex(before[0], before[1]), complex(after[0], after[1])
        first = complex(scaled["I"] or 0.0, scaled["J"] or 0.0)
        if self.motion == 51:
            points = [a, a + first, b]
            self._control = None
        else:
            if scaled["I"] is None and scaled["J"] is None:
                if self._control is None:
                    raise InputError("G5 without I and J: must follow another G5")
                first = self._control
            last = complex(scaled["P"] or 0.0, scaled["Q"] or 0.0)
            points = [a, a + first, b + last, b]
            self._control = -last
        feed = self._feed(abs(b - a))
        for place, share in chords(points):
            z = before[2] + share * (after[2] - before[2])
            self._line(frames.machine([place.real, place.imag, z]), feed, True)

    def provided(self, key: float | str) -> float | None:
        """Return a parameter of the controller; None for others."""
        modes = self.modes
        if isinstance(key, str) and key in self._given:
            return self._given[key]
        if key == "_line":
            return float(self.line)
        if key in ("_feed", "_rpm", "_plane"):
            return {"_feed": modes.feed, "_rpm": modes.spindle, "_plane": 170.0 + 10 * modes.plane}[str(key)]
        if key in (
            "_vmajor",
            "_vminor",
            "_task",
            "_call_level",
            "_remap_level",
            "_motion_mode",
            "_value",
            "_value_returned",
        ):
            return {"_vmajor": 2.9, "_motion_mode": float(self.motion or 0)}.get(str(key), 0.0)
        return self.frames.shown(key)
