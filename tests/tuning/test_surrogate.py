"""The surrogate and its trust region: against dense linear algebra, and scipy's minima of analytic functions."""

import numpy as np
import pytest
from scipy.optimize import minimize

from gantrysim.tuning.region import Measured, TrustRegion
from gantrysim.tuning.surrogate import Surrogate

EXACT = 1e-7  # of solutions by another factorisation
NEAR = 0.02  # of the minimum of the logarithm, 2 % of a metric


def smooth(points):
    return np.sin(2 * points[:, 0]) + points[:, 1] ** 2


def test_a_prediction_is_that_of_the_dense_formula():
    rng = np.random.default_rng(1)
    points, at = rng.normal(size=(30, 2)), rng.normal(size=(5, 2))
    own = Surrogate.fitted(points, smooth(points))

    def k(one, two):
        r = np.sqrt(5) * np.linalg.norm((one[:, None] - two) / own.scales, axis=2)
        return (1 + r + r**2 / 3) * np.exp(-r)

    inverse, one = np.linalg.inv(k(points, points) + own.noise**2 * np.eye(30)), np.ones(30)
    mean = one @ inverse @ smooth(points) / (one @ inverse @ one)
    left = smooth(points) - mean
    values, deviations = own.predict(at)
    np.testing.assert_allclose(values, mean + k(at, points) @ inverse @ left, rtol=EXACT, atol=EXACT)
    size = np.sqrt(left @ inverse @ left / 30)
    variance = 1 - np.einsum("ij,jk,ik->i", k(at, points), inverse, k(at, points))
    np.testing.assert_allclose(deviations**2, size**2 * variance, atol=EXACT * size**2)


def test_a_smooth_function_is_predicted_between_its_values():
    rng = np.random.default_rng(2)
    points, at = rng.uniform(-1, 1, (40, 2)), rng.uniform(-0.9, 0.9, (100, 2))
    values, deviations = Surrogate.fitted(points, smooth(points)).predict(at)
    assert np.abs(values - smooth(at)).max() < 0.05
    assert np.mean(np.abs(values - smooth(at)) < 3 * deviations) > 0.9


def test_scales_tell_which_coordinates_matter_and_noise_how_much():
    rng = np.random.default_rng(3)
    points = rng.uniform(-1, 1, (60, 3))
    exact = Surrogate.fitted(points, smooth(points))
    assert exact.scales[2] > 5 * exact.scales[0]
    noisy = Surrogate.fitted(points, smooth(points) + rng.normal(0, 0.1, 60))
    assert noisy.noise * noisy.size == pytest.approx(0.1, rel=0.4)
    assert exact.noise * exact.size < 0.02


def test_equal_values_are_no_error():
    points = np.random.default_rng(4).normal(size=(8, 3))
    values, deviations = Surrogate.fitted(points, np.ones(8)).predict(points + 0.1)
    assert values == pytest.approx(np.ones(8))
    assert np.isfinite(deviations).all()


def found(metric, start, bounds, rounds, ripple=lambda x: -1.0, seed=1):
    """Return the least feasible value found in so many rounds of 4."""
    region = TrustRegion(np.array(bounds), np.random.default_rng(seed))
    start = np.asarray(start, float)
    points = [start, *(start + 0.3 * np.eye(len(start)))]
    best = 0
    for _ in range(rounds):
        values, slack = np.array([metric(x) for x in points]), np.array([ripple(x) for x in points])
        order = np.where(slack <= 0, values, 1e6 + slack)
        region.adapt(improved=order.argmin() != best or len(points) == len(start) + 1)
        best = int(order.argmin())
        if region.converged:
            region.radius = 0.1
        points += region.ask(Measured(np.array(points), values, slack), best, 4)
    return min(metric(x) for x in points if ripple(x) <= 0)


def rosenbrock(x):
    """Of 10^x, its logarithm: the valley is curved there too; the least is 0 at x = 0."""
    a, b = 10.0 ** np.asarray(x)
    return float(np.log1p(10 * (b - a**2) ** 2 + (1 - a) ** 2))


