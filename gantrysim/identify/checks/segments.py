"""Check: the parameters must not depend on any one part of the log.

A model with the structure of the axis has one set of parameters for early and late, slow and fast, both directions,
every place of the travel and every torque. Where the estimate moves by more than its own scatter once a part is left
out, the difference is a property of the model, and no interval from the noise alone covers it: a jackknife over parts
that are not alike, instead of random ones (B. Efron, The Jackknife, the Bootstrap and Other Resampling Plans, 1982).
"""

# ruff: noqa: N803, N806 - matrices bear the letters of the equations

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.identify.checks.finding import Doubt, Finding
from gantrysim.identify.parts import partitions
from gantrysim.identify.result import AxisFit, Sensitivity
from gantrysim.identify.whiteness import covariance_of

CHECK = "parts of the log"
LARGEST = 0.1  # change of a value from which it is not identified, of the value
SIGNIFICANT = 3.0  # standard deviations from which a change counts
_NOT_JUDGED = ("viscous", "coulomb", "offset", "excess")  # reported by the torque, which has parts of its own; static
_FEWEST = 200  # samples of a part, and of what remains


def check_segments(fit: AxisFit, period: float) -> Doubt:
    """Return by how much each parameter moves without one part of the log, and which move too far."""
    moved = changes_without_a_part(fit, period)
    for name in _NOT_JUDGED:
        del moved[name]
    extra = {name: change for name, (change, _) in moved.items()}
    findings = []
    for name, (change, partition) in moved.items():
        value = abs(float(getattr(fit.model, name)))
        if name == "delay":
            value = max(value, period)  # of a delay of zero, every change is large
        if change > LARGEST * value:
            share = f"{100 * change / value:.0f} %" if value else "all of its value"
            reason = (
                f"{name} changes by {share} with a part of the log ({partition}) left out: must be within "
                f"{100 * LARGEST:.0f} %"
            )
            findings.append(Finding(CHECK, (name,), reason))
    return Doubt(extra, findings)


def changes_without_a_part(fit: AxisFit, period: float) -> dict[str, tuple[float, str]]:
    """Return the largest significant change of each parameter, and the partition with the part whose absence makes it.

    An estimate without a part is one Gauss-Newton step from that of the whole, -(J'J)^-1 J'r over the other samples.
    Where these tell less of a parameter than the whole log, its change counts in proportion.
    """
    sensitivity = fit.sensitivity
    parameters = _parameters(sensitivity)
    names = (*sensitivity.names, "static")
    whole = _deviations(parameters, sensitivity.jacobian, sensitivity.residual)
    moved = dict.fromkeys(names, (0.0, ""))
    for partition, masks in partitions(fit.position, fit.torque, fit.used, period).items():
        for mask in masks:
            others = ~mask[fit.used]
            if min(others.sum(), (~others).sum()) < _FEWEST:
                continue
            change, deviation = _without(parameters, sensitivity, others)
            for k, name in enumerate(names):
                if deviation[k] > 0 and abs(change[k]) > SIGNIFICANT * deviation[k]:
                    counted = abs(float(change[k])) * min(1.0, float(whole[k] / deviation[k]))
                    moved[name] = max(moved[name], (counted, partition))
    return moved


def _without(parameters: Floats, sensitivity: Sensitivity, others: NDArray[np.bool_]) -> tuple[Floats, Floats]:
    """Return how the parameters change with some samples alone, and their standard deviations then, (p + 1,) each."""
    J = sensitivity.jacobian[others]
    residual = sensitivity.residual[others]
    change = -parameters @ np.linalg.pinv(J.T @ J) @ (J.T @ residual)
    return change, _deviations(parameters, J, residual)


def _deviations(parameters: Floats, J: Floats, residual: Floats) -> Floats:
    covariance = covariance_of(J, residual)
    return np.asarray(np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", parameters, covariance, parameters), 0.0)))


def _parameters(sensitivity: Sensitivity) -> Floats:
    """Return the parameters and the static friction as sums of the fit's variables, (p + 1, variables)."""
    count = len(sensitivity.names)
    M = np.zeros((count + 1, sensitivity.jacobian.shape[1]))
    M[:count, :count] = np.diag(sensitivity.slopes)
    for name in ("coulomb", "excess"):
        k = sensitivity.names.index(name)
        M[count, k] = sensitivity.slopes[k]
    return M
