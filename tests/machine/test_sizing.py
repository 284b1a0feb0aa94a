"""What a machine's drives can do, against the documented machines and hand calculation."""

import dataclasses
import math
import re

import numpy as np
import pytest

from gantrysim import Job, Machine, simulate
from gantrysim.machine.sizing import Sizing, _frequency

from support.runs import plain, ramp
from support.tables import EXAMPLES, SCREW
from support.tables import ideal as table_of

DAMPED = table_of(SCREW.replace("damping_ratio = 0", "damping_ratio = 0.05"))


def built(tmp_path, text):
    file = tmp_path / "machine.toml"
    file.write_text(text)
    return Machine(file)


def test_a_built_in_machine_has_the_modes_and_forces_of_its_page():
    """models/README.md: motor locked 576 and 268 Hz, free 604 and 324 Hz, 569 N, 12.6 m/s."""
    sizing = Sizing.of(Machine("xy"))
    assert [(round(one.frequency), one.joint) for one in sizing.locked] == [(268, "y_flex"), (576, "x_flex")]
    assert [round(one.frequency) for one in sizing.free] == [324, 604]
    for one, load in zip(sizing.axes, (1.15, 4.95), strict=True):
        assert one.peak_force == pytest.approx(569, abs=0.5)
        assert math.isnan(one.continuous_force)  # the MJCF does not say
        assert one.gain_margin > 2
        armature = {"x": 2.47e-5, "y": 2.55e-5}[one.axis.name]
        assert one.inertia_ratio == pytest.approx(load / 628.3185**2 / armature, rel=1e-5)
    assert sizing.findings == ()


@pytest.mark.parametrize(
    ("changed", "finding"),
    [
        ({"torque_at_speed": 0.1, "friction_at_speed": 0.1}, ""),
        (
            {"torque_at_speed": 0.1, "friction_at_speed": 0.11},
            "N·m, friction takes 0.11 N·m: lower the speed limit or raise the voltage",
        ),
        ({"inertia_ratio": 10.0}, ""),
        ({"inertia_ratio": 10.1}, "inertia ratio 10.1, above 10 the load leads the motor: more reduction"),
        ({"gain_margin": 1.99}, ""),
        ({"gain_margin": 1.9}, "gain margin 1.9, below 2: a shorter servo period or stiffer drive"),
        ({"rms": 0.5, "continuous_torque": 0.5}, ""),
        ({"rms": 0.6, "continuous_torque": 0.5}, "rms torque 0.6 N·m is 1.20 times the continuous torque"),
        ({"resolution": 0.01}, ""),
        ({"resolution": 0.0101}, "an encoder count is 10.1 µm: an encoder with more counts, or more reduction"),
    ],
)
def test_each_value_beyond_its_bound_is_one_finding(changed, finding):
    one = Sizing.of(Machine("xy")).axes[0]
    if "resolution" in changed:
        changed = {"axis": dataclasses.replace(one.axis, **changed)}
    found = dataclasses.replace(one, **changed).findings()
    assert len(found) == bool(finding)
    assert all(line.startswith("x: ") and finding in line for line in found)


def test_modes_of_a_closed_chain_are_those_of_its_constraints():
    """models/README.md: delta, locked 44 (two) and 79 Hz, free 64 and 92 Hz; r 412 and 534 Hz."""
    sizing = Sizing.of(Machine("delta"))
    assert [round(one.frequency) for one in sizing.locked] == [44, 44, 79, 412]
    free = [one.frequency for one in sizing.free]
    assert [round(one) for one in free[2:]] == [92, 534]
    # linearised from MuJoCo's accelerations, with soft rods, friction and back-EMF
    np.testing.assert_allclose(free, Machine("delta").motion().resonances()[[0, 1, 2, 6]], rtol=2e-3)


