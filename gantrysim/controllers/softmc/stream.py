"""Motions and rests of a program, one after the other, and their setpoints."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError
from gantrysim.base.memory import check_ticks
from gantrysim.controllers.placement import Placement
from gantrysim.controllers.softmc.commands import PLANES, Circle, Command, Coordinates, SoftMCError
from gantrysim.controllers.softmc.group import Group
from gantrysim.controllers.valve import is_upright
from gantrysim.paths.chain import Chain
from gantrysim.paths.pieces import SHORTEST_PIECE, XY, XZ, YZ, Coil, Frame, Line, length_of, vector
from gantrysim.paths.profile import Profile
from gantrysim.record.setpoints import MAX_TICKS, ticks

# The path of a command, given its start.

AXES = "xyzr"

_SAME_POINT = 1e-6  # [mm], between points taken as one
_STRAIGHT_SINE = 1e-6  # sine of an angle of three points taken as collinear
_UPRIGHT = 1e-12  # x and y of a normal taken as the z axis

_FRAMES = (XY, XZ, YZ)
_ORDER = ((0, 1, 2), (0, 2, 1), (1, 2, 0))  # axes of each plane, and the one outside it


@dataclass(frozen=True)
class Segment:
    """The path of a command.

    Attributes:
        piece: of the path; None where at most the orientation changes.
        end: x, y, z [mm] and r [deg], (4,).
    """

    piece: Line | Coil | None
    end: Floats


def segment(command: Command, here: Floats, axes: int, absolute: bool) -> Segment:
    """Return the path of a command.

    Args:
        command: to run.
        here: its start, x, y, z [mm] and r [deg], (4,).
        axes: number of axes, 2 to 4.
        absolute: whether its coordinates are absolute, or relative to `here`.

    Raises:
        SoftMCError: not a circle, or coordinates of missing axes.
    """

    def place(name: str, values: Coordinates) -> Floats:
        if not 2 <= len(values) <= axes:
            numbers = "2" if axes == 2 else f"2 to {axes}"
            raise SoftMCError(f"{name} of {_numbers(len(values))}: must be {numbers}, of the axes {_names(axes)}")
        point = here.copy()
        point[: len(values)] = np.array(values) if absolute else point[: len(values)] + values
        return point

    if not isinstance(command, Circle):
        return _line(here, place("target", command.target))
    if command.via is not None and command.target is not None:
        return _through(here, place("via", command.via), place("target", command.target))
    assert command.angle is not None
    assert command.centre is not None
    i, j, k = _ORDER[command.plane]
    label = PLANES[command.plane]
    if j >= axes:
        raise SoftMCError(f"plane = {command.plane} ({label}): must be 0 (XY) with the axes {_names(axes)}")
    centre = place("centre", command.centre)
    if j >= len(command.centre):
        raise SoftMCError(
            f"centre of {_numbers(len(command.centre))} in plane {command.plane} ({label}): "
            f"must have {AXES[i]} and {AXES[j]}"
        )
    return _by_angle(here, centre, command.angle, (i, j, k), _FRAMES[command.plane])


def placed_path(path: Segment, placement: Placement) -> Segment:
    """Return a path on the work; the orientation r turns with the placement."""
    end = np.array([*placement.point(path.end[:3]), path.end[3] + placement.rotate])
    piece = path.piece
    if isinstance(piece, Line):
        return Segment(Line(placement.place(piece.start), placement.place(piece.end)), end)
    if isinstance(piece, Coil):
        radius = piece.radius
        scale = placement.scale
        turned = replace(
            piece,
            centre=placement.place(piece.centre),
            radius=(scale * radius[0], scale * radius[1]),
            rise=scale * placement.upward * piece.rise,  # along u x v, which a mirrored frame turns round
        )
        if piece.frame == XY:
            return Segment(replace(turned, begin=piece.begin + math.radians(placement.rotate)), end)
        first, second = placement.direction(piece.frame) / scale
        return Segment(replace(turned, frame=(vector(first), vector(second))), end)
    return Segment(None, end)


def _line(here: Floats, end: Floats) -> Segment:
    if np.linalg.norm(end[:3] - here[:3]) <= _SAME_POINT:
        return Segment(None, np.array([*here[:3], end[3]]))
    return Segment(Line(vector(here), vector(end)), end)


def _by_angle(here: Floats, centre: Floats, angle: float, order: tuple[int, int, int], frame: Frame) -> Segment:
    i, j, k = order
    out = here[[i, j]] - centre[[i, j]]
    radius = float(np.hypot(*out))
    if radius <= _SAME_POINT:
        raise SoftMCError(
            f"radius = 0 mm, centre and start are both {AXES[i]} = {here[i]:g}, {AXES[j]} = {here[j]:g}: "
            "must be greater than 0 mm; move away from the centre first"
        )
    turned = math.radians(math.fmod(angle, 360.0))
    end = centre.copy()
    end[i] += out[0] * math.cos(turned) - out[1] * math.sin(turned)
    end[j] += out[0] * math.sin(turned) + out[1] * math.cos(turned)
    middle = centre.copy()
    middle[k] = here[k]
    # the plane's normal is parallel or antiparallel to the axis outside it
    up = float(np.cross(*frame)[k])
    begin = math.atan2(out[1], out[0])
    piece = Coil(vector(middle), (radius, radius), begin, math.radians(angle), up * float(centre[k] - here[k]), frame)
    return Segment(piece, end)


def _through(here: Floats, via: Floats, end: Floats) -> Segment:
    """Return the arc through three points, about c = h + ((a.a b - b.b a) x n) / 2 n.n, n = a x b.

    a and b are the via point and the end relative to the start h. The arc turns left about n.
    """
    a = via[:3] - here[:3]
    b = end[:3] - here[:3]
    sides = np.sort([np.linalg.norm(a), np.linalg.norm(b), np.linalg.norm(b - a)])
    three = f"the three points ({_point_text(here)}), ({_point_text(via)}) and ({_point_text(end)})"
    if sides[0] <= _SAME_POINT:
        raise SoftMCError(f"{three} coincide: must be distinct; use Angle and CircleCenter for a full circle")
    n = np.cross(a, b)
    size = float(np.linalg.norm(n))
    if size <= _STRAIGHT_SINE * sides[0] * sides[2]:
        raise SoftMCError(f"{three} are collinear: must not be; use Move for a straight line")
    # from the centre to the start
    out = -np.cross((a @ a) * b - (b @ b) * a, n) / (2 * size**2)
    centre = here[:3] - out
    radius = float(np.linalg.norm(out))
    first = out / radius
    normal = n / size
    to_end = b + out
    angle = math.atan2(to_end @ np.cross(normal, first), to_end @ first) % (2 * math.pi)
    if normal[2] < -_UPRIGHT:
        normal = -normal
        angle = -angle
    frame = (vector(first), vector(np.cross(normal, first)))
    begin = 0.0
    if np.hypot(*normal[:2]) <= _UPRIGHT:
        frame = XY
        begin = math.atan2(out[1], out[0])
    return Segment(Coil(vector(centre), (radius, radius), begin, angle, 0.0, frame), end)


def _point_text(point: Floats) -> str:
    return ", ".join(f"{value:g}" for value in point[:3])


def _names(axes: int) -> str:
    return ", ".join(AXES[:axes])


def _numbers(count: int) -> str:
    return f"{count} number{'' if count == 1 else 's'}"


@dataclass(frozen=True)
class Leg:
    """The motion of one command.

    Attributes:
        start: x, y, z [mm] and r [deg], (4,).
        path: its path, and its end.
        profile: its speed profile along the path [mm], or of r [deg] where only that moves.
        dispense: whether glue is laid.
        line: of the program.
    """

    start: Floats
    path: Segment
    profile: Profile
    dispense: bool
    line: int

    @property
    def duration(self) -> float:
        """Time of the motion [s]."""
        return self.profile.duration

    @property
    def length(self) -> float:
        """Length of its path [mm]."""
        return 0.0 if self.path.piece is None else length_of(self.path.piece)

    def coordinates(self, t: Floats) -> tuple[Floats, Floats]:
        """Return x, y, z [mm] and r [deg] at times since the start of the command, (n, 4), and the way, (n,) [mm]."""
        s = self.profile.position(t)
        share = s / self.profile.length if self.profile.length > 0 else np.ones(s.shape)
        place = np.tile(self.start, (s.size, 1))
        if self.path.piece is not None:
            place[:, :3] = Chain([self.path.piece]).position(s)
        place[:, 3] += share * (self.path.end[3] - self.start[3])
        return place, share * self.length


@dataclass(frozen=True)
class Rest:
    """A standstill between two motions.

    Attributes:
        duration: [s].
        line: of the program.
    """

    duration: float
    line: int = 0


@dataclass(frozen=True)
class Stream:
    """What becomes of legs and rests at a servo period.

    Attributes:
        position: x, y, z [mm] and r [deg] at every servo period, (n, 4).
        dispense: whether glue is laid, (n,).
        progress: length of the legs' paths so far, (n,) [mm].
        ends: setpoints at the ends of the legs and rests, (m,).
    """

    position: Floats
    dispense: NDArray[np.bool_]
    progress: Floats
    ends: NDArray[np.int64]


def leg_of(
    path: Segment, here: Floats, group: Group, dispense: bool, placement: Placement | None = None, line: int = 0
) -> Leg:
    """Return the motion along a path.

    Args:
        path: in the program's coordinates.
        here: its start, x, y, z [mm] and r [deg], (4,).
        group: its properties for this motion.
        dispense: whether glue is laid, but for a line straight up or down.
        placement: of the program's coordinates on the work.
        line: of the program.

    Raises:
        InputError: too short a path.
    """
    if placement is not None and placement != Placement():
        path = placed_path(path, placement)
        here = placed_path(Segment(None, here), placement).end
    rotation = float(path.end[3] - here[3])
    if path.piece is None:
        return Leg(here, path, group.in_place(rotation), dispense, line)
    length = length_of(path.piece)
    if length <= SHORTEST_PIECE:
        raise InputError(f"path of {length:g} mm: must be longer than {SHORTEST_PIECE:g} mm")
    profile = group.along(length, rotation)
    if isinstance(path.piece, Line) and is_upright(path.piece.start, path.piece.end):
        dispense = False
    return Leg(here, path, profile, dispense, line)


def stream(steps: Sequence[Leg | Rest], period: float) -> Stream:
    """Return the setpoints of legs and rests, each of which starts at the first servo tick after the one before.

    Args:
        steps: at least one leg.
        period: servo period [s].

    Raises:
        InputError: too many ticks.
    """
    counts = [ticks(step.duration, period) for step in steps]
    if sum(counts) > MAX_TICKS:
        raise InputError(f"program of {sum(counts):.3g} ticks of {period:g} s: must be at most {MAX_TICKS:g}")
    check_ticks(sum(counts), f"program in periods of {period:g} s", "use a shorter program or a longer period")
    here = next(step.start for step in steps if isinstance(step, Leg))
    position = np.tile(here, (sum(counts) + 1, 1))
    progress = np.zeros(sum(counts) + 1)
    reached = 0.0
    ends = np.cumsum(counts)
    for step, n, last in zip(steps, counts, ends, strict=True):
        if isinstance(step, Leg):
            place, way = step.coordinates(np.arange(1, n, dtype=np.float64) * period)
            position[last - n + 1 : last] = place
            progress[last - n + 1 : last] = reached + way
            here = step.path.end
            reached += step.length
            position[last] = here
            progress[last] = reached
        else:
            position[last - n + 1 : last + 1] = here
            progress[last - n + 1 : last + 1] = reached
    dispense = np.repeat([isinstance(step, Leg) and step.dispense for step in steps], counts)
    return Stream(position, np.append(dispense, dispense[-1:]), progress, ends.astype(np.int64))
