"""Tangents of curves at the ends of intervals, beside the control polygon of a Bézier curve."""

import numpy as np
import pytest

from gantrysim.base.errors import InputError
from gantrysim.controllers.drawings.fitting import _tangents
from gantrysim.controllers.drawings.shapes import Spline


@pytest.mark.parametrize("backwards", [False, True])
@pytest.mark.parametrize("first_knot", [0.0, -0.5, 1e4])
@pytest.mark.parametrize("coincide", [False, True])
@pytest.mark.parametrize("seed", range(5))
def test_tangents_are_the_legs_of_the_control_polygon_wherever_the_knots_begin(seed, coincide, first_knot, backwards):
    """Where the control points at an end coincide, the derivative is 0 there and the next leg has the direction."""
    points = np.random.default_rng(seed).uniform(-10, 10, (4, 3))
    points[:, 2] = 0.0
    if coincide:
        points[1] = points[0]
    knots = first_knot + np.repeat([0.0, 1.0], 4)
    shape = Spline(knots, points, np.ones(4), 3, backwards)
    legs = np.array([points[2 if coincide else 1] - points[0], points[3] - points[2]])[:, :2]
    legs /= np.linalg.norm(legs, axis=1, keepdims=True)
    expected = (-1.0 if backwards else 1.0) * legs @ [1, 1j]
    start = knots[:1]
    stop = knots[-1:]
    at_start, at_stop = _tangents(shape, start, stop), _tangents(shape, stop, start)
    np.testing.assert_allclose(at_start, expected[:1], atol=1e-2 if coincide else 1e-7)
    np.testing.assert_allclose(at_stop, expected[1:], atol=1e-7)


@pytest.mark.parametrize("weights", [(1.0, -1.0, 1.0, 1.0), (1.0, 1.0, 1.0, 0.0), (np.nan, 1.0, 1.0, 1.0), (1.0,) * 3])
def test_every_weight_of_a_spline_must_be_positive(weights):
    with pytest.raises(InputError, match=r"^spline: weights must be positive, one for each control point$"):
        Spline(np.repeat([0.0, 1.0], 4), np.eye(4)[:, :3], np.array(weights), 3)
