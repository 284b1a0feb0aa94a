"""Check: no prediction of the position may be wrong at once by many times its usual error.

An encoder that loses counts moves the position between two samples, and nothing of the torque. Errors of a healthy
fit, other friction included, stay below 6 standard deviations (10 where the torque is clipped); counts lost in motion,
50 at a time, stand out by 24 to 150.
"""

from __future__ import annotations

import math

import numpy as np

from gantrysim.identify.checks.finding import Doubt, Finding
from gantrysim.identify.result import AxisFit

CHECK = "encoder counts"
LARGEST = 12.0  # error of a prediction, in standard deviations of the errors in motion
_COUNTS = 10.0  # the same, in counts of the encoder
_MEDIAN = 0.6745  # of a normal distribution's magnitude, in standard deviations
_APART = 0.02  # time between two losses: the predictor needs some samples to follow the first [s]


def check_counts(fit: AxisFit, period: float) -> Doubt:
    """Return where the position jumps by more than its prediction is ever wrong."""
    error = np.abs(fit.innovations)
    usual = float(np.median(error[fit.used])) / _MEDIAN
    count = math.sqrt(12) * fit.expected
    bound = max(LARGEST * usual, _COUNTS * count)
    jumps = np.flatnonzero(error > bound)
    if not jumps.size:
        return Doubt({}, [])
    losses = 1 + int((np.diff(jumps) > _APART / period).sum())
    largest = int(np.argmax(error))
    times = "once" if losses == 1 else f"{losses} times"
    reason = (
        f"the position leaves its prediction at once by up to {error[largest]:.2g} {fit.unit}, "
        f"{error[largest] / count:.0f} counts, {times}, first {jumps[0] * period:.4g} s into the moves: must be at "
        f"most {bound:.2g} {fit.unit}; the encoder loses counts, or rows are missing"
    )
    return Doubt({}, [Finding(CHECK, (), reason)])
