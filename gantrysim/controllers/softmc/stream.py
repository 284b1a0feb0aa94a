"""Motions and rests of a program, one after the other, and their setpoints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError
from gantrysim.base.memory import check_ticks
from gantrysim.controllers.placement import Placement
from gantrysim.controllers.softmc.geometry import Segment, placed
from gantrysim.controllers.softmc.group import Group
from gantrysim.controllers.valve import is_upright
from gantrysim.paths.chain import Chain
from gantrysim.paths.pieces import SHORTEST, Line, length_of
from gantrysim.paths.profile import Profile
from gantrysim.record.setpoints import MAX_TICKS, ticks


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
    line: int = 0

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
        path = placed(path, placement)
        here = placed(Segment(None, here), placement).end
    rotation = float(path.end[3] - here[3])
    if path.piece is None:
        return Leg(here, path, group.in_place(rotation), dispense, line)
    length = length_of(path.piece)
    if length <= SHORTEST:
        raise InputError(f"path of {length:g} mm: must be longer than {SHORTEST:g} mm")
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
