"""Corners of a path, rounded within a tolerance.

Between two lines that turn by theta a corner becomes an arc that leaves them at the distance d: its radius is
d / tan(theta / 2), and the corner is d tan(theta / 4) from it, which is the largest deviation. Between other pieces of
a level plane it becomes a biarc, whose deviation is measured.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.controllers.drawings.fitting import arc_to, middle
from gantrysim.paths.pieces import SHORTEST_PIECE, XY, Coil, Line, vector

SMOOTH_TURN = 1e-5  # turn that is no corner [rad]
_SHARPEST_TURN = math.radians(175)  # turn that is rounded
_SAMPLES = np.linspace(0.0, 1.0, 41)  # of an arc, for its deviation
_SAFETY = 0.99  # share of the tolerance at the samples
_SHRINK = 0.85
_TRIALS = 60
_LEVEL_HEIGHT = 1e-9  # [mm]
# Least distance from a corner at which a piece is left: the sharpest blend is then still longer than SHORTEST [mm].
_LEAST_CUT = 1e-7


@dataclass(frozen=True)
class Leg:
    """A piece of the path with its glue, speed and pause.

    Attributes:
        piece: a line, or an arc.
        glue: whether glue is laid.
        speed: programmed speed [mm/s].
        travel: whether it leads from one stroke to another.
        pause: time of rest at its end [s].
        dot: whether glue is laid in that time.
        order: places in the order of the drawing of its begin, its end, and of points evenly between, if any: twice the
            number of the stroke's stretch, more by the share of the way to it, or by 1 and the share of its shapes.
        line: of the table that states its speed, 0 without.
    """

    piece: Line | Coil
    glue: bool
    speed: float
    travel: bool = False
    pause: float = 0.0
    dot: bool = False
    order: tuple[float, ...] = (0.0, 0.0)
    line: int = 0

    @cached_property
    def length(self) -> float:
        return length(self.piece)

    @cached_property
    def start(self) -> Floats:
        return points_at(self.piece, np.zeros(1))[0]

    @cached_property
    def end(self) -> Floats:
        return points_at(self.piece, np.ones(1))[0]


@dataclass
class Count:
    """Numbers of corners.

    Attributes:
        rounded: number of those that are rounded.
        sharp: number of the others.
    """

    rounded: int = 0
    sharp: int = 0


def length(piece: Line | Coil) -> float:
    """Return the length of a line or an arc [mm]."""
    if isinstance(piece, Line):
        return math.dist(piece.start, piece.end)
    return piece.radius[0] * abs(piece.angle)


def points_at(piece: Line | Coil, share: Floats) -> Floats:
    """Return points at shares of a line's or an arc's length, (n, 3) [mm]."""
    if isinstance(piece, Line):
        begin = np.array(piece.start)
        return begin + share[:, None] * (np.array(piece.end) - begin)
    psi = piece.begin + share * piece.angle
    u, v = np.array(piece.frame)
    return np.array(piece.centre) + piece.radius[0] * (np.cos(psi)[:, None] * u + np.sin(psi)[:, None] * v)


def tangent(piece: Line | Coil, share: float) -> Floats:
    """Return the unit tangent of a line or an arc at a share of its length, (3,)."""
    if isinstance(piece, Line):
        a, b, c = piece.start
        u, v, w = piece.end
        return np.array([u - a, v - b, w - c]) / math.dist(piece.start, piece.end)
    psi = piece.begin + share * piece.angle
    u, v = np.array(piece.frame)
    return math.copysign(1.0, piece.angle) * (math.cos(psi) * v - math.sin(psi) * u)


def part(piece: Line | Coil, low: float, high: float) -> Line | Coil:
    """Return the part of a line or an arc between two shares of its length."""
    if isinstance(piece, Line):
        begin, end = points_at(piece, np.array([low, high]))
        return Line(vector(begin), vector(end), piece.frame)
    return replace(piece, begin=piece.begin + low * piece.angle, angle=(high - low) * piece.angle)


def turn(before: Floats, after: Floats) -> float:
    """Return the angle between two unit vectors [rad]."""
    a, b, c = before.tolist()
    u, v, w = after.tolist()
    # from sine and cosine, as acos loses half of the digits at small angles
    return math.atan2(math.hypot(b * w - c * v, c * u - a * w, a * v - b * u), a * u + b * v + c * w)


def legs_with_corners(legs: list[Leg], tolerance: float, count: Count) -> list[Leg]:
    """Return legs with their corners rounded where both sides lay glue or neither does.

    A blend takes at most the whole of a piece, and half of one with a corner at its other end too.

    Args:
        legs: each from the end of the one before.
        tolerance: largest deviation [mm]; 0 rounds nothing.
        count: of corners, increased.
    """
    turns = np.array([turn(tangent(a.piece, 1.0), tangent(b.piece, 0.0)) for a, b in pairwise(legs)])
    corner = turns > SMOOTH_TURN
    lengths = np.array([leg.length for leg in legs])
    sides = np.append(corner, False).astype(int) + np.append(False, corner)
    room = np.where(sides == 2, 0.5, 1.0) * lengths
    cut = np.zeros((len(legs), 2))
    blends: dict[int, list[Line | Coil]] = {}
    for k in np.flatnonzero(corner).tolist():
        blend = None
        before = legs[k]
        after = legs[k + 1]
        if tolerance > 0 and turns[k] < _SHARPEST_TURN and before.glue == after.glue and not before.pause:
            blend = _blend(before.piece, after.piece, turns[k], min(room[k], room[k + 1]), tolerance)
        if blend is None:
            count.sharp += 1
            continue
        count.rounded += 1
        distance, blends[k] = blend
        cut[k, 1] = distance
        cut[k + 1, 0] = distance
    rounded_legs: list[Leg] = []
    for k, leg in enumerate(legs):
        if cut[k].any():
            low = cut[k, 0] / lengths[k]
            high = 1 - cut[k, 1] / lengths[k]
            begin, *_, end = leg.order
            order = (begin + low * (end - begin), begin + high * (end - begin))
            # the chain would drop a shorter piece
            if (high - low) * lengths[k] > SHORTEST_PIECE:
                rounded_legs.append(replace(leg, piece=part(leg.piece, low, high), order=order))
        else:
            rounded_legs.append(leg)
        if k not in blends:
            continue
        after = legs[k + 1]
        # half of the blend stands for the end of the leg before the corner, half for the begin of the next
        corner_order = leg.order[-1]
        before_corner = corner_order - cut[k, 1] / lengths[k] * (corner_order - leg.order[0])
        behind_corner = after.order[0] + cut[k + 1, 0] / lengths[k + 1] * (after.order[-1] - after.order[0])
        orders: list[tuple[float, ...]] = [(before_corner, corner_order, behind_corner)]
        if len(blends[k]) > 1:
            orders = [(before_corner, corner_order), (corner_order, behind_corner)]
        for piece, blend_order in zip(blends[k], orders, strict=True):
            rounded_legs.append(replace(leg, piece=piece, speed=min(leg.speed, after.speed), order=blend_order))
    return rounded_legs


def _blend(
    before: Line | Coil, after: Line | Coil, theta: float, room: float, tolerance: float
) -> tuple[float, list[Line | Coil]] | None:
    """Distance from the corner at which the pieces are left, and the arcs between, or None."""
    distance = min(room, tolerance / math.tan(0.25 * theta))
    if distance < _LEAST_CUT:
        return None
    z = _level(before)
    level = z is not None and _level(after) == z
    if isinstance(before, Line) and isinstance(after, Line):
        return distance, [_fillet(before, after, theta, distance, z if level else None)]
    if not level or z is None:
        return None
    for _ in range(_TRIALS):
        if distance < _LEAST_CUT:
            return None
        first = part(before, 1 - distance / length(before), 1.0)
        last = part(after, 0.0, distance / length(after))
        arcs = _arcs(first, last, z)
        if _deviation(arcs, first, last) <= _SAFETY * tolerance:
            return distance, arcs
        distance *= _SHRINK
    return None


def _fillet(before: Line, after: Line, theta: float, distance: float, z: float | None) -> Line | Coil:
    corner = np.array(after.start)
    ahead = tangent(before, 1.0)
    begin = corner - distance * ahead
    end = corner + distance * tangent(after, 0.0)
    if z is not None:
        return arc_to(complex(*begin[:2]), complex(*ahead[:2]), complex(*end[:2]), z)
    radius = distance / math.tan(0.5 * theta)
    inward = tangent(after, 0.0) - math.cos(theta) * ahead
    inward -= (inward @ ahead) * ahead
    inward /= np.linalg.norm(inward)
    return Coil(
        vector(begin + radius * inward), (radius, radius), -0.5 * math.pi, theta, frame=(vector(ahead), vector(inward))
    )


def _arcs(first: Line | Coil, last: Line | Coil, z: float) -> list[Line | Coil]:
    """Biarc from the start of one piece to the end of another."""
    begin = complex(*points_at(first, np.zeros(1))[0, :2])
    end = complex(*points_at(last, np.ones(1))[0, :2])
    ahead = complex(*tangent(first, 0.0)[:2])
    onward = complex(*tangent(last, 1.0)[:2])
    join = complex(middle(*(np.array([value]) for value in (begin, ahead, end, onward)))[0])
    chord = join - begin
    return [arc_to(begin, ahead, join, z), arc_to(join, (chord / abs(chord)) ** 2 * ahead.conjugate(), end, z)]


def _deviation(arcs: list[Line | Coil], first: Line | Coil, last: Line | Coil) -> float:
    """Largest distance between a biarc and the two pieces that it replaces."""
    blend = np.concatenate([points_at(arc, _SAMPLES) for arc in arcs])
    corner = np.concatenate([points_at(first, _SAMPLES), points_at(last, _SAMPLES)])
    # in both directions, as of two curves each may leave the other where that one is near
    of_blend = np.minimum(_distance(blend, first), _distance(blend, last)).max()
    of_corner = np.minimum(_distance(corner, arcs[0]), _distance(corner, arcs[1])).max()
    return float(max(of_blend, of_corner))


def _distance(points: Floats, piece: Line | Coil) -> Floats:
    """Distance of points from a line or an arc, (n,)."""
    begin, end = points_at(piece, np.array([0.0, 1.0]))
    if isinstance(piece, Line):
        chord = end - begin
        share = np.clip((points - begin) @ chord / (chord @ chord), 0.0, 1.0)
        return np.linalg.norm(points - begin - share[:, None] * chord, axis=1)
    out = points - np.array(piece.centre)
    sense = math.copysign(1.0, piece.angle)
    swept = np.mod(sense * (np.arctan2(out[:, 1], out[:, 0]) - piece.begin), 2 * math.pi)
    ends = np.minimum(np.linalg.norm(points - begin, axis=1), np.linalg.norm(points - end, axis=1))
    return np.where(swept <= abs(piece.angle), np.abs(np.hypot(out[:, 0], out[:, 1]) - piece.radius[0]), ends)


def _level(piece: Line | Coil) -> float | None:
    """Height of a piece in a level plane, None of any other."""
    if isinstance(piece, Line):
        return piece.start[2] if abs(piece.end[2] - piece.start[2]) < _LEVEL_HEIGHT else None
    return piece.centre[2] if piece.frame == XY else None
