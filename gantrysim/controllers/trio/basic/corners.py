"""Speeds along merged moves: what limits them on a circle, at a corner, and where one SP move joins the next."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

from gantrysim.controllers.trio.basic.moves import Arc, Move, Shape, Straight


def speed_along(move: Move, speed: float) -> float:
    """Return the speed of a move along its path, given SPEED of its axis [units/s]."""
    programmed = _programmed(move, speed)
    if isinstance(move.shape, Arc):
        return programmed * move.corners.share_on_circle(move.shape.radius)
    return programmed


def joint_speed(before: Move, after: Move, speed: float) -> float:
    """Return the largest speed where two merged moves join, inf for no limit, given SPEED of their axis [units/s].

    It is the least of ENDMOVE_SPEED of the first, STARTMOVE_SPEED of the second, the lower of their speeds reduced for
    the corner, and the speed on a small circle, which holds from its first point to its last.
    """
    limits = [math.inf]
    if before.speeds is not None:
        limits.append(before.speeds.end)
    if after.speeds is not None:
        limits.append(after.speeds.start)
    share = after.corners.share_at_corner(angle_between(before.shape, after.shape))
    if share < 1:
        limits.append(share * min(_programmed(before, speed), _programmed(after, speed)))
    for move in (before, after):
        along = speed_along(move, speed)
        if along < _programmed(move, speed):
            limits.append(along)
    return min(limits)


def distance_to_stop(chain: Sequence[Move], speed: float, deceleration: float) -> float:
    """Return the distance from the start of merged moves at which braking from now on would bring them to rest.

    Braking with DECEL reaches a joint at its speed v just where it would stop at v^2 / (2 DECEL) beyond the joint: the
    nearest of these places, and the end of the last move, is where the profile has to be able to stop.

    Args:
        chain: moves that follow one another without a stop, the first of which runs.
        speed: SPEED of their axis [units/s].
        deceleration: DECEL, inf for no limit: joints then need no way to brake [units/s²].
    """
    distance = chain[0].shape.length
    stops = []
    for before, after in pairwise(chain):
        limit = joint_speed(before, after, speed)
        if math.isfinite(limit) and math.isfinite(deceleration):
            stops.append(distance + 0.5 * limit**2 / deceleration)
        distance += after.shape.length
    return min([*stops, distance])


def angle_between(before: Shape, after: Shape) -> float:
    """Return the change of direction where one path ends and the next begins [rad], 0 where one has no direction."""
    first = direction(before, before.length)
    second = direction(after, 0.0)
    if first is None or second is None:
        return 0.0
    # exact for small angles and for those near pi
    return 2 * math.atan2(math.dist(first, second), math.hypot(*(a + b for a, b in zip(first, second, strict=True))))


def direction(shape: Shape, s: float) -> tuple[float, ...] | None:
    """Return the unit vector along a path at the distance s, None for a path without a length."""
    if isinstance(shape, Arc):
        psi = shape.begin + (-1 if shape.clockwise else 1) * shape.angle * min(s / shape.length, 1.0)
        turn = -shape.angle if shape.clockwise else shape.angle
        plane = (-turn * shape.radius * math.sin(psi), turn * shape.radius * math.cos(psi))
        vector: tuple[float, ...] = plane if shape.rise is None else (*plane, shape.rise)
    elif isinstance(shape, Straight) and shape.length > 0:
        vector = shape.deltas
    else:
        return None
    length = math.hypot(*vector)
    return tuple(component / length for component in vector)


def _programmed(move: Move, speed: float) -> float:
    if move.speeds is None or move.speeds.force is None:
        return speed
    return move.speeds.force
