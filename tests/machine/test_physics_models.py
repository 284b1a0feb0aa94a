"""Models of a perturbed machine are those of copies made at once, in whatever order they are asked for."""

import threading
from concurrent.futures import ThreadPoolExecutor

import mujoco
import numpy as np
import pytest

from gantrysim import Machine
from gantrysim.machine.compiling import digest_of
from gantrysim.machine.machine import builtin_models
from gantrysim.machine.motors import set_for_steps
from gantrysim.machine.perturbation import Perturbation, perturbed_model

from support.soaked import number_of_examples

CHANGED = Perturbation(payload=0.3, friction=1.4, viscous=0.8, stiffness=0.7, motor_constant=1.1, home_offset=0.02)
STEP = 1.25e-4  # [s]


def expected(machine):
    """Digests of the physics and of a model that is stepped, each a copy of the nominal model that is changed."""
    physics = perturbed_model(machine.physics, CHANGED, machine.plain_axes, machine.nozzle, machine.work)
    stepped = perturbed_model(machine.physics, CHANGED, machine.plain_axes, machine.nozzle, machine.work)
    set_for_steps(stepped, STEP, False, False)
    return digest_of(physics), digest_of(stepped)


LIMITED = """
<mujoco>
  <worldbody>
    <body>
      <joint name="x" type="slide" axis="1 0 0"/><joint name="y" type="slide" axis="0 1 0"/>
      <geom size="0.1"/>
    </body>
  </worldbody>
  <actuator>
    <dcmotor name="x" joint="x" motorconst="0.03 0.03" resistance="0.3" ctrllimited="true" ctrlrange="-5 5"/>
    <motor name="y" joint="y" ctrllimited="true" ctrlrange="-1 1"/>
  </actuator>
  <sensor><jointpos joint="x"/></sensor>
</mujoco>
"""


@pytest.mark.parametrize("stops", [False, True])
@pytest.mark.parametrize("voltage", [False, True])
def test_steps_sense_nothing_and_have_the_limits_and_stops_that_are_wanted(voltage, stops):
    """A current loop may ask more than a dcmotor's range of control; a motor's torque stays within its own."""
    model = mujoco.MjModel.from_xml_string(LIMITED)
    set_for_steps(model, STEP, voltage, stops)
    assert model.opt.timestep == STEP
    assert model.actuator_ctrllimited.tolist() == [not voltage, True]
    bits = mujoco.mjtDisableBit
    assert model.opt.disableflags == bits.mjDSBL_SENSOR | (0 if stops else bits.mjDSBL_CONSTRAINT)


@pytest.mark.parametrize("name", builtin_models())
def test_the_physics_and_the_stepped_model_do_not_depend_on_which_is_asked_for_first(name):
    machine = Machine(name)
    nominal = digest_of(machine.physics)
    first = machine.perturbed(CHANGED)
    physics = first.physics
    stepped = first.stepping(STEP, False, False)
    assert (digest_of(physics), digest_of(stepped)) == expected(machine)
    other = machine.perturbed(CHANGED)
    stepped = other.stepping(STEP, False, False)
    assert (digest_of(other.physics), digest_of(stepped)) == expected(machine)
    assert other.physics is other.physics
    assert other.stepping(STEP, False, False) is stepped
    assert digest_of(machine.physics) == nominal


def test_references_with_home_offsets_are_those_of_the_physics():
    machine = Machine("xyz").perturbed(Perturbation(home_offset=(0.1, -0.2, 0.3)))
    before = machine.to_qpos([1.0, 2.0, 3.0])
    assert np.array_equal(machine.layout.qpos0, Machine("xyz").physics.qpos0)  # the physics is not made yet
    reference = machine.physics.qpos0
    assert not np.array_equal(machine.layout.qpos0, Machine("xyz").physics.qpos0)
    assert np.array_equal(machine.to_qpos([1.0, 2.0, 3.0]), before)
    driven = machine.physics.jnt_qposadr[machine.physics.actuator_trnid[:, 0]]
    assert before[driven] == pytest.approx([1e-3, 2e-3, 3e-3])
    others = np.setdiff1d(np.arange(machine.physics.nq), driven)
    assert np.array_equal(before[others], reference[others])


def test_a_change_of_the_physics_is_stepped():
    machine = Machine("xy").perturbed(CHANGED)
    before = machine.stepping(STEP)
    machine.physics.jnt_limited[:] = 0
    assert before.jnt_limited.any()
    assert not machine.stepping(STEP / 2).jnt_limited.any()


def test_threads_that_ask_at_once_get_models_of_their_own():
    machine = Machine("xy")
    steps = [STEP / k for k in range(1, 9)]
    for _ in range(number_of_examples(20)):
        perturbed = machine.perturbed(CHANGED)
        together = threading.Barrier(len(steps))

        def stepped(step, perturbed=perturbed, together=together):
            together.wait()
            return perturbed.stepping(step, False, False)

        with ThreadPoolExecutor(len(steps)) as threads:
            models = list(threads.map(stepped, steps))
        assert len({id(model) for model in models}) == len(steps)
        assert [model.opt.timestep for model in models] == steps
        for model, step in zip(models, steps, strict=True):
            alone = perturbed_model(machine.physics, CHANGED, machine.plain_axes, machine.nozzle, machine.work)
            set_for_steps(alone, step, False, False)
            assert digest_of(model) == digest_of(alone)
