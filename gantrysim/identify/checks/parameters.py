"""Checks of the fitted values: torques in balance, values within reason, and the same in every part of the log."""

# ruff: noqa: N803, N806 - matrices bear the letters of the equations

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.identify.checks.finding import FRICTION, VISCOUS, Doubt, Finding
from gantrysim.identify.friction_terms import CONFIDENCE
from gantrysim.identify.model import AxisModel
from gantrysim.identify.pieces import Starts, around, by_piece, gradient, inside, partitions, smoothed
from gantrysim.identify.prediction import effective_torque
from gantrysim.identify.result import MODE, AxisFit, Estimate, Sensitivity
from gantrysim.identify.sizes import change_words, times_words
from gantrysim.identify.whiteness import covariance_of, long_run_covariance

# Check: torque must balance inertia and friction at low frequency too.
#
# The fit weighs every sample by how well it predicts the next one, so that a slow error of the torque hardly counts.
# Here torque, acceleration and the friction of the law that the log has chosen pass one zero-phase low-pass, and what
# remains of the torque is regressed on the acceleration: the test of J. Hausman (Econometrica 46, 1978) of two
# estimators of the inertia that agree only where the model is right. What the law leaves of the torque is averaged over
# parts of the log: a friction that depends on place, load or speed otherwise than in its law shows as a mean of its own
# in each.

BALANCE = "torque balance"
# torque that remains in a part of the log, from which the friction's law is another one, of the friction
UNEVEN_FRICTION = 0.1
# Coulomb friction of the predictions less that of the law, from which the mode is doubtful, of the law's
MODE_FRICTION = 0.1
_WIDTH = 0.004  # standard deviation of the low-pass [s]
_SAMPLE_STEPS = 8  # of the torque's course in a sample
_MOVING_SPEED = 0.02  # share of the highest speed from which an axis slides
_SLIDING_SHARE = 0.9  # share of the samples around one that must be in motion
_PART_SAMPLES = 200  # samples of a part of the log
_MEMORY = 8  # correlation of what the low-pass leaves [widths]


class Balance(NamedTuple):
    """Inertia of the balance less that of the fit, and its standard deviation [N·m·s²/u]."""

    change: float
    deviation: float


def check_balance(fit: AxisFit, period: float) -> Doubt:
    """Return how far the balance's inertia is from the fit's, and whether the friction's law is another one."""
    balance = torque_balance(fit, period)
    if balance is None:
        return Doubt({}, [Finding(BALANCE, FRICTION, "too few samples slide to balance the torque")])
    inertia = float(np.sqrt(max(balance.change**2 - balance.deviation**2, 0.0)))
    unevenness = fit.law.unevenness
    largest = max(unevenness, key=lambda name: unevenness[name])
    uneven = unevenness[largest]
    # static friction stands on the same level as Coulomb friction
    doubts = {"inertia": inertia, "coulomb": uneven, "static": uneven, "offset": uneven}
    return Doubt(doubts, _findings(fit, largest, uneven))


def _findings(fit: AxisFit, partition: str, uneven: float) -> list[Finding]:
    coulomb = fit.model.coulomb
    predicted = fit.predicted.coulomb
    findings = []
    if abs(predicted - coulomb) > MODE_FRICTION * coulomb:
        reason = (
            f"the torque in steady motion gives a Coulomb friction of {coulomb:.3g} N·m, the predictions "
            f"{predicted:.3g} N·m: must agree within {100 * MODE_FRICTION:.0f} %"
        )
        findings.append(Finding(BALANCE, ("static", *MODE), reason))
    if uneven > UNEVEN_FRICTION * coulomb:
        reason = (
            f"the friction differs with {partition} by {uneven:.2g} N·m beside {coulomb:.3g} N·m: must be within "
            f"{100 * UNEVEN_FRICTION:.0f} %"
        )
        findings.append(Finding(BALANCE, (*FRICTION, *MODE), reason))
    return findings


def torque_balance(fit: AxisFit, period: float) -> Balance | None:
    """Return the balance of the torque; None where too few samples slide."""
    model = fit.model
    width = _WIDTH / period
    torque = _torque(fit, period)
    starts = fit.starts
    acceleration = by_piece(_second_difference, fit.position, starts) / period**2
    speed = gradient(fit.position, period, starts)
    slow = smoothed(speed, width, starts)
    direction = around(fit.directions, starts)
    friction = model.viscous * speed + (model.coulomb + fit.law.level) * direction + fit.law.ripple
    smooth = _of_both_masses(model, smoothed(acceleration, width, starts), period, starts)
    remains = smoothed(torque - friction, width, starts) - model.inertia * smooth
    chosen = smoothed(
        (np.abs(slow) > _MOVING_SPEED * float(np.quantile(np.abs(slow), 0.99))).astype(np.float64), width, starts
    )
    # where the filter reaches beyond the piece
    slides = (chosen > _SLIDING_SHARE) & inside(slow.size, starts, round(4 * width) + 1)
    if slides.sum() < _PART_SAMPLES:
        return None
    columns = [smooth, slow, smoothed(direction, width, starts), np.ones_like(slow)]
    memory = round(_MEMORY * width)
    return _inertia(np.stack(columns, axis=1)[slides], remains[slides], memory)


