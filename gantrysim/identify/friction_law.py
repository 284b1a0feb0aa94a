"""The friction of an axis by its log: viscous and Coulomb friction, constant torque, and the terms that the log needs.

An interval holds more than the scatter of one regression: by how much a value moves with any other term, and with any
part of the log left out.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from gantrysim.base.arrays import Floats
from gantrysim.identify.friction_terms import (
    DIRECTION,
    LOAD,
    OWN,
    PERIODIC,
    POSITION,
    POSITIVE_TERMS,
    SQUARE,
    STRIBECK,
    Term,
)
from gantrysim.identify.pieces import as_wide, partitions
from gantrysim.identify.result import Estimate, FrictionLaw
from gantrysim.identify.torque_regression import NAMES, Solution, TorqueRegression

# Chooses the terms of friction that a log needs, one by one, by the share of the remaining torque they explain.

_MOST_TERMS = 4  # terms
_MOST_LOAD = 0.5  # friction by load, of the motor's torque
_GAIN = 0.05  # least share of the remaining torque's variance that a term explains
_SIGNIFICANT_TERM = 16.0  # least squared coefficient over its variance, per coefficient
_STRIBECK_SPEEDS = (0.45, 1.5, 4.5)  # that are tried, times the table's
_LONGEST_PERIOD = 1 / 3  # period over the travel, of the log's travel: of a longer one nothing shows that it repeats
_LONGEST_SEARCHED = 2.0  # period up to which the search looks for what a shorter wave would imitate, of the travel
_SHORTEST_PERIOD = 1 / 80  # the same
_HELD_OUT = 0.5  # least gain of a wave in parts that it was not fitted to, of its gain where it was
_TIME_PARTS = 3  # parts of the time, of which one at a time is left out
_TRAVEL_PLACES = 4  # of the travel
_SCAN_STEP = 0.25  # of the scan, in periods over the whole travel
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

    A periodic term comes after all others, as waves over the travel imitate them.

    Args:
        regression: of the log.
        stribeck: Stribeck speed of the machine's table [u/s].
    """
    terms: tuple[Term, ...] = ()
    solution = regression.solved(terms)
    while True:
        plain = list(_candidates(regression, terms, solution, _plain_terms(terms, stribeck)))
        worthy = [other for other in plain if _is_worthy(other)]
        others = plain
        if not worthy:
            waves = list(_candidates(regression, terms, solution, _waves(regression, solution)))
            worthy = [other for other in waves if _is_worthy(other) and _repeats(regression, solution, other)]
            others = plain + waves
        if not worthy or len(terms) == _MOST_TERMS:
            return terms, solution, others
        best = max(worthy, key=lambda other: other.gain)
        terms = (*terms, best.term)
        solution = best.solution


def _is_worthy(candidate: Candidate) -> bool:
    return candidate.gain > _GAIN and candidate.evidence > _SIGNIFICANT_TERM


def _plain_terms(terms: tuple[Term, ...], stribeck: float) -> list[Term]:
    """Return the terms that do not repeat over the travel and are not among the chosen ones."""
    kinds = {term.kind for term in terms}
    tried = [Term(kind) for kind in (DIRECTION, SQUARE, LOAD) if kind not in kinds]
    if STRIBECK not in kinds:
        tried += [Term(STRIBECK, factor * stribeck) for factor in _STRIBECK_SPEEDS]
    return tried


def _waves(regression: TorqueRegression, solution: Solution) -> list[Term]:
    """Return the best term of each kind that repeats over the travel."""
    waves = (_periodic(regression, solution, kind) for kind in PERIODIC)
    return [wave for wave in waves if wave is not None]


def _candidates(
    regression: TorqueRegression, terms: tuple[Term, ...], solution: Solution, tried: list[Term]
) -> Iterator[Candidate]:
    """Yield what one more term would explain; a coefficient of the wrong sign is none."""
    before = float(solution.remainder @ solution.remainder)
    first = len(solution.values)
    for term in tried:
        extended = regression.solved((*terms, term))
        values = extended.values[first:]
        if term.kind in POSITIVE_TERMS and values[0] < 0:
            continue
        # where the torque never brakes, its size in the direction of motion is the torque itself
        if term.kind == LOAD and values[0] > _MOST_LOAD:
            continue
        gain = 1 - float(extended.remainder @ extended.remainder) / max(before, 1e-300)
        weight = np.linalg.pinv(extended.covariance[first:, first:])
        yield Candidate(term, extended, gain, float(values @ weight @ values) / values.size)


