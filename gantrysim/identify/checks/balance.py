"""Check: torque must balance inertia and friction at low frequency too.

The fit weighs every sample by how well it predicts the next one, so that a slow error of the torque hardly counts. Here
torque, acceleration and the friction of the law that the log has chosen pass one zero-phase low-pass, and what remains
of the torque is regressed on the acceleration: the test of J. Hausman (Econometrica 46, 1978) of two estimators of the
inertia that agree only where the model is right. What then remains is averaged over parts of the log: a friction that
depends on place, load or speed otherwise than in its law shows as a mean of its own in each.
"""

# ruff: noqa: N803, N806 - matrices bear the letters of the equations

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from gantrysim.base.arrays import Floats
from gantrysim.identify.checks.finding import FRICTION, Doubt, Finding
from gantrysim.identify.checks.parts import partitions
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
    """Result of the balance.

    Attributes:
        change: inertia of the balance less that of the fit [N·m·s²/u].
        deviation: its standard deviation.
        parts: by partition, the largest mean friction that remains in a part, less two standard deviations [N·m].
    """

    change: float
    deviation: float
    parts: dict[str, float]


def check_balance(fit: AxisFit, period: float) -> Doubt:
    """Return how far the balance's inertia is from the fit's, and whether the friction's law is another one."""
    balance = torque_balance(fit, period)
    if balance is None:
        return Doubt({}, [Finding(CHECK, FRICTION, "too few samples slide to balance the torque")])
    extra = {"inertia": float(np.sqrt(max(balance.change**2 - balance.deviation**2, 0.0)))}
    largest = max(balance.parts, key=lambda name: balance.parts[name], default="")
    uneven = balance.parts.get(largest, 0.0)
    extra["coulomb"] = uneven
    extra["static"] = uneven  # their difference stands on the same friction
    return Doubt(extra, _findings(fit, largest, uneven))


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
    change, deviation, remainder = _regression(np.stack(columns, axis=1)[slides], remains[slides], memory)
    parts = _parts(fit, period, slides, remainder * direction[slides], memory)
    return Balance(float(change[0]), float(deviation[0]), parts)


def _regression(A: Floats, torque: Floats, memory: int) -> tuple[Floats, Floats, Floats]:
    """Return the coefficients of the columns in a torque, their standard deviations, and the remaining torque."""
    size = np.abs(A).max(axis=0)
    A = A / size
    coefficients = np.linalg.lstsq(A, torque, rcond=None)[0]
    remainder = torque - A @ coefficients
    variance = np.diag(long_run_covariance(A, remainder, memory))
    return coefficients / size, np.sqrt(np.maximum(variance, 0.0)) / size, remainder


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


def _parts(fit: AxisFit, period: float, slides: NDArray[np.bool_], friction: Floats, memory: int) -> dict[str, float]:
    """Return by partition the largest mean of a friction over a part, less two standard deviations [N·m]."""
    largest = {}
    for name, masks in partitions(fit.position, fit.torque, fit.used, period).items():
        sizes = [0.0]
        for mask in masks:
            values = friction[mask[1:-1][slides]]
            if values.size >= _FEWEST:
                variance = long_run_covariance(np.ones((values.size, 1)), values - values.mean(), memory)[0, 0]
                sizes.append(abs(float(values.mean())) - 2 * float(np.sqrt(max(variance, 0.0))))
        largest[name] = max(sizes)
    return largest
