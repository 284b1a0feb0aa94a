"""Fit of a dispenser's parameters to all its measurements at once.

The error of a reading is s w, where w has the shape of an instrument's error and s is fitted. With the predictions f(x)
of variables x that have a weak assumption N(0, 1) each, the fit minimises

    |(f(x) - y) / (s w)|^2 + |x|^2.

Yield stress, slip and a flow index other than 1 are terms that a dispenser may have or not. Every choice of terms is
fitted, and weighed by its evidence (Laplace: D. MacKay, Information Theory, Inference, and Learning Algorithms, 2003,
chapter 28): an interval covers what the data leave open between them.
"""

# ruff: noqa: N803, N806 - matrices bear the letters of the equations

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares
from scipy.special import gammaln
from scipy.stats import t as student

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError
from gantrysim.identify.checks.finding import NotIdentifiedError
from gantrysim.identify.dispenser.measurements import Measurements
from gantrysim.identify.dispenser.model import INDEX, LEAK, YIELD, Model, Parameter, Reading, parameters_of, readings_of
from gantrysim.identify.dispenser.start import starts
from gantrysim.identify.whiteness import LAGS

NONE = {YIELD: 0.0, LEAK: 0.0, INDEX: 1.0}  # values of a term that a dispenser has not
READING_ERROR = 0.01  # usual error of a reading, of its value
_PASSES = 3  # in which the errors' sizes are solution
_TOLERANCE = 1e-7  # relative, of the sum of squares and of the variables
_DIGIT = 12**-0.5  # standard deviation of rounding to a digit
_LEAST_FREEDOM = 1.0
_WRONG_RESIDUAL = 1e6  # residual of values that no needle has
_CONFIDENCE = 0.95
_DERIVATIVE_STEP = 1e-4  # of a variable, for the derivative of a value
_LEAST_WEIGHT = 1e-4  # probability of a choice that counts
_WEIGHT_OF_ALL = 0.1  # least probability of the choice with every term
_MOST_STEPS = 60
_SEARCHED_STARTS = 2  # of the starts, those from which a search is made


class Errors(NamedTuple):
    """Size of the errors of a reading.

    Attributes:
        size: standard deviations, (n,).
        freedom: degrees of freedom from which it is known.
    """

    size: Floats
    freedom: float


class Minimum(NamedTuple):
    """The best variables under one choice of terms.

    Attributes:
        free: names of the parameters that were fitted.
        x: all variables, (p,).
        blocks: of each reading, residual over error, (n,), and its derivatives, (n, p) with zeros of what is fixed.
        evidence: logarithm, up to a constant.
    """

    free: tuple[str, ...]
    x: Floats
    blocks: tuple[tuple[Floats, Floats], ...]
    evidence: float

    @property
    def cost(self) -> float:
        """Sum of squares that is minimised."""
        return sum(float(residual @ residual) for residual, _ in self.blocks) + float(self.x @ self.x)


class Choice(NamedTuple):
    """A choice of terms, with its share of the probability.

    Attributes:
        weight: its probability.
        x: variables, (p,).
        covariance: (p, p).
        freedom: degrees of freedom of each variable, (p,).
    """

    weight: float
    x: Floats
    covariance: Floats
    freedom: Floats


