"""Machines with one imperfection removed: that one, and nothing else."""

import math

import mujoco
import numpy as np
import pytest

from gantrysim import Machine, simulate
from gantrysim.base.errors import InputError
from gantrysim.machine.ideal import without_compliance, without_friction, without_winding
from gantrysim.machine.machine import builtin_models
from gantrysim.machine.perturbation import Perturbation

from support.runs import PERIOD, ideal_motors, plain, ramp

EXACT = 1e-12  # relative, of masses and inertias
MOTION = 1e-6  # relative, of a motion in closed form
RIGID_LINK = 1e-9  # [mm]

ALL = (without_friction, without_winding, without_compliance)


def rewritten(machine, tmp_path, *replacements):
    """A machine from the text of another's file with words replaced; each must be there."""
    text = machine.source.read_text().replace('"parts/', f'"{machine.source.parent}/parts/')
    for old, new in replacements:
        assert old in text
        text = text.replace(old, new)
    file = tmp_path / "rewritten.xml"
    file.write_text(text)
    return Machine(file)


def test_a_machine_without_the_imperfection_is_returned_as_it_is(rigid, xy):
    ideal = rigid(inductance=0.0)
    torque_sources = Machine(ideal_motors(rigid(inductance=0.0).source))
    for remove in ALL:
        assert remove(ideal) is ideal
        assert remove(torque_sources) is torque_sources
        once = remove(xy)
        assert once is not xy
        assert once.digest != xy.digest
        assert remove(once) is once


def test_an_edit_that_changes_nothing_changes_no_bit(xy):
    same = xy.edited(lambda spec: None)
    assert same.digest == xy.digest
    assert (same.axes, same.addresses, same.name, same.source) == (xy.axes, xy.addresses, xy.name, xy.source)
    assert same.spec is not xy.spec


@pytest.mark.parametrize("remove", ALL)
def test_perturbations_are_kept(xy, remove):
    machine = remove(xy.perturbed(Perturbation(payload=0.5, motor_constant=(1.1, 1.2))))
    assert machine.physics.body("carriage").mass == pytest.approx(1.5, rel=EXACT)
    assert machine.drive_gain == pytest.approx([1.1, 1.2], rel=EXACT)
    assert machine.digest == remove(xy).perturbed(Perturbation(payload=0.5, motor_constant=(1.1, 1.2))).digest


@pytest.mark.validates(
    "inertia of every axis without compliance",
    "masses and rotor",
    "1e-9 relative",
)
@pytest.mark.parametrize("name", builtin_models())
def test_without_compliance_every_axis_moves_the_same_inertia(name):
    machine = Machine(name)
    rigid = without_compliance(machine)
    assert [mujoco.mj_id2name(rigid.physics, mujoco.mjtObj.mjOBJ_JOINT, j) for j in range(rigid.physics.njnt)] == [
        joint.name for joint in machine.spec.joints if not joint.name.endswith("_flex")
    ]
    assert rigid.physics.nv == len(machine.axes) + len(machine.kinematics.followers) < machine.physics.nv
    assert rigid.physics.body_mass.tolist() == machine.physics.body_mass.tolist()
    assert [axis.inertia for axis in rigid.axes] == pytest.approx([axis.inertia for axis in machine.axes], rel=EXACT)
    # of slides: the mass behind the joint and the rotor's inertia, referred to the axis
    for i, axis in enumerate(rigid.axes):
        if axis.unit == "mm":
            joint = rigid.physics.joint(axis.name)
            gear = rigid.physics.actuator_gear[i, 0]
            mass = rigid.physics.body_subtreemass[joint.bodyid[0]] + rigid.physics.actuator_armature[i] * gear**2
            assert axis.inertia == pytest.approx(mass / gear / 1e3, rel=1e-9)


def test_without_compliance_the_nozzle_is_that_of_a_rigid_machine(xyz):
    rigid = without_compliance(xyz)
    run = simulate(rigid, plain(rigid), ramp(200.0))
    assert np.abs(run.nozzle - run.motor_tip).max() < RIGID_LINK
    soft = simulate(xyz, plain(xyz), ramp(200.0))
    assert np.abs(soft.nozzle - soft.motor_tip).max() > 1e3 * RIGID_LINK


def test_without_friction_a_steady_motion_takes_the_viscous_torque(xy):
    speed = 100.0
    torques = [simulate(machine, plain(xy), ramp(speed)).torque[-1, 0] for machine in (without_friction(xy), xy)]
    viscous = xy.axes[0].viscous * speed
    assert torques[0] == pytest.approx(viscous, rel=MOTION)
    assert torques[1] == pytest.approx(viscous + xy.axes[0].coulomb, rel=1e-2)


