"""Check of the log: its time stamps must be even.

A model of a sampled servo has one period. A stamp that is off by a tenth of it shifts a position by a tenth of a step,
more than any delay that a log shows.
"""

from __future__ import annotations

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError

EVEN = 0.1  # largest deviation of a time stamp from an even one, of the period
_MISSING = 0.5  # the same, from which samples are missing


def even_period(time: Floats) -> float:
    """Return the period of time stamps [s].

    Raises:
        InputError: stamps that do not rise, are missing or uneven.
    """
    steps = np.diff(time)
    period = float(np.mean(steps))
    if not period > 0 or not (steps > 0).all():
        raise InputError("time does not rise")
    late = np.abs(time - time[0] - period * np.arange(time.size))
    worst = int(np.argmax(late))
    if abs(steps - period).max() > _MISSING * period or late[worst] > _MISSING * period:
        raise InputError(f"its samples are not even: near t = {time[worst]:g} s some are missing")
    if late[worst] > EVEN * period:
        share = late[worst] / period
        raise InputError(
            f"its samples are not even: at t = {time[worst]:g} s one is off by {100 * share:.0f} % of the period, "
            f"{1e3 * period:g} ms: must be within {100 * EVEN:.0f} %; log at every servo tick, with all digits"
        )
    return period
