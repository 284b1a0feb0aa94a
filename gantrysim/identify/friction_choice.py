"""Chooses the terms of friction that a log needs, one by one, by the share of the remaining torque they explain."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.identify.friction_terms import COGGING, LOAD, POSITION, POSITIVE, SQUARE, STRIBECK, Term
from gantrysim.identify.torque_regression import NAMES, Solution, TorqueRegression

_MOST = 4  # terms
_GAIN = 0.05  # least share of the remaining torque's variance that a term explains
_SIGNIFICANT = 16.0  # least squared coefficient over its variance, per coefficient
_STRIBECK_SPEEDS = (0.45, 1.5, 4.5, 15.0)  # that are tried, times the table's
_LONGEST = 0.75  # period over the travel, of the log's travel: a longer one is a slope, which other terms have too
_SHORTEST = 1 / 80  # the same
_STEP = 0.25  # of the scan, in periods over the whole travel
_PEAKS = 3  # of the scan that are tried
_FINE = (-0.25, -0.125, 0.0, 0.125, 0.25)  # around a peak, in periods over the whole travel


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
        worthy = [other for other in others if other.gain > _GAIN and other.evidence > _SIGNIFICANT]
        if not worthy or len(terms) == _MOST:
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
        for shift in _FINE:
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
