"""The variables of a fit and what is told of its minimum, against finite differences and sums by hand."""

import math
from dataclasses import replace

import numpy as np
import pytest

from gantrysim import Machine
from gantrysim.identify.fit import _starts
from gantrysim.identify.minimum import Minimum, PredictionError, _slope, _Variables
from gantrysim.identify.model import model_of
from gantrysim.identify.prediction import Prediction
from gantrysim.identify.result import CONFIDENCE, PARAMETERS, SYSTEMATIC, Sensitivity
from gantrysim.identify.whiteness import LAGS, correlation, covariance_of

NAMES = ["inertia", "viscous", "coulomb", "excess", "offset", "delay", "share", "stiffness", "damping", "gap"]
NOISE = 2e-3  # [N·m]
SIZE = 3e-4  # of a count's noise [mm]
PERIOD = 5e-4
MODEL = replace(model_of(Machine("xy"), 1), coulomb=0.02, excess=0.004, offset=-0.003, delay=2e-4, gap=0.01, share=0.3)


@pytest.fixture
def error():
    samples = np.zeros(8)
    return PredictionError(PERIOD, samples, samples, True, samples == 0, SIZE, lambda: None)


@pytest.fixture
def variables(error):
    return _Variables.of(MODEL, NOISE, NAMES, error)


def test_variables_of_one_are_the_start(variables):
    model, noise = variables.unpacked(np.ones(len(NAMES) + 1))
    assert noise == NOISE
    for name in NAMES:
        assert getattr(model, name) == pytest.approx(getattr(MODEL, name), rel=1e-12)


def test_units_are_sizes_that_a_log_shows(variables):
    """Torques vary by Coulomb friction, delays by periods, gaps by ten of the counts' deviations."""
    units = dict(zip(NAMES, variables.units, strict=True))
    assert (units["coulomb"], units["excess"], units["offset"]) == (0.02, 0.02, 0.02)
    assert units["delay"] == PERIOD
    assert units["gap"] == pytest.approx(3e-3)
    assert units["viscous"] == max(MODEL.viscous, 2e-4)


@pytest.mark.parametrize(("viscous", "unit"), [(1e-5, 2e-4), (5e-4, 5e-4)])
def test_viscous_friction_varies_by_itself_or_a_hundredth_of_coulomb_friction(error, viscous, unit):
    assert _Variables.of(replace(MODEL, viscous=viscous), NOISE, ["viscous"], error).units.tolist() == [unit]


@pytest.mark.parametrize("name", NAMES)
def test_a_parameter_changes_by_its_slope(variables, name):
    k = NAMES.index(name)
    step = 1e-5
    ends = []
    for change in (-step, step):
        x = np.ones(len(NAMES) + 1)
        x[k] += change
        model, noise = variables.unpacked(x)
        ends.append(getattr(model, name))
        assert noise == NOISE
        assert all(getattr(model, o) == pytest.approx(getattr(MODEL, o), rel=1e-12) for o in NAMES if o != name)
    assert (ends[1] - ends[0]) / (2 * step) == pytest.approx(_slope(MODEL, name, float(variables.units[k])), rel=1e-6)


def test_variables_keep_parameters_where_they_have_a_meaning(variables):
    low, high = variables.bounds()
    least, least_noise = variables.unpacked(1 + np.maximum(low, -20.0))
    most, most_noise = variables.unpacked(1 + np.minimum(high, 20.0))
    for name in ("viscous", "coulomb", "excess", "gap"):
        assert getattr(least, name) == pytest.approx(0.0, abs=1e-9)
        assert getattr(least, name) >= 0
        assert high[NAMES.index(name)] == math.inf
    for name in ("stiffness", "damping"):
        for end, factor in ((least, math.exp(-1.2)), (most, math.exp(1.2))):
            assert getattr(end, name) == pytest.approx(factor * getattr(MODEL, name))
    # the odds of the load's share go likewise
    for end, factor in ((least, math.exp(-1.2)), (most, math.exp(1.2))):
        assert end.share / (1 - end.share) == pytest.approx(factor * 0.3 / 0.7)
    assert (least_noise, most_noise) == pytest.approx((NOISE * math.exp(-12), NOISE * math.exp(12)))
    for name in ("inertia", "offset", "delay"):
        assert (low[NAMES.index(name)], high[NAMES.index(name)]) == (-math.inf, math.inf)


def minimum(names, covariance):
    nothing = Sensitivity((), np.zeros((0, 0)), np.zeros(0), np.zeros(0))
    return Minimum(MODEL, NOISE, names, np.array(covariance), 1.0, nothing)


