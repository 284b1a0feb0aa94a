"""The minimum of an axis' prediction error near a model, with the covariance of its parameters."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares, minimize

from gantrysim.base.arrays import Floats
from gantrysim.identify.friction_terms import CONFIDENCE
from gantrysim.identify.model import AxisModel
from gantrysim.identify.pieces import WHOLE_LOG, Starts
from gantrysim.identify.prediction import Course, Prediction, Samples, prediction
from gantrysim.identify.result import MODE, PARAMETERS, SYSTEMATIC, Estimate, Sensitivity
from gantrysim.identify.whiteness import correlation, covariance_of

SLOPE_STEP = 3e-4  # of the variables, for the slopes
_EVALUATIONS = 30
_MODE_CHANGE = 1.2  # change of the logarithms of the mode's parameters in one fit
_NOISE_REACH = 12.0  # the same of the torque noise
_DIVERGED_RESIDUAL = 1e9  # residual of a model whose prediction diverges
_BOUNDED_PARAMETERS = ("viscous", "coulomb", "excess", "gap")  # at least zero
_POSITIVE_PARAMETERS = ("inertia", "stiffness", "damping")  # fitted by their logarithms


@dataclass(frozen=True, eq=False)
class PredictionError:
    """The error of a model's one-step prediction of a log.

    Attributes:
        period: of the samples [s].
        position: (n,) [u].
        torque: (n,) [N·m].
        held: whether the torque is a demand, held from sample to sample.
        used: whether a sample is in motion, (n,) bool.
        size: standard deviation of the position noise that the encoder's counts explain [u].
        progress: called with every evaluation.
        course: of friction beside that of the model.
        starts: of the log's pieces.
        speeds: at the start of each [u/s].
        first: row of the log at which it begins.
    """

    period: float
    position: Floats
    torque: Floats
    held: bool
    used: NDArray[np.bool_]
    size: float
    progress: Callable[[], None]
    course: Course | None = None
    starts: Starts = WHOLE_LOG
    speeds: tuple[float, ...] = (0.0,)
    first: int = 0

    def prediction(self, model: AxisModel, noise: float) -> Prediction:
        """Return the prediction of all samples."""
        samples = Samples(self.period, self.position, self.torque, self.held, self.course, self.starts, self.speeds)
        return prediction(model, noise / self.size, samples)

    def residual(self, model: AxisModel, noise: float) -> Floats:
        """Return the innovations of the samples in motion over the position noise, (k,).

        Args:
            model: of the axis.
            noise: standard deviation of the torque noise [N·m].
        """
        self.progress()
        residual = self.prediction(model, noise).innovations[self.used] / self.size
        return np.clip(np.nan_to_num(residual, nan=_DIVERGED_RESIDUAL), -_DIVERGED_RESIDUAL, _DIVERGED_RESIDUAL)

    def cost(self, model: AxisModel, noise: float) -> float:
        """Return the sum of squares of the residual."""
        return float(np.sum(self.residual(model, noise) ** 2))

    def correlation(self, minimum: Minimum) -> float:
        """Return the largest correlation of the residual of a minimum."""
        return float(np.abs(correlation(self.residual(minimum.model, minimum.noise))).max())


@dataclass(frozen=True, eq=False)
class Minimum:
    """A minimum of the prediction error.

    Attributes:
        model: there.
        noise: standard deviation of the torque noise [N·m].
        names: of the fitted parameters.
        covariance: of these, (p, p).
        cost: sum of squares of the residual.
        sensitivity: of the residual to the parameters.
    """

    model: AxisModel
    noise: float
    names: list[str]
    covariance: Floats
    cost: float
    sensitivity: Sensitivity

    def estimates(self) -> dict[str, Estimate]:
        """Return the parameters with their standard deviations, in the order of `PARAMETERS`."""
        # a parameter on which no sample depends has no variance here, but an unbounded interval
        variance = {
            name: float(self.covariance[k, k]) if self.covariance[k, k] > 0 else math.inf
            for k, name in enumerate(self.names)
        }
        friction = [self.names.index(name) for name in ("coulomb", "excess")]
        variance["static"] = max(float(self.covariance[np.ix_(friction, friction)].sum()), 0.0)
        estimates = {}
        for name in PARAMETERS:
            if name in variance:
                value = float(getattr(self.model, name))
                systematic = SYSTEMATIC.get(name, 0.0) * value
                estimates[name] = Estimate(value, math.hypot(math.sqrt(variance[name]), systematic))
        return estimates

    def relative(self, name: str) -> float:
        """Return half the interval of a parameter, of its value."""
        estimate = self.estimates()[name]
        return CONFIDENCE * estimate.deviation / max(abs(estimate.value), 1e-300)


def refined_minimum(
    error: PredictionError,
    model: AxisModel,
    noise: float,
    names: list[str],
    evaluations: int = _EVALUATIONS,
    difference: float = SLOPE_STEP,
) -> Minimum:
    """Return the minimum of the prediction error near a model.

    Args:
        error: of the log.
        model: the start.
        noise: standard deviation of the torque noise at the start; it is fitted too [N·m].
        names: of the parameters to fit.
        evaluations: most of them, besides those for slopes.
        difference: of the variables, for the slopes.
    """
    variables = _Variables.of(model, noise, names, error)
    low, high = variables.bounds()

    def residual(x: Floats) -> Floats:
        return error.residual(*variables.unpacked(x))

    begin = np.ones(len(names) + 1)
    # contact makes the cost non-smooth: Powell first, then least squares
    if "gap" in names:
        along = minimize(
            lambda x: float(np.sum(residual(x) ** 2)), begin, method="Powell",
            bounds=list(zip(1 + np.maximum(low, -5), 1 + np.minimum(high, 5), strict=True)),
            options={"maxfev": 1200, "xtol": 1e-3, "ftol": 1e-4},
        )  # fmt: skip
        # least squares refuses a start on a bound
        begin = np.clip(along.x, 1 + low + 1e-9, 1 + high - 1e-9)
    done = least_squares(
        residual, begin, bounds=(1 + low, 1 + high), x_scale=0.05,
        diff_step=difference, xtol=1e-5, ftol=1e-8, max_nfev=evaluations,
    )  # fmt: skip
    best, best_noise = variables.unpacked(done.x)
    slopes = np.array([_slope(best, name, unit) for name, unit in zip(names, variables.units, strict=True)])
    covariance = covariance_of(done.jac, done.fun)[: len(names), : len(names)] * np.outer(slopes, slopes)
    sensitivity = Sensitivity(tuple(names), np.asarray(done.jac), slopes, np.asarray(done.fun))
    return Minimum(best, best_noise, names, covariance, float(2 * done.cost), sensitivity)


@dataclass(frozen=True, eq=False)
class _Variables:
    """The variables of a fit: they begin at 1, as SciPy's steps of the differences are relative to them.

    Attributes:
        model: at the beginning.
        noise: of the torque at the beginning [N·m].
        names: of the parameters; the last variable is the logarithm of the noise.
        units: in which parameters vary that are not fitted by a logarithm, (p,).
    """

    model: AxisModel
    noise: float
    names: list[str]
    units: Floats

    @classmethod
    def of(cls, model: AxisModel, noise: float, names: list[str], error: PredictionError) -> _Variables:
        """Return the variables of a fit that begins at a model."""
        return cls(model, noise, names, np.array([_unit(model, name, error) for name in names]))

    def unpacked(self, x: Floats) -> tuple[AxisModel, float]:
        """Return the model and the torque noise at values of the variables."""
        x = x - 1.0
        values = {}
        for name, unit, change in zip(self.names, self.units, x, strict=False):
            value = getattr(self.model, name)
            if name in _POSITIVE_PARAMETERS:
                values[name] = value * math.exp(change)
            elif name == "share":  # by its logit, so that it stays between 0 and 1
                values[name] = 1 / (1 + (1 / value - 1) * math.exp(-change))
            elif name in _BOUNDED_PARAMETERS:
                values[name] = max(value + unit * change, 0.0)
            else:
                values[name] = value + unit * change
        return replace(self.model, **values), self.noise * math.exp(x[-1])

    def bounds(self) -> tuple[Floats, Floats]:
        """Return the lowest and highest changes of the variables, (p + 1,) each."""
        low = np.full(len(self.names) + 1, -np.inf)
        high = np.full(len(self.names) + 1, np.inf)
        for k, name in enumerate(self.names):
            if name in _BOUNDED_PARAMETERS:
                low[k] = -getattr(self.model, name) / self.units[k] - 1e-9
            elif name in MODE:  # further away another resonance would be fitted
                low[k] = -_MODE_CHANGE
                high[k] = _MODE_CHANGE
        low[-1] = -_NOISE_REACH
        high[-1] = _NOISE_REACH
        return low, high


def _unit(model: AxisModel, name: str, error: PredictionError) -> float:
    """Return the unit in which a parameter varies."""
    if name in ("coulomb", "excess", "offset"):
        return model.coulomb
    if name == "viscous":
        return max(model.viscous, model.coulomb / 100.0)
    return {"delay": error.period, "gap": 10 * error.size}.get(name, 1.0)


def _slope(model: AxisModel, name: str, unit: float) -> float:
    """Return the change of a parameter per change of the variable that is fitted."""
    if name in _POSITIVE_PARAMETERS:
        return float(getattr(model, name))
    return model.share * (1 - model.share) if name == "share" else unit