def _inertia(A: Floats, torque: Floats, memory: int) -> Balance:
    """Return the coefficient of the first column in a torque, and its standard deviation."""
    size = np.abs(A).max(axis=0)
    A = A / size
    coefficients = np.linalg.lstsq(A, torque, rcond=None)[0]
    variance = np.diag(long_run_covariance(A, torque - A @ coefficients, memory))
    return Balance(float(coefficients[0] / size[0]), float(np.sqrt(max(variance[0], 0.0)) / size[0]))


def _torque(fit: AxisFit, period: float) -> Floats:
    """Return the effective torque over the two steps around each sample, at the ends of a piece its neighbour's, (n,).

    A second difference of the position is the acceleration's mean with triangular weights: so is this torque [N·m].
    """
    rise = np.arange(_SAMPLE_STEPS) + 0.5
    weights = np.concatenate([rise, rise[::-1]]) / _SAMPLE_STEPS**2

    def around(torque: Floats) -> Floats:
        means = effective_torque(fit.model, period, torque, _SAMPLE_STEPS, fit.held).ravel()
        return np.pad(np.convolve(means, weights, "valid")[::_SAMPLE_STEPS][: torque.size - 2], 1, "edge")

    return by_piece(around, fit.torque, fit.starts)


def _second_difference(position: Floats) -> Floats:
    """Return the second difference around each sample, at the ends its neighbour's, (n,)."""
    return np.pad(np.diff(position, 2), 1, "edge")


def _of_both_masses(model: AxisModel, acceleration: Floats, period: float, starts: Starts) -> Floats:
    """Return the mean acceleration of motor and load by mass; below resonance the load's exceeds the motor's by a''/w².

    w is the natural frequency of the load with the motor held.
    """
    if not model.share:
        return acceleration
    flexibility = model.inertia * model.share / model.stiffness
    return acceleration - model.share * flexibility * gradient(gradient(acceleration, period, starts), period, starts)


# Check: inertia, friction and delay must be within reason of the machine's table.
#
# A fit scales with the log: a torque in mN·m gives a thousand times the inertia, with narrow intervals. The table knows
# the machine to some tens of per cent, a payload included, so that a factor is a unit or a gear, not a finding. A delay
# below zero would be a motion ahead of its torque. A value whose interval reaches into reason is only not known.

PLAUSIBILITY = "plausibility"
FAR_INERTIA = 2.0  # ratio of the inertia to the table's, or its inverse, from which nothing is identified
FRICTION_FAR = 10.0  # ratio of the Coulomb friction to the table's
# largest half interval of static over Coulomb friction, of itself: else one has been taken for the other
EXCESS_SEEN = 0.5
LATEST_DELAY = 10.0  # longest delay, in periods of the log
GAP_OVER_BRISTLES = 2.0  # deflection of the bristles that a gap must exceed, times: presliding looks like a smaller one
EARLY_DELAY = 0.1  # delay below zero that the torque between samples explains, of a period


def _faster_drive(fit: AxisFit, delay: Estimate) -> str:
    """Return that a drive with a faster current loop than the table's looks like this, where it may."""
    lag = fit.model.lag
    # the fit takes the lag of the table's winding from the torque's way to the motion, which a faster drive lacks
    if not delay.interval[0] <= -lag <= delay.interval[1]:
        return ""
    return (
        f", or the drive lacks the lag of {1e3 * lag:.3g} ms that the machine's table gives its winding: give the "
        "closed current loop's there, or log the motor's torque"
    )


