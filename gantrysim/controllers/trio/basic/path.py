"""The path that a program requests: its moves as exact geometry, or the spiral that a job states."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from itertools import pairwise

import numpy as np

from gantrysim.base.arrays import Floats, read_only_view
from gantrysim.base.errors import InputError, finite, plane_point, positive, whole_number
from gantrysim.controllers.placement import Placement
from gantrysim.controllers.trio.basic.moves import Arc, Move
from gantrysim.paths.chain import Chain
from gantrysim.paths.nearest import find_progress_on_path
from gantrysim.paths.path import Path
from gantrysim.paths.pieces import SHORTEST_PIECE, Coil, Frame, Line, Vector, vector
from gantrysim.paths.spirals import Involute

_PER_TURN = 720  # angles of a spiral that are tabulated
TOLERANCE = 5e-4  # of the commanded trace that stands for a path which the program does not state [mm]
_JOINT = 1e-6  # [mm]
_UNITS: tuple[Vector, ...] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))  # of the columns


@dataclass(frozen=True)
class StatedSpiral:
    """The spiral that a program means: an involute, as the continuous limit of AN-225's loop makes it.

    Attributes:
        diameter: outer diameter of the virtual circles [mm].
        turns: number of circles, a whole number.
        thickness: distance between neighbouring turns [mm].
        start: first point (x, y) [mm].
        heading: direction of the first motion, counter-clockwise from +x [deg].
        clockwise: direction of rotation.
        height: height climbed evenly over all turns, 0 for a flat spiral [mm].
    """

    diameter: float
    turns: int
    thickness: float
    start: tuple[float, float] = (0.0, 0.0)
    heading: float = 90.0
    clockwise: bool = True
    height: float = 0.0

    def __post_init__(self) -> None:
        positive("spiral.diameter", self.diameter, "mm")
        positive("spiral.thickness", self.thickness, "mm")
        object.__setattr__(self, "turns", whole_number("spiral.turns", self.turns, 1))
        object.__setattr__(self, "start", plane_point("spiral.start", self.start))
        finite("spiral.heading", self.heading, "deg")
        finite("spiral.height", self.height, "mm")
        if 2 * self.turns * self.thickness > self.diameter * (1 + 1e-12):
            raise InputError(
                f"spiral.thickness = {self.thickness:g} mm: must be at most diameter / (2 turns), "
                f"{self.diameter / (2 * self.turns):g} mm"
            )

    def path(self, placement: Placement) -> Involute:
        """Return its path on the work."""
        x, y, _ = placement.point([*self.start, 0.0]).tolist()
        heading = math.radians(self.heading + placement.rotate)
        return Involute(0.5 * self.diameter, self.thickness, self.turns, (x, y), heading, self.clockwise, self.height)


def exact(
    moves: list[Move], unstated: set[int], numbers: tuple[int, ...], start: Floats, placement: Placement
) -> Chain | None:
    """Return the moves of the machine's axes as geometry, None where they do not state it.

    They do where the machine's linear axes are moved by nothing but MOVE, MOVEABS, MOVECIRC and MHELICAL, one at a
    time and to their ends.

    Args:
        moves: those kinds, in the order of their beginning.
        unstated: axes that were moved otherwise.
        numbers: of the machine's axes.
        start: their first positions, (3,) [mm].
        placement: of the program on the work.
    """
    columns = {number: k for k, number in enumerate(numbers[:3])}
    if unstated & columns.keys():
        return None
    corners = [start.tolist()]
    # with its columns, from each corner to the next; None for a line
    arcs: list[tuple[Arc, list[int]] | None] = []
    for move in moves:
        moved = [columns.get(number) for number in move.axes]
        on_machine = [column for column in moved if column is not None]
        if not on_machine:
            continue
        if not move.finished or not columns.keys().isdisjoint(move.beside):
            return None
        shape = move.shape
        ends = shape.displacement(shape.length) if shape.length else (0.0,) * len(moved)
        place = corners[-1]
        end = list(place)
        for column, first, displaced in zip(moved, move.start, ends, strict=True):
            if column is not None:
                if abs(place[column] - first) > _JOINT:
                    return None
                end[column] += displaced
        if not isinstance(shape, Arc):
            arcs.append(None)
        elif len(on_machine) == len(moved):
            arcs.append((shape, on_machine))
        else:
            return None
        corners.append(end)
    frame = cache(partial(_frame, placement))
    pieces: list[Line | Coil] = []
    on_work = [(x, y, z) for x, y, z in placement.point(corners).tolist()]
    for k, curve in enumerate(arcs):
        if curve is not None:
            pieces.append(_coil(*curve, corners[k], placement, frame))
        elif math.dist(corners[k], corners[k + 1]) > SHORTEST_PIECE:
            pieces.append(Line(on_work[k], on_work[k + 1]))
    return Chain(pieces) if pieces else None


def _frame(placement: Placement, first: int, second: int) -> Frame:
    """Return the plane of two columns on the work."""
    return placement.direct(_UNITS[first]), placement.direct(_UNITS[second])


def _coil(
    arc: Arc, columns: list[int], start: list[float], placement: Placement, frame: Callable[[int, int], Frame]
) -> Coil:
    first, second = columns[:2]
    centre = list(start)
    centre[first] += arc.centre[0]
    centre[second] += arc.centre[1]
    x, y, z = centre
    angle = -arc.angle if arc.clockwise else arc.angle
    rise = 0.0
    if arc.rise is not None:
        normal = np.cross(_UNITS[first], _UNITS[second])
        rise = arc.rise * placement.upward * float(normal[columns[2]])
    radius = (arc.radius, arc.radius)
    return Coil(placement.place((x, y, z)), radius, arc.begin, angle, rise, frame(first, second))


def on_path(path: Path, points: Floats) -> Floats | None:
    """Return the progress of a trace on the path of its moves, (n,) [mm], or None where it leaves the path.

    The moves run one after the other and each to its end: of a place that the path passes several times, the trace is
    at the first that it has not left behind.

    Args:
        path: made of the moves.
        points: the trace, (n, 3) [mm].
    """
    progress = np.empty(len(points))
    count = find_progress_on_path(path.table, read_only_view(np.ascontiguousarray(points)), progress)  # type: ignore[no-untyped-call]
    return progress if count == len(points) else None


def around(spiral: Involute, points: Floats) -> Floats:
    """Return the progress of a trace along the spiral that its program means, (n,) [mm].

    The spiral is there at the same angle about its centre as the trace, as both turn with the virtual axes.

    Args:
        spiral: the spiral.
        points: the trace, (n, 3) [mm].
    """
    s = np.linspace(0.0, spiral.length, max(math.ceil(spiral.turns * _PER_TURN), 2))
    turn = -1.0 if spiral.clockwise else 1.0

    def angle(places: Floats) -> Floats:
        arm = places - spiral.centre
        angles: Floats = turn * np.unwrap(np.arctan2(arm[:, 1], arm[:, 0]))
        return angles

    of_spiral = angle(spiral.position(s))
    of_trace = angle(points)
    # where the trace begins half a turn before or behind the spiral, the nearer of the two
    of_trace += 2 * np.pi * np.round((of_spiral[0] - of_trace[0]) / (2 * np.pi))
    return np.interp(np.maximum.accumulate(of_trace), np.maximum.accumulate(of_spiral), s)


def polyline(points: Floats) -> Chain:
    """Return the trace through points as lines that keep to it within `TOLERANCE`.

    Args:
        points: (n, 3) [mm].
    """
    moved = np.linalg.norm(np.diff(points, axis=0), axis=1) > SHORTEST_PIECE
    corners = points[np.concatenate([[True], moved])]
    is_end = np.zeros(len(corners), bool)
    is_end[[0, -1]] = True
    stretches = [(0, len(corners) - 1)]
    while stretches:  # Douglas and Peucker
        first, last = stretches.pop()
        if last - first < 2:
            continue
        chord = corners[last] - corners[first]
        between = corners[first + 1 : last] - corners[first]
        share = np.clip(between @ chord / max(float(chord @ chord), SHORTEST_PIECE**2), 0.0, 1.0)
        off = np.linalg.norm(between - share[:, None] * chord, axis=1)
        worst = int(off.argmax())
        if off[worst] > TOLERANCE:
            middle = first + 1 + worst
            is_end[middle] = True
            stretches += [(first, middle), (middle, last)]
    ends = corners[is_end]
    return Chain(Line(vector(a), vector(b)) for a, b in pairwise(ends))