@dataclass(frozen=True, eq=False)
class DispenserFit:
    """Parameters of a dispenser, fitted.

    Attributes:
        measured: what they were fitted to.
        parameters: all that the measurements can bear on, (p,).
        readings: what was measured.
        errors: of the readings.
        choices: of terms, that with the largest evidence first, that with every term last.
        full: the minimum with every term.
    """

    measured: Measurements
    parameters: tuple[Parameter, ...]
    readings: tuple[Reading, ...]
    errors: tuple[Errors, ...]
    choices: tuple[Choice, ...]
    full: Minimum

    @property
    def x(self) -> Floats:
        """Variables of the choice of terms with the largest evidence, (p,)."""
        return self.choices[0].x

    @property
    def values(self) -> dict[str, float]:
        """Values of the parameters by name."""
        return values_of(self.parameters, self.x)

    def half_width(self, function: Callable[[Floats], float], choices: Sequence[Choice] = ()) -> float:
        """Return half the 95 % interval of a function of the variables, over all choices of terms or some."""
        choices = choices or self.choices
        middle = function(choices[0].x)
        whole_weight = sum(choice.weight for choice in choices)
        variance = 0.0
        freedom = 0.0
        for choice in choices:
            weight = choice.weight / whole_weight
            value = function(choice.x)
            gradient = np.array(
                [
                    (function(choice.x + step) - value) / _DERIVATIVE_STEP
                    for step in _DERIVATIVE_STEP * np.eye(self.x.size)
                ]
            )
            variance += weight * (float(gradient @ choice.covariance @ gradient) + (value - middle) ** 2)
            shares = gradient**2 * np.diag(choice.covariance)
            whole = float(shares.sum())
            freedom += weight * (whole / float((shares / choice.freedom).sum()) if whole else 1.0)
        return float(student.ppf(0.5 + 0.5 * _CONFIDENCE, freedom)) * float(np.sqrt(variance))

    def misfit(self, reading: Reading) -> float:
        """Return the rms difference of a reading from its prediction, over the rms of the reading."""
        predicted = Model(self.measured).predict(self.values, reading.experiment)[reading.quantity]
        difference = predicted - reading.values
        if reading.has_offset:
            difference = difference - difference.mean()
        scale = reading.values - reading.values.mean() if reading.is_even else reading.values
        return float(np.sqrt(np.mean(difference**2) / max(np.mean(scale**2), 1e-300)))


def values_of(parameters: Sequence[Parameter], x: Floats) -> dict[str, float]:
    """Return the values of variables, by name."""
    return {
        parameter.name: float(np.clip(parameter.value(float(variable)), parameter.low, parameter.high))
        for parameter, variable in zip(parameters, x, strict=True)
    }


def fit_dispenser(measured: Measurements, progress: Callable[[float], None] = lambda _: None) -> DispenserFit:
    """Fit all parameters that measurements can bear on.

    Args:
        measured: the measurements, checked.
        progress: called with the completed share.

    Raises:
        NotIdentifiedError: no values of the parameters predict the measurements.
    """
    parameters = parameters_of(measured)
    readings = readings_of(measured)
    search = _Search(Model(measured), parameters, readings)
    terms = [parameter.name for parameter in parameters if parameter.name in NONE]
    choices = [set(absent) for size in range(len(terms) + 1) for absent in combinations(terms, size)]
    errors = search.first_errors()
    begins = search.starts(errors)
    full = search.minimum(frozenset(), errors, begins)
    for done in range(_PASSES):
        errors = search.errors(full)
        full = search.minimum(frozenset(), errors, [full.x])
        progress(0.5 * (done + 1) / _PASSES)
    minima = []
    for done, absent in enumerate(choices):
        minima.append(search.minimum(frozenset(absent), errors, [full.x]))
        progress(0.5 + 0.5 * (done + 1) / len(choices))
    # a smaller choice may have come to a better minimum of the whole
    lowest = min(minima, key=lambda minimum: minimum.cost)
    if lowest is not minima[0]:
        minima[0] = search.minimum(frozenset(), errors, [lowest.x])
    return _weighed_fit(search, minima, errors)


def _weighed_fit(search: _Search, minima: Sequence[Minimum], errors: tuple[Errors, ...]) -> DispenserFit:
    """Return the fit over all choices of terms."""
    scores = np.array([search.evidence(minimum) for minimum in minima])
    weights = np.exp(scores - scores.max())
    weights /= weights.sum()
    best = int(np.argmax(weights))
    order = [best, *(k for k in range(1, len(minima)) if k != best and weights[k] > _LEAST_WEIGHT), 0]
    # no glue is exactly Newtonian: the choice with every term counts in any case
    weights[0] = max(float(weights[0]), _WEIGHT_OF_ALL)
    choices = [Choice(float(weights[k]), minima[k].x, *search.covariance(minima[k], errors)) for k in order]
    return DispenserFit(search.model.measured, search.parameters, search.readings, errors, tuple(choices), minima[0])