def _repeats(regression: TorqueRegression, without: Solution, candidate: Candidate) -> bool:
    """Whether a wave explains the torque of parts of the log that its coefficients were not fitted to.

    Thirds of the time and quarters of the travel are left out in turn: what is there by chance at some time or place,
    or is no wave, does not repeat there.
    """
    position = regression.motion.position[regression.slides]
    for values, count in ((np.arange(position.size, dtype=np.float64), _TIME_PARTS), (position, _TRAVEL_PLACES)):
        edges = np.linspace(values.min(), values.max(), count + 1)[1:-1]
        part = np.searchsorted(edges, values)
        before = sum(_held_out(without, part == k) for k in range(count))
        after = sum(_held_out(candidate.solution, part == k) for k in range(count))
        if 1 - after / before < _HELD_OUT * candidate.gain:
            return False
    return True


def _held_out(solution: Solution, inside: NDArray[np.bool_]) -> float:
    """Return the sum of squares of what a regression leaves in a part when fitted to all else."""
    matrix = solution.matrix
    inner = matrix[inside]
    # the normal equations without the part; the remainder is orthogonal to the whole matrix
    change = -np.linalg.pinv(matrix.T @ matrix - inner.T @ inner) @ (inner.T @ solution.remainder[inside])
    return float(np.sum((solution.remainder[inside] - inner @ change) ** 2))


def _periodic(regression: TorqueRegression, solution: Solution, kind: str) -> Term | None:
    """Return the term of the period over the travel that explains most of the remaining torque.

    A sum over the samples, without the low-pass, finds the nearest periods; the regression tells them apart. Periods
    that are too long to be seen to repeat are searched too: where one explains most, a shorter one only imitates it.
    """
    position = regression.motion.position[regression.slides]
    travel = float(np.ptp(position))
    if not travel > 0:
        return None
    direction = regression.motion.direction[regression.slides] if kind == POSITION else 1.0
    waves = np.arange(1 / _LONGEST_SEARCHED, 1 / _SHORTEST_PERIOD, _SCAN_STEP) / travel
    weighted = solution.remainder * direction
    phases = 2j * np.pi * position
    power = np.array([abs(np.sum(weighted * np.exp(wave * phases))) for wave in waves])

    def unexplained(wave: float) -> float:
        columns = regression.columns_of(Term(kind, 1 / wave))
        columns = columns - solution.basis @ (solution.basis.T @ columns)
        fitted = columns @ np.linalg.lstsq(columns, solution.remainder, rcond=None)[0]
        return -float(fitted @ fitted)

    trials = [peak + shift / travel for peak in _peaks(waves, power, 1 / travel) for shift in _FINE_SCAN]
    inner = [wave for wave in trials if waves[0] <= wave <= waves[-1]]
    if not inner:
        return None
    best = min(inner, key=unexplained)
    half = _FINE_SCAN[-1] / 2 / travel
    near = (max(best - half, waves[0]), min(best + half, waves[-1]))
    minimum = minimize_scalar(unexplained, bounds=near, method="bounded", options={"xatol": 0.02 * half})
    period = 1 / float(minimum.x)
    return Term(kind, period) if period <= _LONGEST_PERIOD * travel else None


def _peaks(waves: Floats, power: Floats, apart: float) -> list[float]:
    """Return the strongest waves that keep a distance from one another."""
    peaks: list[float] = []
    for k in np.argsort(power)[::-1]:
        if all(abs(waves[k] - peak) > apart for peak in peaks):
            peaks.append(float(waves[k]))
        if len(peaks) == _PEAKS:
            break
    return peaks


# Factors on the scatter of the regression, as blocks of a log are not as independent as a formula has it, and on the
# largest significant change without a part. By the truth of 178 random axes with nine laws of friction.
_SCATTER = 2.25
_PART = 1 / 3
_TRAVEL_PARTS = 6  # parts of the travel
# deviation that no log undercuts, of the value
_LEAST_DEVIATION = {"viscous": 0.015, "viscous_forward": 0.015, "viscous_back": 0.015, "coulomb": 0.01}
_OFFSET = 0.01  # the same of the constant torque, of the Coulomb friction
_LOAD = 0.03  # deviation of Coulomb friction beside a friction by load, which it resembles, of its value
_SIGNIFICANT_CHANGE = 3.0  # standard deviations from which a change without a part of the log counts
_PART_SAMPLES = 200  # samples of a part, and of what remains


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
    motion = regression.motion
    masks = partitions(motion.position, motion.torque, used, regression.period, regression.starts)
    # quarters of the travel average a wave of their own length out
    unevenness = _unevenness(regression, solution, {**masks, "place": as_wide(motion.position, used, _TRAVEL_PARTS)})
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
        mine = slice(first, first + len(shapes))
        values = solution.values[mine]
        first = mine.stop
        if term.kind in OWN:
            ripple += values @ shapes
        else:
            level += values @ shapes
        words.append(term.words(values, solution.covariance[mine, mine], coulomb, fastest, unit))
    return level, ripple, tuple(words)


