"""Check of the log: samples must be fast enough for the reversals they hold, and for the mode.

Between two samples the torque of the model is held, and friction has one direction. Where an axis reverses every other
sample, both are wrong, and inertia and delay take up the difference: a log of every tenth tick gave an inertia of
+45 % and a delay of -3.7 ms.
"""

from __future__ import annotations

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.identify.checks.excitation import strokes
from gantrysim.identify.checks.finding import Doubt, Finding, NotIdentifiedError
from gantrysim.identify.result import AxisFit
from gantrysim.machine.axis import Axis

CHECK = "sampling"
FEWEST = 3.0  # samples of the median stroke


def check_sampling(axis: Axis, position: Floats, period: float) -> None:
    """Refuse a log too slow for its strokes.

    Raises:
        NotIdentifiedError: with the strokes' length and the period that does.
    """
    lengths = strokes(position, axis.resolution)
    if not lengths.size:
        return
    median = float(np.median(lengths))
    if median < FEWEST:
        raise NotIdentifiedError(
            f"axis {axis.name}: half its strokes last at most {median:.0f} samples of {1e3 * period:g} ms: must "
            f"be at least {FEWEST:.0f}; log every servo tick, with a loop that does not oscillate"
        )


def check_rate(fit: AxisFit, period: float) -> Doubt:
    """Return whether the mode of the machine's table is beyond the log's rate: likely cause of a doubtful fit."""
    if fit.shows_mode or not fit.nominal.share or fit.nominal.resonance < fit.highest:
        return Doubt({}, [])
    reason = (
        f"samples of {1e3 * period:g} ms show {fit.highest:.0f} Hz at most, the mode of the machine's table is at "
        f"{fit.nominal.resonance:.0f} Hz: log faster, at every servo tick"
    )
    return Doubt({}, [Finding(CHECK, (), reason)])
