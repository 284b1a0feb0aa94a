"""Times at which the valve opens and closes, with the leads of the program's command."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError

_EDGE = 1e-9  # distance from a tick within which an edge is at the tick [servo periods]


class ValveTimes(NamedTuple):
    """Times at which the valve opens and closes, ascending, in servo periods.

    Attributes:
        opens: (k,).
        closes: (k,).
    """

    opens: Floats
    closes: Floats

    @classmethod
    def of(cls, on: NDArray[np.bool_], period: float, start_lead: float, stop_lead: float) -> ValveTimes:
        """Return the times for a dispenser command.

        Args:
            on: command from each tick to the next, (n,).
            period: servo period [s].
            start_lead: time by which the valve opens before the program's on [s].
            stop_lead: time by which the valve closes before the program's off [s].

        Raises:
            InputError: a start lead longer than the time before the first dispensing.
        """
        changes = np.flatnonzero(on[1:] != on[:-1]) + 1
        first = [0] if on.size and on[0] else []
        last = [on.size] if on.size and on[-1] else []
        edges = np.concatenate([first, changes, last]).astype(np.float64)
        opens = edges[::2] - start_lead / period
        closes = edges[1::2] - stop_lead / period
        if opens.size and opens[0] < -_EDGE:
            before = period * (opens[0] + start_lead / period)
            raise InputError(
                f"start_lead = {start_lead:g} s: must be at most {before:g} s, the time before the first "
                "dispensing; Setpoints.wait holds the motion back"
            )
        opens = on_ticks(opens)
        closes = on_ticks(closes)
        if on.size and on[-1]:
            # the program has not closed the valve by the end of the record
            closes[-1] = on.size
        return cls(opens, closes)

    def is_open(self, time: Floats) -> NDArray[np.bool_]:
        """Return whether the valve is open just after a time in servo periods, of the same shape.

        Leads may merge two stretches, or put an end before its beginning: openings and closings are counted.
        """
        return np.searchsorted(self.opens, time, "right") > np.searchsorted(self.closes, time, "right")


def on_ticks(time: Floats) -> Floats:
    """Return times in periods, snapped to a tick where they are off it by rounding alone."""
    near = np.round(time)
    return np.where(np.abs(time - near) < _EDGE * np.maximum(1.0, np.abs(near) * 1e-3), near, time)