def _quantities(terms: tuple[Term, ...], solution: Solution) -> dict[str, Floats]:
    """Return the friction's values as sums of the regression's coefficients, (p,) each."""
    unit = np.eye(solution.values.size)
    viscous = unit[NAMES.index("viscous")]
    # the model's constant torque drives, the regression's brakes
    quantities = {"viscous": viscous, "coulomb": unit[NAMES.index("coulomb")], "offset": -unit[NAMES.index("offset")]}
    if any(term.kind == DIRECTION for term in terms):
        difference = unit[_column(terms, DIRECTION)]
        quantities |= {"viscous_forward": viscous + difference, "viscous_back": viscous - difference}
    return quantities


def _column(terms: tuple[Term, ...], kind: str) -> int:
    """Return the first column of a term."""
    kinds = [term.kind for term in terms]
    return len(NAMES) + sum(2 if term.kind in PERIODIC else 1 for term in terms[: kinds.index(kind)])


def _estimates(
    terms: tuple[Term, ...], solution: Solution, others: list[Candidate], without: list[_WithoutPart]
) -> dict[str, Estimate]:
    """Return viscous and Coulomb friction and the constant torque with their deviations."""
    coulomb = abs(float(solution.values[NAMES.index("coulomb")]))
    estimates = {}
    for name, quantity in _quantities(terms, solution).items():
        value = float(quantity @ solution.values)
        variance = float(quantity @ solution.covariance @ quantity)
        with_others = [_moved_by_term(solution, other.solution, quantity) for other in others]
        floor = _OFFSET * coulomb if name == "offset" else _LEAST_DEVIATION[name] * abs(value)
        if name == "coulomb" and any(term.kind == LOAD for term in terms):
            floor = _LOAD * abs(value)
        scatter = _SCATTER * float(np.sqrt(max(variance, 0.0)))
        with_part = _PART * _moved_by_part(solution, without, quantity)
        deviation = float(np.linalg.norm([scatter, max(with_others, default=0.0), with_part, floor]))
        estimates[name] = Estimate(value, deviation)
    return estimates


def _moved_by_term(solution: Solution, extended: Solution, quantity: Floats) -> float:
    """Return how far a quantity moves with one more term, beyond the scatter of that move.

    The difference of the variances is the move's own (J. Hausman, Econometrica 46, 1978).
    """
    count = quantity.size
    change = float(quantity @ (extended.values[:count] - solution.values))
    scatter = float(quantity @ (extended.covariance[:count, :count] - solution.covariance) @ quantity)
    return float(np.sqrt(max(change**2 - max(scatter, 0.0), 0.0)))


class _WithoutPart(NamedTuple):
    """A regression without a part of the log.

    Attributes:
        change: of the coefficients, (p,).
        inverse: of its normal matrix, (p, p).
    """

    change: Floats
    inverse: Floats


def _without_parts(
    regression: TorqueRegression, solution: Solution, masks: dict[str, list[NDArray[np.bool_]]]
) -> list[_WithoutPart]:
    """Return what the regression becomes with each part of the log left out."""
    without = []
    matrix = solution.matrix
    whole = matrix.T @ matrix
    sizes = np.outer(solution.sizes, solution.sizes)
    for parts in masks.values():
        for part in parts:
            inside = part[regression.slides]
            if min(inside.sum(), (~inside).sum()) < _PART_SAMPLES:
                continue
            # the normal equations without the part; the remainder is orthogonal to the whole matrix
            inner = matrix[inside]
            inverse = np.linalg.pinv(whole - inner.T @ inner)
            change = -inverse @ (inner.T @ solution.remainder[inside]) / solution.sizes
            without.append(_WithoutPart(change, inverse / sizes))
    return without


def _moved_by_part(solution: Solution, without: list[_WithoutPart], quantity: Floats) -> float:
    """Return the largest significant change of a quantity with a part of the log left out.

    Where the rest of the log tells less of the quantity than the whole, its change counts in proportion.
    """
    deviation = math.sqrt(max(float(quantity @ solution.covariance @ quantity), 0.0))
    matrix = solution.matrix
    inverse = np.linalg.pinv(matrix.T @ matrix) / np.outer(solution.sizes, solution.sizes)
    known = float(quantity @ inverse @ quantity)
    largest = 0.0
    for part in without:
        share = math.sqrt(known / max(float(quantity @ part.inverse @ quantity), 1e-300))
        change = abs(float(quantity @ part.change)) * min(share, 1.0)
        if change > _SIGNIFICANT_CHANGE * deviation:
            largest = max(largest, change)
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
            if inside.sum() >= _PART_SAMPLES:
                values = friction[inside]
                deviation = np.sqrt(regression.variance_of_sum(values - values.mean())) / values.size
                sizes.append(abs(float(values.mean())) - 2 * float(deviation))
        largest[name] = max(sizes)
    return largest
