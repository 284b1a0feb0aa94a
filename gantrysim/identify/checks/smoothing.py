"""Likely cause of a doubtful fit: a position that has passed a filter.

Between a quarter and almost half of the sampling rate an axis moves at least as its whole mass would by the torque,
more where the motor moves alone, and counts of the encoder come on top. A mean over nine samples leaves 20 to 57 % of
that, a low-pass of 5 ms 25 to 84 %. Noise that the log's torque has and the motor's has not lowers it too, so that this
is said only of a fit that another check doubts.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.signal import welch

from gantrysim.identify.checks.finding import Doubt, Finding
from gantrysim.identify.result import AxisFit

CHECK = "smooth position"
LEAST = 0.6  # of the acceleration that the torque gives the whole mass; doubtful fits of unfiltered logs have 0.79
_BAND = (0.25, 0.45)  # of the sampling rate
_SEGMENT = 256  # samples of a spectrum's segment


def check_smoothing(fit: AxisFit, period: float) -> Doubt:
    """Return whether the position lacks the fast motion that the torque makes."""
    acceleration = np.diff(fit.position, 2) / period**2
    segment = min(_SEGMENT, acceleration.size)
    frequency, power = welch(acceleration, 1 / period, nperseg=segment)
    torque_power = welch(fit.torque, 1 / period, nperseg=segment)[1]
    band = (frequency > _BAND[0] / period) & (frequency < _BAND[1] / period)
    expected = float(torque_power[band].sum()) / fit.start[0] ** 2
    if not expected > 0:
        return Doubt({}, [])
    ratio = math.sqrt(float(power[band].sum()) / expected)
    if ratio >= LEAST:
        return Doubt({}, [])
    reason = (
        f"from {_BAND[0] / period:.0f} to {_BAND[1] / period:.0f} Hz the position has {100 * ratio:.0f} % of the "
        f"motion that the torque gives the whole mass: must have at least {100 * LEAST:.0f} %; it is filtered or "
        "interpolated: log the counts of the encoder"
    )
    return Doubt({}, [Finding(CHECK, (), reason)])