def check_plausible(fit: AxisFit, period: float, estimates: dict[str, Estimate]) -> list[Finding]:
    """Return which values are beyond reason, with the whole of their intervals.

    Args:
        fit: of an axis.
        period: of the log [s].
        estimates: of its parameters, with what the other checks add to their intervals.
    """
    model = fit.model
    table = fit.nominal
    findings = []
    if _beyond(estimates["inertia"], table.inertia / FAR_INERTIA, table.inertia * FAR_INERTIA):
        reason = (
            f"inertia is {times_words(model.inertia / table.inertia, 2)} that of the machine's table: must be "
            f"{1 / FAR_INERTIA:g} to {FAR_INERTIA:g} times; check units, gear and payload"
        )
        findings.append(Finding(PLAUSIBILITY, (), reason))
    delay = estimates["delay"]
    if delay.value < -EARLY_DELAY * period and delay.interval[1] < 0:
        reason = (
            f"delay = {1e3 * delay.value:.3g} ms: must be at least 0; the motion is ahead of its torque: the torque "
            f"was logged later than the position, or filtered{_faster_drive(fit, delay)}"
        )
        findings.append(Finding(PLAUSIBILITY, (), reason))
    if delay.interval[0] > LATEST_DELAY * period:
        reason = f"delay = {1e3 * delay.value:.3g} ms: must be at most {LATEST_DELAY:g} periods of the log"
        findings.append(Finding(PLAUSIBILITY, (), reason))
    for name, values in (("viscous", VISCOUS), ("coulomb", ("coulomb", "static"))):
        low, high = estimates[name].interval
        if float(getattr(model, name)) <= 1e-6 * float(getattr(table, name)):
            reason = f"{name} friction is at its bound, 0: by the log it is from {low:.2g} to {high:.2g}"
            findings.append(Finding(PLAUSIBILITY, FRICTION if high < 0 else values, reason))
    excess = estimates["excess"]
    half = CONFIDENCE * excess.deviation
    if half > EXCESS_SEEN * excess.value:
        reason = (
            f"static friction exceeds Coulomb friction by {excess.value:.2g} ± {half:.2g} N·m: must be known within "
            f"{100 * EXCESS_SEEN:.0f} %; the log does not show it"
        )
        findings.append(Finding(PLAUSIBILITY, ("static",), reason))
    travel = model.deflection * model.scale
    if "gap" in estimates and model.gap < GAP_OVER_BRISTLES * travel:
        reason = (
            f"backlash is {model.gap:.2g} {fit.unit}, presliding of the friction {travel:.2g} {fit.unit}: must be at "
            f"least {GAP_OVER_BRISTLES:g} times as wide to be told from it"
        )
        findings.append(Finding(PLAUSIBILITY, ("gap",), reason))
    if table.coulomb > 0 and _beyond(estimates["coulomb"], table.coulomb / FRICTION_FAR, table.coulomb * FRICTION_FAR):
        reason = (
            f"Coulomb friction is {times_words(model.coulomb / table.coulomb, 2)} that of the machine's table: must be "
            f"{1 / FRICTION_FAR:g} to {FRICTION_FAR:g} times"
        )
        findings.append(Finding(PLAUSIBILITY, FRICTION, reason))
    return findings


def _beyond(estimate: Estimate, low: float, high: float) -> bool:
    """Whether a value is outside bounds with the whole of its interval."""
    return estimate.interval[1] < low or estimate.interval[0] > high


# Check: the parameters must not depend on any one part of the log.
#
# A model with the structure of the axis has one set of parameters for early and late, slow and fast, both directions,
# every place of the travel and every torque. Where the estimate moves by more than its own scatter once a part is left
# out, the difference is a property of the model, and no interval from the noise alone covers it: a jackknife over parts
# that are not alike, instead of random ones (B. Efron, The Jackknife, the Bootstrap and Other Resampling Plans, 1982).

PARTS_OF_LOG = "parts of the log"
LARGEST_CHANGE = 0.1  # change of a value from which it is not identified, of the value
SIGNIFICANT_CHANGE = 3.0  # standard deviations from which a change counts
_NOT_JUDGED = ("viscous", "coulomb", "offset", "excess")  # reported by the torque, which has parts of its own; static


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
            # of a delay of zero, every change is large
            value = max(value, period)
        if change > LARGEST_CHANGE * value:
            share = change_words(change / value) if value else "all of its value"
            reason = (
                f"{name} changes by {share} with a part of the log ({partition}) left out: must be within "
                f"{100 * LARGEST_CHANGE:.0f} %"
            )
            findings.append(Finding(PARTS_OF_LOG, (name,), reason))
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
    for partition, masks in partitions(fit.position, fit.torque, fit.used, period, fit.starts).items():
        for mask in masks:
            others = ~mask[fit.used]
            if min(others.sum(), (~others).sum()) < _PART_SAMPLES:
                continue
            change, deviation = _without(parameters, sensitivity, others)
            for k, name in enumerate(names):
                if deviation[k] > 0 and abs(change[k]) > SIGNIFICANT_CHANGE * deviation[k]:
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
