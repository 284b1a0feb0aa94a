"""The simplex against scipy's own, and at scipy's minima of analytic functions."""

import numpy as np
import pytest
from scipy.optimize import minimize

from gantrysim.study.tuning.rounds import Simplex, Vertex

NEAR = 1e-3  # of the least value


def rosenbrock(x):
    """Of 10^x, its logarithm: the valley is curved there too; the least is 0 at x = 0."""
    a, b = 10.0 ** np.asarray(x)
    return float(np.log1p(10 * (b - a**2) ** 2 + (1 - a) ** 2))


def bowl(x):
    return float(np.sum(np.array([1.0, 4.0, 0.5]) * (np.asarray(x) - [0.5, -0.3, 0.2]) ** 2) + x[0] * x[1])


def around(start, step=0.2):
    return np.vstack([start, start + step * np.eye(len(start))])


def descent(function, corners, bounds, moved=1, limit=2000):
    """The points of a descent in the order of their measurement, by rounds, and its simplex."""
    rounds = [list(corners)]
    keys = [(1, function(point)) for point in corners]
    vertices = [Vertex(point, k) for k, point in enumerate(corners)]
    simplex = Simplex(vertices, np.array(bounds, float), moved, list(keys))
    steps = simplex.descend()
    points = next(steps)
    while sum(map(len, rounds)) < limit:
        rounds.append(points)
        keys += [(1, function(point)) for point in points]
        try:
            points = steps.send(list(keys))
        except StopIteration:
            break
    return rounds, simplex


@pytest.mark.parametrize(("function", "start", "count"), [(rosenbrock, [-0.6, 0.4], 40), (bowl, [-0.6, 0.5, -0.5], 40)])
def test_one_point_at_a_time_measures_the_points_of_scipy_s_method(function, start, count):
    """The two differ where a contraction outside is worse than its reflection: scipy shrinks then."""
    corners, measured = around(np.array(start)), []

    def recorded(x):
        measured.append(x.copy())
        return function(x)

    options = {"initial_simplex": corners, "adaptive": True, "maxfev": count}
    minimize(recorded, start, method="Nelder-Mead", options=options)
    rounds, _ = descent(function, corners, [(-9, 9)] * len(start), limit=count)
    np.testing.assert_allclose([point for points in rounds for point in points][:count], measured[:count], atol=1e-12)
    assert len(measured) == count


@pytest.mark.parametrize("moved", [1, 2])
def test_the_minimum_of_a_curved_valley_is_found(moved):
    rounds, simplex = descent(rosenbrock, around(np.array([-0.6, 0.4])), [(-1, 1)] * 2, moved)
    assert simplex.converged
    assert min(rosenbrock(point) for points in rounds for point in points) < NEAR
    assert sum(map(len, rounds)) < 150


@pytest.mark.parametrize("moved", [1, 2])
def test_the_minimum_at_a_bound_is_found_and_no_point_is_beyond(moved):
    bounds = np.array([(-1, 0.1), (-1, 1), (-1, 1)])
    least = minimize(bowl, np.zeros(3), bounds=bounds).fun
    rounds, _ = descent(bowl, around(np.array([-0.6, 0.5, -0.5])), bounds, moved)
    points = np.vstack(rounds)
    assert ((points >= bounds[:, 0]) & (points <= bounds[:, 1])).all()
    assert least <= min(map(bowl, points)) < least + 5 * NEAR


def test_several_points_are_moved_side_by_side():
    rounds, _ = descent(bowl, around(np.array([-0.6, 0.5, -0.5])), [(-1, 1)] * 3, moved=9)
    assert max(map(len, rounds[1:])) in (2, 3)  # half of 4 points, or 3 that shrink
    alone, _ = descent(bowl, around(np.array([-0.6, 0.5, -0.5])), [(-1, 1)] * 3)
    assert len(rounds) < len(alone)


def test_a_simplex_without_progress_shrinks_until_it_has_converged():
    start = np.zeros(2)
    rounds, simplex = descent(lambda x: float(np.abs(x).sum()), around(start), [(-1, 1)] * 2)
    assert simplex.converged
    assert simplex.size < 0.02
    assert min(np.abs(point).sum() for points in rounds for point in points) == 0.0


def test_points_of_equal_rank_and_amount_have_converged_but_not_points_of_different_rank():
    corners = [Vertex(point, k) for k, point in enumerate(around(np.zeros(2)))]
    bounds = np.array([(-1.0, 1.0)] * 2)
    assert Simplex(corners, bounds, 1, [(1, 2.0), (1, 2.0001), (1, 2.0002)]).converged
    assert not Simplex(corners, bounds, 1, [(1, 2.0), (1, 2.0001), (2, 2.0)]).converged
    assert not Simplex(corners, bounds, 1, [(1, 2.0), (1, 2.0001), (1, 2.1)]).converged


def test_later_values_of_earlier_points_count():
    """As on several machines, where a candidate's value over all is an estimate until it is run on all."""
    corners = [Vertex(point, k) for k, point in enumerate(around(np.zeros(2)))]
    simplex = Simplex(corners, np.array([(-9.0, 9.0)] * 2), 1, [(1, 1.0), (1, 2.0), (1, 3.0)])
    steps = simplex.descend()
    (reflection,) = next(steps)
    assert reflection == pytest.approx([0.2, -0.2])  # of the third corner
    (trial,) = steps.send([(1, 5.0), (1, 2.0), (1, 3.0), (1, 2.5)])
    assert trial == pytest.approx([0.4, -0.2])  # the reflection of the first corner, which is the worst now
