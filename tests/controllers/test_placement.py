"""Where a program lies on the work, against turns that change nothing."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gantrysim.controllers.placement import Placement

from support.soaked import examples

numbers = st.floats(-1e3, 1e3) | st.sampled_from([0.0, -0.0])


@given(st.lists(st.tuples(numbers, numbers, numbers), min_size=1, max_size=4), st.tuples(numbers, numbers, numbers))
@examples(100)
def test_a_whole_turn_moves_no_point_and_a_shift_all_alike(points, shift):
    x, y, z = shift
    shifted = Placement(x, y, z=z).point(points)
    turned = Placement(x, y, z=z, rotate=360.0).point(points)
    assert np.array_equal(shifted, turned)
    assert np.array_equal(shifted, np.add(points, shift))
    assert not np.signbit(shifted[shifted == 0]).any()


@pytest.mark.parametrize("changed", [{"rotate": 90.0}, {"scale": 2.0}, {"z_down": True}])
def test_each_of_turn_scale_and_depth_counts(changed):
    point = Placement(1.0, 2.0, z=3.0, **changed).point([4.0, 5.0, 6.0])
    wanted = {"rotate": [-4.0, 6.0, 9.0], "scale": [9.0, 12.0, 15.0], "z_down": [5.0, 7.0, -3.0]}
    assert point.tolist() == wanted[next(iter(changed))]


@given(st.tuples(numbers, numbers, numbers), st.tuples(numbers, numbers, numbers), st.sampled_from([0.0, 33.0]))
@examples(100)
def test_a_single_point_lies_where_an_array_of_it_does(point, shift, rotate):
    x, y, z = shift
    placement = Placement(x, y, rotate, z=z)
    placed = placement.place(point)
    assert placed == tuple(placement.point(point).tolist())
    assert not any(np.signbit(number) for number in placed if number == 0) or rotate
    assert placement.direct(point) == tuple(placement.direction(point).tolist())
