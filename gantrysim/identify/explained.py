"""Size of the residual that encoder counts and noise of the torque explain.

Where the encoder stands still the torque of a servo is smooth, so that its scatter there is noise of the log. With that
noise and the counts, the predictor's own variance is that of its errors where the model is right.
"""

from __future__ import annotations

import math

import numpy as np

from gantrysim.base.arrays import Floats, spans
from gantrysim.identify.prediction import error_variance
from gantrysim.identify.result import AxisFit

_STILL = 5  # shortest standstill that counts [samples]
_SETTLED = 1  # first samples of it, whose torque may answer to the last count
_FEWEST = 40  # second differences at rest
_SECOND_DIFFERENCE = math.sqrt(6)  # standard deviation of a second difference of white noise of 1


def explained_residual(fit: AxisFit, period: float) -> float:
    """Return the standard deviation of the residual that counts and torque noise explain, nan where none is known [u].

    Args:
        fit: of an axis.
        period: of the log [s].
    """
    noise = _noise_at_rest(fit.position, fit.torque)
    if math.isnan(noise):
        return math.nan
    steps = np.abs(np.diff(fit.position))
    # of the log, which may differ from the table's
    count = float(steps[steps > 1e-9].min(initial=math.inf))
    size = count / math.sqrt(12) if math.isfinite(count) else fit.expected
    return size * math.sqrt(error_variance(fit.predicted, noise / size, period))


def _noise_at_rest(position: Floats, torque: Floats) -> float:
    """Return the standard deviation of the torque's noise where the position stands still, nan without rest [N·m]."""
    still = np.concatenate([[False], np.diff(position) == 0])
    differences = []
    for first, after in spans(still):
        if after - first >= _STILL:
            differences.append(np.diff(torque[first + _SETTLED : after], 2))
    scatter = np.concatenate(differences) if differences else np.zeros(0)
    if scatter.size < _FEWEST:
        return math.nan
    return float(np.sqrt(np.mean(scatter**2))) / _SECOND_DIFFERENCE