def test_the_minimum_of_rosenbrock_s_valley_is_found():
    bounds = [(-1, 1), (-1, 1)]
    least = minimize(rosenbrock, [0.1, 0.1], method="Nelder-Mead", bounds=bounds, options={"xatol": 1e-8}).fun
    assert found(rosenbrock, [-0.6, 0.4], bounds, 20) < least + NEAR


def sharp_valley(x):
    """Its floor is the line x = y/2, which falls by 0.4 along y to -0.4 at the bound of y; its walls are planes."""
    return float(4 * abs(x[0] - 0.5 * x[1]) - 0.4 * x[1] + 0.02 * (x[2] - 0.3) ** 2)


def test_the_region_follows_the_floor_of_a_sharp_valley():
    """Without repeated moves the rounds end at 0.2."""
    assert found(sharp_valley, [-0.45, -0.9, 0.0], [(-1, 1)] * 3, 12) < -0.1


def bowl(x):
    return float(np.sum(np.array([1.0, 4.0, 0.5]) * (np.asarray(x) - [0.5, -0.3, 0.2]) ** 2) + x[0] * x[1])


def test_the_minimum_of_a_bowl_is_found_at_a_bound():
    bounds = [(-1, 0.1), (-1, 1), (-1, 1)]
    least = minimize(bowl, np.zeros(3), bounds=bounds).fun
    value = found(bowl, [-0.6, 0.5, -0.5], bounds, 10)
    assert least <= value < least + 0.25 * NEAR


def test_the_minimum_of_a_bowl_is_found_within_a_constraint():
    bounds = [(-1, 1)] * 3

    def ripple(x):  # at most 0
        return float(x[0] + 0.5 * x[2] ** 2 - 0.1)

    held = {"type": "ineq", "fun": lambda x: -ripple(x)}
    least = minimize(bowl, np.zeros(3), bounds=bounds, constraints=held).fun
    assert least > minimize(bowl, np.zeros(3), bounds=bounds).fun + 2 * NEAR  # the constraint bites
    value = found(bowl, [-0.6, 0.5, -0.5], bounds, 12, ripple)
    assert least - 1e-9 <= value < least + NEAR


def test_a_region_grows_with_progress_and_shrinks_without():
    region = TrustRegion(np.array([[-1.0, 1.0]]), np.random.default_rng(1))
    radius = region.radius
    region.adapt(improved=True)
    assert region.radius > radius
    for _ in range(10):
        region.adapt(improved=False)
    assert region.converged


def test_values_that_are_not_known_do_not_stop_the_region():
    region = TrustRegion(np.array([[-1.0, 1.0]] * 2), np.random.default_rng(1))
    points = np.array([[0.0, 0.0], [0.3, 0.0], [0.0, 0.3]])
    for metric in ([np.inf] * 3, [1.0, np.inf, 2.0]):
        asked = np.array(region.ask(Measured(points, np.array(metric), np.array([np.inf, -1.0, -0.1])), 0, 4))
        assert np.isfinite(asked).all()
        assert (np.abs(asked) <= 1).all()


def test_the_last_point_of_a_round_repeats_the_last_two_moves_within_the_bounds():
    bounds = np.array([[-1.0, 1.0], [-1.0, 0.5]])
    region = TrustRegion(bounds, np.random.default_rng(1))
    points, best = [np.array([-0.6, -0.5])], 0
    moves = [None, (0.1, 0.2), (0.15, 0.1), None, (0.2, 0.3)]
    repeated = {2: (-0.35 + 0.25, -0.2 + 0.3), 4: (-0.15 + 0.35, 0.5)}  # by arithmetic; the second ends at the bound
    for k, move in enumerate(moves):
        if move is not None:
            points.append(points[best] + move)
            best = len(points) - 1
        values = np.array([float(np.sum(point**2)) for point in points])
        measured = Measured(np.array(points), values, np.full(len(points), -9.0))
        asked = region.ask(measured, best, 4)
        assert len(asked) == 4
        if k in repeated:
            assert asked[-1] == pytest.approx(repeated[k])
        assert len(region.ask(measured, best, 1)) == 1  # alone, a point is the surrogate's
