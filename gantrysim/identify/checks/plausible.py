"""Check: inertia, friction and delay must be within reason of the machine's table.

A fit scales with the log: a torque in mN·m gives a thousand times the inertia, with narrow intervals. The table knows
the machine to some tens of per cent, a payload included, so that a factor is a unit or a gear, not a finding. A delay
below zero would be a motion ahead of its torque.
"""

from __future__ import annotations

import math

from gantrysim.base.errors import InputError
from gantrysim.identify.checks.finding import FRICTION, Doubt, Finding
from gantrysim.identify.model import AxisModel
from gantrysim.identify.result import CONFIDENCE, AxisFit

CHECK = "plausibility"
UNUSABLE = 5.0  # ratio of the inertia to the table's, or its inverse, from which the log is refused
FAR = 2.0  # the same, from which nothing is identified
FRICTION_FAR = 10.0  # ratio of the Coulomb friction to the table's
EXCESS_SEEN = (
    0.5  # largest half interval of static over Coulomb friction, of itself: else one has been taken for the other
)
LATEST = 10.0  # longest delay, in periods of the log
EARLY = 0.1  # delay below zero that the torque between samples explains, of a period
_SLIPS = {
    1000.0: "torque in mN·m read as N·m, or position in m read as mm",
    100.0: "torque in N·cm read as N·m",
    9.81: "torque in N·m read as kgf·m, or the reverse",
    25.4: "position in inches read as mm",
    180 / math.pi: "an angle in rad read as deg",
}
_NEAR = 1.4  # ratio of two factors that may be the same


def check_inertia(axis: str, inertia: float, table: AxisModel) -> None:
    """Refuse an inertia of the log that is no machine's of this table.

    Args:
        axis: its name.
        inertia: by the regression of the torque [N·m·s²/u].
        table: model of the MJCF.

    Raises:
        InputError: the ratio of both exceeds `UNUSABLE`.
    """
    ratio = inertia / table.inertia
    if 1 / UNUSABLE <= ratio <= UNUSABLE:
        return
    factor = max(ratio, 1 / ratio)
    slips = [text for known, text in _SLIPS.items() if 1 / _NEAR < factor / known < _NEAR]
    hint = f"; about {_nearest(factor):g}: {', '.join(slips)}?" if slips else "; check units, lead and gear ratio"
    raise InputError(
        f"axis {axis}: the log gives {ratio:.3g} times the inertia of the machine's table, must be "
        f"{1 / UNUSABLE:g} to {UNUSABLE:g} times{hint}"
    )


def _nearest(factor: float) -> float:
    return min(_SLIPS, key=lambda known: abs(math.log(factor / known)))


def check_plausible(fit: AxisFit, period: float) -> Doubt:
    """Return which values are beyond reason."""
    model = fit.model
    table = fit.nominal
    findings = []
    ratio = model.inertia / table.inertia
    if not 1 / FAR <= ratio <= FAR:
        reason = f"inertia is {ratio:.2g} times that of the machine's table: must be {1 / FAR:g} to {FAR:g} times"
        findings.append(Finding(CHECK, (), reason))
    delay = fit.estimates["delay"]
    if delay.value < -EARLY * period and delay.interval[1] < 0:
        reason = f"delay = {1e3 * delay.value:.3g} ms: must be at least 0; the motion would be ahead of its torque"
        findings.append(Finding(CHECK, (), reason))
    if delay.value > LATEST * period:
        reason = f"delay = {1e3 * delay.value:.3g} ms: must be at most {LATEST:g} periods of the log"
        findings.append(Finding(CHECK, (), reason))
    for name in ("viscous", "coulomb"):
        value = float(getattr(model, name))
        if value <= 1e-6 * float(getattr(table, name)):
            reason = f"{name} friction is at its bound, 0: without it the fit would be below zero"
            findings.append(Finding(CHECK, FRICTION, reason))
    excess = fit.estimates["excess"]
    half = CONFIDENCE * excess.deviation
    if half > EXCESS_SEEN * excess.value:
        reason = (
            f"static friction exceeds Coulomb friction by {excess.value:.2g} ± {half:.2g} N·m: must be known within "
            f"{100 * EXCESS_SEEN:.0f} %; the log does not show it"
        )
        findings.append(Finding(CHECK, ("static",), reason))
    if table.coulomb > 0 and not 1 / FRICTION_FAR <= model.coulomb / table.coulomb <= FRICTION_FAR:
        reason = (
            f"Coulomb friction is {model.coulomb / table.coulomb:.2g} times that of the machine's table: must be "
            f"{1 / FRICTION_FAR:g} to {FRICTION_FAR:g} times"
        )
        findings.append(Finding(CHECK, FRICTION, reason))
    return Doubt({}, findings)
