"""Cutter compensation: the path beside the programmed one.

As on the controller, lines are offset along their normal, arcs and spirals along the radius, which for a spiral is
not exactly a constant offset. At outer corners the motions are extended along their tangents.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.controllers.fanuc.blocks import FRAMES
from gantrysim.controllers.fanuc.legs import PathLeg
from gantrysim.paths.chain import Chain
from gantrysim.paths.pieces import Coil, Frame, Line, Vector, vector

_GAP = 1e-6  # between two ends taken as one [mm]
_SHARP_CORNER = math.pi / 2 + 1e-9  # largest outer corner of lines that is not cut off
_SLIGHT_CORNER = math.radians(5)  # largest inner corner that a short bridge may cross


def compensated_legs(legs: list[PathLeg]) -> list[PathLeg]:
    """Return the motions, offset where their compensation is not 0.

    Stops and motions along the plane's normal take place on the offset path.

    Raises:
        Alarm: compensation that begins or ends in an arc, another plane while it is in force, or an offset too large
            for a corner or an arc.
    """
    if not any(leg.compensation for leg in legs):
        return legs
    in_plane = [k for k, leg in enumerate(legs) if _runs_in_plane(leg)]
    # what becomes of each of them
    runs: dict[int, list[PathLeg]] = {}
    for n, k in enumerate(in_plane):
        leg = legs[k]
        before = legs[in_plane[n - 1]] if n else None
        compensates = before is not None and before.compensation != 0
        if leg.compensation and not compensates:
            follows = legs[in_plane[n + 1]] if n + 1 < len(in_plane) else leg
            runs[k] = [_start_up(leg, follows if follows.compensation else leg)]
        elif before is None or not compensates:
            runs[k] = [leg]
        elif not leg.compensation:
            runs[k] = [_between(leg, _end(runs[in_plane[n - 1]][-1]), _end(leg))]
        else:
            _check_plane(before, leg)
            run = runs[in_plane[n - 1]]
            run[-1], runs[k] = _joined_legs(run[-1], replace(leg, piece=_beside(leg)))
    beside: list[PathLeg] = []
    for k, leg in enumerate(legs):
        last = next((other for other in reversed(beside) if other.piece is not None), None)
        beside += runs.get(k) or [leg if last is None else _moved_leg(leg, _end(last))]
    return beside


def _check_plane(before: PathLeg, leg: PathLeg) -> None:
    """Compensation lies in one plane: the ends of two motions beside their paths meet in no other."""
    if leg.plane != before.plane:
        raise leg.source.fail(
            37, f"plane {leg.plane} under cutter compensation in plane {before.plane}: must be selected after G40"
        )


def _runs_in_plane(leg: PathLeg) -> bool:
    return isinstance(leg.piece, Coil) or (leg.piece is not None and bool(_normal(leg.piece).any()))


def _moved_leg(leg: PathLeg, there: Vector) -> PathLeg:
    """A stop, or a motion along the plane's normal, at another place of the plane."""
    start = _level(there, leg.start, leg)
    if not isinstance(leg.piece, Line):
        return replace(leg, start=start)
    return replace(leg, start=start, piece=replace(leg.piece, start=start, end=_level(there, leg.piece.end, leg)))


def _level(place: Vector, height: Vector, leg: PathLeg) -> Vector:
    """A place in the plane of a motion, at another height."""
    u, v = np.array(getattr(leg.piece, "frame", FRAMES["xy"]))
    w = np.cross(u, v)
    return vector(np.array(place) + ((np.array(height) - place) @ w) * w)


def _beside(leg: PathLeg) -> Line | Coil | None:
    piece = leg.piece
    d = leg.compensation
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
    return replace(piece, start=vector(np.add(piece.start, shift)), end=vector(np.add(piece.end, shift)))


def _normal(line: Line) -> Floats:
    """Left normal in the line's plane; zero for a line along the plane's normal."""
    u, v = np.array(line.frame)
    displacement = np.subtract(line.end, line.start)
    a = displacement @ u
    b = displacement @ v
    size = math.hypot(a, b)
    return (a * v - b * u) / size if size > _GAP else np.zeros(3)


def _start_up(leg: PathLeg, follows: PathLeg) -> PathLeg:
    """The move that starts the compensation: it ends where the next motion begins beside its path."""
    beside = replace(follows, piece=_beside(follows))
    return _between(leg, _start(leg), _end(beside) if follows is leg else _start(beside))


