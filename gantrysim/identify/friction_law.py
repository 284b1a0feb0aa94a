"""The friction of an axis by its log: viscous and Coulomb friction, constant torque, and the terms that the log needs.

An interval holds more than the scatter of one regression: by how much a value moves with any other term, and with any
part of the log left out.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.identify.friction_terms import COGGING, LOAD, POSITION, POSITIVE, SQUARE, STRIBECK, Term
from gantrysim.identify.parts import partitions
from gantrysim.identify.result import Estimate, FrictionLaw
from gantrysim.identify.torque_regression import NAMES, Solution, TorqueRegression

# Chooses the terms of friction that a log needs, one by one, by the share of the remaining torque they explain.

_MOST_TERMS = 4  # terms
_GAIN = 0.05  # least share of the remaining torque's variance that a term explains
_SIGNIFICANT_TERM = 16.0  # least squared coefficient over its variance, per coefficient
_STRIBECK_SPEEDS = (0.45, 1.5, 4.5, 15.0)  # that are tried, times the table's
_LONGEST = 0.75  # period over the travel, of the log's travel: a longer one is a slope, which other terms have too
_SHORTEST = 1 / 80  # the same
_STEP = 0.25  # of the scan, in periods over the whole travel
_PEAKS = 3  # of the scan that are tried
_FINE_SCAN = (-0.25, -0.125, 0.0, 0.125, 0.25)  # around a peak, in periods over the whole travel


class Candidate(NamedTuple):
    """A term beside those chosen.

    Attributes:
        term: which.
        solution: of the regression with it.
        gain: share of the remaining torque's variance that it explains.
        evidence: its squared coefficients over their covariance, per coefficient.
    """

    term: Term
    solution: Solution
    gain: float
    evidence: float


def chosen_terms(regression: TorqueRegression, stribeck: float) -> tuple[tuple[Term, ...], Solution, list[Candidate]]:
    """Return the terms that a log needs, the regression with them, and the candidates that were not taken.

    Args:
        regression: of the log.
        stribeck: Stribeck speed of the machine's table [u/s].
    """
    terms: tuple[Term, ...] = ()
    solution = regression.solved(terms)
    while True:
        others = list(_candidates(regression, terms, solution, stribeck))
        worthy = [other for other in others if other.gain > _GAIN and other.evidence > _SIGNIFICANT_TERM]
        if not worthy or len(terms) == _MOST_TERMS:
            return terms, solution, others
        best = max(worthy, key=lambda other: other.gain)
        terms = (*terms, best.term)
        solution = best.solution


def _candidates(
    regression: TorqueRegression, terms: tuple[Term, ...], solution: Solution, stribeck: float
) -> Iterator[Candidate]:
    """Yield what one more term would explain; a coefficient of the wrong sign is none."""
    kinds = {term.kind for term in terms}
    tried = [Term(kind) for kind in (SQUARE, LOAD) if kind not in kinds]
    if STRIBECK not in kinds:
        tried += [Term(STRIBECK, factor * stribeck) for factor in _STRIBECK_SPEEDS]
    for kind in (POSITION, COGGING):
        periodic = _periodic(regression, solution, kind)
        if periodic is not None:
            tried.append(periodic)
    before = float(solution.remainder @ solution.remainder)
    for term in tried:
        extended = regression.solved((*terms, term))
        first = len(NAMES) + sum(regression.columns_of(other).shape[1] for other in terms)
        values = extended.values[first:]
        if term.kind in POSITIVE and values[0] < 0:
            continue
        gain = 1 - float(extended.remainder @ extended.remainder) / max(before, 1e-300)
        weight = np.linalg.pinv(extended.covariance[first:, first:])
        yield Candidate(term, extended, gain, float(values @ weight @ values) / values.size)


def _periodic(regression: TorqueRegression, solution: Solution, kind: str) -> Term | None:
    """Return the term of the period over the travel that explains most of the remaining torque.

    A sum over the samples, without the low-pass, finds the nearest periods; the regression tells them apart.
    """
    position = regression.motion.position[regression.slides]
    travel = float(np.ptp(position))
    if not travel > 0:
        return None
    direction = regression.motion.direction[regression.slides] if kind == POSITION else 1.0
    waves = np.arange(1 / _LONGEST, 1 / _SHORTEST, _STEP) / travel
    weighted = solution.remainder * direction
    phases = 2j * np.pi * position
    power = np.array([abs(np.sum(weighted * np.exp(wave * phases))) for wave in waves])
    best = 0.0
    term = None
    for peak in _peaks(waves, power, 1 / travel):
        for shift in _FINE_SCAN:
            wave = peak + shift / travel
            if not waves[0] <= wave <= waves[-1]:
                continue
            trial = Term(kind, 1 / float(wave))
            columns = regression.columns_of(trial)
            columns = columns - solution.basis @ (solution.basis.T @ columns)
            fitted = columns @ np.linalg.lstsq(columns, solution.remainder, rcond=None)[0]
            explained = float(fitted @ fitted)
            if explained > best:
                best = explained
                term = trial
    return term


def _peaks(waves: Floats, power: Floats, apart: float) -> list[float]:
    """Return the strongest waves that keep a distance from one another."""
    peaks: list[float] = []
    for k in np.argsort(power)[::-1]:
        if all(abs(waves[k] - peak) > apart for peak in peaks):
            peaks.append(float(waves[k]))
        if len(peaks) == _PEAKS:
            break
    return peaks


FRICTION = ("viscous", "coulomb", "offset")
_SIGNS = {"viscous": 1.0, "coulomb": 1.0, "offset": -1.0}  # the model's constant torque drives, the regression's brakes
_SCATTER = 2.0  # factor on deviations of the regression: blocks of a log are not as independent as a formula has it
_LEAST_DEVIATION = {"viscous": 0.015, "coulomb": 0.01}  # deviation that no log undercuts, of the value
_OFFSET = 0.01  # the same of the constant torque, of the Coulomb friction
_LOAD = 0.03  # deviation of Coulomb friction beside a friction by load, which it resembles, of its value
_SIGNIFICANT = 3.0  # standard deviations from which a change without a part of the log counts
_FEWEST = 200  # samples of a part, and of what remains


def friction_law(regression: TorqueRegression, used: NDArray[np.bool_], stribeck: float, unit: str) -> FrictionLaw:
    """Return the friction of a log.

    Args:
        regression: of its torque.
        used: whether a sample is in motion, (n,) bool.
        stribeck: Stribeck speed of the machine's table [u/s].
        unit: of the position, u.
    """
    terms, solution, others = chosen_terms(regression, stribeck)
    level, ripple, words = _course(regression, terms, solution, unit)
    masks = partitions(regression.motion.position, regression.motion.torque, used, regression.period)
    unevenness = _unevenness(regression, solution, masks)
    return FrictionLaw(
        estimates=_estimates(terms, solution, others, _without_parts(regression, solution, masks)),
        terms=terms,
        words=words,
        level=level,
        ripple=ripple,
        remainder=float(np.sqrt(np.mean(solution.remainder**2))),
        size=float(np.sqrt(np.mean(regression.torque**2))),
        unevenness=unevenness,
    )


def _course(
    regression: TorqueRegression, terms: tuple[Term, ...], solution: Solution, unit: str
) -> tuple[Floats, Floats, tuple[str, ...]]:
    """Return level and ripple of the terms at each sample, (n,) each, and the terms in words."""
    motion = regression.motion
    level = np.zeros(motion.position.size)
    ripple = np.zeros(motion.position.size)
    words = []
    coulomb = float(solution.values[NAMES.index("coulomb")])
    fastest = float(np.quantile(np.abs(motion.calm), 0.99))
    first = len(NAMES)
    for term in terms:
        shapes = np.stack(term.levels(motion))
        values = solution.values[first : first + len(shapes)]
        first += len(shapes)
        if term.kind == COGGING:
            ripple += values @ shapes
        else:
            level += values @ shapes
        words.append(term.words(values, coulomb, fastest, unit))
    return level, ripple, tuple(words)


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
        with_others = [_moved_by_term(solution, other.solution, k) for other in others]
        floor = _OFFSET * coulomb if name == "offset" else _LEAST_DEVIATION[name] * abs(value)
        if name == "coulomb" and any(term.kind == LOAD for term in terms):
            floor = _LOAD * abs(value)
        scatter = _SCATTER * float(np.sqrt(max(variance, 0.0)))
        deviation = float(np.linalg.norm([scatter, max(with_others, default=0.0), without_parts[k], floor]))
        estimates[name] = Estimate(value, deviation)
    return estimates


def _moved_by_term(solution: Solution, extended: Solution, k: int) -> float:
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


def _unevenness(
    regression: TorqueRegression, solution: Solution, masks: dict[str, list[NDArray[np.bool_]]]
) -> dict[str, float]:
    """Return by partition the largest mean friction that remains in a part, less two standard deviations [N·m]."""
    direction = regression.motion.direction[regression.slides]
    friction = solution.remainder * direction
    largest = {}
    for name, parts in masks.items():
        sizes = [0.0]
        for part in parts:
            inside = part[regression.slides]
            if inside.sum() >= _FEWEST:
                values = friction[inside]
                deviation = np.sqrt(regression.variance_of_sum(values - values.mean())) / values.size
                sizes.append(abs(float(values.mean())) - 2 * float(deviation))
        largest[name] = max(sizes)
    return largest
