"""Check of the log: samples must be fast enough for the reversals they hold.

Between two samples the torque of the model is held, and friction has one direction. Where an axis reverses every other
sample, both are wrong, and inertia and delay take up the difference: a log of every tenth tick gave an inertia of
+45 % and a delay of -3.7 ms.
"""

from __future__ import annotations

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError
from gantrysim.identify.checks.excitation import strokes
from gantrysim.machine.axis import Axis

FEWEST = 3.0  # samples of the median stroke


def check_sampling(axis: Axis, position: Floats, period: float) -> None:
    """Refuse a log too slow for its strokes.

    Raises:
        InputError: with the strokes' length and the period that does.
    """
    lengths = strokes(position, axis.resolution)
    if not lengths.size:
        return
    median = float(np.median(lengths))
    if median < FEWEST:
        raise InputError(
            f"axis {axis.name}: half its strokes last at most {median:.0f} samples of {1e3 * period:g} ms: must "
            f"be at least {FEWEST:.0f}; log every servo tick, with a loop that does not oscillate"
        )