def test_deviations_of_a_minimum_are_those_of_the_covariance_and_of_the_method():
    """Static friction is the sum of two; a parameter that no sample shows has no bound."""
    found = minimum(["delay", "coulomb", "excess"], [[0.0, 0, 0], [0, 9e-8, -2e-8], [0, -2e-8, 4e-8]])
    estimates = found.estimates()
    assert list(estimates) == [name for name in PARAMETERS if name in ("coulomb", "excess", "static", "delay")]
    assert estimates["delay"].deviation == math.inf
    assert estimates["static"].value == pytest.approx(0.024)
    assert estimates["excess"].deviation == pytest.approx(2e-4)
    assert estimates["coulomb"].deviation == pytest.approx(math.hypot(3e-4, SYSTEMATIC["coulomb"] * 0.02))
    static = math.hypot(math.sqrt(9e-8 + 4e-8 - 2 * 2e-8), SYSTEMATIC["static"] * 0.024)
    assert estimates["static"].deviation == pytest.approx(static)
    assert found.relative("excess") == pytest.approx(CONFIDENCE * 2e-4 / 0.004)
    low, high = estimates["excess"].interval
    assert (low, high) == pytest.approx((0.004 - 1.96 * 2e-4, 0.004 + 1.96 * 2e-4))


def test_a_relative_interval_of_a_negative_value_is_positive():
    found = minimum(["coulomb", "excess", "offset"], np.diag([1e-8, 1e-8, 9e-8]))
    assert found.relative("offset") == pytest.approx(CONFIDENCE * 3e-4 / 0.003)


def test_the_cost_is_the_sum_of_squares_of_innovations_in_motion_over_counts(monkeypatch):
    told = np.array([3.0, -4.0, 7.0, np.nan, 1e30, -1e30]) * SIZE
    used = np.array([True, True, False, True, True, True])
    calls = []
    error = PredictionError(PERIOD, told, told, True, used, SIZE, lambda: calls.append(1))
    predicted = Prediction(told, np.zeros(told.size))
    monkeypatch.setattr("gantrysim.identify.minimum.prediction", lambda model, noise, samples: predicted)
    residual = error.residual(MODEL, NOISE)
    assert residual.tolist() == pytest.approx([3.0, -4.0, 1e9, 1e9, -1e9])
    assert error.cost(MODEL, NOISE) == pytest.approx(9 + 16 + 3e18)
    assert len(calls) == 2


def test_the_correlation_of_a_wave_is_its_cosine():
    """Of one over 50 samples, at lags from 1."""
    n = 50_000
    found = correlation(np.sin(2 * np.pi * np.arange(n) / 50))
    assert found.shape == (LAGS,)
    assert found == pytest.approx(np.cos(2 * np.pi * np.arange(1, LAGS + 1) / 50), abs=2e-3)


@pytest.mark.parametrize("rho", [0.0, 0.5])
def test_the_covariance_of_a_mean_grows_with_the_correlation_of_the_residual(rho):
    """The variance of the mean of an autoregressive residual is that of a white one times (1 + rho) / (1 - rho)."""
    n = 200_000
    random = np.random.default_rng(3).standard_normal(n)
    residual = np.empty(n)
    residual[0] = random[0]
    for k in range(1, n):
        residual[k] = rho * residual[k - 1] + random[k]
    found = covariance_of(np.ones((n, 1)), residual)
    expected = residual.var() / n * (1 + rho) / (1 - rho)
    assert found[0, 0] == pytest.approx(expected, rel=0.06)


@pytest.mark.parametrize("filled", [False, True])
@pytest.mark.parametrize("seed", range(20))
def test_a_fit_with_a_backlash_begins_at_the_cheapest_model_of_its_grid(seed, filled):
    """A cost that grows with the distance of stiffness, gap and bristles from the truth, as factors."""
    random = np.random.default_rng(seed)
    truth = {
        "stiffness": MODEL.stiffness * random.uniform(0.7, 1.2),
        "gap": SIZE * random.uniform(10.0, 1000.0),
        "deflection": MODEL.deflection * 10 ** random.uniform(-1.5, 0.5),
    }

    class Error:
        size = SIZE

        @staticmethod
        def cost(model, noise):
            return noise * sum(abs(math.log(getattr(model, name) / value)) for name, value in truth.items())

    fitted = replace(MODEL, stiffness=100.0 * MODEL.stiffness, deflection=7.0 * MODEL.deflection)
    as_fitted, free = _starts(Error, fitted, MODEL, NOISE, filled)
    assert as_fitted.deflection == fitted.deflection
    for start in (as_fitted, free):
        assert start.filled == filled
        assert start.stiffness == pytest.approx(truth["stiffness"], rel=0.1)
        assert start.gap == pytest.approx(truth["gap"], rel=0.07)
    # the grid of the bristles is by half decades
    assert abs(math.log10(free.deflection / truth["deflection"])) < 0.27
