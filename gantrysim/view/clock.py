"""Which moment is to be shown: the clock of the wall times a speed, and how fast that really went."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, replace

from gantrysim.errors import at_least, finite, positive

SLOWEST, FASTEST = 1e-3, 1e3  # to which keys change the speed
_SPAN = 1.0  # of the wall's time over which the pace is taken [s]


@dataclass(frozen=True)
class Clock:
    """Runs from 0 to the end, and stays there.

        s(t) = min(s0 + v (t - t0), e),         s0 while it stands

    Attributes:
        speed: v, seconds shown in a second.
        end: e, inf where it is not known [s].
        moment: s0, what was shown at t0 [s].
        since: t0 by the wall's clock; None while it stands [s].

    Raises:
        InputError: a speed that is not above zero, or a moment outside 0 to the end.
    """

    speed: float = 1.0
    end: float = math.inf
    moment: float = 0.0
    since: float | None = None

    def __post_init__(self) -> None:
        positive("speed", self.speed)
        if not math.isinf(self.end):
            at_least("end", self.end, 0, "s")
        at_least("moment", self.moment, 0, "s")
        if self.since is not None:
            finite("since", self.since, "s")

    def at(self, now: float) -> float:
        """Return the moment to be shown, s [s].

        Args:
            now: t by the wall's clock [s].
        """
        if self.since is None:
            return min(self.moment, self.end)
        return min(self.moment + self.speed * max(now - self.since, 0.0), self.end)

    @property
    def stands(self) -> bool:
        """Whether it was told to stand; at its end it is not."""
        return self.since is None

    def toggled(self, now: float) -> Clock:
        """Return one that stands where this one runs, and the other way round."""
        return replace(self, moment=self.at(now), since=now if self.stands else None)

    def moved(self, moment: float, now: float) -> Clock:
        """Return one that shows another moment now, or the nearest there is, and goes on as this one does."""
        return replace(self, moment=min(max(moment, 0.0), self.end), since=None if self.stands else now)

    def scaled(self, factor: float, now: float) -> Clock:
        """Return one whose speed is larger by a factor, within SLOWEST to FASTEST; the moment does not jump."""
        slowest, fastest = min(SLOWEST, self.speed), max(FASTEST, self.speed)
        return replace(self.moved(self.at(now), now), speed=min(max(self.speed * factor, slowest), fastest))


class Pace:
    """How fast what is shown went over the last second of the wall's clock."""

    def __init__(self) -> None:
        self._seen: deque[tuple[float, float]] = deque()

    def note(self, now: float, moment: float) -> None:
        """Take down what is shown at a time of the wall's clock [s]."""
        self._seen.append((now, moment))
        while len(self._seen) > 2 and now - self._seen[1][0] >= _SPAN:
            self._seen.popleft()

    def forget(self) -> None:
        """Begin anew, after a jump or a change of speed."""
        self._seen.clear()

    @property
    def factor(self) -> float | None:
        """Seconds shown in a second; None before a whole second was seen."""
        if not self._seen:
            return None
        (begun, first), (ended, last) = self._seen[0], self._seen[-1]
        return (last - first) / (ended - begun) if ended - begun >= _SPAN else None
