"""Where a program lies on the work, against turns that change nothing."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gantrysim import InputError, Job
from gantrysim.controllers.placement import Placement
from gantrysim.job.programs import build

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


LEVEL = "G21 G90\nF1800\nG1 X10\nG1 Y10\nM2\n"


@pytest.mark.parametrize(
    ("controller", "argument"), [("linuxcnc.Program", "text"), ("slicer.Program", "text"), ("fanuc.Program", "program")]
)
def test_a_level_program_at_another_height_commands_z(controller, argument):
    """The path lies there, and the nozzle with it: an error of the height would count as one of the path."""
    text = LEVEL if argument == "text" else f"O1\n{LEVEL.replace('M2', 'M30')}"
    low, high = (build(controller, {argument: text, "placement": {"z": z}}) for z in (0.0, 1.5))
    assert (low.axes, high.axes) == (("x", "y"), ("x", "y", "z"))
    assert set(high.setpoints(0.001).position[:, 2]) == {1.5}


def test_a_program_without_z_is_refused_at_another_height_than_the_nozzle_s():
    program = {"controller": "trio.Basic", "text": "BASE(0,1): SPEED=10\nMOVE(10,0): WAIT IDLE\n"}
    content = {"name": "level", "machine": "xy", "program": {**program, "placement": {"z": 1.5}}}
    with pytest.raises(InputError, match=r"its path lies at z = 1.5 mm, but it commands no z, .* add -1.5 to program"):
        Job.of_content(content, "job level").plan()
