"""Check: inertia, friction and delay must be within reason of the machine's table.

A fit scales with the log: a torque in mN·m gives a thousand times the inertia, with narrow intervals. The table knows
the machine to some tens of per cent, a payload included, so that a factor is a unit or a gear, not a finding. A delay
below zero would be a motion ahead of its torque.
"""

from __future__ import annotations

from gantrysim.identify.checks.finding import FRICTION, Doubt, Finding
from gantrysim.identify.result import CONFIDENCE, AxisFit

CHECK = "plausibility"
FAR = 2.0  # ratio of the inertia to the table's, or its inverse, from which nothing is identified
FRICTION_FAR = 10.0  # ratio of the Coulomb friction to the table's
EXCESS_SEEN = (
    0.5  # largest half interval of static over Coulomb friction, of itself: else one has been taken for the other
)
LATEST = 10.0  # longest delay, in periods of the log
WIDEST = 2.0  # deflection of the bristles that a gap must exceed, times: presliding looks like a smaller one
EARLY = 0.1  # delay below zero that the torque between samples explains, of a period


def check_plausible(fit: AxisFit, period: float) -> Doubt:
    """Return which values are beyond reason."""
    model = fit.model
    table = fit.nominal
    findings = []
    ratio = model.inertia / table.inertia
    if not 1 / FAR <= ratio <= FAR:
        reason = (
            f"inertia is {ratio:.2g} times that of the machine's table: must be {1 / FAR:g} to {FAR:g} times; check "
            "units, gear and payload"
        )
        findings.append(Finding(CHECK, (), reason))
    delay = fit.estimates["delay"]
    if delay.value < -EARLY * period and delay.interval[1] < 0:
        reason = (
            f"delay = {1e3 * delay.value:.3g} ms: must be at least 0; the motion is "
            "ahead of its torque: the torque was logged later than the position, or filtered"
        )
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
    travel = model.deflection * model.scale
    if "gap" in fit.estimates and model.gap < WIDEST * travel:
        reason = (
            f"backlash is {model.gap:.2g} {fit.unit}, presliding of the friction {travel:.2g} {fit.unit}: must be at "
            f"least {WIDEST:g} times as wide to be told from it"
        )
        findings.append(Finding(CHECK, ("gap",), reason))
    if table.coulomb > 0 and not 1 / FRICTION_FAR <= model.coulomb / table.coulomb <= FRICTION_FAR:
        reason = (
            f"Coulomb friction is {model.coulomb / table.coulomb:.2g} times that of the machine's table: must be "
            f"{1 / FRICTION_FAR:g} to {FRICTION_FAR:g} times"
        )
        findings.append(Finding(CHECK, FRICTION, reason))
    return Doubt({}, findings)