def test_without_friction_frictionloss_is_gone_and_cogging_stays(rigid, tmp_path):
    lossy = ('name="x" axis="1 0 0"', 'name="x" axis="1 0 0" frictionloss="5"')
    machine = rewritten(rigid(), tmp_path, lossy, ("<dcmotor gear", '<dcmotor cogging="0.01 8 0" gear'))
    smooth = without_friction(machine)
    assert machine.physics.dof_frictionloss.max() == 5
    assert not smooth.physics.dof_frictionloss.any()
    assert smooth.physics.actuator_biasprm.tolist() == machine.physics.actuator_biasprm.tolist()
    assert smooth.physics.actuator_biasprm[0, 0] == 0.01


def steady(torque):
    """A law that demands a torque of the first of two axes."""
    return lambda tick: np.array([torque, 0.0])


def test_without_winding_the_torque_is_there_at_once(rigid):
    """A step of torque accelerates a mass at once, v = a t; behind a winding, v = a (t - tau (1 - exp(-t / tau)))."""
    torque, step = 0.02, 2.5e-5
    machine = rigid(damping=0.0)
    servo = plain(machine)
    acceleration = torque / machine.axes[0].inertia  # [mm/s²]
    t, tau = np.arange(141) * PERIOD, machine.axes[0].lag
    assert tau == pytest.approx(1e-3)
    direct, lagging = (
        simulate(one, servo, ramp(1000.0), physics_step=step, law=steady(torque))
        for one in (without_winding(machine), machine)
    )
    way = direct.motor[:, 0] - direct.motor[0, 0]
    exact = acceleration * (0.5 * t**2 + 0.5 * step * t)  # of semi-implicit Euler
    assert way == pytest.approx(exact, rel=MOTION, abs=1e-9)
    assert direct.current[:, 0] == pytest.approx(np.full(141, torque / 0.03), rel=MOTION)
    behind = way - (lagging.motor[:, 0] - lagging.motor[0, 0])
    expected = acceleration * (tau * t - tau**2 * (1 - np.exp(-t / tau)))
    assert behind == pytest.approx(expected, rel=2 * step / tau, abs=acceleration * tau * step)
    assert lagging.current[1, 0] == pytest.approx(torque / 0.03 * (1 - math.exp(-1)), rel=0.05)


def test_without_winding_the_bus_voltage_still_limits_the_torque(rigid):
    """At a speed w the torque is at most K (V - K w) / R, which the run must not exceed and does reach."""
    machine = without_winding(rigid(damping=0.0, voltage=6.0))
    axis = machine.axes[0]
    run = simulate(machine, plain(machine), ramp(100.0), physics_step=2.5e-5, law=steady(axis.peak_torque))
    free = slice(1, int(np.argmax(run.motor[:, 0] > 140)) - 1)  # before the end of the travel
    speed = np.gradient(run.motor[:, 0], PERIOD)[free] / axis.scale
    bound = 0.03 * (6.0 - 0.03 * speed) / 0.3
    assert run.torque[free, 0] == pytest.approx(bound, rel=0.02, abs=1e-3)
    assert bound[-1] < 0.1 * run.torque[0, 0] == pytest.approx(0.1 * axis.peak_torque)
    # it is the torque that moves the axis
    assert np.gradient(axis.scale * speed, PERIOD)[1:-1] == pytest.approx(bound[1:-1] / axis.inertia, rel=0.02, abs=20)


def test_keyframes_do_not_stand_in_the_way(xy, tmp_path):
    machine = rewritten(xy, tmp_path, ('<key name="home"/>', '<key name="home" qpos="0 0 0 0" act="0 0 0 0"/>'))
    assert machine.physics.nkey == 1
    for remove in ALL:
        assert remove(machine).physics.nkey == 0


SENSED = """
<mujoco>
  <size nuser_jnt="1" nuser_sensor="1"/>
  <worldbody>
    <body name="work"/>
    <body name="slide">
      <joint name="x" type="slide" axis="1 0 0"/>
      <geom size="0.01" mass="1"/>
      <body name="head">
        <joint name="give" type="slide" axis="1 0 0" stiffness="1e6" damping="10"/>
        <geom size="0.01" mass="1"/>
        <site name="nozzle"/>
      </body>
    </body>
  </worldbody>
  <actuator><motor name="x" joint="x" gear="600" ctrlrange="-1 1"/></actuator>
  <sensor><jointpos name="deflection" joint="give"/></sensor>
</mujoco>
"""


def test_a_spring_that_is_referred_to_cannot_be_removed(tmp_path):
    file = tmp_path / "sensed.xml"
    file.write_text(SENSED)
    with pytest.raises(InputError, match=r"sensed.xml, edited: .*'give'"):
        without_compliance(Machine(file))