class _Search(NamedTuple):
    """The problem to be solved.

    Attributes:
        model: that predicts.
        parameters: (p,).
        readings: to be predicted.
    """

    model: Model
    parameters: tuple[Parameter, ...]
    readings: tuple[Reading, ...]

    def differences(self, x: Floats) -> list[Floats]:
        """Return predicted less measured for each reading, (n,) each."""
        values = values_of(self.parameters, x)
        predicted: dict[int, Mapping[str, Floats]] = {}
        differences = []
        for reading in self.readings:
            key = id(reading.experiment)
            if key not in predicted:
                try:
                    predicted[key] = self.model.predict(values, reading.experiment)
                except InputError:
                    predicted[key] = {}
            prediction = predicted[key].get(reading.quantity)
            if prediction is None or not np.isfinite(prediction).all():
                differences.append(np.full(reading.values.size, _WRONG_RESIDUAL * (1 + np.abs(reading.values).max())))
                continue
            difference = prediction - reading.values
            differences.append(difference - difference.mean() if reading.has_offset else difference)
        return differences

    def starts(self, errors: tuple[Errors, ...]) -> list[Floats]:
        """Return the variables from which searches begin, the best first."""
        points = []
        for guess in starts(self.model.measured):
            values = {p.name: min(max(guess.get(p.name, p.usual), p.low), p.high) for p in self.parameters}
            points.append(np.array([float(p.variable(values[p.name])) for p in self.parameters]))

        def cost(x: Floats) -> float:
            return float(sum(np.sum((d / e.size) ** 2) for d, e in zip(self.differences(x), errors, strict=True)))

        return sorted(points, key=cost)[:_SEARCHED_STARTS]

    def minimum(self, absent: frozenset[str], errors: tuple[Errors, ...], begins: Sequence[Floats]) -> Minimum:
        """Return the best variables without some terms."""
        free = np.array([parameter.name not in absent for parameter in self.parameters])
        fixed = np.array([p.variable(NONE[p.name]) if p.name in absent else 0.0 for p in self.parameters], float)
        low = np.array([p.variable(p.low) for p in self.parameters])
        high = np.array([p.variable(p.high) for p in self.parameters])

        def residuals(part: Floats) -> Floats:
            x = fixed.copy()
            x[free] = part
            scaled = [d / e.size for d, e in zip(self.differences(x), errors, strict=True)]
            return np.concatenate([*scaled, part])

        best = None
        for begin in begins:
            start = np.clip(begin, low + 1e-9, high - 1e-9)[free]
            bounds = (low[free], high[free])
            tolerances = {"ftol": _TOLERANCE, "xtol": _TOLERANCE, "max_nfev": _MOST_STEPS}
            solution = least_squares(residuals, start, bounds=bounds, x_scale="jac", **tolerances)
            if best is None or solution.cost < best.cost:
                best = solution
        assert best is not None
        x = fixed.copy()
        x[free] = best.x
        jacobian = np.zeros((best.jac.shape[0], x.size))
        jacobian[:, free] = best.jac
        ends = np.cumsum([reading.values.size for reading in self.readings])
        rows = np.split(np.arange(best.fun.size), ends)[: len(self.readings)]
        blocks = tuple((best.fun[k], jacobian[k]) for k in rows)
        information = best.jac.T @ best.jac
        sizes = np.maximum(np.linalg.eigvalsh(information), 1.0)
        evidence = -0.5 * float(np.log(sizes).sum()) - 0.5 * float(best.x @ best.x)
        names = tuple(parameter.name for parameter in self.parameters if parameter.name not in absent)
        return Minimum(names, x, blocks, evidence)

    def first_errors(self) -> tuple[Errors, ...]:
        """Return errors before anything is fitted: a share of the readings."""
        return tuple(
            Errors(self._shape(reading, reading.values), max(reading.values.size - 1.0, _LEAST_FREEDOM))
            for reading in self.readings
        )

    def _shape(self, reading: Reading, values: Floats) -> Floats:
        """Return the shape of the errors: of one size over time, else growing with the value, but for the digits."""
        if reading.is_even:
            return np.full(values.size, READING_ERROR * max(float(np.ptp(reading.values)), reading.least))
        return np.hypot(READING_ERROR * values, reading.least)

    def errors(self, minimum: Minimum) -> tuple[Errors, ...]:
        """Return the errors that a minimum leaves."""
        root = inverse_root(_information(minimum, self.parameters))
        inverse = root @ root.T
        differences = self.differences(minimum.x)
        result = []
        for reading, difference, (_, J) in zip(self.readings, differences, minimum.blocks, strict=True):
            freedom = self._freedom(reading, J, inverse)
            shape = self._shape(reading, reading.values + difference)
            size = float(np.sqrt(np.sum((difference / shape) ** 2) / freedom))
            rounding = _DIGIT * reading.least / shape
            result.append(Errors(shape * np.maximum(max(size, 1e-4), rounding), freedom))
        return tuple(result)

    def evidence(self, minimum: Minimum) -> float:
        """Return the logarithm of a choice's evidence, up to a constant, over all sizes of the errors."""
        root = inverse_root(_information(minimum, self.parameters))
        inverse = root @ root.T
        score = minimum.evidence
        for reading, (residual, J) in zip(self.readings, minimum.blocks, strict=True):
            half = 0.5 * self._freedom(reading, J, inverse)
            score += gammaln(half) - half * np.log(max(0.5 * float(residual @ residual), 1e-300))
        return float(score)

    def _freedom(self, reading: Reading, J: Floats, inverse: Floats) -> float:
        """Return the degrees of freedom that a fit leaves a reading."""
        used = float(np.trace(inverse @ J.T @ J)) + reading.has_offset
        return float(max(reading.values.size - used, _LEAST_FREEDOM))

    def covariance(self, minimum: Minimum, errors: tuple[Errors, ...]) -> tuple[Floats, Floats]:
        """Return covariance, (p, p), and degrees of freedom, (p,), of the variables under one choice of terms.

        The variance is the larger of that of Gauss and Newton, and that of the residuals themselves, which may be
        larger where the settings have most weight, and correlated over time.
        """
        free = np.array([parameter.name in minimum.free for parameter in self.parameters])
        root = np.zeros((free.size, int(free.sum())))
        root[free] = inverse_root(_information(minimum, self.parameters)[np.ix_(free, free)])
        inverse = root @ root.T
        variance = np.maximum(np.diag(inverse), 1e-300)
        S = np.diag(free.astype(float))
        inverse_freedom = np.zeros(free.size)
        for reading, (residual, J), error in zip(self.readings, minimum.blocks, errors, strict=True):
            S += _scores(reading, residual, J, inverse)
            share = np.sum((J @ inverse) ** 2, axis=0) / variance
            inverse_freedom += share**2 / error.freedom
        sizes, directions = np.linalg.eigh(root.T @ S @ root)
        wide = root @ directions
        covariance = wide * np.maximum(sizes, 1.0) @ wide.T
        return covariance, 1.0 / np.maximum(inverse_freedom, 1e-6)


