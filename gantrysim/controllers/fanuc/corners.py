"""Chamfers, `,C`, and rounded corners, `,R`, between motions of one plane."""

from __future__ import annotations

import cmath
import math
from dataclasses import replace

import numpy as np

from gantrysim.controllers.fanuc.blocks import FRAMES, PLANES, Dwell, Plane
from gantrysim.controllers.fanuc.legs import PathLeg
from gantrysim.paths.pieces import Coil, Line, Vector
from gantrysim.paths.plane_moves import PlaneMove, meeting

_STRAIGHT_TURN = 1e-6  # corner that is none [rad]


def cornered_legs(legs: list[PathLeg]) -> list[PathLeg]:
    """Return the motions with the chamfers and rounded corners that their blocks ask for.

    Raises:
        Alarm: a corner that is not between two motions at feed in one plane, or has no room for it.
    """
    legs = list(legs)
    corners = [k for k, leg in enumerate(legs) if _size(leg)]
    # from the end: what is inserted does not change the places before
    for k in reversed(corners):
        if k + 1 == len(legs) or not _can_join(legs[k + 1]):
            raise legs[k].source.fail(51, f"{_name(legs[k])}: must be followed by a motion at feed in its plane")
        if not _can_join(legs[k]) or _plane(legs[k]) != _plane(legs[k + 1]):
            raise legs[k].source.fail(50, f"{_name(legs[k])}: must be in a motion at feed in the plane of the next one")
        legs[k : k + 2] = _cut_legs(legs[k], legs[k + 1])
    return legs


def _size(leg: PathLeg) -> float:
    """Length of a chamfer, or radius of a rounded corner, at the end of a motion; 0 without [mm]."""
    block = leg.source.block
    return 0.0 if isinstance(block, Dwell) else max(block.chamfer, block.rounding)


def _name(leg: PathLeg) -> str:
    block = leg.source.block
    assert not isinstance(block, Dwell)
    return f",C{block.chamfer:g}" if block.chamfer else f",R{block.rounding:g}"


def _can_join(leg: PathLeg) -> bool:
    return leg.piece is not None and not leg.rapid and not leg.spiral and not _rises(leg)


def _rises(leg: PathLeg) -> bool:
    across = PLANES[_plane(leg)][2]
    if isinstance(leg.piece, Coil):
        return leg.piece.rise != 0
    return leg.piece is not None and leg.piece.start[across] != leg.piece.end[across]


def _plane(leg: PathLeg) -> Plane:
    block = leg.source.block
    return "xy" if isinstance(block, Dwell) else block.plane


def _cut_legs(before: PathLeg, after: PathLeg) -> list[PathLeg]:
    """The two motions, shorter, with the chamfer or arc between them."""
    first = _plane_move(before)
    second = _plane_move(after)
    bend = cmath.phase(second.first_tangent / first.last_tangent)
    size = _size(before)
    block = before.source.block
    assert not isinstance(block, Dwell)
    if abs(bend) < _STRAIGHT_TURN:
        return [before, after]
    if block.chamfer:
        if first.centre is not None or second.centre is not None:
            raise before.source.fail(
                50, f"{_name(before)}: a chamfer must be between two lines; ,R rounds other corners"
            )
        begin = first.end - size * first.last_tangent
        end = first.end + size * second.first_tangent
        corner = PlaneMove(begin, end)
    else:
        offset = math.copysign(size, bend)
        centre = None
        if not (_too_tight(first, offset) or _too_tight(second, offset)):
            centre = meeting(first.offset_move(offset), second.offset_move(offset))
        if centre is None:
            raise _no_room(before)
        begin = _foot(first, centre)
        end = _foot(second, centre)
        sense = math.copysign(1.0, bend)
        swept = sense * cmath.phase((end - centre) / (begin - centre)) % (2 * math.pi)
        corner = PlaneMove(begin, end, centre, sense * swept)
    if first.back(begin) >= _length(first) or second.onward(end) >= _length(second):
        raise _no_room(before)
    height = _height(before)
    still = (before.rotary[1], before.rotary[1])
    return [
        replace(before, piece=_piece(first.until(begin), _plane(before), height)),
        replace(
            before,
            start=_place(begin, _plane(before), height),
            piece=_piece(corner, _plane(before), height),
            rotary=still,
        ),
        replace(
            after,
            start=_place(end, _plane(before), height),
            piece=_piece(second.without(end), _plane(after), height),
        ),
    ]


def _no_room(leg: PathLeg) -> Exception:
    return leg.source.fail(55, f"{_name(leg)}: the motions before and after the corner must be longer, or it smaller")


def _too_tight(move: PlaneMove, offset: float) -> bool:
    return move.turns_towards(offset) and move.smallest_radius <= abs(offset)


def _foot(move: PlaneMove, place: complex) -> complex:
    """The point of a line or circle nearest to a place."""
    if move.centre is not None:
        arm = place - move.centre
        return move.centre + arm / abs(arm) * abs(move.end - move.centre)
    tangent = move.first_tangent
    return move.start + ((place - move.start) * tangent.conjugate()).real * tangent


def _length(move: PlaneMove) -> float:
    """Length of a line [mm], angle of an arc [rad]."""
    return abs(move.end - move.start) if move.centre is None else abs(move.angle)


def _plane_move(leg: PathLeg) -> PlaneMove:
    first, second, _ = PLANES[_plane(leg)]
    piece = leg.piece
    if isinstance(piece, Line):
        return PlaneMove(complex(piece.start[first], piece.start[second]), complex(piece.end[first], piece.end[second]))
    assert isinstance(piece, Coil)
    centre = complex(piece.centre[first], piece.centre[second])
    start = centre + cmath.rect(piece.radius[0], piece.begin)
    end = centre + cmath.rect(piece.radius[1], piece.begin + piece.angle)
    return PlaneMove(start, end, centre, piece.angle)


def _height(leg: PathLeg) -> float:
    """Height of a motion across its plane [mm]."""
    across = PLANES[_plane(leg)][2]
    assert leg.piece is not None
    return leg.piece.start[across] if isinstance(leg.piece, Line) else leg.piece.centre[across]


def _place(place: complex, plane: Plane, height: float) -> Vector:
    u, v = np.array(FRAMES[plane])
    x, y, z = (place.real * u + place.imag * v + height * np.cross(u, v)).tolist()
    return x, y, z


def _piece(move: PlaneMove, plane: Plane, height: float) -> Line | Coil:
    if move.centre is None:
        return Line(_place(move.start, plane, height), _place(move.end, plane, height), FRAMES[plane])
    arm = move.start - move.centre
    return Coil(
        centre=_place(move.centre, plane, height),
        radius=(abs(arm), abs(move.end - move.centre)),
        begin=cmath.phase(arm),
        angle=move.angle,
        frame=FRAMES[plane],
    )