def test_values_of_a_table(tmp_path):
    """0.05 N·m/A, 0.5 ohm, 24 V, 20 A and 20 mm per turn, with an efficiency of 90 %."""
    one = Sizing.of(built(tmp_path, DAMPED.replace("diameter = 16", "diameter = 16\nefficiency = 0.9"))).axes[0]
    gear = 2 * math.pi / 0.02
    assert one.peak_force == pytest.approx(0.9 * 1.0 * gear)
    assert one.continuous_force == pytest.approx(0.9 * 0.2 * gear)
    screw = math.pi * 7850 * 0.6 * 0.016**4 / 32
    assert one.inertia_ratio == pytest.approx((screw + 1.25 / gear**2) / 2e-5, rel=1e-6)
    assert one.acceleration == pytest.approx(1e3 * 1.0 / (2e-5 + screw + 1.25 / gear**2) / gear, rel=1e-6)
    speed = min(9.0 * gear, 24 / 0.05)  # declared, and that of the bus
    assert one.torque_at_speed == pytest.approx(0.05 * (24 - 0.05 * speed) / 0.5, abs=1e-9)


def test_the_heat_of_a_run_is_that_of_friction_and_acceleration(tmp_path):
    """A ramp at constant speed takes viscous friction alone: 30 N·s/m at 0.1 m/s."""
    text = DAMPED.replace("speed = 9000", "speed = 9000\nguides = { viscous = 30.0 }")
    machine = built(tmp_path, text)
    run = simulate(machine, plain(machine), ramp(100.0))
    sizing = Sizing.of(machine, run=run)
    torque = 30 * 0.1 * 0.02 / (2 * math.pi)
    steady = np.mean(run.torque[len(run.torque) // 4 : 3 * len(run.torque) // 4, 0])  # it starts with a jerk
    assert steady == pytest.approx(torque, rel=0.02)
    assert sizing.axes[0].rms == pytest.approx(np.sqrt(np.mean(run.torque[:, 0] ** 2)))
    assert sizing.axes[0].load == pytest.approx(sizing.axes[0].rms / 0.2)
    assert sizing.axes[1].load < 1e-3


def test_the_rms_torque_of_a_job_is_that_of_its_motion():
    """Inertia, viscous and Coulomb friction of the commanded motion, differentiated here."""
    job = Job.load("an225", ["turns=1"], machine=str(EXAMPLES / "tandem.toml"))
    run = job.run()
    machine = job.built_machine
    at = machine.kinematics.inverse(run.commanded_tip[:, :2])[:, 0]
    period = job.servo.period
    speed = np.gradient(at, period)
    acceleration = np.gradient(np.convolve(speed, np.ones(9) / 9, "same"), period)
    axis = machine.axes[0]
    moving = np.abs(speed) > 1.0
    torque = axis.inertia * acceleration + axis.viscous * speed + axis.coulomb * np.sign(speed)
    expected = math.sqrt(np.mean(torque[moving] ** 2) * moving.mean())
    assert Sizing.of(machine, run=run).axes[0].rms == pytest.approx(expected, rel=0.1)


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        ("rotor_inertia = 2e-5", "rotor_inertia = 1e-6", "x: inertia ratio .*, above 10 .*: more reduction"),
        ("encoder = 10000", "encoder = 500", "x: an encoder count is 40 µm: an encoder with more counts"),
        ("speed = 9000", "speed = 9000\nguides = { viscous = 60.0 }", "x: at 1528 mm/s the bus leaves 0 N·m, friction"),
    ],
)
def test_what_does_not_suit_is_said_with_what_to_change(tmp_path, old, new, text):
    assert Sizing.of(built(tmp_path, DAMPED)).axes[1].findings() == ()
    found = Sizing.of(built(tmp_path, DAMPED.replace(old, new, 1))).axes[0].findings()
    assert any(re.match(text, one) for one in found), found


def test_a_job_that_is_too_much_for_its_motors_is_said(tmp_path):
    machine = built(tmp_path, DAMPED.replace("continuous_torque = 0.2", "continuous_torque = 0.001"))
    run = simulate(machine, plain(machine), ramp(100.0))
    (found,) = (one for one in Sizing.of(machine, run=run).findings if "overheats" in one)
    assert found.startswith("x: rms torque")