def _between(leg: PathLeg, start: Vector, end: Vector) -> PathLeg:
    """A straight move between other places of its plane, at the same heights."""
    if not isinstance(leg.piece, Line):
        raise leg.source.fail(34, "cutter compensation begins or ends in an arc: must be in a straight move")
    first = _level(start, leg.piece.start, leg)
    last = _level(end, leg.piece.end, leg)
    return replace(leg, start=first, piece=replace(leg.piece, start=first, end=last))


def _joined_legs(before: PathLeg, leg: PathLeg) -> tuple[PathLeg, list[PathLeg]]:
    """Join a motion to the one before, extending or cutting either."""
    there = _start(leg)
    here = _level(_end(before), there, leg)
    gap = math.dist(here, there)
    if gap <= _GAP:
        return before, [leg]
    corner = _corner(before, leg)
    inside = corner * leg.compensation > 0
    same = abs(before.compensation - leg.compensation) <= _GAP
    lines = isinstance(before.piece, Line) and isinstance(leg.piece, Line)
    if lines and same and (inside or abs(corner) <= _SHARP_CORNER):
        meeting = vector(here + _direction(before, 1) * leg.compensation * -math.tan(0.5 * corner))
        return _cut_leg(before, _start(before), meeting), [_cut_leg(leg, meeting, _end(leg))]
    if inside and abs(corner) > _SLIGHT_CORNER:
        raise leg.source.fail(
            41, f"inner corner of {math.degrees(abs(corner)):.4g} deg at an arc: the offset paths do not meet there"
        )
    return before, [*_bridge(before, leg, here, there, 0.0 if inside or not same else abs(corner)), leg]


def _bridge(before: PathLeg, leg: PathLeg, here: Vector, there: Vector, corner: float) -> list[PathLeg]:
    """Straight moves from the end of one motion to the start of the next.

    At an outer corner both are extended to where they meet, but by no more than the offset d: a straight line
    between those ends is no nearer to the corner than d.
    """
    extension = abs(leg.compensation) * min(math.tan(0.5 * min(corner, math.pi / 2)), 1.0)
    out = vector(here + extension * _direction(before, 1))
    back = vector(there - extension * _direction(leg, 0))
    bridge = []
    for place in (out, back, there):
        if math.dist(here, place) > _GAP:
            line = Line(here, place, _frame(leg))
            still = (leg.rotary[0], leg.rotary[0])
            bridge.append(replace(leg, start=here, piece=line, rotary=still, spiral=False, exact_stop=False))
            here = place
    return bridge


def _cut_leg(leg: PathLeg, start: Vector, end: Vector) -> PathLeg:
    cut = _between(leg, start, end)
    if np.subtract(end, start) @ _direction(leg, 0) <= 0:
        raise leg.source.fail(
            41, f"straight move too short for the offset of {abs(leg.compensation):g} mm at its corners"
        )
    return cut


def _corner(before: PathLeg, leg: PathLeg) -> float:
    """Angle from the end of one motion to the start of the next, positive to the left [rad]."""
    u, v = np.array(_frame(leg))
    first = _direction(before, 1)
    second = _direction(leg, 0)
    return float(np.angle(complex(second @ u, second @ v) / complex(first @ u, first @ v)))


def _direction(leg: PathLeg, end: int) -> Floats:
    """Unit vector in the plane along a motion at its start, 0, or its end, 1."""
    u, v = np.array(_frame(leg))
    if isinstance(leg.piece, Line):
        tangent = np.subtract(leg.piece.end, leg.piece.start)
    else:
        chain = _chain(leg)
        tangent = chain.tangent(end * chain.length)[0]
    flat = (tangent @ u) * u + (tangent @ v) * v
    return flat / np.linalg.norm(flat)


def _frame(leg: PathLeg) -> Frame:
    assert leg.piece is not None
    return leg.piece.frame


def _chain(leg: PathLeg) -> Chain:
    assert leg.piece is not None
    return Chain([leg.piece])


def _start(leg: PathLeg) -> Vector:
    return leg.piece.start if isinstance(leg.piece, Line) else vector(_chain(leg).position(0.0)[0])


def _end(leg: PathLeg) -> Vector:
    if isinstance(leg.piece, Line):
        return leg.piece.end
    chain = _chain(leg)
    return vector(chain.position(chain.length)[0])
