"""The moment to be shown, from the wall clock and a speed, and the actual pace."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, replace

from gantrysim.base.errors import positive

# speeds that keys reach
SLOWEST_PACE = 1e-3
FASTEST_PACE = 1e3
_PACE_SPAN = 1.0  # of the wall clock, over which the pace is taken [s]


@dataclass(frozen=True)
class Clock:
    """Runs from 0 to the end, and stops there.

        s(t) = min(s0 + v (t - t0), e),         s0 while it is paused

    Attributes:
        speed: v, seconds shown per second.
        end: e, inf if unknown [s].
        moment: s0, shown at t0 [s].
        since: t0 on the wall clock; None while it is paused [s].

    Raises:
        InputError: a speed that is not above zero.
    """

    speed: float = 1.0
    end: float = math.inf
    moment: float = 0.0
    since: float | None = None

    def __post_init__(self) -> None:
        positive("speed", self.speed)

    def at(self, now: float) -> float:
        """Return the moment to be shown at a time of the wall clock, s(t) [s]."""
        if self.since is None:
            return min(self.moment, self.end)
        return min(self.moment + self.speed * max(now - self.since, 0.0), self.end)

    @property
    def is_paused(self) -> bool:
        """Whether it is paused; a clock at its end is not."""
        return self.since is None

    def toggled(self, now: float) -> Clock:
        """Return the clock paused, or resumed if it is paused."""
        return replace(self, moment=self.at(now), since=now if self.is_paused else None)

    def moved(self, moment: float, now: float) -> Clock:
        """Return the clock set to another moment, or to the nearest that exists."""
        return replace(self, moment=min(max(moment, 0.0), self.end), since=None if self.is_paused else now)

    def scaled(self, factor: float, now: float) -> Clock:
        """Return the clock with its speed multiplied, within SLOWEST to FASTEST, without a jump."""
        slowest = min(SLOWEST_PACE, self.speed)
        fastest = max(FASTEST_PACE, self.speed)
        return replace(self.moved(self.at(now), now), speed=min(max(self.speed * factor, slowest), fastest))


class Pace:
    """Actual speed of what is shown over the last second of the wall clock."""

    def __init__(self) -> None:
        self._shown: deque[tuple[float, float]] = deque()

    def note(self, now: float, moment: float) -> None:
        """Record the moment shown at a time of the wall clock [s]."""
        self._shown.append((now, moment))
        while len(self._shown) > 2 and now - self._shown[1][0] >= _PACE_SPAN:
            self._shown.popleft()

    def reset(self) -> None:
        """Start again after a jump or a change of speed."""
        self._shown.clear()

    @property
    def factor(self) -> float | None:
        """Seconds shown per second; None before a whole second is recorded."""
        if not self._shown:
            return None
        start, first = self._shown[0]
        end, last = self._shown[-1]
        return (last - first) / (end - start) if end - start >= _PACE_SPAN else None
