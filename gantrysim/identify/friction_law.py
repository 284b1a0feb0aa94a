"""The friction of an axis by its log: viscous and Coulomb friction, constant torque, and the terms that the log needs.

An interval holds more than the scatter of one regression: by how much a value moves with any other term, and with any
part of the log left out.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.identify.checks.parts import partitions
from gantrysim.identify.friction_choice import Candidate, chosen_terms
from gantrysim.identify.friction_terms import COGGING, LOAD, Term
from gantrysim.identify.model import AxisModel
from gantrysim.identify.result import Estimate, FrictionLaw
from gantrysim.identify.torque_regression import NAMES, Solution, TorqueRegression

FRICTION = ("viscous", "coulomb", "offset")
_SIGNS = {"viscous": 1.0, "coulomb": 1.0, "offset": -1.0}  # the model's constant torque drives, the regression's brakes
_SCATTER = 1.5  # factor on deviations of the regression: blocks of a log are not as independent as a formula has it
_LEAST = {"viscous": 0.015, "coulomb": 0.01}  # deviation that no log undercuts, of the value
_OFFSET = 0.01  # the same of the constant torque, of the Coulomb friction
_LOAD = 0.03  # deviation of Coulomb friction beside a friction by load, which it resembles, of its value
_SIGNIFICANT = 3.0  # standard deviations from which a change without a part of the log counts
_FEWEST = 200  # samples of a part, and of what remains


def friction_law(
    model: AxisModel, unit: str, period: float, position: Floats, torque: Floats, used: NDArray[np.bool_], held: bool
) -> FrictionLaw:
    """Return the friction of a log.

    Args:
        model: whose lag, delay and Stribeck speed hold.
        unit: of the position, u.
        period: of the samples [s].
        position: (n,) [u].
        torque: (n,) [N·m].
        used: whether a sample is in motion, (n,) bool.
        held: whether the torque is a demand, held from sample to sample.
    """
    regression = TorqueRegression.of(model, period, position, torque, held)
    terms, solution, others = chosen_terms(regression, model.scale * model.stribeck)
    coefficients = solution.values[len(NAMES) :]
    level = np.zeros(position.size)
    ripple = np.zeros(position.size)
    words = []
    coulomb = float(solution.values[NAMES.index("coulomb")])
    fastest = float(np.quantile(np.abs(regression.motion.calm), 0.99))
    first = 0
    for term in terms:
        shapes = term.levels(regression.motion)
        values = coefficients[first : first + len(shapes)]
        first += len(shapes)
        torques = np.sum([value * shape for value, shape in zip(values, shapes, strict=True)], axis=0)
        if term.kind == COGGING:
            ripple += torques
        else:
            level += torques
        words.append(term.words(values, coulomb, fastest, unit))
    masks = partitions(position, torque, used, period)
    return FrictionLaw(
        estimates=_estimates(terms, solution, others, _without_parts(regression, solution, masks)),
        terms=terms,
        words=tuple(words),
        level=level,
        ripple=ripple,
        remainder=float(np.sqrt(np.mean(solution.remainder**2))),
        size=float(np.sqrt(np.mean(regression.torque**2))),
    )


def _estimates(
    terms: tuple[Term, ...], solution: Solution, others: list[Candidate], without_parts: Floats
) -> dict[str, Estimate]:
    """Return viscous and Coulomb friction and the constant torque with their deviations."""
    coulomb = abs(float(solution.values[NAMES.index("coulomb")]))
    estimates = {}
    for name in FRICTION:
        k = NAMES.index(name)
        value = _SIGNS[name] * float(solution.values[k])
        variance = float(solution.covariance[k, k])
        with_others = [_moved(solution, other.solution, k) for other in others]
        floor = _OFFSET * coulomb if name == "offset" else _LEAST[name] * abs(value)
        if name == "coulomb" and any(term.kind == LOAD for term in terms):
            floor = _LOAD * abs(value)
        scatter = _SCATTER * float(np.sqrt(max(variance, 0.0)))
        deviation = float(np.linalg.norm([scatter, max(with_others, default=0.0), without_parts[k], floor]))
        estimates[name] = Estimate(value, deviation)
    return estimates


def _moved(solution: Solution, extended: Solution, k: int) -> float:
    """Return how far a coefficient moves with one more term, beyond the scatter of that move.

    The difference of the variances is the move's own (J. Hausman, Econometrica 46, 1978).
    """
    change = float(extended.values[k] - solution.values[k])
    scatter = float(extended.covariance[k, k] - solution.covariance[k, k])
    return float(np.sqrt(max(change**2 - max(scatter, 0.0), 0.0)))


def _without_parts(
    regression: TorqueRegression, solution: Solution, masks: dict[str, list[NDArray[np.bool_]]]
) -> Floats:
    """Return the largest significant change of each coefficient of `NAMES` with a part of the log left out, (6,)."""
    largest = np.zeros(len(NAMES))
    matrix = solution.matrix
    whole = matrix.T @ matrix
    deviation = np.sqrt(np.maximum(np.diag(solution.covariance), 0.0))
    for parts in masks.values():
        for part in parts:
            inside = part[regression.slides]
            if min(inside.sum(), (~inside).sum()) < _FEWEST:
                continue
            # the normal equations without the part; the remainder is orthogonal to the whole matrix
            inner = matrix[inside]
            remaining = whole - inner.T @ inner
            change = -np.linalg.pinv(remaining) @ (inner.T @ solution.remainder[inside]) / solution.sizes
            share = np.sqrt(np.diag(np.linalg.pinv(whole)) / np.maximum(np.diag(np.linalg.pinv(remaining)), 1e-300))
            counted = np.abs(change) * np.minimum(share, 1.0)
            counted = np.where(counted > _SIGNIFICANT * deviation, counted, 0.0)
            largest = np.maximum(largest, counted[: len(NAMES)])
    return largest
