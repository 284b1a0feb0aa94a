"""The checks of a fit, and the estimates after them."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from gantrysim.identify.checks.finding import Doubt, Finding
from gantrysim.identify.checks.parameters import check_balance, check_plausible, check_segments
from gantrysim.identify.checks.residual import (
    PREDICTED,
    RESIDUAL,
    check_clipping,
    check_counts,
    check_residual,
    check_smoothing,
)
from gantrysim.identify.checks.sampling import check_rate
from gantrysim.identify.friction_terms import LOAD
from gantrysim.identify.result import KNOWN_DAMPING, KNOWN_INTERVAL, MODE, AxisFit, Estimate

INTERVAL = "interval"  # reason of a value whose interval is too wide
# half intervals that are narrow enough of any constant torque, of the Coulomb friction, and any delay, of the period
_FRICTION = ("coulomb", "viscous", "viscous_forward", "viscous_back", "offset")
_MODE_PAIR = ("share", "stiffness")
_NO_OFFSET = 0.05
_NO_DELAY = 0.1
# standard deviations that no log undercuts
_DELAY = 0.015  # of the period
_DELAY_IN_GAP = 0.1  # the same beside a backlash
_OFFSET = 0.01  # of the Coulomb friction
# of static over Coulomb friction: the Stribeck speed is that of the table, which nobody has measured
_STATIC_EXCESS = 0.3
# of the static friction, of the Coulomb friction: counts are coarse where it shows, and on Stribeck speeds other than
# the table's it was up to 18 % low on independent axes
_STATIC = 0.12
# the same of the mode beside a friction of further terms, which bend its torque
_MODE = {"share": 0.03, "stiffness": 0.02}
_MODE_IN_GAP = {"share": 0.05, "stiffness": 0.03}  # the same beside a backlash, which hides it
_DAMPING = 0.15  # of the damping beside a friction by load


@dataclass(frozen=True, eq=False)
class Judgement:
    """The fit of an axis after its checks.

    Attributes:
        estimates: with deviations that hold the disagreements which the checks found.
        findings: checks that failed.
        period: of the log [s].
    """

    estimates: dict[str, Estimate]
    findings: tuple[Finding, ...]
    period: float

    def reason(self, name: str) -> str:
        """Return why a value is not identified: the checks that forbid it, or its interval; empty if it is."""
        checks = [finding.check for finding in self.findings if not finding.values or name in finding.values]
        if checks:
            return ", ".join(dict.fromkeys(checks))
        low, high = self.estimates[name].interval
        bound = (KNOWN_DAMPING if name == "damping" else KNOWN_INTERVAL) * abs(self.estimates[name].value)
        # that there is none, or next to none, is known too
        if name == "offset":
            bound = max(bound, _NO_OFFSET * self.estimates["coulomb"].value)
        if name == "delay":
            bound = max(bound, _NO_DELAY * self.period)
        return INTERVAL if 0.5 * (high - low) > bound else ""

    def adopted(self, fit: AxisFit) -> frozenset[str]:
        """Return the values that a machine takes from the log.

        Correlated values are adopted together or not at all: of a pair that repeats the log, one value beside the
        table's other one does not. They are if one of them is identified, and no check forbids the others.
        """
        names = {name for name in self.estimates if not self.reason(name)}
        adopted = names & {"inertia"}
        for group in (_FRICTION, _MODE_PAIR):
            reasons = [self.reason(name) for name in group if name in self.estimates]
            known = [not reason for reason in reasons]
            if any(known) and all(reason in ("", INTERVAL) for reason in reasons):
                adopted |= {*group, *(names & {"static", "damping"})}
        if not fit.shows_mode:
            adopted -= set(MODE)
        return frozenset(adopted)

    def notes(self, axis: str) -> list[str]:
        """Return the failed checks of an axis in sentences."""
        return [
            f"{axis}: {', '.join(finding.values) or 'no value'} {_verb(finding)} identified: {finding.check}: "
            f"{finding.reason}"
            for finding in self.findings
        ]


def _verb(finding: Finding) -> str:
    if not finding.values:
        return "is"
    return "is not" if len(finding.values) == 1 else "are not"


def _with_values(doubt: Doubt, values: tuple[str, ...]) -> Doubt:
    return Doubt(doubt.deviations, [finding._replace(values=values) for finding in doubt.findings])


def judged_fit(fit: AxisFit, period: float) -> Judgement:
    """Return the estimates of a fit after its checks, and the failed checks.

    Args:
        fit: of an axis.
        period: of the log [s].

    Raises:
        NotIdentifiedError: the log's torque has not made the log's motion.
    """
    doubts = [
        check_counts(fit, period),
        check_residual(fit, period),
        check_segments(fit, period),
        check_balance(fit, period),
    ]
    if any(not finding.values or finding.check == RESIDUAL for doubt in doubts for finding in doubt.findings):
        # what a healthy log may show too is said only of a fit that is doubtful
        # a drive at its limit clips the torque too: it forbids no more than what it explains
        values = () if any(not finding.values for doubt in doubts for finding in doubt.findings) else PREDICTED
        causes = [check_rate(fit, period), _with_values(check_clipping(fit), values)]
        # slow samples lack fast motion as a filter does
        if not causes[0].findings:
            causes.append(check_smoothing(fit, period))
        doubts = [*causes, *doubts]
    model = fit.model
    static = math.hypot(_STATIC_EXCESS * model.excess, _STATIC * model.coulomb)
    loaded = any(term.kind == LOAD for term in fit.law.terms)
    mode = _MODE_IN_GAP if "gap" in fit.estimates else _MODE if fit.law.terms else {}
    floors = Doubt(
        {
            "delay": (_DELAY_IN_GAP if "gap" in fit.estimates else _DELAY) * period,
            "offset": _OFFSET * model.coulomb,
            "static": static,
            **{name: part * getattr(model, name) for name, part in mode.items()},
            "damping": _DAMPING * model.damping if loaded else 0.0,
        },
        [],
    )
    estimates = {}
    for name, estimate in fit.estimates.items():
        added = [doubt.deviations.get(name, 0.0) for doubt in (*doubts, floors)]
        estimates[name] = replace(estimate, deviation=math.hypot(estimate.deviation, *added))
    findings = [finding for doubt in doubts for finding in doubt.findings]
    findings += check_plausible(fit, period, estimates)
    return Judgement(estimates, tuple(findings), period)
