"""Loops that wait for the end of a motion: their passes are counted, not run, while the motion goes on."""

from __future__ import annotations

import numpy as np

from gantrysim.controllers.basic.code import Frame
from gantrysim.controllers.basic.tasks import StatementClock
from gantrysim.controllers.softmc.basic.timeline import Timeline

_MOST = 100_000  # statements at once


class Waits:
    """Skips passes of a loop in which nothing changes but the program's time.

    Such a pass only tests, jumps and sleeps, and reads of what follows from the time no more than whether the group
    moves. The next one is then the same, up to the one in which the motion ends: `WHILE isMoving: SLEEP 1: END WHILE`
    takes as long as the motion, a thousand passes a second.

    Args:
        time: the program's.
        clock: of the statements.

    Attributes:
        changed: whether something else has taken place, or was read, since the last jump back.
    """

    def __init__(self, time: Timeline, clock: StatementClock) -> None:
        self.changed = True
        self._time = time
        self._clock = clock
        self._loop: tuple[Frame, int] | None = None  # of the last jump back: where it lies and where it begins
        self._count = 0  # of statements then
        self._durations: list[float] = []  # by which the time has advanced since

    def pass_time(self, duration: float) -> None:
        """Let time pass [s]."""
        self._time.clock += duration
        if not self.changed:
            self._durations.append(duration)

    def come_back(self, frame: Frame, goal: int) -> None:
        """Begin a pass of a loop; skip those that are like the one that has ended."""
        if not self.changed and self._loop is not None and self._loop[0] is frame and self._loop[1] == goal:
            self._skip(self._clock.count - self._count)
        self.changed = False
        self._loop = (frame, goal)
        self._count = self._clock.count
        self._durations = []

    def _skip(self, statements: int) -> None:
        """Let the time of passes with so many statements go by, each to the same last bit, while the group moves."""
        duration = sum(self._durations)
        if not self._time.moving or duration <= 0:
            return
        most = int((self._time.free - self._time.clock) / duration) + 1
        if statements:
            most = min(most, self._clock.remaining // statements)
        size = len(self._durations)
        durations = np.tile(self._durations, min(most, _MOST // size + 1))
        # one after the other, as statements add them
        clocks = np.add.accumulate(np.concatenate([[self._time.clock], durations]))
        ends = clocks[size::size]
        passes = int(np.searchsorted(ends, self._time.free))
        if passes:
            self._time.clock = float(ends[passes - 1])
            self._clock.count += passes * statements
