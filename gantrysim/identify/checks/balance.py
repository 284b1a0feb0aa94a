"""Check: torque must balance inertia and friction at low frequency too.

The fit weighs every sample by how well it predicts the next one, so that a slow error of the torque hardly counts. Here
torque, acceleration and the friction of the law that the log has chosen pass one zero-phase low-pass, and what remains
of the torque is regressed on the acceleration: the test of J. Hausman (Econometrica 46, 1978) of two estimators of the
inertia that agree only where the model is right. What the law leaves of the torque is averaged over parts of the log: a
friction that depends on place, load or speed otherwise than in its law shows as a mean of its own in each.
"""

# ruff: noqa: N803, N806 - matrices bear the letters of the equations

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter1d

from gantrysim.base.arrays import Floats
from gantrysim.identify.checks.finding import FRICTION, Doubt, Finding
from gantrysim.identify.model import AxisModel
from gantrysim.identify.prediction import effective_torque
from gantrysim.identify.result import MODE, AxisFit
from gantrysim.identify.whiteness import long_run_covariance

CHECK = "torque balance"
LARGEST = 0.1  # torque that remains in a part of the log, from which the friction's law is another one, of the friction
APART = 0.1  # Coulomb friction of the predictions less that of the law, from which the mode is doubtful, of the law's
_WIDTH = 0.004  # standard deviation of the low-pass [s]
_STEPS = 8  # of the torque's course in a sample
_MOVING = 0.02  # share of the highest speed from which an axis slides
_SLIDING = 0.9  # share of the samples around one that must be in motion
_FEWEST = 200  # samples of a part of the log
_MEMORY = 8  # correlation of what the low-pass leaves [widths]


class Balance(NamedTuple):
    """Inertia of the balance less that of the fit, and its standard deviation [N·m·s²/u]."""

    change: float
    deviation: float


def check_balance(fit: AxisFit, period: float) -> Doubt:
    """Return how far the balance's inertia is from the fit's, and whether the friction's law is another one."""
    balance = torque_balance(fit, period)
    if balance is None:
        return Doubt({}, [Finding(CHECK, FRICTION, "too few samples slide to balance the torque")])
    inertia = float(np.sqrt(max(balance.change**2 - balance.deviation**2, 0.0)))
    unevenness = fit.law.unevenness
    largest = max(unevenness, key=lambda name: unevenness[name])
    uneven = unevenness[largest]
    # static friction stands on the same level as Coulomb friction
    return Doubt({"inertia": inertia, "coulomb": uneven, "static": uneven}, _findings(fit, largest, uneven))


def _findings(fit: AxisFit, partition: str, uneven: float) -> list[Finding]:
    coulomb = fit.model.coulomb
    predicted = fit.predicted.coulomb
    findings = []
    if abs(predicted - coulomb) > APART * coulomb:
        reason = (
            f"the torque in steady motion gives a Coulomb friction of {coulomb:.3g} N·m, the predictions "
            f"{predicted:.3g} N·m: must agree within {100 * APART:.0f} %"
        )
        findings.append(Finding(CHECK, ("static", *MODE), reason))
    if uneven > LARGEST * coulomb:
        reason = (
            f"the friction differs with {partition} by {uneven:.2g} N·m beside {coulomb:.3g} N·m: must be within "
            f"{100 * LARGEST:.0f} %"
        )
        findings.append(Finding(CHECK, (*FRICTION, *MODE), reason))
    return findings


def torque_balance(fit: AxisFit, period: float) -> Balance | None:
    """Return the balance of the torque; None where too few samples slide."""
    model = fit.model
    width = _WIDTH / period
    torque = _torque(fit, period)
    acceleration = np.diff(fit.position, 2) / period**2
    speed = (fit.position[2:] - fit.position[:-2]) / (2 * period)
    slow = gaussian_filter1d(speed, width)
    direction = _direction(speed)
    friction = model.viscous * speed + (model.coulomb + fit.law.level[1:-1]) * direction + fit.law.ripple[1:-1]
    smooth = _of_both_masses(model, gaussian_filter1d(acceleration, width), period)
    remains = gaussian_filter1d(torque - friction, width) - model.inertia * smooth
    chosen = gaussian_filter1d(1.0 * (np.abs(slow) > _MOVING * float(np.quantile(np.abs(slow), 0.99))), width)
    slides = chosen > _SLIDING
    edge = round(4 * width)  # where the filter reaches beyond the log
    slides[:edge] = slides[-edge:] = False
    if slides.sum() < _FEWEST:
        return None
    columns = [smooth, slow, gaussian_filter1d(direction, width), np.ones_like(slow)]
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
    """Return the effective torque over the two steps around each sample but the ends, (n - 2,) [N·m].

    A second difference of the position is the acceleration's mean with triangular weights: so is this torque.
    """
    means = effective_torque(fit.model, period, fit.torque, _STEPS, fit.held).ravel()
    rise = np.arange(_STEPS) + 0.5
    weights = np.concatenate([rise, rise[::-1]]) / _STEPS**2
    return np.asarray(np.convolve(means, weights, "valid")[::_STEPS][: fit.position.size - 2])


def _direction(speed: Floats) -> Floats:
    """Return the sign of the last speed that is not zero; counts of the encoder stand still on slow moves."""
    last = np.maximum.accumulate(np.where(speed != 0, np.arange(speed.size), 0))
    return np.asarray(np.sign(speed[last]))


def _of_both_masses(model: AxisModel, acceleration: Floats, period: float) -> Floats:
    """Return the mean acceleration of motor and load by mass; below resonance the load's exceeds the motor's by a''/w².

    w is the natural frequency of the load with the motor held.
    """
    if not model.share:
        return acceleration
    flexibility = model.inertia * model.share / model.stiffness
    return acceleration - model.share * flexibility * np.gradient(np.gradient(acceleration, period), period)
