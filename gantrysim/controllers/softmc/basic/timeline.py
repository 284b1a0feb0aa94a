"""What a program's commands become: legs and rests, and the instants of what happens beside them."""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.controllers.placement import Placement
from gantrysim.controllers.softmc.commands import Command, SoftMCError
from gantrysim.controllers.softmc.group import Group
from gantrysim.controllers.softmc.stream import AXES, Leg, Rest, Segment, leg_of, segment
from gantrysim.paths.chain import Chain

MOST_MOTIONS = 100_000
LONGEST_TIME = 86_400.0  # [s]
_AT_ONCE = 1e-3  # since a motion was issued, in which a program has not waited for anything [s]


@dataclass(frozen=True)
class Mark:
    """An instant: `offset` [s] after the end of the first `steps` legs and rests."""

    steps: int
    offset: float

    def tick(self, ends: NDArray[np.int64], period: float) -> int:
        """Return the index of the first setpoint at or after the instant."""
        end = int(ends[self.steps - 1]) if self.steps else 0
        return end + math.ceil(self.offset / period - 1e-9)


@dataclass
class Timeline:
    """The program's clock, and the group's motions.

    A motion starts when the one before has ended. One motion may wait; the program waits to issue a further one.

    Attributes:
        placement: of the program's coordinates on the work.
        start: initial position, (4,); None until the first motion.
        clock: time of the program [s].
        free: end of the last motion [s].
        steps: the legs and rests.
        settled: number of steps before each leg that waits for the axes to settle.
        supervised: the group at the last motion.
        issued: program's time at which the last motion was issued [s].
    """

    placement: Placement
    start: Floats | None = None
    clock: float = 0.0
    free: float = 0.0
    steps: list[Leg | Rest] = field(default_factory=list)
    settled: list[int] = field(default_factory=list)
    supervised: Group | None = None
    issued: float = -math.inf
    _begins: list[float] = field(default_factory=list)
    _legs: list[int] = field(default_factory=list)
    _paths: list[tuple[Floats, Segment, Leg]] = field(default_factory=list)

    @property
    def here(self) -> Floats:
        """Where the last motion ends, x, y, z [mm] and r [deg], (4,)."""
        if self._paths:
            return self._paths[-1][1].end
        return np.zeros(len(AXES)) if self.start is None else self.start

    @property
    def moving(self) -> bool:
        """Whether a motion is under way."""
        return self.clock < self.free

    @property
    def unawaited(self) -> float:
        """Time to the end of the motions that the program has just issued and not waited for; 0 without any [s]."""
        return self.free - self.clock if self.moving and self.clock - self.issued < _AT_ONCE else 0.0

    @property
    def travels(self) -> bool:
        """Whether the last motion changes more than the orientation."""
        return bool(self._paths) and self._paths[-1][1].piece is not None

    @property
    def position(self) -> Floats:
        """Commanded position at the program's time, x, y, z [mm] and r [deg], (4,)."""
        k = bisect_right(self._begins, self.clock) - 1
        if k < 0:
            return np.zeros(len(AXES)) if self.start is None else self.start
        start, path, leg = self._paths[k]
        s = float(leg.profile.position(np.array([self.clock - self._begins[k]]))[0])
        share = s / leg.profile.length if leg.profile.length > 0 else 1.0
        if share >= 1.0:
            return path.end
        place = start + share * (path.end - start)
        if path.piece is not None:
            chain = Chain([path.piece])
            place[:3] = chain.position(np.array([share * chain.length]))[0]
        return place

    def mark(self) -> Mark:
        """Return the present instant."""
        if not self.moving:
            return Mark(len(self.steps), self.clock - self.free)
        k = bisect_right(self._begins, self.clock) - 1
        return Mark(self._legs[k], self.clock - self._begins[k])

    def wait(self) -> None:
        """Let the program wait until the motion has ended."""
        self.clock = max(self.clock, self.free)

    def settle(self) -> None:
        """Let the next step wait until the axes have settled."""
        if self._paths and (not self.settled or self.settled[-1] != len(self.steps)):
            self.settled.append(len(self.steps))

    def fill_rest(self, line: int) -> None:
        """Fill the time since the last motion."""
        if self.clock > self.free:
            self.steps.append(Rest(self.clock - self.free, line))
            self.free = self.clock

    def issue(self, command: Command, axes: int, group: Group, dispense: bool, settled: bool, line: int) -> None:
        """Start a motion, or let it wait for its turn.

        Args:
            command: the motion.
            axes: number of axes of the group.
            group: its properties for this motion.
            dispense: whether glue is laid.
            settled: whether the motion waits for the axes to settle.
            line: of the program.

        Raises:
            InputError: a command that cannot be run, or too many motions.
        """
        if len(self._paths) >= MOST_MOTIONS:
            raise SoftMCError(f"{MOST_MOTIONS} motions: a program must have at most that many")
        start = self.here
        try:
            with np.errstate(over="raise", invalid="raise", divide="raise"):
                path = segment(command, start, axes, group.absolute)
                leg = leg_of(path, start, group, dispense, self.placement, line)
                duration = leg.duration
        except ArithmeticError:
            raise SoftMCError("the motion has no finite duration: must be slower or shorter") from None
        if not duration <= LONGEST_TIME:
            raise SoftMCError(f"motion of {duration:g} s: must be at most {LONGEST_TIME:g} s")
        # one motion may wait for its turn: the program goes on when the one before has begun
        if self._begins:
            self.clock = max(self.clock, self._begins[-1])
        self.fill_rest(line)
        if settled:
            self.settle()
        self._begins.append(self.free)
        self._legs.append(len(self.steps))
        self._paths.append((start, path, leg))
        self.steps.append(leg)
        self.free += duration
        self.supervised = group
        self.issued = self.clock
        if self.free > LONGEST_TIME:
            raise SoftMCError(f"motion of {self.free:g} s: must be at most {LONGEST_TIME:g} s")
