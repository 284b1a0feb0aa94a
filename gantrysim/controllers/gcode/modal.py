"""The modal state of a program: words of a block in, moves out."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import replace

from gantrysim.base.errors import InputError
from gantrysim.controllers.gcode.dialect import Dialect, Dispense
from gantrysim.controllers.gcode.frames import Frames, unit_of
from gantrysim.controllers.gcode.lines import Words
from gantrysim.controllers.gcode.motions import Modes, Motions
from gantrysim.controllers.gcode.moves import EXACT_PATH, EXACT_STOP, Moves

_AXES = "XYZ"
_MOTION = {0, 10, 20, 30, 50, 51}


class Modal(Motions):
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
        frames = Frames(list(moves.start), tools=tools)
        frames.stored = {280: list(moves.start), 300: list(moves.start)}
        super().__init__(moves, dialect, dispense, tolerance, frames, Modes(path=path))
        self.lacking = lacking
        self.ignored: Counter[str] = Counter()
        self._saved: dict[int, tuple[Modes, float, bool]] = {}  # by the depth of calls
        self._restored: set[int] = set()  # depths at whose end they come back
        self.depth = 0
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
            if self.extrudes and not codes:  # the words of the others are theirs
                return self._auxiliary(auxiliary, values)
            going = self._auxiliary(auxiliary, values)
        else:
            going = True
        in_machine = False
        special = 0
        for code in codes:
            if code in _MOTION and not (code == 50 and self.extrudes):
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
            self.move(values, in_machine)
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
            elif code in (82, 83) and self.extrudes:
                self.relative_extruder = code == 83
            elif code in (70, 71, 72, 73) and not self.extrudes:
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
        if self.extrudes and codes and not {82, 83} & set(codes):
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
        modes = self.modes
        frames = self.frames
        if code in (170, 180, 190):
            modes.plane = (code - 170) // 10
        elif code in (200, 210):
            frames.unit = unit_of(code)
        elif code in (900, 910):
            frames.absolute = code == 900
            if self.extrudes:
                self.relative_extruder = code == 910
        elif code in (901, 911):
            modes.centres = code == 901
        elif code in (930, 940, 950):
            modes.feed_code = code
        elif code == 610:
            modes.path = EXACT_PATH
            modes.naive = 0.0
        elif code == 611:
            modes.path = EXACT_STOP
            modes.naive = 0.0
        elif code == 640:
            p = values.pop("P", None)
            q = values.pop("Q", None)
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
            self.pause(times[0])
        elif code in (281, 301):
            frames.stored[code - 1] = list(frames.here)
        elif code in (280, 300):
            if any(letter in values for letter in _AXES):
                moved = [letter in values for letter in _AXES]
                self.straight(frames.end(values, False), 0.0, False)
            else:
                moved = [True] * 3
            stored = frames.stored[code]
            self.straight(
                [there if m else h for there, h, m in zip(stored, frames.here, moved, strict=True)], 0.0, False
            )
        elif code in (520, 920):
            if "E" in values and self.extrudes:
                self.extruder = values.pop("E")
            frames.set_shift(values, code == 520)
        else:
            kind = values.pop("L", None)
            number = values.pop("P", 0.0)
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
            return {"_vmajor": 2.9, "_motion_mode": float(self.motion)}.get(str(key), 0.0)
        return self.frames.shown(key)