BY_HAND = """
<mujoco>
  <worldbody>
    <body name="work"><geom type="box" size=".2 .2 .005" pos="0 0 -.005" contype="0" conaffinity="0"/></body>
    <body name="bridge" pos="0 0 .1">
      <joint name="y" type="slide" axis="0 1 0" range="-.1 .1" user="0.5" damping="5" frictionloss="2"/>
      <geom type="box" size=".02 .02 .02" mass="3" contype="0" conaffinity="0"/>
      <body name="carriage">
        <joint name="x" type="slide" axis="1 0 0" range="-.1 .1" damping="5" frictionloss="2" armature="0.5"/>
        <geom type="box" size=".02 .02 .02" mass="1" contype="0" conaffinity="0"/>
        <body name="head">
          <joint name="z" type="slide" axis="0 0 1" range="-.1 .1" damping="5" frictionloss="1"/>
          <geom type="box" size=".02 .02 .02" mass="0.5" contype="0" conaffinity="0"/>
          <site name="nozzle" pos="0 0 -.1"/>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor name="x" joint="x" gear="10" ctrlrange="-10 10"/>
    <motor name="y" joint="y" gear="10" ctrlrange="-10 10"/>
    <motor name="z" joint="z" gear="10" ctrlrange="-{z} {z}"/>
  </actuator>
</mujoco>
"""


def test_a_machine_written_by_hand_is_sized_with_friction_weight_and_armature_of_its_joints(tmp_path):
    """Forces of 100 N at gear 10 1/m, less friction and m g, on the masses that each axis moves."""
    file = tmp_path / "hand.xml"
    file.write_text(BY_HAND.format(z=10))
    sizing = Sizing.of(Machine(file))
    x, y, z = sizing.axes
    assert x.acceleration == pytest.approx(1e3 * (100 - 2) / (1.5 + 0.5))
    assert y.acceleration == pytest.approx(1e3 * (100 - 2) / 4.5)
    assert z.acceleration == pytest.approx(1e3 * (100 - 1 - 0.5 * 9.81) / 0.5)
    # 500 mm/s, declared: dry and viscous friction of the joint, at the motor
    assert y.friction_at_speed == pytest.approx((2 + 5 * 0.5) / 10)
    # not stated
    assert math.isnan(x.friction_at_speed)
    # 1.5 kg on an armature of 0.5 kg
    assert x.inertia_ratio == pytest.approx(3.0)
    assert math.isnan(y.inertia_ratio)
    assert sizing.findings == ()


def test_a_motor_that_does_not_hold_its_weight_is_said(tmp_path):
    """0.5 N·m at gear 10 1/m are 5 N: weight and friction take 5.9 N."""
    file = tmp_path / "hand.xml"
    file.write_text(BY_HAND.format(z=0.5))
    sizing = Sizing.of(Machine(file))
    assert sizing.axes[2].acceleration == pytest.approx(1e3 * (5 - 1 - 0.5 * 9.81) / 0.5)
    (finding,) = sizing.findings
    assert finding.startswith("z: the peak torque 0.5 N·m does not move it: friction and weight take as much")


def test_the_frequency_of_a_drive_s_loop_is_that_of_its_stiffness():
    """A velocity demand of kp x decays as exp(-kp t); a stepper's field holds p T sin(p phi)."""
    sizing = Sizing.of(Machine(EXAMPLES / "stepper.toml"))
    x = sizing.axes[0]
    held = x.axis.phases.pole_pairs * x.axis.peak_torque / x.axis.scale
    assert x.frequency == pytest.approx(math.sqrt(held / x.axis.inertia) / (2 * math.pi))
    assert _frequency(x.axis, "velocity", 100.0) == pytest.approx(100 / (2 * math.pi))
    assert _frequency(x.axis, "torque", 2.0) == pytest.approx(math.sqrt(2.0 / x.axis.inertia) / (2 * math.pi))
