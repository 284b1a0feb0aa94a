"""Likely cause of a doubtful fit: a torque that the recorder has clipped.

A drive at its limit gives a flat torque too, and the fit of its motion is good. So this is said only of a fit that
another check doubts.
"""

from __future__ import annotations

import numpy as np

from gantrysim.identify.checks.finding import Doubt, Finding
from gantrysim.identify.result import AxisFit

CHECK = "clipped torque"
MOST = 0.01  # share of the samples at the largest torque; a torque that is not clipped is there once or twice
_EQUAL = 1e-6  # difference of equal torques, of the largest: logs are rounded


def check_clipping(fit: AxisFit) -> Doubt:
    """Return whether the torque stays at its largest value."""
    size = np.abs(fit.torque)
    largest = float(size.max())
    share = float(np.mean(size >= largest * (1 - _EQUAL)))
    if share <= MOST:
        return Doubt({}, [])
    reason = (
        f"the torque is at its largest, ± {largest:.3g} N·m, in {100 * share:.0f} % of the samples: must be in at most "
        f"{100 * MOST:.0f} %; it is clipped: widen the range of the recorder, or excite less"
    )
    return Doubt({}, [Finding(CHECK, (), reason)])
