"""Perturbed machines for the compiled loop, summed from a few readings, are those that are read off MuJoCo's steps."""

from dataclasses import fields

import mujoco
import numpy as np
import pytest

from gantrysim import Machine
from gantrysim.engine.linear import linear_machine
from gantrysim.engine.perturbed_linear import _MULTIPLIED, family_of, linear_of
from gantrysim.machine.motors import springs_have_axes
from gantrysim.machine.perturbation import Perturbation
from gantrysim.machine.tolerances import Tolerances

STEP = 1.25e-4  # [s]
WIDE = Tolerances(payload=4.0, friction=1.0, viscous=2.0, stiffness=1.0, motor_constant=0.5)


def read(machine, voltage=False):
    return linear_machine(machine, machine.stepping(STEP, voltage, stops=False))


def assert_same(linear, other, rounding=1e-13):
    np.testing.assert_array_equal(linear.slots, other.slots)
    for name in linear.plant.dtype.names:
        value, wanted = linear.plant[name].astype(float), other.plant[name].astype(float)
        largest = np.abs(wanted[np.isfinite(wanted)]).max()
        np.testing.assert_allclose(value, wanted, rtol=0, atol=rounding * largest, err_msg=name)


@pytest.mark.parametrize("voltage", [False, True])
@pytest.mark.parametrize("name", ["xy", "xyz"])
def test_random_machines_are_those_that_are_read(name, voltage):
    """A second perturbation, as of a payload that changes in an episode, is added to the first."""
    machine = Machine(name)
    random = np.random.default_rng(3)
    for _ in range(10):
        once = machine.perturbed(WIDE.draw(random, machine))
        twice = once.perturbed(WIDE.draw(random, machine))
        for each in (once, twice):
            assert_same(linear_of(each, STEP, voltage), read(each, voltage))


def test_every_value_of_a_perturbation_is_in_the_sums_or_is_read():
    """A new one needs its effect in `gantrysim.engine.perturbed_linear`, and its range in `WIDE`."""
    in_sums = {"payload", "viscous", "stiffness"}
    of_motors = set(_MULTIPLIED)
    without_effect_on_the_step = {"geometry"}
    read = {"home_offset"}
    names = {field.name for field in fields(Perturbation)}
    assert names == in_sums | of_motors | without_effect_on_the_step | read
    assert in_sums | of_motors == {field.name for field in fields(Tolerances)}


def test_a_machine_with_a_moved_home_is_read():
    machine = Machine("xy").perturbed(Perturbation(home_offset={"x": 0.1}, payload=0.3))
    assert_same(linear_of(machine, STEP, False), read(machine), rounding=0)


def test_viscous_friction_that_grows_faster_than_speed_is_not_linear(tmp_path):
    spec = mujoco.MjSpec.from_file(str(Machine("xy").source))
    spec.joint("x").damping[1] = 3.0
    file = tmp_path / "machine.xml"
    file.write_text(spec.to_xml(), encoding="utf-8")
    machine = Machine(file)
    assert family_of(machine, STEP, False) is None
    assert linear_of(machine.perturbed(Perturbation(viscous=1.2)), STEP, False) is None


def test_springs_that_no_axis_carries_alone_take_one_factor(tmp_path):
    """As a machine on soft feet: x and y stand on the spring, so neither has a factor of its own."""
    spec = mujoco.MjSpec.from_file(str(Machine("xy").source))
    frame = spec.body("frame")
    frame.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.1, 0, 0], mass=30.0, contype=0, conaffinity=0)
    frame.add_joint(name="feet", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0, 1, 0], stiffness=2e6, damping=[500.0, 0, 0])
    file = tmp_path / "machine.xml"
    file.write_text(spec.to_xml(), encoding="utf-8")
    machine = Machine(file)
    perturbed = machine.perturbed(Perturbation(stiffness=1.4, viscous=(0.7, 1.2), payload=1.1))
    assert not springs_have_axes(machine.layout)
    assert family_of(machine, STEP, False) is not None
    assert_same(linear_of(perturbed, STEP, False), read(perturbed))
