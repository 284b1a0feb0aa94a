"""Cutter compensation: the nozzle's path at an offset beside the programmed one, as LinuxCNC has it.

The move in which it begins ends beside the programmed end, at a right angle to the move. Around an outer corner an arc
of the offset about the corner joins the moves; at an inner one both are cut where they meet. A move changes after it
is added, as the end of a move depends on the one that follows.
"""

from __future__ import annotations

import cmath
import math
from typing import NamedTuple

from gantrysim.base.errors import InputError
from gantrysim.controllers.gcode.move_table import ARC, DWELL, END, PLANES, MoveRow, MoveTable
from gantrysim.paths.plane_moves import PlaneMove, meeting

_STRAIGHT_ON = 0.05  # corner that is none, LinuxCNC's [rad]
_NAMES = "xyz"
_ARC_ROUNDING = 1e-6  # angle of an arc that is left [rad]


class _Last(NamedTuple):
    """The last move in the plane.

    Attributes:
        row: of the table.
        beside: the offset move, as far as it was added.
        is_entry: whether compensation begins in it.
    """

    row: int
    beside: PlaneMove
    is_entry: bool = False


class CutterCompensation:
    """Adds moves beside programmed ones.

    Args:
        moves: to which moves are added.
    """

    def __init__(self, moves: MoveTable) -> None:
        self._moves = moves
        # positive to the left [mm]
        self._offset = 0.0
        self._plane = 0
        self._last: _Last | None = None
        # whether the nozzle is still beside the path, which a straight move ends
        self._leaves = False

    @property
    def is_on(self) -> bool:
        """Whether moves are offset."""
        return self._offset != 0

    def begin(self, offset: float, plane: int) -> None:
        """Offset the moves that follow.

        Args:
            offset: positive to the left [mm].
            plane: its index.
        """
        self._offset = offset
        self._plane = plane
        self._last = None

    def end(self) -> None:
        """Add the moves that follow as programmed, the first of them from where the nozzle is."""
        self._leaves = self._last is not None
        self._offset = 0.0
        self._last = None

    def add(self, move: MoveRow, start: list[float]) -> None:
        """Add a programmed move from its start [mm].

        Raises:
            InputError: a move or a corner in which the nozzle has no room beside the path.
        """
        if not self._offset:
            if self._leaves and move.kind == ARC:
                raise InputError("arc after cutter compensation has ended: must follow a straight move")
            if self._leaves and move.kind == DWELL:
                last = self._moves.row(len(self._moves) - 1)
                move = move._replace(x=last.x, y=last.y, z=last.z)
            self._leaves = self._leaves and move.kind == DWELL
            self._moves.add(move)
            return
        programmed = self._in_plane(move, start)
        if move.kind == DWELL or programmed.stands:
            self._add_beside(move)
            return
        if programmed.turns_towards(self._offset) and programmed.smallest_radius <= abs(self._offset):
            raise InputError(
                f"radius = {programmed.smallest_radius:.6g} mm: must be greater than the offset of "
                f"cutter compensation, {abs(self._offset):.6g} mm"
            )
        if self._last is None:
            self._enter(move, programmed)
        else:
            self._join(move, programmed, self._last)

    def _in_plane(self, move: MoveRow, start: list[float]) -> PlaneMove:
        first, second, _ = PLANES[self._plane]
        begin = complex(start[first], start[second])
        end = complex(move[END + first], move[END + second])
        if move.kind == ARC:
            return PlaneMove(begin, end, complex(move.u, move.v), move.angle)
        return PlaneMove(begin, end)

    def _add_beside(self, move: MoveRow) -> None:
        """Add a dwell, or a move across the plane, where the nozzle is."""
        if self._last is None:
            if move.kind != DWELL:
                raise InputError("cutter compensation begins in a move across its plane: must begin in the plane")
            self._moves.add(move)
            return
        self._moves.add(self._at(move, self._last.beside.end))

    def _at(self, move: MoveRow, place: complex) -> MoveRow:
        """A move that ends at a place of the plane, at its own height."""
        first, second, _ = PLANES[self._plane]
        return move._replace(**{_NAMES[first]: place.real, _NAMES[second]: place.imag})

    def _enter(self, move: MoveRow, programmed: PlaneMove) -> None:
        length = abs(programmed.end - programmed.start)
        if length <= abs(self._offset):
            raise InputError(
                f"cutter compensation begins in a move of {length:.6g} mm: must be longer than its offset, "
                f"{abs(self._offset):.6g} mm"
            )
        beside = programmed.offset_move(self._offset)
        if programmed.centre is None:
            self._moves.add(self._at(move, beside.end))
            self._last = _Last(len(self._moves) - 1, beside, is_entry=True)
            return
        # an arc from where the nozzle is that ends as the programmed one does, to whose centre its own lies in line
        inward = (programmed.centre - programmed.end) / abs(programmed.centre - programmed.end)
        chord = programmed.start - beside.end
        lean = (chord * inward.conjugate()).real
        if lean <= 0:
            raise InputError("cutter compensation begins in an arc that leaves no room for it: must be longer")
        radius = abs(chord) ** 2 / (2 * lean)
        arc = _swept_arc(programmed.start, beside.end, beside.end + radius * inward, programmed.angle)
        self._add_arc(move, arc, is_entry=True)

    def _join(self, move: MoveRow, programmed: PlaneMove, last: _Last) -> None:
        beside = programmed.offset_move(self._offset)
        here = last.beside.end
        corner = cmath.phase(programmed.first_tangent / last.beside.last_tangent)
        # positive towards the nozzle
        inward = corner if self._offset > 0 else -corner
        reverses = abs(inward) > math.pi - _STRAIGHT_ON
        if abs(inward) < _STRAIGHT_ON:
            beside = beside.begun_at(here)
        elif self._is_outside_arc(beside, last.beside) if reverses else inward > 0:
            beside = self._cut_at_meeting(beside, last)
        else:
            self._go_round(move, programmed.start, here, beside.start)
        if beside.centre is None:
            self._moves.add(self._at(move, beside.end))
            self._last = _Last(len(self._moves) - 1, beside)
        elif beside.angle * programmed.angle > 0:
            self._add_arc(move, beside)

    def _is_outside_arc(self, beside: PlaneMove, before: PlaneMove) -> bool:
        """Whether a move that turns back leads along an arc on its outside: the two then meet above the arc."""
        arc = before if beside.centre is None else beside
        return arc.centre is not None and not arc.turns_towards(self._offset)

    def _go_round(self, move: MoveRow, corner: complex, begin: complex, end: complex) -> None:
        """Add the way around an outer corner: an arc about it, and in a rapid move a line."""
        across = PLANES[self._plane][2]
        height = self._moves.row(len(self._moves) - 1)[END + across]
        level = move._replace(**{_NAMES[across]: height, "flow": 0.0})
        if move.feed == 0:
            self._moves.add(self._at(level, end))
            return
        sense = -1.0 if self._offset > 0 else 1.0
        angle = sense * (sense * cmath.phase((end - corner) / (begin - corner)) % (2 * math.pi))
        self._add_arc(level, PlaneMove(begin, end, corner, angle))

    def _add_arc(self, move: MoveRow, arc: PlaneMove, is_entry: bool = False) -> None:
        assert arc.centre is not None
        row = self._at(move, arc.end)
        row = row._replace(kind=ARC, u=arc.centre.real, v=arc.centre.imag, plane=self._plane, angle=arc.angle)
        self._moves.add(row)
        self._last = _Last(len(self._moves) - 1, arc, is_entry)

    def _cut_at_meeting(self, beside: PlaneMove, last: _Last) -> PlaneMove:
        """End the move before where it meets a move, and return what is left of that one."""
        place = meeting(last.beside, beside)
        if place is None or _exceeds(beside, beside.onward(place)):
            raise self._no_room("move")
        # the straight move in which compensation begins leads beside its own path in any case
        enters = last.is_entry and last.beside.centre is None
        if not enters and _exceeds(last.beside, last.beside.back(place)):
            raise self._no_room("move before")
        self._moves_end(last.beside.until(place), last.row)
        return beside.without(place)

    def _moves_end(self, shorter: PlaneMove, row: int) -> None:
        """End the last move in the plane earlier, and with it what has followed across the plane."""
        for k in range(row, len(self._moves)):
            changed = self._at(self._moves.row(k), shorter.end)
            if changed.kind == ARC:
                changed = changed._replace(angle=shorter.angle)
            self._moves.change(k, changed)

    def _no_room(self, name: str) -> InputError:
        return InputError(
            f"inner corner of cutter compensation: the {name} must be longer, or the offset of "
            f"{abs(self._offset):.6g} mm smaller, for the nozzle to fit in"
        )


def _exceeds(move: PlaneMove, way: float) -> bool:
    """Whether a way from one end of a move goes beyond its other end."""
    if move.centre is None:
        return way > abs(move.end - move.start)
    return way > abs(move.angle) - _ARC_ROUNDING


def _swept_arc(start: complex, end: complex, centre: complex, programmed: float) -> PlaneMove:
    """An arc about a centre in the sense of a programmed one, with as many turns."""
    sense = math.copysign(1.0, programmed)
    angle = sense * cmath.phase((end - centre) / (start - centre)) % (2 * math.pi)
    angle += (math.ceil(abs(programmed) / (2 * math.pi) - 1e-9) - 1) * 2 * math.pi
    return PlaneMove(start, end, centre, sense * angle)
