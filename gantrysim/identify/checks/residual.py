"""Check: the residual must be of the size of encoder counts and torque noise, and white.

What the fitted model does not predict of the next position is noise where its structure is that of the axis. A residual
many times the encoder's counts, a torque noise that is a large share of the torque, or a residual that its own past
predicts, is motion which this torque has not made: another axis, another clock, a frozen encoder, a missing mode.

Inertia and friction stand on the torque of the sliding axis too, which a wrong mode, a backlash or coarse counts do not
touch. Where that torque is balanced, a residual that is somewhat correlated forbids only the values that rest on
predictions.
"""

from __future__ import annotations

import numpy as np

from gantrysim.identify.checks.finding import Doubt, Finding, NotIdentifiedError
from gantrysim.identify.explained import explained_residual
from gantrysim.identify.result import MODE, WHITE, AxisFit
from gantrysim.identify.whiteness import correlation

CHECK = "residual"
LARGEST = 15.0  # of the residual, times the encoder's counts; ten times the counts' noise is coarse but harmless
UNUSABLE = 100.0  # the same, from which the log is refused
NOISE = 0.15  # largest fitted torque noise, of the torque's own deviation
CORRELATED = 0.5  # correlation from which no value is identified
NOISY = 0.5  # torque noise from which no value is identified, of the torque's own deviation
EXPLAINED = 2.0  # size of the residual from which predictions are doubtful, of that which counts and noise explain
BALANCED = (
    0.03  # largest rms of the low-passed torque that the friction's law and the acceleration leave, of the torque
)
PREDICTED = ("static", "delay", *MODE, "gap")  # values that rest on predictions alone


def check_residual(fit: AxisFit, period: float) -> Doubt:
    """Return whether the residual looks like noise, by size and correlation.

    Args:
        fit: of an axis.
        period: of the log [s].

    Raises:
        NotIdentifiedError: the log's torque has not made the log's motion.
    """
    findings = []
    count = np.sqrt(12) * fit.expected
    times = float(np.std(fit.residual)) / fit.expected
    size = times / np.sqrt(12)
    if times > UNUSABLE:
        raise NotIdentifiedError(
            f"axis {fit.axis}: the prediction of the position is wrong by {times:.0f} times the encoder's counts, must "
            f"be at most {UNUSABLE:.0f}: the torque did not cause this motion; check for a frozen or skipping encoder, "
            "columns of two axes, and a log of fewer samples than the servo's"
        )
    if times > LARGEST:
        reason = f"the residual is {times:.0f} times the encoder's counts: must be at most {LARGEST:.0f}"
        findings.append(Finding(CHECK, (), reason))
    balanced = fit.law.remainder < BALANCED * fit.law.size
    share = fit.noise / float(np.std(fit.torque))
    if share > NOISE:
        reason = (
            f"torque noise of {100 * share:.0f} % of the torque would explain it: must be at most {100 * NOISE:.0f} %"
        )
        findings.append(Finding(CHECK, PREDICTED if balanced and share < NOISY else (), reason))
    explained = explained_residual(fit, period) / count
    if size > EXPLAINED * explained:
        reason = (
            f"the residual is {size:.2g} counts rms, counts and the torque's noise at rest explain {explained:.2g}: "
            f"must be at most {EXPLAINED:g} times as much"
        )
        findings.append(Finding(CHECK, PREDICTED, reason))
    colour = float(np.abs(correlation(fit.residual)).max())
    if colour > WHITE:
        reason = f"the residual is correlated by {colour:.2f}: must be at most {WHITE}"
        findings.append(Finding(CHECK, PREDICTED if balanced and colour < CORRELATED else (), reason))
    return Doubt({}, findings)