def inverse_root(information: Floats) -> Floats:
    """Return R with R R' the inverse of an information, which has at least that of the weak assumption, (p, p)."""
    sizes, directions = np.linalg.eigh(information)
    return np.asarray(directions / np.sqrt(np.maximum(sizes, 1.0)))


def _information(minimum: Minimum, parameters: Sequence[Parameter]) -> Floats:
    """Return J'J of the readings with the weak assumption, (p, p)."""
    return np.asarray(sum((J.T @ J for _, J in minimum.blocks), np.eye(len(parameters))))


def _scores(reading: Reading, residual: Floats, J: Floats, inverse: Floats) -> Floats:
    """Return the sum of the squares of J r, with the correlation of neighbours in a record, (p, p)."""
    if not reading.is_even:
        leverage = np.minimum(np.einsum("ij,jk,ik->i", J, inverse, J), 0.9)
        scores = J * (residual / (1 - leverage))[:, None]
        return np.asarray(scores.T @ scores)
    scores = J * residual[:, None]
    S = scores.T @ scores
    for lag in range(1, min(LAGS, len(residual) - 1) + 1):
        cross = scores[lag:].T @ scores[:-lag]
        S += (1 - lag / (LAGS + 1)) * (cross + cross.T)
    return np.asarray(S)


def check_explained(fit: DispenserFit, most: float) -> None:
    """Raise NotIdentifiedError where a reading is not explained within a share of it."""
    for reading in fit.readings:
        misfit = fit.misfit(reading)
        if misfit <= most:
            continue
        raise NotIdentifiedError(
            f"{reading.experiment.label}: the dispenser's law leaves {100 * misfit:.2g} % of the {reading.quantity} "
            f"unexplained, must be at most {100 * most:.0f} %: check that no columns are swapped, and that needle and "
            "glue were the same in all rows"
        )
