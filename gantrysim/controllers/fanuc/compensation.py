"""Cutter compensation: the path beside the programmed one.

Lines are offset along their normal, arcs and spirals along the radius, on virtual circles about their centre: that
is the controller's own way, and for a spiral not quite an offset of even distance.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from gantrysim.controllers.chain import Chain, Coil, Line, Vector
from gantrysim.controllers.fanuc.legs import Leg
from gantrysim.controllers.path import Floats

__all__ = ["compensated"]

_GAP = 1e-6  # [mm], between two ends that are one
_SHARP = math.pi / 2  # an outer corner of lines beyond it is bridged instead of extended
_SLIGHT = math.radians(5)  # an inner corner that a short bridge may cross


def compensated(legs: list[Leg]) -> list[Leg]:
    """Return the motions beside those of the program, where their compensation is not 0.

    Raises:
        Alarm: compensation that begins or ends in an arc, or a corner or an arc that the offset has no room for.
    """
    if not any(leg.compensation for leg in legs):
        return legs
    beside = [replace(leg, piece=_beside(leg)) for leg in legs]
    moving = [k for k, leg in enumerate(legs) if leg.piece is not None]
    made: list[Leg] = []
    before: Leg | None = None  # the last that moves, as it is run
    for n, k in enumerate(moving):
        leg = legs[k]
        made += [stop for stop in legs[(moving[n - 1] + 1 if n else 0) : k] if stop.piece is None]
        was = legs[moving[n - 1]].compensation if n else 0.0
        follows = beside[moving[n + 1]] if n + 1 < len(moving) else None
        if leg.compensation and not was:
            run = [_start_up(leg, beside[k], follows)]
        elif was and not leg.compensation:
            run = [_between(leg, _end(before), _end(leg))]
        elif leg.compensation:
            run = _joined(before, beside[k], made)
        else:
            run = [leg]
        made += run
        before = run[-1]
    return made + [stop for stop in legs[moving[-1] + 1 :] if stop.piece is None]


def _beside(leg: Leg) -> Line | Coil | None:
    piece, d = leg.piece, leg.compensation
    if piece is None or d == 0:
        return piece
    if isinstance(piece, Coil):
        outward = -d * math.copysign(1.0, piece.angle)
        radius = (piece.radius[0] + outward, piece.radius[1] + outward)
        if min(radius) <= 0:
            smallest = min(piece.radius)
            raise leg.source.fail(41, f"radius = {smallest:.6g} mm: must be greater than the offset, {abs(d):g} mm")
        return replace(piece, radius=radius)
    shift = d * _normal(piece)
    return replace(piece, start=_vector(np.add(piece.start, shift)), end=_vector(np.add(piece.end, shift)))


def _normal(line: Line) -> Floats:
    """Left normal in the line's plane; none where it is square to the plane."""
    u, v = np.array(line.frame)
    way = np.subtract(line.end, line.start)
    a, b = way @ u, way @ v
    size = math.hypot(a, b)
    normal: Floats = (a * v - b * u) / size if size > _GAP else np.zeros(3)
    return normal


def _start_up(leg: Leg, own: Leg, follows: Leg | None) -> Leg:
    at = follows if follows is not None and follows.compensation else None
    return _between(leg, _start(leg), _start(at) if at is not None else _end(own))


def _between(leg: Leg, start: Vector, end: Vector) -> Leg:
    if not isinstance(leg.piece, Line):
        raise leg.source.fail(34, "cutter compensation begins and ends in an arc: must be in a straight move")
    return replace(leg, start=start, piece=replace(leg.piece, start=start, end=end))


def _joined(before: Leg | None, leg: Leg, made: list[Leg]) -> list[Leg]:
    """Join a motion to the one before it, which may be lengthened or cut for it."""
    assert before is not None
    if isinstance(leg.piece, Line) and not _normal(leg.piece).any():  # square to the plane: from where we are
        way = np.subtract(leg.piece.end, leg.piece.start)
        return [_between(leg, _end(before), _vector(np.add(_end(before), way)))]
    here, there = np.array(_end(before)), np.array(_start(leg))
    gap = float(np.linalg.norm(there - here))
    corner = _corner(before, leg)
    inside = corner * leg.compensation > 0
    if gap <= _GAP:
        return [leg]
    if isinstance(before.piece, Line) and isinstance(leg.piece, Line) and (inside or abs(corner) <= _SHARP):
        meeting = here + _direction(before.piece, 1) * leg.compensation * -math.tan(0.5 * corner)
        made[made.index(before)] = _cut(before, _start(before), _vector(meeting))
        return [_cut(leg, _vector(meeting), _end(leg))]
    if inside and abs(corner) > _SLIGHT:
        raise leg.source.fail(
            41, f"inner corner of {math.degrees(abs(corner)):.4g} deg at an arc: the offset paths do not meet there"
        )
    bridge = replace(leg, start=_vector(here), piece=Line(_vector(here), _vector(there)), spiral=False)
    return [bridge, leg]


def _cut(leg: Leg, start: Vector, end: Vector) -> Leg:
    cut = _between(leg, start, end)
    if leg.piece is None or np.subtract(end, start) @ _direction(leg.piece, 0) <= 0:
        raise leg.source.fail(
            41, f"straight move is too short for the offset of {abs(leg.compensation):g} mm at its corners"
        )
    return cut


def _corner(before: Leg, leg: Leg) -> float:
    """Angle from the end of one motion to the start of the next, to the left positive [rad]."""
    assert before.piece is not None
    assert leg.piece is not None
    u, v = np.array(leg.piece.frame)
    first, second = _direction(before.piece, 1), _direction(leg.piece, 0)
    return float(np.angle(complex(second @ u, second @ v) / complex(first @ u, first @ v)))


def _direction(piece: Line | Coil, end: int) -> Floats:
    chain = Chain([piece])
    direction: Floats = chain.tangent(end * chain.length)[0]
    return direction


def _start(leg: Leg) -> Vector:
    assert leg.piece is not None
    return leg.piece.start if isinstance(leg.piece, Line) else _vector(Chain([leg.piece]).position(0.0)[0])


def _end(leg: Leg | None) -> Vector:
    assert leg is not None
    assert leg.piece is not None
    if isinstance(leg.piece, Line):
        return leg.piece.end
    chain = Chain([leg.piece])
    return _vector(chain.position(chain.length)[0])


def _vector(point: Floats) -> Vector:
    x, y, z = np.asarray(point).tolist()
    return x, y, z
