"""Forward kinematics against MuJoCo and plane geometry."""

import math

import mujoco
import numpy as np
import pytest

from gantrysim import Machine
from gantrysim.machine.machine import builtin_models

from support.runs import turntable

SAME = 1e-9  # [mm]

# bodies of any orientation; joints off their bodies' origins, with references, several per body, some not driven;
# nozzle and work on chains of hinges and slides from a common body that also moves
NASTY = """
<mujoco>
  <compiler angle="degree" autolimits="true"/>
  <default>
    <motor gear="20" ctrlrange="-1 1"/>
  </default>
  <worldbody>
    <body name="base" pos="0.3 -0.2 0.7" euler="20 -30 70">
      <joint name="u" type="hinge" axis="1 2 3" pos="0.1 0.2 -0.3" range="-50 90" user="3"/>
      <geom size="0.1"/>
      <body pos="0.1 0.05 -0.2" euler="-40 10 110">
        <joint name="a" type="slide" axis="1 -1 0.5" ref="0.05"/>
        <joint name="b" type="hinge" axis="0 1 1" pos="-0.2 0.07 0.02" ref="25"/>
        <joint type="slide" axis="0 0 1" stiffness="1e5"/>
        <geom size="0.1"/>
        <body name="work" pos="0.02 0.3 0.1" quat="0.3 -0.2 0.8 0.5">
          <joint name="c" type="slide" axis="0 1 0"/>
          <geom size="0.1"/>
        </body>
      </body>
      <body pos="-0.2 0.1 0.4" euler="5 15 -60">
        <joint name="d" type="slide" axis="-1 0 2"/>
        <joint name="e" type="slide" axis="0 3 1"/>
        <geom size="0.1"/>
        <body euler="90 0 0">
          <joint type="ball"/>
          <geom size="0.1" pos="0 0 0.01"/>
          <body pos="0.4 -0.1 0.2">
            <joint name="f" type="hinge" axis="-2 1 1" pos="0.05 0 0.3"/>
            <geom size="0.1"/>
            <site name="nozzle" pos="0.01 0.15 -0.35"/>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor name="f" joint="f"/>
    <motor name="a" joint="a"/>
    <motor name="d" joint="d"/>
    <motor name="b" joint="b"/>
    <motor name="u" joint="u"/>
    <motor name="c" joint="c"/>
  </actuator>
</mujoco>
"""


@pytest.fixture
def nasty(tmp_path):
    file = tmp_path / "nasty.xml"
    file.write_text(NASTY)
    return Machine(file)


def tip_by_mujoco(machine, position):
    data = mujoco.MjData(machine.model)
    tips = []
    for row in position:
        data.qpos[:] = machine.to_qpos(row)
        mujoco.mj_kinematics(machine.model, data)
        frame = data.xmat[machine.work].reshape(3, 3)
        tips.append(1e3 * frame.T @ (data.site_xpos[machine.nozzle] - data.xpos[machine.work]))
    return np.array(tips)


@pytest.mark.parametrize("name", builtin_models())
def test_tip_agrees_with_mujoco_on_every_machine(name):
    machine = Machine(name)
    low, high = np.clip(np.transpose([axis.travel for axis in machine.axes]), -1e3, 1e3)
    position = np.random.default_rng(3).uniform(low, high, (100, len(machine.axes)))
    np.testing.assert_allclose(machine.tip(position), tip_by_mujoco(machine, position), rtol=0, atol=SAME)


@pytest.mark.validates(
    "nozzle in the work frame, any chain of slides and hinges",
    "MuJoCo",
    "1e-9 mm",
)
def test_tip_agrees_with_mujoco_on_a_chain_of_everything(nasty):
    assert [axis.unit for axis in nasty.axes] == ["deg", "mm", "mm", "deg", "deg", "mm"]
    position = np.random.default_rng(4).uniform(-300, 300, (200, 6))
    tip = nasty.tip(position)
    np.testing.assert_allclose(tip, tip_by_mujoco(nasty, position), rtol=0, atol=SAME)
    assert np.ptp(tip, axis=0).min() > 100
    np.testing.assert_allclose(nasty.tip(position[7]), tip[7], rtol=1e-14)  # BLAS sums one row in an order of its own
    # a joint that moves nozzle and work alike does not change their relative position
    position[:, nasty.axis_names.index("u")] += 33.0
    np.testing.assert_allclose(nasty.tip(position), tip, rtol=0, atol=SAME)


def test_a_turning_work_moves_the_nozzle_in_its_frame_by_plane_geometry(tmp_path):
    machine = turntable(tmp_path)
    th, x = np.random.default_rng(5).uniform(-400, 400, (2, 50))
    a = np.radians(th)
    # the nozzle at (200, 0) over the table, whose slide carries the work along the table's own x
    expected = np.stack([200 * np.cos(a) - x, -200 * np.sin(a), 0 * a], axis=1)
    np.testing.assert_allclose(machine.tip(np.stack([th, x], axis=1)), expected, rtol=0, atol=SAME)


def test_a_rotary_axis_is_in_degrees(tmp_path):
    th, x = turntable(tmp_path).axes
    assert (th.unit, x.unit) == ("deg", "mm")
    assert th.travel == pytest.approx((-400.0, 400.0))
    assert x.travel == (-400.0, 400.0)
    assert th.declared_speed == pytest.approx(360.0)
    assert th.scale == pytest.approx(math.degrees(1 / 36))
    assert th.resolution == pytest.approx(360 / (36 * 10_000))
    # a disc of 2 kg and the slide's body, a ball of 1 kg, through the gear
    inertia = 0.5 * 2 * 0.1**2 + 0.4 * 1 * 0.01**2
    assert th.inertia == pytest.approx(math.radians(inertia) / 36, rel=1e-9)
    assert th.viscous == pytest.approx(math.radians(0.5) / 36, rel=1e-12)


def test_to_qpos_is_si_and_leaves_the_rest_at_its_reference(nasty):
    qpos = nasty.to_qpos([180.0, 250.0, 0.0, -90.0, 0.0, 0.0])
    joint = {name: int(nasty.model.joint(name).qposadr[0]) for name in "abcdef"}
    assert qpos[joint["f"]] == pytest.approx(math.pi)
    assert qpos[joint["a"]] == pytest.approx(0.25)
    assert qpos[joint["b"]] == pytest.approx(-0.5 * math.pi)
    assert qpos[joint["e"]] == 0.0
