"""The motions of a program in its modes: lines, arcs, splines, dwells."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from gantrysim.base.errors import InputError
from gantrysim.controllers.gcode.dialect import Dialect, Dispense
from gantrysim.controllers.gcode.frames import Frames
from gantrysim.controllers.gcode.moves import (
    ARC,
    DWELL,
    EXACT_STOP,
    LINE,
    PLANES,
    Moves,
    centre_by_radius,
    swept_angle,
)
from gantrysim.controllers.gcode.splines import chords

_CENTRES = "IJK"
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


class Motions:
    """Adds moves in the modes that are in force.

    Args:
        moves: to which moves are added.
        dialect: the words.
        dispense: when glue is laid.
        tolerance: of an arc's radius at its end [mm].
        frames: the coordinate systems.
        modes: the modes.
    """

    def __init__(
        self, moves: Moves, dialect: Dialect, dispense: Dispense, tolerance: float, frames: Frames, modes: Modes
    ) -> None:
        self.moves = moves
        self.dialect = dialect
        self.dispense = dispense
        self.tolerance = tolerance
        self.frames = frames
        self.modes = modes
        self.extrudes = dialect.extrudes
        self.motion = 10 if self.extrudes else 0  # G code in tenths
        self.glue = False
        self.extruder = 0.0
        self.relative_extruder = False
        self.line = 0
        self._control: complex | None = None  # of the cubic before, to the next one's first

    def move(self, values: dict[str, float], in_machine: bool) -> None:
        """Run the words of a move, and take them from the values."""
        letters = values.keys()
        moves = not letters.isdisjoint("XYZ@^") or (self.motion in (20, 30) and not letters.isdisjoint("IJKR"))
        if self.motion in (50, 51):
            moves = moves or not letters.isdisjoint("IJPQ")
        fed = self._fed(values) if self.extrudes and "E" in values else 0.0
        if not moves:
            if fed and self.motion in (0, 10):  # a retraction: the nozzle stands
                feed = self.modes.feed * self.frames.unit / 60
                self.pause(abs(fed) / feed if feed else 0.0)
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
            rapid = self.motion == 0 and not self.extrudes
            self.straight(end, 0.0 if rapid else self._feed(math.dist(start, end)), not rapid, fed)
        if self.motion not in (50, 51):
            self._control = None

    def _fed(self, values: dict[str, float]) -> float:
        """Material that a move feeds [mm]."""
        e = values.pop("E")
        if self.relative_extruder:
            self.extruder += e
            return e * self.frames.unit
        fed = e - self.extruder
        self.extruder = e
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

    def straight(self, end: list[float], feed: float, at_feed: bool, fed: float = 0.0) -> None:
        """Add a line to a place of the machine [mm]."""
        if not max(map(abs, end)) <= _FARTHEST:
            raise InputError(f"end at {[round(v, 3) for v in end]} mm: must be within {_FARTHEST:g} mm")
        modes = self.modes
        self.moves.add(LINE, end, feed, modes.path, modes.naive, self._lays(at_feed, fed), self.line, fed)
        self.frames.here = end

    def pause(self, time: float) -> None:
        """Add a dwell [s]."""
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
        a = complex(before[u], before[v])
        b = complex(after[u], after[v])
        i = values.pop(_CENTRES[u], None)
        j = values.pop(_CENTRES[v], None)
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
        feed = self._feed(length)
        modes = self.modes
        if not max(*map(abs, end), *map(abs, placed)) <= _FARTHEST:
            raise InputError(f"arc to {[round(c, 3) for c in end]} mm: must be within {_FARTHEST:g} mm")
        glue = self._lays(True, fed)
        self.moves.add(
            ARC, end, feed, modes.path, modes.naive, glue, self.line, fed, (placed[u], placed[v]), modes.plane, angle
        )
        frames.here = end

    def _checked(self, begin: complex, end: complex, clockwise: bool, turns: int) -> float:
        radius = abs(begin)
        reached = abs(end)
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
        a = complex(before[0], before[1])
        b = complex(after[0], after[1])
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
            self.straight(frames.machine([place.real, place.imag, z]), feed, True)
